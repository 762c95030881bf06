"""Figures 23 to 47: estimates of K, and tracking with the law corrected by them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flightbed.analysis.seeds import Flown
from flightbed.document import drawing
from flightbed.scenario.reading import Scenario
from flightbed.studies.sillence import plots, printed, setup
from flightbed.studies.sillence.measures import SETTLED_S, peak, tracking
from flightbed.studies.sillence.plots import BASIC, NOISES, TIME, Figure, columns_of, noise_words
from flightbed.studies.sillence.setup import EXPANDING, FAST, WINDOW, estimator, thesis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PI = "proportional-integral"


def _window(scenario: dict[str, Any], *, bounded: bool = False) -> Scenario:
    bounds: dict[str, Any] = {"bounds": (0.0, 1.0)} if bounded else {}
    filters = [estimator(WINDOW, **bounds), estimator(EXPANDING, "expanding"), estimator(FAST, smoothing=0.7)]
    return thesis(estimators=filters, **scenario)


def estimates() -> Iterator[Figure]:
    """Figures 23 to 39: estimates of K with a fixed law."""
    for i, left in enumerate(printed.GAINS_LEFT):
        yield Figure(
            23 + i, f"K, expanding horizon, K_1 = {left:g}", noise_words("37.227", f"K_1 = {left:g}", "fixed proportional-integral law"),
            [thesis(left=left, law=_PI)], (*BASIC, *columns_of(EXPANDING)), 1, _draw_expanding,
        )  # fmt: skip
    at_06 = {"left": 0.6, "law": _PI}
    words = noise_words("37.227", "K_1 = 0.6", "fixed proportional-integral law")
    for number, title, rows, draw in (
        (28, "expanding horizon against moving window", 1, _draw_against),
        (29, "the command and the moving window's estimate", 2, _draw_with_command),
        (30, "delay of the smoothed estimates", 1, _draw_smoothings),
        (31, "raw and smoothed estimates of the moving window", 1, _draw_smoothed),
        (34, "two sigma around the moving window's estimate", 1, _draw_two_sigma),
    ):
        yield Figure(number, title, words, [_window(at_06)], _ALL, rows, draw)
    for number, snr, bounded in (
        (32, "53.286", False), (33, "23.29", False), (35, "23.29", True), (36, "40", False), (37, "40", True),
        (38, "60", False), (39, "60", True),
    ):  # fmt: skip
        yield Figure(
            number, f"moving window at {snr} dB, {'bounded to 0 .. 1' if bounded else 'unbounded'}",
            noise_words(snr, "K_1 = 0.2", "fixed proportional-integral law", "smoothing 0.9"),
            [_window({"left": 0.2, "law": _PI, "noise": NOISES[snr]}, bounded=bounded)], _ALL, 1, _draw_smoothed,
        )  # fmt: skip


_ALL = (*BASIC, *columns_of(WINDOW), *columns_of(EXPANDING), *columns_of(FAST))
_RAW, _SMOOTH = f"{WINDOW}.effectiveness", f"{WINDOW}.effectiveness_smoothed"


def _effectiveness_after(flown: Flown) -> float:
    return float(flown.columns["effectiveness_true"][-1])


def _entry_words(flown: Flown, *columns: tuple[str, str]) -> str:
    words = []
    for column, name in columns:
        c = flown.columns
        late = c[TIME] >= printed.FAILED_AT_S - 1e-9
        inside = np.flatnonzero(
            late & (np.abs(c[column] - _effectiveness_after(flown)) <= 0.2 * _effectiveness_after(flown))
        )
        words.append(
            f"{name} within 20 % after "
            + (f"{c[TIME][inside[0]] - printed.FAILED_AT_S:.2f} s" if inside.size else "never")
        )
    return "; ".join(words) + "."


def _draw_expanding(axes: list[Axes], flown: Sequence[Flown]) -> str:
    column = f"{EXPANDING}.effectiveness"
    plots.gain(axes[0], flown[0], [(column, "expanding horizon", drawing.ACTUAL)], band=_effectiveness_after(flown[0]))
    return f"K-hat at the end {flown[0].columns[column][-1]:.4f}; " + _entry_words(flown[0], (column, "K-hat"))


def _draw_against(axes: list[Axes], flown: Sequence[Flown]) -> str:
    lines = [
        (_RAW, "moving window", drawing.COMMAND),
        (f"{EXPANDING}.effectiveness", "expanding horizon", drawing.ACTUAL),
    ]
    plots.gain(axes[0], flown[0], lines, band=_effectiveness_after(flown[0]))
    return _entry_words(flown[0], (lines[0][0], "window"), (lines[1][0], "expanding horizon"))


def _draw_with_command(axes: list[Axes], flown: Sequence[Flown]) -> str:
    plots.response(axes[:1], flown[0])
    plots.gain(axes[1], flown[0], [(_RAW, "moving window", drawing.COMMAND)])
    c = flown[0].columns
    quiet = (c[TIME] >= 14.5) & (c[TIME] <= 16.0)
    busy = (c[TIME] >= 5.0) & (c[TIME] <= 13.5)
    error = c[_RAW] - c["effectiveness_true"]
    return (
        f"RMS error {np.sqrt(np.mean(error[quiet] ** 2)):.3f} from 14.5 to 16 s, {np.sqrt(np.mean(error[busy] ** 2)):.3f} during the "
        f"doublets after the failure: {'worse' if np.mean(error[quiet] ** 2) > np.mean(error[busy] ** 2) else 'better'} where little is "
        "commanded; in the thesis it is worse."
    )


def _draw_smoothings(axes: list[Axes], flown: Sequence[Flown]) -> str:
    lines = [
        (_RAW, "raw", drawing.OTHER), (f"{FAST}.effectiveness_smoothed", "0.7", drawing.COMMAND), (_SMOOTH, "0.9", drawing.ACTUAL),
    ]  # fmt: skip
    plots.gain(axes[0], flown[0], lines, band=_effectiveness_after(flown[0]))
    axes[0].set_xlim(4.3, 5.5)
    return _entry_words(flown[0], (lines[0][0], "raw"), (lines[1][0], "smoothing 0.7"), (lines[2][0], "smoothing 0.9"))


def _draw_smoothed(axes: list[Axes], flown: Sequence[Flown]) -> str:
    plots.gain(
        axes[0],
        flown[0],
        [(_RAW, "window", drawing.OTHER), (_SMOOTH, "smoothed", drawing.ACTUAL)],
        band=_effectiveness_after(flown[0]),
    )
    return plots.error_words(flown[0], _RAW, "window") + " " + plots.error_words(flown[0], _SMOOTH, "smoothed")


def _draw_two_sigma(axes: list[Axes], flown: Sequence[Flown]) -> str:
    c = flown[0].columns
    std = c[f"{WINDOW}.effectiveness_std"]
    plots.gain(axes[0], flown[0], [(_RAW, "window", drawing.ACTUAL)])
    axes[0].fill_between(
        c[TIME],
        c["effectiveness_true"] - 2.0 * std,
        c["effectiveness_true"] + 2.0 * std,
        color=drawing.TRUTH,
        alpha=0.2,
        linewidth=0,
    )
    outside = np.abs(c[_RAW] - c["effectiveness_true"]) > 2.0 * std
    mixed = (c[TIME] >= printed.FAILED_AT_S) & (c[TIME] < printed.FAILED_AT_S + 0.3)
    return (
        f"{np.mean(~outside[~mixed & (c[TIME] > 0.3)]):.1%} of the estimates lie within two sigma, windows that contain the failure "
        f"excluded ({np.mean(~outside[mixed]):.0%} of those). Table 'coverage' gives the reason."
    )


def adaptive() -> Iterator[Figure]:
    """Figures 40 to 47: the law corrected by 1/K-hat."""
    for number, snr, bounded, remark in (
        (40, "23.29", False, ""), (41, "23.29", True, ""), (43, "37.227", True, ""), (45, "40", True, ""),
        (46, "53.286", False, " Unbounded according to its caption, bounded according to S 5.6."), (47, "60", True, ""),
    ):  # fmt: skip
        flown = [setup.adaptive(snr=snr, bounded=bounded, feedback=feedback) for feedback in ("effective", "position")]
        words = noise_words(
            snr, "K_1 = 0.2", "proportional-integral law, fed the window's alpha and q, corrected by its smoothed K-hat",
            "position feedback behind the 1/K, and position feedback multiplied by 1/K"
        )  # fmt: skip
        yield Figure(
            number, f"tracking with adaptation at {snr} dB, {'bounded' if bounded else 'unbounded'}", words + remark,
            [*flown, thesis(left=0.2, law=_PI, noise=NOISES[snr])], BASIC, 1, _draw_adapted,
        )  # fmt: skip
    words = noise_words("37.227", "K_1 = 0.2", "proportional-integral law")
    yield Figure(
        42, "K, moving window, law fixed", words, [_window({"left": 0.2, "law": _PI})], _ALL, 1, _draw_smoothed
    )
    yield Figure(
        44, "K, moving window, law adapted", noise_words("37.227", "K_1 = 0.2", "as Fig. 43, position feedback behind the 1/K"),
        [setup.adaptive()], (*BASIC, *columns_of(WINDOW)), 1, _draw_unbounded,
    )  # fmt: skip


def _draw_unbounded(axes: list[Axes], flown: Sequence[Flown]) -> str:
    raw = f"{WINDOW}.effectiveness_raw"
    plots.gain(
        axes[0],
        flown[0],
        [(raw, "window", drawing.OTHER), (_SMOOTH, "bounded, smoothed", drawing.ACTUAL)],
        band=_effectiveness_after(flown[0]),
    )
    return plots.error_words(flown[0], raw, "window") + " " + plots.error_words(flown[0], _SMOOTH, "bounded, smoothed")


def _draw_adapted(axes: list[Axes], flown: Sequence[Flown]) -> str:
    plots.response(axes, flown[0], label="q, adapted")
    others = (("q, position corrected too", drawing.COMMAND), ("q, fixed", drawing.OTHER))
    for flight, (label, color) in zip(flown[1:], others, strict=True):
        axes[0].plot(flight.columns[TIME], flight.columns["q_deg_s"], color=color, linewidth=0.9, label=label)
    drawing.legend(axes[0])
    rms = [f"{tracking(flight, SETTLED_S):.2f}" for flight in flown]
    largest = [f"{peak(flight):.2f}" for flight in flown]
    return (
        f"RMS of q - reference from 0.3 s after the failure: {rms[0]} deg/s adapted, {rms[1]} with the position corrected too, {rms[2]} "
        f"fixed; largest error until then {largest[0]}, {largest[1]} and {largest[2]} deg/s."
    )
