"""Figures of the estimates of a flight: K, NIS, reconstructed inputs, standard deviations; each returns computed facts in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flightbed import drawing, palette
from flightbed.naming import numbered, of_surface, surface_of
from flightbed.signals import SURFACES
from flightbed.statistics import chi_square_bound
from flightbed.trace import true_share

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from flightbed.flight_result import Result

_NIS_SHOWN = 18.0  # upper limit of the axis without a declared number of readings; with it three times the bound


def color_of(result: Result, name: str) -> str:
    """Return the colour of an estimate, the same in all figures."""
    return palette.estimate(numbered(result.trace.estimators)[name])


def number(value: float | None, spec: str = ".2f", unit: str = "") -> str:
    """Return a number with its unit, - for none and for one that is not finite."""
    return "-" if value is None or not np.isfinite(value) else format(value, spec) + unit


def telling(result: Result, column: str = "effectiveness") -> list[str]:
    """Return the estimates with finite values in a column; a gust estimator has none of K."""
    return [name for name in result.trace.estimators if np.isfinite(result.trace[f"{name}.{column}"]).any()]


def reconstructing(result: Result) -> list[str]:
    """Return the estimators that reconstruct an unknown input."""
    return [name for name in result.trace.estimators if f"{name}.reconstructed_deg" in result.trace.columns]


def estimated(result: Result) -> list[str]:
    """Return the surfaces whose K is estimated."""
    return [surface for surface in SURFACES if of_surface(telling(result), surface)]


def effectiveness(axes: list[Axes], result: Result) -> str:
    """Draw each estimate, its band and the true K of its surface on its own axes; returns errors in words."""
    trace, words = result.trace, []
    t = trace["t_s"]
    for axis, name in zip(axes, telling(result), strict=True):
        truth, color = trace[true_share(name)], color_of(result, name)
        raw, std, smoothed = (trace[f"{name}.effectiveness{c}"] for c in ("", "_std", "_smoothed"))
        drawing.line(axis, t, truth, color=drawing.TRUTH, linewidth=2.4, label="truth")
        drawing.band(axis, t, raw - 2.0 * std, raw + 2.0 * std, color=color, alpha=0.18, label="+-2 sigma")
        drawing.line(axis, t, raw, color=color, linewidth=0.6, alpha=0.7, label=f"K-hat of '{name}'")
        drawing.line(axis, t, smoothed, color=color, linewidth=1.3, label="smoothed")
        settled = np.concatenate([raw[t > 0.3], truth])
        settled = settled[np.isfinite(settled)]
        axis.set_ylim(max(-1.0, min(-0.08, settled.min() - 0.05)), min(3.0, max(1.25, settled.max() + 0.05)))
        axis.set_ylabel("K")
        m = result.metrics.estimators[name]
        inside = np.mean(np.abs(raw - truth) <= 2.0 * std)
        after = number(m.median_abs_error_post, ".2g")
        error = "" if m.median_abs_error_post is None else f"median |K-hat - K| {after} from 0.3 s after the failure, "
        words.append(
            f"'{name}' ends at {number(m.final, '.3f')} (truth {truth[-1]:.3f}), {error}truth within +-2 sigma in "
            f"{inside:.0%} of the ticks."
        )
    return " ".join(words)


def nis(axes: list[Axes], result: Result) -> str:
    """Draw the NIS of each estimator with its 95 % bound; returns means and shares."""
    words = []
    for axis, name in zip(axes, of_surface(telling(result, "nis"), "elevator"), strict=True):
        readings = result.metrics.estimators[name].nis_expected
        bound = None if readings is None else chi_square_bound(readings)
        shown = _NIS_SHOWN if bound is None else 3.0 * bound
        nis = result.trace[f"{name}.nis"][1:]
        drawing.line(axis, result.trace["t_s"][1:], nis, color=color_of(result, name), linewidth=0.7, label=f"'{name}'")
        if bound is not None:
            axis.axhline(bound, color=drawing.OTHER, linestyle="--", linewidth=1.0, label="95 % bound")
        axis.set_ylabel("NIS")
        finite = nis[np.isfinite(nis)]
        axis.set_ylim(0.0, shown)
        if finite.size:
            beyond = int(np.sum(finite > shown))
            cut = f", {beyond} beyond the frame, the largest {finite.max():.3g}" if beyond else ""
            above = (
                "" if bound is None else f", above the bound {bound:.2f} in {np.mean(finite > bound):.1%} of the ticks"
            )
            words.append(f"'{name}': mean {finite.mean():.2f}{above}{cut}.")
    return " ".join(words)


def reconstruction(axes: list[Axes], result: Result) -> str:
    """Draw each reconstructed input and the true one; returns errors in words."""
    trace, words = result.trace, []
    of_gust = {e.name: getattr(e, "unknown", "") == "gust" for e in result.plan.scenario.estimators}
    for axis, name in zip(axes, reconstructing(result), strict=True):
        what, column = ("gust", "gust_alpha_deg") if of_gust[name] else ("elevator", "elevator_acting_deg")
        found, truth = trace[f"{name}.reconstructed_deg"], trace[column]
        drawing.line(axis, trace["t_s"], truth, color=drawing.TRUTH, linewidth=2.0, label="acts")
        if not of_gust[name]:
            drawing.line(
                axis, trace["t_s"], trace["elevator_deg"], color=drawing.OTHER, linewidth=1.0, label="position"
            )
        drawing.line(axis, trace["t_s"], found, color=color_of(result, name), linewidth=0.7, label=f"'{name}'")
        seen = truth[np.isfinite(truth)]
        spare = 0.5 * float(np.ptp(seen)) + 0.5  # a transient of the reconstruction may be larger than all that acts
        axis.set_ylim(seen.min() - spare, seen.max() + spare)
        axis.set_ylabel(f"{what}, deg")
        error = (found - truth)[np.isfinite(found - truth)]
        rms = float(np.sqrt(np.mean(error**2))) if error.size else None
        words.append(
            f"'{name}': RMS error {number(rms, '.3f', ' deg')}, largest {number(np.abs(error).max(), '.2f', ' deg')}."
        )
    return " ".join(words)


def sigma(axes: list[Axes], result: Result) -> str:
    """Draw each estimate's own standard deviation of K, per surface, and the Cramer-Rao bound of the elevator's; returns medians."""
    trace, words = result.trace, []
    t, bound, shown = trace["t_s"], trace.columns.get("effectiveness_bound"), estimated(result)
    if bound is not None:
        drawing.line(
            axes[0],
            t,
            np.where(bound > 0.0, bound, np.nan),
            color=drawing.OTHER,
            linewidth=3.5,
            alpha=0.45,
            label="Cramer-Rao bound",
        )
    for name in telling(result):
        std = trace[f"{name}.effectiveness_std"]
        axis = axes[shown.index(surface_of(name))]
        drawing.line(axis, t, np.where(std > 0.0, std, np.nan), color=color_of(result, name), label=f"'{name}'")
        words.append(f"'{name}': median sigma {number(float(np.median(std)), '.2g')}.")
    if bound is not None:
        words.append(f"Bound: median {number(float(np.median(bound)), '.2g')}.")
    for axis in axes:
        if any(np.any(np.asarray(line.get_ydata()) > 0.0) for line in axis.lines):
            axis.set_yscale("log")
            axis.yaxis.set_major_formatter(
                "{x:g}"
            )  # powers of ten would be set by matplotlib's mathematics: slow to load
            axis.yaxis.set_minor_formatter("")
        axis.set_ylim(top=3.0)
        axis.set_ylabel("sigma of K")
    return " ".join(words)
