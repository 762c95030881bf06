"""Plots of the kinds that the thesis shows, drawn from the columns of a flight: responses, estimates of K, tracking."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flightbed.analysis.seeds import Flown
from flightbed.document import drawing
from flightbed.scenario.reading import Scenario
from flightbed.studies.sillence import printed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Vector = npt.NDArray[np.float64]
Draw = Callable[["list[Axes]", "Sequence[Flown]"], str]

TIME = "t_s"
BASIC = (TIME, "q_deg_s", "q_ref_deg_s", "q_cmd_deg_s", "alpha_deg", "effectiveness_true")
NOISES = MappingProxyType(
    {text: (alpha, q) for q, alpha, text in printed.TABLE_1}
)  # SNR, dB -> standard deviations, deg, deg/s


@dataclass(frozen=True)
class Figure:
    """One figure of the thesis.

    Attributes:
        number: number in the thesis.
        title: title without the number.
        parameters: parameters of the flights, as a sentence.
        scenarios: scenarios to fly, once each (seed 0).
        columns: trace columns that the figure needs of each flight.
        rows: number of axes, one above the other.
        draw: draws on the axes and returns computed facts as sentences.

    """

    number: int
    title: str
    parameters: str
    scenarios: Sequence[Scenario]
    columns: tuple[str, ...]
    rows: int
    draw: Draw


def noise_words(snr: str, *more: str) -> str:
    """Return the parameters of a figure as a sentence that ends with the noise of row ``snr`` of Table 1."""
    alpha, q = NOISES[snr]
    return "; ".join([*more, f"sigma_q {q:g} deg/s, sigma_alpha {alpha:g} deg, SNR {snr} dB"]) + "."


def columns_of(estimator: str) -> tuple[str, ...]:
    """Return the trace columns of an estimator that the figures use."""
    return tuple(
        f"{estimator}.{c}"
        for c in (
            "effectiveness",
            "effectiveness_raw",
            "effectiveness_std",
            "effectiveness_smoothed",
            "alpha_deg",
            "q_deg_s",
        )
    )


def response(
    axes: Sequence[Axes], flown: Flown, *, failed_at_s: float | None = printed.FAILED_AT_S, label: str = "q"
) -> None:
    """Draw pitch rate and reference, deg/s, on the first axis, and alpha, deg, on the second axis if present."""
    t = flown.columns[TIME]
    axes[0].plot(t, flown.columns["q_ref_deg_s"], color=drawing.REFERENCE, label="reference")
    axes[0].plot(t, flown.columns["q_deg_s"], color=drawing.ACTUAL, label=label)
    axes[0].set_ylabel("pitch rate, deg/s")
    drawing.legend(axes[0])
    if len(axes) > 1:
        axes[1].plot(t, flown.columns["alpha_deg"], color=drawing.ACTUAL)
        axes[1].set_ylabel("alpha, deg")
    for axis in axes:
        drawing.mark(axis, failed_at_s)
    axes[-1].set_xlabel("time, s")


def gain(axes: Axes, flown: Flown, lines: Sequence[tuple[str, str, str]], *, band: float | None = None) -> None:
    """Draw estimates of K and the true K.

    Args:
        axes: axes to draw on.
        flown: the flight.
        lines: (column, label, colour) of each estimate.
        band: K_1 of a band of +-20 % to draw; None draws no band.

    """
    t, truth = flown.columns[TIME], flown.columns["effectiveness_true"]
    for column, label, color in lines:
        axes.plot(t, flown.columns[column], color=color, label=label)
    axes.plot(t, truth, color=drawing.TRUTH, label="true", linewidth=1.4)
    if band is not None:
        for factor in (0.8, 1.2):
            axes.axhline(factor * band, color=drawing.OTHER, linestyle="--", linewidth=0.8)
    shown = np.concatenate([flown.columns[column][t > 0.3] for column, _, _ in lines])
    low, high = float(np.min(shown)), float(np.max(shown))
    axes.set_ylim(max(-3.0, min(-0.1, low - 0.05)), min(6.0, max(1.2, high + 0.05)))
    axes.set_ylabel("K")
    axes.set_xlabel("time, s")
    drawing.legend(axes)
    drawing.mark(axes, printed.FAILED_AT_S)


def error_words(flown: Flown, column: str, name: str) -> str:
    """Return the RMS error of an estimate before and after the failure, as a sentence."""
    t = flown.columns[TIME]
    error = flown.columns[column] - flown.columns["effectiveness_true"]
    before = error[(t > 0.3) & (t < printed.FAILED_AT_S)]
    after = error[t >= printed.FAILED_AT_S + 0.3 - 1e-9]
    return f"{name}: RMS error {np.sqrt(np.mean(before**2)):.3f} before, {np.sqrt(np.mean(after**2)):.3f} from 0.3 s after the failure."
