"""Figures of the estimates of a flight: effectiveness K, NIS, reconstructed inputs and standard deviation, with computed facts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flightbed.analysis.trace import true_share
from flightbed.core.estimate_names import estimator_indices, of_surface, surface_of
from flightbed.core.signals import SURFACES
from flightbed.document import drawing, palette
from flightbed.statistics.intervals import chi_square_bound

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from flightbed.analysis.result import Result

_NIS_LIMIT = 18.0  # upper end of the axis if the number of predicted readings is unknown; else three times the bound


def color_of(result: Result, name: str) -> str:
    """Return the colour of an estimator, which is the same in all figures."""
    return palette.estimate(estimator_indices(result.trace.estimators)[name])


def number(value: float | None, spec: str = ".2f", unit: str = "") -> str:
    """Return a number with its unit; "-" for None and non-finite values."""
    return "-" if value is None or not np.isfinite(value) else format(value, spec) + unit


def estimates_with(result: Result, column: str) -> list[str]:
    """Return the estimates with finite values in a column; an estimate of a gust has none in ``"effectiveness"``."""
    return [name for name in result.trace.estimators if np.isfinite(result.trace[f"{name}.{column}"]).any()]


def reconstruction_names(result: Result) -> list[str]:
    """Return the estimators that reconstruct an unknown input."""
    return [name for name in result.trace.estimators if f"{name}.reconstructed_deg" in result.trace.columns]


def estimated_surfaces(result: Result) -> list[str]:
    """Return the surfaces whose K is estimated."""
    return [surface for surface in SURFACES if of_surface(estimates_with(result, "effectiveness"), surface)]


def effectiveness(axes: list[Axes], result: Result) -> str:
    """Draw each estimate of K, its band and the true K of its surface, one estimate per axes; return the errors in words."""
    trace, words = result.trace, []
    t = trace["t_s"]
    for axis, name in zip(axes, estimates_with(result, "effectiveness"), strict=True):
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
    """Draw the NIS of each estimator with its 95 % bound; return means and shares above the bound in words."""
    words = []
    for axis, name in zip(axes, of_surface(estimates_with(result, "nis"), "elevator"), strict=True):
        readings = result.metrics.estimators[name].nis_expected
        bound = None if readings is None else chi_square_bound(readings)
        limit = _NIS_LIMIT if bound is None else 3.0 * bound
        nis = result.trace[f"{name}.nis"][1:]
        drawing.line(axis, result.trace["t_s"][1:], nis, color=color_of(result, name), linewidth=0.7, label=f"'{name}'")
        if bound is not None:
            axis.axhline(bound, color=drawing.OTHER, linestyle="--", linewidth=1.0, label="95 % bound")
        axis.set_ylabel("NIS")
        finite = nis[np.isfinite(nis)]
        axis.set_ylim(0.0, limit)
        if finite.size:
            beyond = int(np.sum(finite > limit))
            clipped = f", {beyond} values above the axis range, the largest {finite.max():.3g}" if beyond else ""
            above = (
                "" if bound is None else f", above the bound {bound:.2f} in {np.mean(finite > bound):.1%} of the ticks"
            )
            words.append(f"'{name}': mean {finite.mean():.2f}{above}{clipped}.")
    return " ".join(words)


def reconstruction(axes: list[Axes], result: Result) -> str:
    """Draw each reconstructed input and its true value; return the RMS and largest errors in words."""
    trace, words = result.trace, []
    of_gust = {e.name: getattr(e, "unknown", "") == "gust" for e in result.plan.scenario.estimators}
    for axis, name in zip(axes, reconstruction_names(result), strict=True):
        label, column = ("gust", "gust_alpha_deg") if of_gust[name] else ("elevator", "elevator_acting_deg")
        found, truth = trace[f"{name}.reconstructed_deg"], trace[column]
        drawing.line(axis, trace["t_s"], truth, color=drawing.TRUTH, linewidth=2.0, label="truth")
        if not of_gust[name]:
            drawing.line(
                axis, trace["t_s"], trace["elevator_deg"], color=drawing.OTHER, linewidth=1.0, label="position"
            )
        drawing.line(axis, trace["t_s"], found, color=color_of(result, name), linewidth=0.7, label=f"'{name}'")
        finite = truth[np.isfinite(truth)]
        margin = 0.5 * float(np.ptp(finite)) + 0.5  # for transients of the reconstruction beyond the range of the truth
        axis.set_ylim(finite.min() - margin, finite.max() + margin)
        axis.set_ylabel(f"{label}, deg")
        error = (found - truth)[np.isfinite(found - truth)]
        rms = float(np.sqrt(np.mean(error**2))) if error.size else None
        words.append(
            f"'{name}': RMS error {number(rms, '.3f', ' deg')}, largest {number(np.abs(error).max(), '.2f', ' deg')}."
        )
    return " ".join(words)


def sigma(axes: list[Axes], result: Result) -> str:
    """Draw each estimate's standard deviation of K, one surface per axes, and the elevator's bound; return medians in words."""
    trace, words = result.trace, []
    t, bound, surfaces = trace["t_s"], trace.columns.get("effectiveness_bound"), estimated_surfaces(result)
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
    for name in estimates_with(result, "effectiveness"):
        std = trace[f"{name}.effectiveness_std"]
        axis = axes[surfaces.index(surface_of(name))]
        drawing.line(axis, t, np.where(std > 0.0, std, np.nan), color=color_of(result, name), label=f"'{name}'")
        words.append(f"'{name}': median sigma {number(float(np.median(std)), '.2g')}.")
    if bound is not None:
        words.append(f"Bound: median {number(float(np.median(bound)), '.2g')}.")
    for axis in axes:
        if any(np.any(np.asarray(line.get_ydata()) > 0.0) for line in axis.lines):
            axis.set_yscale("log")
            axis.yaxis.set_major_formatter(
                "{x:g}"
            )  # plain numbers, because matplotlib's mathtext for powers of ten is slow to load
            axis.yaxis.set_minor_formatter("")
        axis.set_ylim(top=3.0)
        axis.set_ylabel("sigma of K")
    return " ".join(words)
