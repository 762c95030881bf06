"""The layout of the viewer: one blueprint for recordings, live flights and comparisons."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import rerun.blueprint as rrb

from flightbed.telemetry.channels import AIRFRAME, ESTIMATORS, OVERVIEW, TURNING, Plot

TIMELINE = "time"
TABS = (
    OVERVIEW,
    ESTIMATORS,
    AIRFRAME,
)  # of every flight with estimators; TURNING comes last, where roll and yaw are flown
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

    turns = any(p.tab == TURNING for p in plots)
    words = rrb.Tabs(
        rrb.TextDocumentView(name="Run card", origin="/run_card"), rrb.TextLogView(name="Events", origin="/events")
    )
    mode = rrb.StateTimelineView(name="Modes", origin="/mode", time_view=rrb.TimeAxis(link="LinkToGlobal"))
    overview = rrb.Horizontal(
        rrb.Vertical(
            _chase("/world/cg", ["/world/trail"], moving="surfaces" if turns else "stabilators"),
            mode,
            words,
            row_shares=[4.2, 2.6, 3.8],
        ),
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
    if turns:
        pages.append(_turning([p for p in plots if p.tab == TURNING]))
    return _blueprint(rrb.Tabs(*pages, active_tab=min(tab, len(pages) - 1)), live=live)


def _turning(plots: Sequence[Plot], *, legend: Callable[[Plot], bool] = lambda _: True) -> rrb.Horizontal:
    """Return the page of roll and yaw: roll and aileron on the left, sideslip and rudder on the right."""
    views = [_plot(plot, legend=legend(plot)) for plot in plots]
    begins = next(i for i, plot in enumerate(plots) if plot.key == "sideslip")
    return rrb.Horizontal(rrb.Vertical(*views[:begins]), rrb.Vertical(*views[begins:]), name=TURNING)


def comparison(plots: Sequence[Plot], *, follow: str, trails: Sequence[str]) -> rrb.Blueprint:
    """Return the layout of several flights; ``follow`` is what the chase view keeps in its middle."""
    table = rrb.TextDocumentView(name="Metrics and differences", origin="/run_card")
    mode = rrb.StateTimelineView(name="Modes", origin="/mode", time_view=rrb.TimeAxis(link="LinkToGlobal"))

    def legend(plot: Plot) -> bool:
        # The colours are those of the runs in all plots: one legend, beside K's, which name the estimators, is enough.
        return plot.key in ("pitch_rate", "mach", "roll_rate") or plot.key.startswith("effectiveness")

    def of(tab: str) -> list[Any]:
        return [_plot(plot, legend=legend(plot)) for plot in plots if plot.tab == tab]

    turning = [plot for plot in plots if plot.tab == TURNING]
    overview = rrb.Horizontal(
        rrb.Vertical(
            _chase(follow, trails, moving="surfaces" if turning else "stabilators", far=True),
            mode,
            table,
            row_shares=[4, 2.2, 5],
        ),
        rrb.Vertical(*of(OVERVIEW)),
        column_shares=[1, 1],
        name=OVERVIEW,
    )
    airframe = rrb.Grid(*of(AIRFRAME), grid_columns=2, name=AIRFRAME)
    pages = [overview, airframe, *([_turning(turning, legend=legend)] if turning else [])]
    return _blueprint(rrb.Tabs(*pages, active_tab=0), live=False)


def _title(plots: Sequence[Plot], index: int) -> str:
    return next(p.title.partition(":")[0] for p in plots if p.estimator == index)


def _plot(plot: Plot, *, legend: bool = True) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=plot.title,
        origin=f"/{plot.key}",
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=None if plot.range is None else rrb.ScalarAxis(range=plot.range),
        plot_legend=rrb.PlotLegend(
            rrb.Corner2D.LeftBottom if plot.key.startswith("effectiveness") else rrb.Corner2D.RightTop, visible=legend
        ),
    )


def _chase(origin: str, trails: Sequence[str], *, moving: str = "stabilators", far: bool = False) -> rrb.Spatial3DView:
    """Return the view that follows an aircraft; from far it is seen from behind, with those at its right."""
    position, target = ([-130, 80, -38], [0, 10, 0]) if far else ([-15, 11, -7], [0, 0, 0])
    return rrb.Spatial3DView(
        name=f"Chase view, m; {moving}: blue K = 1, red K = 0",
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
