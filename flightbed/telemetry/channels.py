"""Plots of a flight in the viewer and their lines, defined on the columns of the trace. Does not import rerun."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, log10

import numpy as np

from flightbed.analysis.trace import ACTING, GUST_ALPHA, Trace, Vector, true_share
from flightbed.core.estimate_names import estimate_name, estimator_indices, of_surface
from flightbed.core.units import unit_of
from flightbed.document import palette
from flightbed.statistics.intervals import chi_square_bound

OVERVIEW, ESTIMATORS, AIRFRAME, ROLL_YAW = "Overview", "Estimators", "Airframe", "Roll and yaw"
_LOWEST = 1e-4  # lower limit of sigma on a logarithmic axis


@dataclass(frozen=True)
class Line:
    """A line of a plot: a column of the trace times a factor, or a constant.

    Attributes:
        label: label with unit.
        color: ``#rrggbb``, from the palette.
        column: column of the trace; empty for a constant.
        factor: multiplier of the column, or the value of a constant.
        width: points.
        per: divisor column; the quotient is 0 where the divisor is 0.
        log: whether to plot the decimal logarithm, of values clipped to at least 1e-4.

    """

    label: str
    color: str
    column: str = ""
    factor: float = 1.0
    width: float = 1.6
    per: str = ""
    log: bool = False

    def values(self, trace: Trace) -> Vector:
        """Return the values of the line (T,), one per tick."""
        if not self.column:
            return np.full(len(trace), self.factor)
        values = trace[self.column]
        if self.per:
            values = np.divide(values, trace[self.per], out=np.zeros(len(trace)), where=trace[self.per] != 0.0)
        if self.log:
            return np.log10(np.clip(values, _LOWEST, None))
        return values if self.factor == 1.0 else values * self.factor


@dataclass(frozen=True)
class Plot:
    """A plot over time.

    Attributes:
        key: entity path of its data.
        title: title with the unit of the axis.
        tab: page of the layout.
        lines: lines of the plot.
        range: range of the axis; None for automatic.
        estimator: index of the estimator that the plot belongs to, if any.
        bands: estimators whose K is plotted with a band of two standard deviations.

    """

    key: str
    title: str
    tab: str
    lines: tuple[Line, ...]
    range: tuple[float, float] | None = None
    estimator: int | None = None
    bands: tuple[str, ...] = ()


def plots(
    trace: Trace,
    *,
    stops_deg: Mapping[str, Sequence[float]],
    gusts: bool,
    moves_cg: bool,
    readings: Mapping[str, float],
    certain: Collection[str] = (),
) -> tuple[Plot, ...]:
    """Return the plots of a flight; a column without finite values has no line.

    Args:
        trace: the flight, or its first ticks.
        stops_deg: surface -> lowest and highest deflection, deg, for commanded surfaces; empty for a surface without stops.
        gusts, moves_cg: whether the scenario has gusts or a c.g. shift in flight, which then have plots.
        readings: estimator -> number of readings in its NIS; its plot then shows the 95 % bound.
        certain: columns to plot even if the first ticks have no values.

    """
    wanted = [
        *_overview(trace, stops_deg),
        *_estimators(trace, readings),
        *_airframe(),
        *_roll_and_yaw(trace, stops_deg),
    ]
    kept = []
    for plot in wanted:
        lines = tuple(
            line for line in plot.lines if not line.column or line.column in certain or _has_values(trace, line.column)
        )
        if (
            any(line.column for line in lines)
            and (gusts or plot.key != "gust")
            and (moves_cg or plot.key != "cg_shift")
        ):
            kept.append(replace(plot, lines=lines))
    return tuple(kept)


def with_room(plot: Plot, trace: Trace) -> Plot:
    """Return a plot whose axis range contains at least two of the viewer's labels, which are multiples of a power of ten."""
    values = np.concatenate([line.values(trace) for line in plot.lines])
    values = values[np.isfinite(values)]
    if plot.range is not None or not values.size or not (span := float(np.ptp(values))) > 0.0:
        return plot
    low, high, step = float(values.min()), float(values.max()), 10.0 ** floor(log10(span))
    if floor(high / step) - ceil(low / step) >= 1:
        return plot
    return replace(plot, range=(floor(low / step) * step - 0.08 * step, ceil(high / step) * step + 0.08 * step))


def _has_values(trace: Trace, column: str) -> bool:
    return column in trace.columns and bool(np.any(np.isfinite(trace[column])))


def _line(label: str, color: str, column: str, factor: float = 1.0, width: float = 1.6) -> Line:
    unit = unit_of(column)
    return Line(label if unit == "1" or "," in label else f"{label}, {unit}", color, column, factor, width)


def _share(trace: Trace, surface: str, key: str, tab: str) -> Plot:
    """Return the plot of a surface's K: its estimates with their bands, and the truth."""
    names, numbers = of_surface(trace.estimators, surface), estimator_indices(trace.estimators)
    gains = [
        _line(f"K {name}, smoothed", palette.estimate(numbers[name]), f"{name}.effectiveness_smoothed")
        for name in names
    ]
    truth = _line("K true", palette.TRUTH, true_share(estimate_name("", surface)), width=2.2)
    lines = [truth, *gains]
    if surface == "elevator":
        lines.append(_line("pitch loop stable above", palette.OTHER, "effectiveness_stable_min", width=1.0))
    title = f"{surface.capitalize()} effectiveness K, share; bands +-2 sigma"
    return Plot(key, title, tab, tuple(lines), (-0.1, 1.3), bands=names)


def _deflection(surface: str, stops_deg: Mapping[str, Sequence[float]], tab: str) -> Plot:
    """Return the plot of a surface: command, position and stops."""
    lines = (
        _line("command", palette.COMMAND, f"{surface}_cmd_deg"),
        _line("position", palette.ACTUAL, f"{surface}_deg"),
        *(Line("stop, deg", palette.OTHER, factor=stop, width=1.0) for stop in stops_deg.get(surface, ())),
    )
    return Plot(surface, f"{surface.capitalize()}, deg", tab, lines)


def _overview(trace: Trace, stops_deg: Mapping[str, Sequence[float]]) -> list[Plot]:
    return [
        Plot(
            "pitch_rate",
            "Pitch rate, deg/s",
            OVERVIEW,
            (
                _line("q reference", palette.REFERENCE, "q_ref_deg_s"),
                _line("q", palette.ACTUAL, "q_deg_s"),
            ),
        ),
        _share(trace, "elevator", "effectiveness", OVERVIEW),
        _deflection("elevator", stops_deg, OVERVIEW),
        Plot("alpha", "Angle of attack, deg", OVERVIEW, (_line("alpha", palette.ACTUAL, "alpha_deg"),)),
    ]


def _estimators(trace: Trace, readings: Mapping[str, float]) -> list[Plot]:
    # Each estimator has one innovation and one NIS, recorded with its estimate of the elevator.
    names = of_surface(trace.estimators, "elevator")
    each = [plot for i, name in enumerate(names) for plot in _estimator(i, name, readings.get(name))]
    each += [plot for i, name in enumerate(names) for plot in _reconstruction(trace, i, name)]
    # The bound comes first and wide, so that estimates that reach it remain visible on top.
    sigmas = [
        Line("Cramer-Rao bound", palette.OTHER, "effectiveness_bound", width=5.0, log=True),
        *(
            Line(f"sigma {name}", palette.estimate(i), f"{name}.effectiveness_std", log=True)
            for i, name in enumerate(names)
        ),
    ]
    return [
        *each,
        Plot("sigma", "log10 of sigma of K, share", ESTIMATORS, tuple(sigmas), (-3.5, 0.5)),
        Plot(
            "excitation",
            "Excitation, deg/s^2",
            ESTIMATORS,
            (_line("RMS of M_delta times deflection over 0.3 s, deg/s^2", palette.OTHER, "excitation_deg_s2"),),
        ),
    ]


def _estimator(index: int, name: str, readings: float | None) -> list[Plot]:
    def innovation(label: str, color: str, key: str, unit: str) -> Line:
        column, spread = f"{name}.innovation_{key}_{unit}", f"{name}.innovation_{key}_std_{unit}"
        return Line(label, color, column, width=1.0, per=spread)

    color = palette.estimate(index)
    return [
        Plot(
            f"innovation/{name}",
            f"{name}: innovations over their sigma, 1; clipped at 5",
            ESTIMATORS,
            (
                innovation("alpha", palette.OTHER, "alpha", "deg"),
                innovation("q", color, "q", "deg_s"),
                *(Line(f"{bound:+g} sigma", palette.REFERENCE, factor=bound, width=1.0) for bound in (2.0, -2.0)),
            ),
            (-5.0, 5.0),
            index,
        ),
        Plot(
            f"nis/{name}",
            f"{name}: NIS, 1; clipped at 15",
            ESTIMATORS,
            (
                _line("NIS", color, f"{name}.nis", width=1.0),
                *(
                    ()
                    if readings is None
                    else (Line("95 % bound", palette.REFERENCE, factor=chi_square_bound(readings), width=1.0),)
                ),
            ),
            (0.0, 15.0),
            index,
        ),
    ]


def _reconstruction(trace: Trace, index: int, name: str) -> list[Plot]:
    """Return the plot of a reconstructed input with its truth and, for the elevator, the measured position; empty without one."""
    column = f"{name}.reconstructed_deg"
    if column not in trace.columns:
        return []
    elevator, color = _has_values(trace, f"{name}.verdict"), palette.estimate(index)
    lines = [_line("truth", palette.TRUTH, ACTING if elevator else GUST_ALPHA, width=2.2)]
    if elevator:
        position = palette.OTHER if color != palette.OTHER else palette.REFERENCE
        lines.append(_line("position", position, "elevator_mean_meas_deg"))
    lines.append(_line("reconstructed", color, column, width=1.0))
    quantity = "effective deflection" if elevator else "gust angle of attack"
    return [Plot(f"reconstruction/{name}", f"{name}: {quantity}, deg", ESTIMATORS, tuple(lines), None, index)]


def _roll_and_yaw(trace: Trace, stops_deg: Mapping[str, Sequence[float]]) -> list[Plot]:
    """Return the plots of roll and yaw; empty for a flight under the stock laws, whose trace has no such columns."""
    if "p_deg_s" not in trace.columns:
        return []

    def tracking(key: str, title: str, name: str, suffix: str) -> Plot:
        lines = (
            _line(f"{name} reference", palette.REFERENCE, f"{name}_ref_{suffix}"),
            _line(name, palette.ACTUAL, f"{name}_{suffix}"),
        )
        return Plot(key, title, ROLL_YAW, lines)

    return [
        tracking("roll_rate", "Roll rate, deg/s", "p", "deg_s"),
        Plot("bank", "Angle of bank, deg", ROLL_YAW, (_line("phi", palette.ACTUAL, "phi_deg"),)),
        _deflection("aileron", stops_deg, ROLL_YAW),
        _share(trace, "aileron", "effectiveness_aileron", ROLL_YAW),
        tracking("sideslip", "Sideslip, deg", "beta", "deg"),
        _deflection("rudder", stops_deg, ROLL_YAW),
        _share(trace, "rudder", "effectiveness_rudder", ROLL_YAW),
    ]


def _airframe() -> list[Plot]:
    def one(key: str, title: str, label: str, column: str) -> Plot:
        return Plot(key, title, AIRFRAME, (_line(label, palette.ACTUAL, column),))

    return [
        one("mach", "Mach number, 1", "Mach", "mach"),
        one("altitude", "Altitude, ft", "altitude", "altitude_ft"),
        Plot(
            "load_factor",
            "Load factor nz, g",
            AIRFRAME,
            (_line("nz reference", palette.REFERENCE, "nz_ref_g"), _line("nz", palette.ACTUAL, "nz_g")),
        ),
        Plot(
            "attitude",
            "Attitude, deg",
            AIRFRAME,
            (_line("theta", palette.ACTUAL, "theta_deg"), _line("phi", palette.OTHER, "phi_deg")),
        ),
        Plot(
            "forces",
            "Forces, N",
            AIRFRAME,
            (
                _line("lift", palette.ACTUAL, "lift_n"),
                _line("drag", palette.COMMAND, "drag_n"),
                _line("thrust", palette.REFERENCE, "thrust_n"),
            ),
        ),
        one("gust", "Gust, ft/s", "gust up", "gust_up_fps"),
        Plot(
            "cg_shift",
            "C.g. shift aft, % of the mean chord",
            AIRFRAME,
            (_line("c.g. shift, %", palette.ACTUAL, "cg_shift_cbar", 100.0),),
        ),
    ]
