"""Kinds of pictures that the thesis has: responses, estimates of K, tracking; each from the columns of a flight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flightbed import drawing
from flightbed.ensemble import Flown
from flightbed.scenario import Scenario
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
        number: his.
        title: what it shows.
        parameters: what was flown, in words.
        scenarios: what has to be flown.
        columns: of each flight.
        rows: axes.
        draw: draws on the axes, returns computed facts in words.

    """

    number: int
    title: str
    parameters: str
    scenarios: Sequence[Scenario]
    columns: tuple[str, ...]
    rows: int
    draw: Draw


def noise_words(snr: str, *more: str) -> str:
    """Return the parameters of a figure in words, ended by its noise: a row of Table 1."""
    alpha, q = NOISES[snr]
    return "; ".join([*more, f"sigma_q {q:g} deg/s, sigma_alpha {alpha:g} deg, SNR {snr} dB"]) + "."


def columns_of(estimator: str) -> tuple[str, ...]:
    """Return the columns of an estimator that pictures use."""
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
    """Draw pitch rate against its reference, and alpha if there is a second axis."""
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
    """Draw estimates of K and the truth.

    Args:
        axes: where.
        flown: the flight.
        lines: (column, label, colour) of each.
        band: K_1 of which +-20 % are drawn.

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
    """Return in words how far an estimate is from the truth before and after the failure."""
    t = flown.columns[TIME]
    error = flown.columns[column] - flown.columns["effectiveness_true"]
    before = error[(t > 0.3) & (t < printed.FAILED_AT_S)]
    after = error[t >= printed.FAILED_AT_S + 0.3 - 1e-9]
    return f"{name}: RMS error {np.sqrt(np.mean(before**2)):.3f} before, {np.sqrt(np.mean(after**2)):.3f} from 0.3 s after the failure."
