"""Figures of a flight: tracking, control surfaces, flight condition; the table of all figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flightbed.analysis.metrics import PHASES, at_stop
from flightbed.core.estimate_names import of_surface
from flightbed.core.units import DEG
from flightbed.document import drawing
from flightbed.report.estimate_figures import (
    effectiveness,
    estimated_surfaces,
    estimates_with,
    nis,
    number,
    reconstruction,
    reconstruction_names,
    sigma,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from flightbed.analysis.result import Result
    from flightbed.document.document import Picture
    from flightbed.scenario.tables import Scenario

Vector = npt.NDArray[np.float64]

MARGIN = 0.72  # left margin of the axes of histories, inches


@dataclass(frozen=True)
class Figure:
    """One figure.

    Attributes:
        title: title of the figure.
        text: description of the lines.
        rows: flight -> number of axes; 0 if the figure does not apply.
        draw: draws on the axes and returns computed facts in words.
        height: height of each of the axes, inches.

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
        keys: keys of ``FIGURES``; None for all figures that apply to the flight.

    """
    wanted = FIGURES if keys is None else {key: FIGURES[key] for key in keys}
    return [_picture(key, figure, result) for key, figure in wanted.items() if figure.rows(result)]


def _picture(key: str, figure: Figure, result: Result) -> Picture:
    from flightbed.document.document import Picture

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
    """Mark the onsets of failures and gusts up to ``end_s``; with ``name`` they appear in the legend."""
    for kind, color, times in (
        ("failure", drawing.FAILURE, [f.at_s for f in scenario.failures]),
        ("gust", drawing.OTHER, [g.at_s for g in scenario.gusts]),
    ):
        for i, at_s in enumerate(sorted(at for at in times if at <= end_s)):
            axes.axvline(at_s, color=color, linestyle=":", linewidth=1.3, label="_" if i or not name else kind)


def _one(_result: Result) -> int:
    return 1


def _estimates(result: Result) -> int:
    return len(estimates_with(result, "effectiveness"))


def _estimators(result: Result) -> int:
    return len(of_surface(estimates_with(result, "nis"), "elevator"))


def _range(values: Vector, spec: str, unit: str) -> str:
    values = values[np.isfinite(values)]
    return f"{values.min():{spec}} to {values.max():{spec}} {unit}" if values.size else "no finite value"


def _pitch_rate(axes: list[Axes], result: Result) -> str:
    return _tracking(axes[0], result, "q", "deg_s", "pitch rate, deg/s", "deg_s")


def _tracking(axis: Axes, result: Result, name: str, suffix: str, label: str, key: str) -> str:
    """Draw a controlled variable with its command and reference.

    The columns are NAME_SUFFIX, NAME_cmd_SUFFIX and NAME_ref_SUFFIX; ``key`` is the suffix of the metrics.
    """
    trace, summary, unit = result.trace, result.summary, label.rpartition(", ")[2]
    t, actual, reference = trace["t_s"], trace[f"{name}_{suffix}"], trace[f"{name}_ref_{suffix}"]
    axis.set_ylabel(label)
    if not np.any(np.isfinite(reference)):
        drawing.line(axis, t, actual, color=drawing.ACTUAL, label=name)
        return f"{_range(actual, '+.2f', unit)}; no command in {name}."
    drawing.line(axis, t, trace[f"{name}_cmd_{suffix}"], color=drawing.COMMAND, linewidth=0.8, label="command")
    drawing.line(axis, t, reference, color=drawing.REFERENCE, label="reference")
    drawing.line(axis, t, actual, color=drawing.ACTUAL, label=name)
    before, after = (number(summary.metrics.tracking_rms(phase, key)) for phase in PHASES)
    error = np.abs(np.where(np.isfinite(actual - reference), actual - reference, 0.0))
    worst = f"largest |{name} - reference| {error.max():.2f} {unit}, at {t[error.argmax()]:.2f} s."
    if summary.failed_at_s is None:
        return f"RMS of {name} - reference {before} {unit}; {worst}"
    return f"RMS of {name} - reference {before} {unit} before the failure, {after} {unit} from 0.3 s after it; {worst}"


def _load_factor(axes: list[Axes], result: Result) -> str:
    return _tracking(axes[0], result, "nz", "g", "load factor, g", "nz_g")


def _roll(axes: list[Axes], result: Result) -> str:
    roll = _tracking(axes[0], result, "p", "deg_s", "roll rate, deg/s", "p_deg_s")
    sideslip = _tracking(axes[1], result, "beta", "deg", "sideslip, deg", "beta_deg")
    bank = result.trace["phi_deg"]
    drawing.line(axes[2], result.trace["t_s"], bank, color=drawing.ACTUAL, label="phi")
    axes[2].set_ylabel("angle of bank, deg")
    return f"{roll} {sideslip} Bank {_range(bank, '+.1f', 'deg')}."


def _alpha(axes: list[Axes], result: Result) -> str:
    t, alpha, trim = result.trace["t_s"], result.trace["alpha_deg"], result.summary.trim.alpha_deg
    drawing.line(axes[0], t, alpha, color=drawing.ACTUAL, label="alpha")
    axes[0].axhline(trim, color=drawing.OTHER, linestyle="--", linewidth=0.9, label="trim")
    axes[0].set_ylabel("angle of attack, deg")
    away = np.abs(np.where(np.isfinite(alpha), alpha, trim) - trim)
    departs = " More than 25 deg counts as departed." if result.summary.metrics.departed else ""
    return (
        f"{_range(alpha, '.2f', 'deg')}; trimmed at {trim:.3f} deg, at most {away.max():.2f} deg from it, "
        f"at {t[away.argmax()]:.2f} s.{departs}"
    )


def _elevator(axes: list[Axes], result: Result) -> str:
    return _surface(axes[0], result, "elevator")


def _surface(axis: Axes, result: Result, surface: str) -> str:
    trace, actuator = result.trace, result.plan.actuators[surface]
    command = trace[f"{surface}_cmd_deg"]
    drawing.line(axis, trace["t_s"], command, color=drawing.COMMAND, linewidth=0.9, label="command")
    drawing.line(axis, trace["t_s"], trace[f"{surface}_deg"], color=drawing.ACTUAL, label="position")
    stops = [s / DEG for s in (actuator.min_rad, actuator.max_rad) if np.isfinite(s)]
    for i, stop in enumerate(stops):
        axis.axhline(
            stop, color=drawing.OTHER, linestyle="--", linewidth=0.9, label="_" if i else "stops of the surface"
        )
    axis.set_ylabel(f"{surface}, deg")
    limits = f"stops at {' and '.join(f'{s:+g}' for s in stops)} deg" if stops else "no stops"
    return (
        f"Command {_range(command, '+.2f', 'deg')}, {limits}; "
        f"at a stop in {np.mean(at_stop(trace, actuator, surface)):.1%} of the ticks."
    )


def _aileron_and_rudder(axes: list[Axes], result: Result) -> str:
    both = zip(axes, ("aileron", "rudder"), strict=True)
    return " ".join(f"{surface.capitalize()}: {_surface(axis, result, surface)}" for axis, surface in both)


_CONDITION = (
    ("mach", "Mach number", ".3f", ""),
    ("altitude_ft", "altitude, ft", ",.0f", "ft"),
    ("nz_g", "nz, g", ".2f", "g"),
)
_GUST = ("gust_up_fps", "gust, ft/s up", ".1f", "ft/s")


def _lateral_rows(rows: int) -> Callable[[Result], int]:
    """Return the row function of a figure that applies only to flights with aileron and rudder commands."""
    return lambda result: rows if result.plan.lateral is not None else 0


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
        "Pitch rate", "Pilot command, prefiltered reference and response of the aircraft.", _one, _pitch_rate
    ),
    "load-factor": Figure(
        "Load factor", "Command relative to level flight at the measured attitude, reference and response of the aircraft.",
        lambda result: int(result.plan.scenario.in_g), _load_factor,
    ),
    "alpha": Figure("Angle of attack", "Relative to the air, gusts included.", _one, _alpha),
    "elevator": Figure("Elevator", "Command of the law and position of the surface; trailing edge down is positive.", _one, _elevator),
    "roll": Figure(
        "Roll rate, sideslip and bank", "Command, prefiltered reference and response of the aircraft.", _lateral_rows(3), _roll,
        height=1.6,
    ),
    "aileron-and-rudder": Figure(
        "Aileron and rudder", "Commands of the regulator and positions of the actuators.", _lateral_rows(2), _aileron_and_rudder,
        height=1.6,
    ),
    "effectiveness": Figure(
        "Effectiveness K",
        "Each estimate with its +-2 sigma band, the smoothed estimate that the law uses, and the true K of its surface; 'NAME' without a "
        "surface is the elevator's.",
        _estimates, effectiveness, height=1.9,
    ),
    "nis": Figure(
        "Normalized innovation squared",
        "Chi-square distributed if the filter's model holds: the mean equals the number of predicted readings, and 5 % of the values lie "
        "above the bound.",
        _estimators, nis, height=1.6,
    ),
    "reconstruction": Figure(
        "Reconstructed input",
        "Effective deflection of the elevator, or gust angle of attack (delayed by one tick), reconstructed from alpha and q alone.",
        lambda result: len(reconstruction_names(result)), reconstruction,
    ),
    "sigma": Figure(
        "Standard deviation of K",
        "Each estimator's own standard deviation of K and, where it can be computed, the Cramer-Rao bound (grey).",
        lambda result: len(estimated_surfaces(result)), sigma,
    ),
    "condition": Figure(
        "Flight condition", "Mach number, altitude, load factor and, if the scenario has gusts, their vertical speed.",
        _condition_rows, _condition, height=1.4,
    ),
}  # fmt: skip
