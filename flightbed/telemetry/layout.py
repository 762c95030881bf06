"""Layouts (Rerun blueprints) of the viewer: a flight, recorded or live, and a comparison."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import rerun.blueprint as rrb

from flightbed.telemetry.channels import AIRFRAME, ESTIMATORS, OVERVIEW, ROLL_YAW, Plot

TIMELINE = "time"
TABS = (
    OVERVIEW,
    ESTIMATORS,
    AIRFRAME,
)  # pages of every flight with estimators; ROLL_YAW follows if aileron and rudder are commanded
_DARK = [18, 22, 30]
_PAST = rrb.VisibleTimeRange(
    TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
)


def flight(plots: Sequence[Plot], *, live: bool = False, tab: int = 0) -> rrb.Blueprint:
    """Return the layout of one flight.

    Args:
        plots: plots of the flight.
        live: whether the time cursor follows the incoming data; else it starts at the beginning.
        tab: index of the open page.

    """
    views = {plot.key: _plot(plot) for plot in plots}

    def of(tab: str, estimator: int | None = None) -> list[Any]:
        return [views[p.key] for p in plots if p.tab == tab and p.estimator == estimator]

    lateral = any(p.tab == ROLL_YAW for p in plots)
    texts = rrb.Tabs(
        rrb.TextDocumentView(name="Summary", origin="/run_card"), rrb.TextLogView(name="Events", origin="/events")
    )
    mode = rrb.StateTimelineView(name="Modes", origin="/mode", time_view=rrb.TimeAxis(link="LinkToGlobal"))
    overview = rrb.Horizontal(
        rrb.Vertical(
            _chase("/world/cg", ["/world/trail"], moving="surfaces" if lateral else "stabilators"),
            mode,
            texts,
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
    if lateral:
        pages.append(_roll_yaw_page([p for p in plots if p.tab == ROLL_YAW]))
    return _blueprint(rrb.Tabs(*pages, active_tab=min(tab, len(pages) - 1)), live=live)


def _roll_yaw_page(plots: Sequence[Plot], *, legend: Callable[[Plot], bool] = lambda _: True) -> rrb.Horizontal:
    """Return the page of roll and yaw: roll and aileron on the left, sideslip and rudder on the right."""
    views = [_plot(plot, legend=legend(plot)) for plot in plots]
    sideslip = next(i for i, plot in enumerate(plots) if plot.key == "sideslip")
    return rrb.Horizontal(rrb.Vertical(*views[:sideslip]), rrb.Vertical(*views[sideslip:]), name=ROLL_YAW)


def comparison(plots: Sequence[Plot], *, follow: str, trails: Sequence[str]) -> rrb.Blueprint:
    """Return the layout of several flights; the chase view follows the entity ``follow``."""
    table = rrb.TextDocumentView(name="Metrics and differences", origin="/run_card")
    mode = rrb.StateTimelineView(name="Modes", origin="/mode", time_view=rrb.TimeAxis(link="LinkToGlobal"))

    def legend(plot: Plot) -> bool:
        # All plots use the colours of the runs: one legend per page suffices; those of K also name the estimators.
        return plot.key in ("pitch_rate", "mach", "roll_rate") or plot.key.startswith("effectiveness")

    def of(tab: str) -> list[Any]:
        return [_plot(plot, legend=legend(plot)) for plot in plots if plot.tab == tab]

    roll_yaw = [plot for plot in plots if plot.tab == ROLL_YAW]
    overview = rrb.Horizontal(
        rrb.Vertical(
            _chase(follow, trails, moving="surfaces" if roll_yaw else "stabilators", far=True),
            mode,
            table,
            row_shares=[4, 2.2, 5],
        ),
        rrb.Vertical(*of(OVERVIEW)),
        column_shares=[1, 1],
        name=OVERVIEW,
    )
    airframe = rrb.Grid(*of(AIRFRAME), grid_columns=2, name=AIRFRAME)
    pages = [overview, airframe, *([_roll_yaw_page(roll_yaw, legend=legend)] if roll_yaw else [])]
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
    """Return the view that follows an aircraft; with ``far`` from a distance behind, with the aircraft to its right in view."""
    position, target = ([-130, 80, -38], [0, 10, 0]) if far else ([-15, 11, -7], [0, 0, 0])
    return rrb.Spatial3DView(
        name=f"Chase view, m; {moving}: blue K = 1, red K = 0",
        origin=origin,
        contents="/world/**",
        background=_DARK,
        eye_controls=rrb.EyeControls3D(kind="Orbital", position=position, look_target=target, eye_up=[0, 0, -1]),
        line_grid=rrb.LineGrid3D(visible=False),
        # The trail shows the past of the flight. The same range on the whole view would remove the colours of the meshes.
        overrides={trail: rrb.VisibleTimeRanges(_PAST) for trail in trails},
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
