"""The figures of a flight: what it did against what it should, the elevator, K and how far to trust it; facts from what is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flightbed import drawing, palette
from flightbed.metrics import at_stop
from flightbed.units import DEG

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from flightbed.document import Picture
    from flightbed.mission import Result
    from flightbed.settings import Scenario

Vector = npt.NDArray[np.float64]

MARGIN = 0.72  # left of the axes of histories, inches
_NIS_SHOWN = 18.0  # three times the bound
NIS_BOUND = 5.991464547107979  # chi-square with 2 degrees of freedom, 95 %: -2 ln 0.05


@dataclass(frozen=True)
class Figure:
    """One figure.

    Attributes:
        title: what it shows.
        text: what the lines are, in words.
        rows: flight -> number of axes.
        draw: draws on them, returns computed facts in words.
        height: of each of the axes, inches.

    """

    title: str
    text: str
    rows: Callable[[Result], int]
    draw: Callable[[list[Axes], Result], str]
    height: float = 2.3


def pictures(result: Result, keys: tuple[str, ...] | None = None) -> list[Picture]:
    """Draw a flight.

    Args:
        result: the flight.
        keys: of ``FIGURES``, which; all that say something about the flight if None.

    """
    wanted = FIGURES if keys is None else {key: FIGURES[key] for key in keys}
    return [_picture(key, figure, result) for key, figure in wanted.items() if figure.rows(result)]


def _picture(key: str, figure: Figure, result: Result) -> Picture:
    from flightbed.document import Picture

    t = result.trace["t_s"]
    with drawing.canvas(figure.rows(result), height=figure.height, margin=MARGIN) as (axes, svg):
        facts = figure.draw(axes, result)
        for axis in axes:
            mark_changes(axis, result.plan.scenario, float(t[-1]), name=axis is axes[0])
            axis.set_xlim(0.0, max(float(t[-1]), 1e-3))
            drawing.legend(axis)
        axes[-1].set_xlabel("time, s")
        return Picture(key, figure.title, drawing.distinct(svg(), key), figure.text, facts)


def mark_changes(axes: Axes, scenario: Scenario, end_s: float, *, name: bool) -> None:
    """Draw when failures begin, and gusts, as far as the flight got; with a name in the legend if wanted."""
    for kind, color, times in (
        ("failure", drawing.FAILURE, [f.at_s for f in scenario.failures]),
        ("gust", drawing.OTHER, [g.at_s for g in scenario.gusts]),
    ):
        for i, at_s in enumerate(sorted(at for at in times if at <= end_s)):
            axes.axvline(at_s, color=color, linestyle=":", linewidth=1.3, label="_" if i or not name else kind)


def color_of(result: Result, name: str) -> str:
    """Return the colour of an estimator, the same in all figures."""
    return palette.estimate(result.trace.estimators.index(name))


def _one(_result: Result) -> int:
    return 1


def _estimators(result: Result) -> int:
    return len(result.trace.estimators)


def number(value: float | None, spec: str = ".2f", unit: str = "") -> str:
    """Return a number with its unit, - for none and for one that is not finite."""
    return "-" if value is None or not np.isfinite(value) else format(value, spec) + unit


def _range(values: Vector, spec: str, unit: str) -> str:
    values = values[np.isfinite(values)]
    return f"{values.min():{spec}} to {values.max():{spec}} {unit}" if values.size else "no finite value"


def _pitch_rate(axes: list[Axes], result: Result) -> str:
    trace, summary = result.trace, result.summary
    t, q, reference = trace["t_s"], trace["q_deg_s"], trace["q_ref_deg_s"]
    drawing.line(axes[0], t, trace["q_cmd_deg_s"], color=drawing.COMMAND, linewidth=0.8, label="command")
    drawing.line(axes[0], t, reference, color=drawing.REFERENCE, label="reference")
    drawing.line(axes[0], t, q, color=drawing.ACTUAL, label="q")
    axes[0].set_ylabel("pitch rate, deg/s")
    before, after = (number(summary[f"tracking_rms_{k}_deg_s"]) for k in ("pre", "post"))
    error = np.abs(np.where(np.isfinite(q - reference), q - reference, 0.0))
    worst = f"largest |q - reference| {error.max():.2f} deg/s, at {t[error.argmax()]:.2f} s."
    if summary["failed_at_s"] is None:
        return f"RMS of q - reference {before} deg/s; {worst}"
    return f"RMS of q - reference {before} deg/s before the failure, {after} deg/s from 0.3 s after it; {worst}"


def _alpha(axes: list[Axes], result: Result) -> str:
    t, alpha, trim = result.trace["t_s"], result.trace["alpha_deg"], result.summary["trim"]["alpha_deg"]
    drawing.line(axes[0], t, alpha, color=drawing.ACTUAL, label="alpha")
    axes[0].axhline(trim, color=drawing.OTHER, linestyle="--", linewidth=0.9, label="trim")
    axes[0].set_ylabel("angle of attack, deg")
    away = np.abs(np.where(np.isfinite(alpha), alpha, trim) - trim)
    departs = " More than 25 deg counts as departed." if result.summary["departed"] else ""
    return (
        f"{_range(alpha, '.2f', 'deg')}; trimmed at {trim:.3f} deg, at most {away.max():.2f} deg from it, "
        f"at {t[away.argmax()]:.2f} s.{departs}"
    )


def _elevator(axes: list[Axes], result: Result) -> str:
    trace, actuator = result.trace, result.plan.aircraft.actuator
    drawing.line(
        axes[0], trace["t_s"], trace["elevator_cmd_deg"], color=drawing.COMMAND, linewidth=0.9, label="command"
    )
    drawing.line(axes[0], trace["t_s"], trace["elevator_deg"], color=drawing.ACTUAL, label="position")
    stops = [s / DEG for s in (actuator.min_rad, actuator.max_rad) if np.isfinite(s)]
    for i, stop in enumerate(stops):
        axes[0].axhline(
            stop, color=drawing.OTHER, linestyle="--", linewidth=0.9, label="_" if i else "stops of the surface"
        )
    axes[0].set_ylabel("elevator, deg")
    where = f"stops at {' and '.join(f'{s:+g}' for s in stops)} deg" if stops else "no stops"
    return (
        f"Commanded {_range(trace['elevator_cmd_deg'], '+.2f', 'deg')}, {where}; "
        f"at a stop in {np.mean(at_stop(trace, actuator)):.1%} of the ticks."
    )


def _effectiveness(axes: list[Axes], result: Result) -> str:
    trace, words = result.trace, []
    t, truth = trace["t_s"], trace["effectiveness_true"]
    for axis, name in zip(axes, trace.estimators, strict=True):
        color = color_of(result, name)
        raw, std, smoothed = (trace[f"{name}.effectiveness{c}"] for c in ("", "_std", "_smoothed"))
        drawing.line(axis, t, truth, color=drawing.TRUTH, linewidth=2.4, label="truth")
        drawing.band(axis, t, raw - 2.0 * std, raw + 2.0 * std, color=color, alpha=0.18, label="+-2 sigma")
        drawing.line(axis, t, raw, color=color, linewidth=0.6, alpha=0.7, label=f"K-hat of '{name}'")
        drawing.line(axis, t, smoothed, color=color, linewidth=1.3, label="smoothed")
        settled = np.concatenate([raw[t > 0.3], truth])
        settled = settled[np.isfinite(settled)]
        axis.set_ylim(max(-1.0, min(-0.08, settled.min() - 0.05)), min(3.0, max(1.25, settled.max() + 0.05)))
        axis.set_ylabel("K")
        m = result.summary["estimators"][name]
        inside = np.mean(np.abs(raw - truth) <= 2.0 * std)
        after = number(m["median_abs_error_post"], ".2g")
        error = (
            "" if m["median_abs_error_post"] is None else f"median |K-hat - K| {after} from 0.3 s after the failure, "
        )
        words.append(
            f"'{name}' ends at {number(m['final'], '.3f')} (truth {truth[-1]:.3f}), {error}truth within +-2 sigma in "
            f"{inside:.0%} of the ticks."
        )
    return " ".join(words)


def _nis(axes: list[Axes], result: Result) -> str:
    words = []
    for axis, name in zip(axes, result.trace.estimators, strict=True):
        nis = result.trace[f"{name}.nis"][1:]
        drawing.line(axis, result.trace["t_s"][1:], nis, color=color_of(result, name), linewidth=0.7, label=f"'{name}'")
        axis.axhline(NIS_BOUND, color=drawing.OTHER, linestyle="--", linewidth=1.0, label="95 % bound")
        axis.set_ylabel("NIS")
        finite = nis[np.isfinite(nis)]
        axis.set_ylim(0.0, _NIS_SHOWN)
        if finite.size:
            beyond = int(np.sum(finite > _NIS_SHOWN))
            cut = f", {beyond} beyond the frame, the largest {finite.max():.3g}" if beyond else ""
            words.append(
                f"'{name}': mean {finite.mean():.2f}, above the bound in {np.mean(finite > NIS_BOUND):.1%} of the ticks{cut}."
            )
    return " ".join(words)


def _sigma(axes: list[Axes], result: Result) -> str:
    trace, words = result.trace, []
    t, bound = trace["t_s"], trace.columns.get("effectiveness_bound")
    if bound is not None:
        shown = np.where(bound > 0.0, bound, np.nan)
        drawing.line(axes[0], t, shown, color=drawing.OTHER, linewidth=3.5, alpha=0.45, label="Cramer-Rao bound")
    for name in trace.estimators:
        std = trace[f"{name}.effectiveness_std"]
        drawing.line(axes[0], t, np.where(std > 0.0, std, np.nan), color=color_of(result, name), label=f"'{name}'")
        words.append(f"'{name}': median sigma {number(float(np.median(std)), '.2g')}.")
    if bound is not None:
        words.append(f"Bound: median {number(float(np.median(bound)), '.2g')}.")
    if any(np.any(np.asarray(line.get_ydata()) > 0.0) for line in axes[0].lines):
        axes[0].set_yscale("log")
        axes[0].yaxis.set_major_formatter(
            "{x:g}"
        )  # powers of ten would be set by the mathematics of matplotlib: slow to load
        axes[0].yaxis.set_minor_formatter("")
    axes[0].set_ylim(top=3.0)
    axes[0].set_ylabel("sigma of K")
    return " ".join(words)


_CONDITION = (
    ("mach", "Mach number", ".3f", ""),
    ("altitude_ft", "altitude, ft", ",.0f", "ft"),
    ("nz_g", "nz, g", ".2f", "g"),
)
_GUST = ("gust_up_fps", "gust, ft/s up", ".1f", "ft/s")


def _condition_rows(result: Result) -> int:
    return len(_CONDITION) + bool(result.plan.scenario.gusts)


def _condition(axes: list[Axes], result: Result) -> str:
    words = []
    for axis, (column, label, spec, unit) in zip(axes, (*_CONDITION, _GUST), strict=False):
        drawing.line(axis, result.trace["t_s"], result.trace[column], color=drawing.ACTUAL)
        axis.set_ylabel(label)
        axis.ticklabel_format(axis="y", useOffset=False, style="plain")
        words.append(f"{label.partition(',')[0]} {_range(result.trace[column], spec, unit)}".strip())
    return "; ".join(words) + "."


FIGURES = {
    "pitch-rate": Figure(
        "Pitch rate", "What the pilot asks for, the prefiltered reference, and what the aircraft does.", _one, _pitch_rate
    ),
    "alpha": Figure("Angle of attack", "To the air, gusts included.", _one, _alpha),
    "elevator": Figure("Elevator", "What the law commands and where the surface is; trailing edge down is positive.", _one, _elevator),
    "effectiveness": Figure(
        "Effectiveness K", "Each estimator's K-hat with its own +-2 sigma, K-hat smoothed as the law uses it, and the truth.",
        _estimators, _effectiveness, height=1.9,
    ),
    "nis": Figure(
        "Normalized innovation squared",
        f"Of two readings: chi-square with 2 degrees of freedom if the filter's model holds, mean 2, above {NIS_BOUND:.2f} in 5 %.",
        _estimators, _nis, height=1.6,
    ),
    "sigma": Figure(
        "Standard deviation of K", "What each estimator says of itself, beside what no unbiased one can beat, where it can be computed.",
        lambda result: min(1, _estimators(result)), _sigma,
    ),
    "condition": Figure("Flight condition", "Where the flight went.", _condition_rows, _condition, height=1.4),
}  # fmt: skip
