"""Figures of a flight: references and responses, surfaces, flight condition; the table of all figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flightbed import drawing
from flightbed.estimate_figures import (
    effectiveness,
    estimated,
    nis,
    number,
    reconstructing,
    reconstruction,
    sigma,
    telling,
)
from flightbed.metrics import PHASES, at_stop
from flightbed.naming import of_surface
from flightbed.units import DEG

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from flightbed.document import Picture
    from flightbed.flight_result import Result
    from flightbed.settings import Scenario

Vector = npt.NDArray[np.float64]

MARGIN = 0.72  # left of the axes of histories, inches


@dataclass(frozen=True)
class Figure:
    """One figure.

    Attributes:
        title: heading.
        text: explanation of the lines.
        rows: flight -> number of axes, 0 for a flight without this figure.
        draw: draws on the axes, returns computed facts in words.
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
        keys: of ``FIGURES``; None for all figures that apply to the flight.

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
    """Draw a vertical line at the onset of every failure and gust before ``end_s``; ``name`` adds it to the legend."""
    for kind, color, times in (
        ("failure", drawing.FAILURE, [f.at_s for f in scenario.failures]),
        ("gust", drawing.OTHER, [g.at_s for g in scenario.gusts]),
    ):
        for i, at_s in enumerate(sorted(at for at in times if at <= end_s)):
            axes.axvline(at_s, color=color, linestyle=":", linewidth=1.3, label="_" if i or not name else kind)


def _one(_result: Result) -> int:
    return 1


def _estimates(result: Result) -> int:
    return len(telling(result))


def _estimators(result: Result) -> int:
    return len(of_surface(telling(result, "nis"), "elevator"))


def _range(values: Vector, spec: str, unit: str) -> str:
    values = values[np.isfinite(values)]
    return f"{values.min():{spec}} to {values.max():{spec}} {unit}" if values.size else "no finite value"


def _pitch_rate(axes: list[Axes], result: Result) -> str:
    return _followed(axes[0], result, "q", "deg_s", "pitch rate, deg/s", "deg_s")


def _followed(axis: Axes, result: Result, name: str, suffix: str, label: str, key: str) -> str:
    """Draw a quantity, its command and its reference: columns NAME_SUFFIX, NAME_cmd_SUFFIX, NAME_ref_SUFFIX; ``key`` ends its metrics."""
    trace, summary, unit = result.trace, result.summary, label.rpartition(", ")[2]
    t, flown, reference = trace["t_s"], trace[f"{name}_{suffix}"], trace[f"{name}_ref_{suffix}"]
    axis.set_ylabel(label)
    if not np.any(np.isfinite(reference)):
        drawing.line(axis, t, flown, color=drawing.ACTUAL, label=name)
        return f"{_range(flown, '+.2f', unit)}; no {name} is commanded."
    drawing.line(axis, t, trace[f"{name}_cmd_{suffix}"], color=drawing.COMMAND, linewidth=0.8, label="command")
    drawing.line(axis, t, reference, color=drawing.REFERENCE, label="reference")
    drawing.line(axis, t, flown, color=drawing.ACTUAL, label=name)
    before, after = (number(summary.metrics.tracking_rms(phase, key)) for phase in PHASES)
    error = np.abs(np.where(np.isfinite(flown - reference), flown - reference, 0.0))
    worst = f"largest |{name} - reference| {error.max():.2f} {unit}, at {t[error.argmax()]:.2f} s."
    if summary.failed_at_s is None:
        return f"RMS of {name} - reference {before} {unit}; {worst}"
    return f"RMS of {name} - reference {before} {unit} before the failure, {after} {unit} from 0.3 s after it; {worst}"


def _load_factor(axes: list[Axes], result: Result) -> str:
    return _followed(axes[0], result, "nz", "g", "load factor, g", "nz_g")


def _roll(axes: list[Axes], result: Result) -> str:
    roll = _followed(axes[0], result, "p", "deg_s", "roll rate, deg/s", "p_deg_s")
    sideslip = _followed(axes[1], result, "beta", "deg", "sideslip, deg", "beta_deg")
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
    where = f"stops at {' and '.join(f'{s:+g}' for s in stops)} deg" if stops else "no stops"
    return (
        f"Commanded {_range(command, '+.2f', 'deg')}, {where}; "
        f"at a stop in {np.mean(at_stop(trace, actuator, surface)):.1%} of the ticks."
    )


def _turning_surfaces(axes: list[Axes], result: Result) -> str:
    both = zip(axes, ("aileron", "rudder"), strict=True)
    return " ".join(f"{surface.capitalize()}: {_surface(axis, result, surface)}" for axis, surface in both)


_CONDITION = (
    ("mach", "Mach number", ".3f", ""),
    ("altitude_ft", "altitude, ft", ",.0f", "ft"),
    ("nz_g", "nz, g", ".2f", "g"),
)
_GUST = ("gust_up_fps", "gust, ft/s up", ".1f", "ft/s")


def _turning(rows: int) -> Callable[[Result], int]:
    """Return the number of axes of a figure for flights with commanded aileron and rudder."""
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
        "Pitch rate", "Command, prefiltered reference and response.", _one, _pitch_rate
    ),
    "load-factor": Figure(
        "Load factor", "Command over level flight at the measured attitude, reference and response.",
        lambda result: int(result.plan.scenario.in_g), _load_factor,
    ),
    "alpha": Figure("Angle of attack", "Relative to the air, gusts included.", _one, _alpha),
    "elevator": Figure("Elevator", "Command of the law and position of the surface; trailing edge down is positive.", _one, _elevator),
    "roll": Figure(
        "Roll rate, sideslip and bank", "Commands, prefiltered references and response.", _turning(3), _roll,
        height=1.6,
    ),
    "aileron-and-rudder": Figure(
        "Aileron and rudder", "Commands of the regulator and positions of the actuators.", _turning(2), _turning_surfaces,
        height=1.6,
    ),
    "effectiveness": Figure(
        "Effectiveness K",
        "Each estimate with its own +-2 sigma, smoothed as the law uses it, and the true K of its surface; 'NAME' is the elevator's.",
        _estimates, effectiveness, height=1.9,
    ),
    "nis": Figure(
        "Normalized innovation squared",
        "Chi-square distributed under the filter's model, with one degree of freedom per predicted reading; the mean is that number, "
        "and 5 % lie above the bound.",
        _estimators, nis, height=1.6,
    ),
    "reconstruction": Figure(
        "Reconstructed input",
        "The elevator's deflection that acts, or a gust's angle of attack (estimated one tick late), from alpha and q alone.",
        lambda result: len(reconstructing(result)), reconstruction,
    ),
    "sigma": Figure(
        "Standard deviation of K", "Each estimator's own standard deviation of K, and the Cramer-Rao bound (grey) where it is known.",
        lambda result: len(estimated(result)), sigma,
    ),
    "condition": Figure("Flight condition", "Mach number, altitude, load factor.", _condition_rows, _condition, height=1.4),
}  # fmt: skip
