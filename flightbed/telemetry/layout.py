"""The layout of the viewer: one blueprint for recordings, live flights and comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import rerun.blueprint as rrb

from flightbed.telemetry.channels import AIRFRAME, ESTIMATORS, OVERVIEW, Plot

TIMELINE = "time"
TABS = (OVERVIEW, ESTIMATORS, AIRFRAME)
_DARK = [18, 22, 30]
_FLOWN = rrb.VisibleTimeRange(
    TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
)


def flight(plots: Sequence[Plot], *, live: bool = False, tab: int = 0) -> rrb.Blueprint:
    """Return the layout of one flight.

    Args:
        plots: what there is to plot.
        live: follow what comes in, instead of standing at the start.
        tab: index of the page that is open.

    """
    views = {plot.key: _plot(plot) for plot in plots}

    def of(tab: str, estimator: int | None = None) -> list[Any]:
        return [views[p.key] for p in plots if p.tab == tab and p.estimator == estimator]

    words = rrb.Tabs(
        rrb.TextDocumentView(name="Run card", origin="/run_card"), rrb.TextLogView(name="Events", origin="/events")
    )
    mode = rrb.StateTimelineView(name="Modes", origin="/mode", time_view=rrb.TimeAxis(link="LinkToGlobal"))
    overview = rrb.Horizontal(
        rrb.Vertical(_chase("/world/cg", ["/world/trail"]), mode, words, row_shares=[4.2, 2.6, 3.8]),
        rrb.Vertical(*of(OVERVIEW), row_shares=[5, 5, 4, 3]),
        column_shares=[2, 3],
        name=OVERVIEW,
    )
    pages: list[Any] = [overview]
    indices = sorted({p.estimator for p in plots if p.estimator is not None})
    if each := [rrb.Vertical(*of(ESTIMATORS, index), name=_title(plots, index)) for index in indices]:
        estimators = rrb.Horizontal(*each) if len(each) < 4 else rrb.Tabs(*each)
        shared = rrb.Horizontal(*of(ESTIMATORS))
        pages.append(rrb.Vertical(estimators, shared, row_shares=[3, 1], name=ESTIMATORS))
    elif of(ESTIMATORS):
        pages.append(rrb.Vertical(*of(ESTIMATORS), name=ESTIMATORS))
    airframe = of(AIRFRAME)
    rows = [rrb.Horizontal(*airframe[i : i + 2]) for i in range(0, len(airframe), 2)]
    pages.append(rrb.Vertical(*rows, name=AIRFRAME))
    return _blueprint(rrb.Tabs(*pages, active_tab=min(tab, len(pages) - 1)), live=live)


def comparison(plots: Sequence[Plot], *, follow: str, trails: Sequence[str]) -> rrb.Blueprint:
    """Return the layout of several flights; ``follow`` is what the chase view keeps in its middle."""
    table = rrb.TextDocumentView(name="Metrics and differences", origin="/run_card")
    mode = rrb.StateTimelineView(name="Modes", origin="/mode", time_view=rrb.TimeAxis(link="LinkToGlobal"))

    def of(tab: str) -> list[Any]:
        # The colours are those of the runs in all plots: one legend, beside K's, which names the estimators, is enough.
        return [
            _plot(plot, legend=plot.key in ("pitch_rate", "effectiveness", "mach")) for plot in plots if plot.tab == tab
        ]

    overview = rrb.Horizontal(
        rrb.Vertical(
            _chase(follow, trails, far=True),
            mode,
            table,
            row_shares=[4, 2.2, 5],
        ),
        rrb.Vertical(*of(OVERVIEW)),
        column_shares=[1, 1],
        name=OVERVIEW,
    )
    airframe = rrb.Grid(*of(AIRFRAME), grid_columns=2, name=AIRFRAME)
    return _blueprint(rrb.Tabs(overview, airframe, active_tab=0), live=False)


def _title(plots: Sequence[Plot], index: int) -> str:
    return next(p.title.partition(":")[0] for p in plots if p.estimator == index)


def _plot(plot: Plot, *, legend: bool = True) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=plot.title,
        origin=f"/{plot.key}",
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=None if plot.range is None else rrb.ScalarAxis(range=plot.range),
        plot_legend=rrb.PlotLegend(
            rrb.Corner2D.LeftBottom if plot.key == "effectiveness" else rrb.Corner2D.RightTop, visible=legend
        ),
    )


def _chase(origin: str, trails: Sequence[str], *, far: bool = False) -> rrb.Spatial3DView:
    """Return the view that follows an aircraft; from far it is seen from behind, with those at its right."""
    position, target = ([-130, 80, -38], [0, 10, 0]) if far else ([-15, 11, -7], [0, 0, 0])
    return rrb.Spatial3DView(
        name="Chase view, m; stabilators: blue K = 1, red K = 0",
        origin=origin,
        contents="/world/**",
        background=_DARK,
        eye_controls=rrb.EyeControls3D(kind="Orbital", position=position, look_target=target, eye_up=[0, 0, -1]),
        line_grid=rrb.LineGrid3D(visible=False),
        # Of the trail all that has been flown so far; on the whole view it would take the meshes' colours away.
        overrides={trail: rrb.VisibleTimeRanges(_FLOWN) for trail in trails},
    )


def _blueprint(page: Any, *, live: bool) -> rrb.Blueprint:
    return rrb.Blueprint(
        page,
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following" if live else "paused"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
