"""Figures 3 to 12 and 14 to 47 in the thesis's order; Figures 1, 2 and 13 are sketches of a block diagram and an aircraft."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from flightbed.analysis.seeds import Flown, Job
from flightbed.avionics.short_period import zero_order_hold
from flightbed.control.design import reference_gain
from flightbed.document import drawing
from flightbed.document.document import Picture, Section
from flightbed.models.linear_aircraft import load_linear_aircraft
from flightbed.studies.base import Flights, Part
from flightbed.studies.sillence import plots, printed, setup
from flightbed.studies.sillence.gain_figures import adaptive, estimates
from flightbed.studies.sillence.measures import SETTLED_S, tracking
from flightbed.studies.sillence.plots import BASIC, TIME, Figure, columns_of, noise_words
from flightbed.studies.sillence.setup import EXPANDING, thesis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_P, _PI = "proportional", "proportional-integral"
_QUIET = (1e-9, 1e-9)


def figures() -> Part:
    """Draw all figures, each from one noise draw (seed 0)."""
    wanted = sorted(
        [*_introduction_figures(), *_hold_figures(), *_tracking_figures(), *estimates(), *adaptive()],
        key=lambda f: f.number,
    )
    jobs = [Job(scenario, 1, figure.columns) for figure in wanted for scenario in figure.scenarios]

    def build(flights: Flights) -> Section:
        each, pictures = iter(flights), []
        for figure in wanted:
            flown = [next(each)[0] for _ in figure.scenarios]
            with drawing.canvas(figure.rows, height=1.9 if figure.rows > 1 else 2.6) as (axes, svg):
                facts = figure.draw(axes, flown)
                drawn = drawing.distinct(svg(), f"figure-{figure.number}")
            pictures.append(
                Picture(
                    f"figure-{figure.number}",
                    f"Figure {figure.number}: {figure.title}",
                    drawn,
                    figure.parameters,
                    facts,
                )
            )
        return Section(
            "Figures",
            [
                "Every figure of the thesis that shows a computation, in the thesis's order, from one noise draw (seed 0). The dotted "
                "line marks the failure. SNR as in Table 1.",
            ],
            pictures,
        )

    return Part(jobs, build)


def _introduction_figures() -> Iterator[Figure]:
    """Figures 3 to 6: the loop with and without alpha feedback; 7 to 10: the effect of noise in alpha."""
    design = load_linear_aircraft("sillence").design
    for number, law, word in ((3, _P, "without"), (4, _P, "with"), (5, _PI, "without"), (6, _PI, "with")):
        gains = setup.gains(law)
        if word == "without":
            gains |= {"alpha": 0.0, "reference_s": reference_gain(design, [0.0, gains["q_s"], gains["elevator"]])}
        yield Figure(
            number, f"pitch rate {word} alpha feedback, {law} law",
            f"Nothing fails, no noise; K_alpha {gains['alpha']:g}, K_r {gains['reference_s']:.4f}.",
            [thesis(left=None, law=law, noise=_QUIET, control={"gains": gains})], BASIC, 1, _draw_nominal,
        )  # fmt: skip
    signal = printed.ALPHA_MAX_DEG**2 + printed.Q_MAX_FITTED_DEG_S**2 / abs(np.prod(printed.SNR_POLES))
    for number, alpha_std, rate in ((7, 0.03, False), (8, 0.3, False), (9, 0.03, True), (10, 0.3, True)):
        q_std = sqrt((signal / (2.0 * 10.0**1.861) - alpha_std**2) * abs(np.prod(printed.SNR_POLES)))
        yield Figure(
            number, f"{'pitch rate' if rate else 'alpha'} with a fixed law, sigma_alpha {alpha_std:g} deg",
            f"P law, K = 0.8 from 3 s on; SNR 18.61 dB; the thesis does not print sigma_q: {q_std:.3f} deg/s follows from the weighting "
            "and the largest pitch rate of Table 1.",
            [thesis(left=0.8, at_s=3.0, noise=(alpha_std, q_std)), thesis(left=0.8, at_s=3.0, noise=_QUIET)],
            (*BASIC, "q_meas_deg_s", "alpha_meas_deg"), 1, _draw_noisy_rate if rate else _draw_noisy_alpha,
        )  # fmt: skip


def _draw_nominal(axes: list[Axes], flown: Sequence[Flown]) -> str:
    plots.response(axes, flown[0], failed_at_s=None)
    return f"RMS of q - reference {tracking(flown[0], 0.0):.2f} deg/s."


def _draw_noisy(axes: list[Axes], flown: Sequence[Flown], column: str, measured: str, label: str) -> str:
    noisy, quiet = (f.columns for f in flown)
    axes[0].plot(noisy[TIME], noisy[measured], color=drawing.OTHER, linewidth=0.6, label="measured")
    axes[0].plot(noisy[TIME], noisy[column], color=drawing.ACTUAL, label="flown")
    axes[0].plot(quiet[TIME], quiet[column], color=drawing.REFERENCE, linestyle="--", label="without noise")
    axes[0].set_ylabel(label)
    axes[0].set_xlabel("time, s")
    drawing.legend(axes[0])
    drawing.mark(axes[0], 3.0)
    return f"Effect of the noise on the flight: {np.std(noisy[column] - quiet[column]):.3f} RMS, {label.partition(', ')[2]}."


def _draw_noisy_alpha(axes: list[Axes], flown: Sequence[Flown]) -> str:
    return _draw_noisy(axes, flown, "alpha_deg", "alpha_meas_deg", "alpha, deg")


def _draw_noisy_rate(axes: list[Axes], flown: Sequence[Flown]) -> str:
    return _draw_noisy(axes, flown, "q_deg_s", "q_meas_deg_s", "pitch rate, deg/s")


def _hold_figures() -> Iterator[Figure]:
    yield Figure(
        11,
        "a step response, sampled and held",
        "Response of 3/(s+3) to a step, held for T = 0.1 s.",
        [],
        (),
        1,
        _draw_step_held,
    )
    yield Figure(
        12, "the commanded pitch rate, continuous and held", "The first reversal of the doublets, T = 0.01 s.",
        [thesis(left=None, noise=_QUIET)], BASIC, 1, _draw_command_held,
    )  # fmt: skip


def _draw_step_held(axes: list[Axes], _flown: Sequence[Flown]) -> str:
    T, t = 0.1, np.linspace(0.0, 1.5, 1501)
    y = 1.0 - np.exp(-3.0 * t)
    held = y[(np.floor(t / T + 1e-9) * T * 1000).round().astype(int)]
    # Thesis S 5.1: the mean delay of a zero-order hold is T/2, to first order (2/T)/(s + 2/T).
    lag = zero_order_hold(np.array([[-3.0, 0.0], [2.0 / T, -2.0 / T]]), np.array([3.0, 0.0]), t[1])
    late, x = np.empty_like(t), np.zeros(2)
    for k in range(len(t)):
        late[k] = x[1]
        x = lag.A @ x + lag.b
    axes[0].plot(t, y, color=drawing.REFERENCE, label="continuous")
    axes[0].step(t, held, color=drawing.ACTUAL, label="held", linewidth=0.9)
    axes[0].plot(t, late, color=drawing.COMMAND, label="(2/T)/(s + 2/T)")
    axes[0].set_xlabel("time, s")
    drawing.legend(axes[0])
    behind = float(np.mean(y - held) / np.mean(np.gradient(y, t)))
    return f"The mean delay of the held signal is {1000 * behind:.1f} ms; T/2 is 50 ms."


def _draw_command_held(axes: list[Axes], flown: Sequence[Flown]) -> str:
    t, held = flown[0].columns[TIME], flown[0].columns["q_ref_deg_s"]
    part = (t >= 2.2) & (t <= 2.4)
    fine = np.linspace(2.2, 2.4, 2001)
    at = np.searchsorted(t, 2.25 - 1e-9)
    smooth = np.where(
        fine < 2.25, 10.0 - 10.0 * np.exp(-3.0 * fine), -10.0 + (held[at] + 10.0) * np.exp(-3.0 * (fine - 2.25))
    )
    axes[0].plot(fine, smooth, color=drawing.REFERENCE, label="continuous")
    axes[0].step(t[part], held[part], where="post", color=drawing.ACTUAL, label="held at 100 Hz")
    axes[0].set_ylabel("pitch rate, deg/s")
    axes[0].set_xlabel("time, s")
    drawing.legend(axes[0])
    exact = np.where(
        t < 2.25 - 1e-9, 10.0 - 10.0 * np.exp(-3.0 * t), -10.0 + (held[at] + 10.0) * np.exp(-3.0 * (t - 2.25))
    )
    return f"At the samples both signals agree to {np.max(np.abs(held - exact)[part]):.0e} deg/s."


def _tracking_figures() -> Iterator[Figure]:
    """Figures 14 to 18, 21 and 22: fixed laws after the failure; 19 and 20: estimates of the state."""
    wanted = [(14 + i, left, _PI) for i, left in enumerate(printed.GAINS_LEFT)] + [(21, 0.2, _P), (22, 0.1, _P)]
    for number, left, law in wanted:
        yield Figure(
            number, f"pitch rate and alpha after a loss to K = {left:g}, fixed {law} law", noise_words("37.227", f"K_1 = {left:g}"),
            [thesis(left=left, law=law)], BASIC, 2, _draw_fixed,
        )  # fmt: skip
    for number, left in ((19, 0.8), (20, 0.2)):
        yield Figure(
            number, f"estimates of pitch rate and alpha, K = {left:g}",
            noise_words("37.227", f"K_1 = {left:g}", "fixed proportional-integral law", "expanding horizon"),
            [thesis(left=left, law=_PI)], (*BASIC, *columns_of(EXPANDING)), 2, _draw_states,
        )  # fmt: skip


def _draw_fixed(axes: list[Axes], flown: Sequence[Flown]) -> str:
    plots.response(axes, flown[0])
    return f"RMS of q - reference {tracking(flown[0], SETTLED_S):.2f} deg/s from 0.3 s after the failure."


def _draw_states(axes: list[Axes], flown: Sequence[Flown]) -> str:
    c = flown[0].columns
    words = []
    for axis, column, label in ((axes[0], "q_deg_s", "pitch rate, deg/s"), (axes[1], "alpha_deg", "alpha, deg")):
        axis.plot(c[TIME], c[column], color=drawing.ACTUAL, label="true")
        axis.plot(c[TIME], c[f"{EXPANDING}.{column}"], color=drawing.COMMAND, label="estimate", linestyle="--")
        axis.set_ylabel(label)
        drawing.legend(axis)
        drawing.mark(axis, printed.FAILED_AT_S)
        error, late = c[f"{EXPANDING}.{column}"] - c[column], c[TIME] >= printed.FAILED_AT_S
        words.append(
            f"{label}: largest error {np.max(np.abs(error[late])):.2f} after the failure, {abs(error[-1]):.2f} at the end"
        )
    axes[1].set_xlabel("time, s")
    return "; ".join(words) + "."
