"""What is shown of a flight: plots and their lines, from the columns that the trace has. No rerun in here."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, log10

import numpy as np

from flightbed import palette
from flightbed.trace import Trace, Vector
from flightbed.units import unit_of

OVERVIEW, ESTIMATORS, AIRFRAME = "Overview", "Estimators", "Airframe"
_LOWEST = 1e-4  # sigma that is told from 0 on a logarithmic axis


@dataclass(frozen=True)
class Line:
    """A line of a plot: a column of the trace times a factor, or a constant.

    Attributes:
        label: with its unit.
        color: from the palette.
        column: of the trace; empty for a constant.
        factor: what the column is multiplied by; of a constant its value.
        width: points.
        per: column that it is divided by; 0 where that is 0.
        log: whether the logarithm to the base 10 is drawn, of at least 1e-4.

    """

    label: str
    color: str
    column: str = ""
    factor: float = 1.0
    width: float = 1.6
    per: str = ""
    log: bool = False

    def values(self, trace: Trace) -> Vector:
        """Return one value per tick."""
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
        key: where its data are logged.
        title: with the unit of its axis.
        tab: page of the layout.
        lines: what it shows.
        range: of its axis; None lets the viewer choose.
        estimator: index of the estimator that it is about, if it is about one.
        bands: estimators whose K it shows with two standard deviations around it.

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
    stops_deg: Sequence[float],
    gusts: bool,
    moves_cg: bool,
    readings: Mapping[str, float],
    certain: Collection[str] = (),
) -> tuple[Plot, ...]:
    """Return the plots of a flight; what has no finite value in the trace has no line.

    Args:
        trace: the flight, or its first ticks.
        stops_deg: lowest and highest deflection of the elevator; empty if it has none.
        gusts, moves_cg: whether the scenario has gusts, or a c.g. that moves: they are plotted then.
        readings: of estimators how many readings their NIS is of: the bound that 95 % of it stay below is drawn then.
        certain: columns that have values even if the first ticks do not.

    """
    wanted = [*_overview(trace, stops_deg), *_estimators(trace, readings), *_airframe()]
    kept = []
    for plot in wanted:
        lines = tuple(
            line for line in plot.lines if not line.column or line.column in certain or _told(trace, line.column)
        )
        if (
            any(line.column for line in lines)
            and (gusts or plot.key != "gust")
            and (moves_cg or plot.key != "cg_shift")
        ):
            kept.append(replace(plot, lines=lines))
    return tuple(kept)


def with_room(plot: Plot, trace: Trace) -> Plot:
    """Return a plot whose axis shows at least two of the viewer's labels, which stand at powers of ten and their multiples."""
    values = np.concatenate([line.values(trace) for line in plot.lines])
    values = values[np.isfinite(values)]
    if plot.range is not None or not values.size or not (span := float(np.ptp(values))) > 0.0:
        return plot
    low, high, step = float(values.min()), float(values.max()), 10.0 ** floor(log10(span))
    if floor(high / step) - ceil(low / step) >= 1:
        return plot
    return replace(plot, range=(floor(low / step) * step - 0.08 * step, ceil(high / step) * step + 0.08 * step))


def _told(trace: Trace, column: str) -> bool:
    return column in trace.columns and bool(np.any(np.isfinite(trace[column])))


def _line(label: str, color: str, column: str, factor: float = 1.0, width: float = 1.6) -> Line:
    unit = unit_of(column)
    return Line(label if unit == "1" or "," in label else f"{label}, {unit}", color, column, factor, width)


def _overview(trace: Trace, stops_deg: Sequence[float]) -> list[Plot]:
    gains = [
        _line(f"K {name}, smoothed", palette.estimate(i), f"{name}.effectiveness_smoothed")
        for i, name in enumerate(trace.estimators)
    ]
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
        Plot(
            "effectiveness",
            "Elevator effectiveness K, share; bands +-2 sigma",
            OVERVIEW,
            (_line("K true", palette.TRUTH, "effectiveness_true", width=2.2), *gains),
            (-0.1, 1.3),
            bands=trace.estimators,
        ),
        Plot(
            "elevator",
            "Elevator, deg",
            OVERVIEW,
            (
                _line("command", palette.COMMAND, "elevator_cmd_deg"),
                _line("position", palette.ACTUAL, "elevator_deg"),
                *(Line("stop, deg", palette.OTHER, factor=stop, width=1.0) for stop in stops_deg),
            ),
        ),
        Plot("alpha", "Angle of attack, deg", OVERVIEW, (_line("alpha", palette.ACTUAL, "alpha_deg"),)),
    ]


def _estimators(trace: Trace, readings: Mapping[str, float]) -> list[Plot]:
    each = [plot for i, name in enumerate(trace.estimators) for plot in _estimator(i, name, readings.get(name))]
    # The bound first and wide: what reaches it is drawn on it.
    sigmas = [
        Line("Cramer-Rao bound", palette.OTHER, "effectiveness_bound", width=5.0, log=True),
        *(
            Line(f"sigma {name}", palette.estimate(i), f"{name}.effectiveness_std", log=True)
            for i, name in enumerate(trace.estimators)
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


def _bound(readings: float) -> float:
    """Return what 95 % of a chi-square with so many degrees of freedom stay below."""
    from scipy.special import chdtri  # slow to import

    return float(chdtri(readings, 0.05))


def _estimator(index: int, name: str, readings: float | None) -> list[Plot]:
    def innovation(label: str, color: str, key: str, unit: str) -> Line:
        column, spread = f"{name}.innovation_{key}_{unit}", f"{name}.innovation_{key}_std_{unit}"
        return Line(label, color, column, width=1.0, per=spread)

    color = palette.estimate(index)
    return [
        Plot(
            f"innovation/{name}",
            f"{name}: innovations over their sigma, 1; cut at 5",
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
            f"{name}: NIS, 1; cut at 15",
            ESTIMATORS,
            (
                _line("NIS", color, f"{name}.nis", width=1.0),
                *(
                    ()
                    if readings is None
                    else (Line("95 % bound", palette.REFERENCE, factor=_bound(readings), width=1.0),)
                ),
            ),
            (0.0, 15.0),
            index,
        ),
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
            "C.g. shift aft, % of the chord",
            AIRFRAME,
            (_line("c.g. shift, %", palette.ACTUAL, "cg_shift_cbar", 100.0),),
        ),
    ]
