"""Worked examples of the thesis's methods: S 2.2 sinusoidal tests, S 2.4 correlated noise, S 4.4 the batch form."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flightbed.analysis.seeds import Flown, Job
from flightbed.avionics.short_period import zero_order_hold
from flightbed.control.design import closed_loop
from flightbed.core.units import DEG
from flightbed.document.document import Section, Table
from flightbed.models.linear_aircraft import load_linear_aircraft
from flightbed.studies.base import Flights, Part
from flightbed.studies.methods.least_squares import difference_noise_covariance, least_squares
from flightbed.studies.methods.record import batch_estimate, estimate_record
from flightbed.studies.methods.sinusoids import phasor, second_order, transfer_function
from flightbed.studies.sillence import printed
from flightbed.studies.sillence.setup import law_gains, thesis

Array = npt.NDArray[np.float64]

_SECOND_ORDER = (2.0, 0.4)  # natural frequency omega_n, rad/s, and damping ratio zeta of the example
_TESTS_RAD_S = (0.5, 4.0, 15.0)
_A, _B, _STD, _SAMPLES = 0.9, 0.5, 0.5, 200  # y+ = a y + b u, standard deviation of the readings, length of a record
_BATCH = 60  # samples of a flight


def examples(runs: int) -> Part:
    """Return the worked examples: ``runs`` records for S 2.4; the first samples of one flight (seed 0) for S 4.4."""
    columns = ("alpha_meas_deg", "q_meas_deg_s", "elevator_mean_meas_deg")
    job = Job(thesis(left=0.4, at_s=0.0), 1, columns)

    def build(flights: Flights) -> Section:
        return Section(
            "Worked examples",
            [
                "S 2.2: one sine test gives natural frequency and damping of a second-order system of unit gain; three sine tests give "
                "the six parameters of a third-order system, here the closed loop of Table 3 from reference to pitch rate. The responses "
                "are simulated exactly, in the steady state, sampled at 100 Hz and free of noise.",
                "S 2.4: in a difference equation written in readings, the noise of each reading enters several rows, so the covariance R "
                "of the residuals is banded. The plain regression is biased, a towards 0, because the same noise enters its regressors. "
                "Weighting by R reduces the scatter and removes nearly all of the bias, which the thesis does not claim: after "
                "whitening, the noise in the regressors is older than the noise of the row. A small bias remains because R is computed "
                "from the plain estimate of a.",
                "S 4.4: the recursion over a record equals one regression for (x_0, K) to round-off, also with process noise if R~ is "
                "the full covariance. The diagonal R~ of the thesis, eqs (76) and (77), is right without process noise only.",
            ],
            [_sine_table(), _regression_table(runs), _batch_table(flights[0][0])],
        )

    return Part([job], build)


class IdentifiedParameter(NamedTuple):
    """A parameter of a known system: name with unit, true value, and the value identified from the sine tests."""

    name: str
    known: float
    found: float


def sine_tests() -> list[IdentifiedParameter]:
    """Identify the second-order example from one sine and the closed loop of Table 3 from three sines."""
    omega_n, zeta = _SECOND_ORDER
    A2 = np.array([[0.0, 1.0], [-(omega_n**2), -2.0 * zeta * omega_n]])
    found = second_order(3.0, _steady(A2, np.array([0.0, omega_n**2]), np.array([1.0, 0.0]), 3.0))
    identified = [IdentifiedParameter("omega_n, rad/s", omega_n, found[0]), IdentifiedParameter("zeta", zeta, found[1])]
    design, gains = load_linear_aircraft("sillence").design, law_gains("proportional")
    A3, (_, b3) = closed_loop(design, gains), design.with_actuator()
    responses = np.array([_steady(A3, b3 * gains.reference, np.array([0.0, 1.0, 0.0]), w) for w in _TESTS_RAD_S])
    H = transfer_function(np.array(_TESTS_RAD_S), responses, order=3)
    poles = np.sort_complex(np.roots(np.append(1.0, -H.a)))
    exact = np.sort_complex(np.linalg.eigvals(A3))
    for i in (2, 1):  # the slow pole, and one pole of the pair
        part = f"pole {2 - i + 1} of the closed loop"
        identified.append(IdentifiedParameter(f"{part}, real, rad/s", float(exact[i].real), float(poles[i].real)))
        if exact[i].imag:
            identified.append(
                IdentifiedParameter(f"{part}, imaginary, rad/s", float(exact[i].imag), float(poles[i].imag))
            )
    gain = float((H.response(np.array([1e-6]))).real[0])
    known = (
        -float(np.array([0.0, 1.0, 0.0]) @ np.linalg.solve(A3, b3)) * gains.reference
    )  # not quite 1, as K_r is rounded
    identified.append(IdentifiedParameter("gain from reference to pitch rate", known, gain))
    return identified


def _steady(A: Array, b: Array, c: Array, omega_rad_s: float) -> complex:
    """Return the phasor of the response to sin(w t), from a simulation after its transient.

    The sine is generated by two states of the simulation, so the response is exact at the samples.
    """
    n, dt = len(b), 0.01
    system = np.zeros((n + 2, n + 2))
    system[:n, :n], system[:n, n] = A, b
    system[n, n + 1], system[n + 1, n] = omega_rad_s, -omega_rad_s
    step = zero_order_hold(system, np.zeros(n + 2), dt).A
    x, y = np.zeros(n + 2), []
    x[n + 1] = 1.0
    samples = 4000
    for _ in range(samples):
        y.append(float(c @ x[:n]))
        x = step @ x
    t: Array = np.arange(samples, dtype=np.float64) * dt
    settled = t >= 25.0
    return phasor(omega_rad_s, t[settled], np.array(y)[settled])


def _sine_table() -> Table:
    rows: list[list[Any]] = [[t.name, t.known, t.found, abs(t.found - t.known)] for t in sine_tests()]
    return Table(
        "sine_tests", "S 2.2: identification from sines", ("parameter", "known", "found", "difference"), rows,
        {"known": ".5f", "found": ".5f", "difference": ".0e"},
        note=f"The second-order system is tested at 3 rad/s, the closed loop at {', '.join(f'{w:g}' for w in _TESTS_RAD_S)} rad/s.",
    )  # fmt: skip


def regressions(runs: int, seed: int = 0) -> tuple[Array, Array]:
    """Estimate (a, b) of y+ = a y + b u from noisy readings, by plain and by weighted regression; (runs, 2) each.

    R of the weighted regression is computed from the plain estimate of a and the known standard deviation of the readings.
    """
    rng = np.random.default_rng(seed)
    u = np.sign(np.sin(0.2 * np.arange(_SAMPLES)))
    y = np.zeros(_SAMPLES + 1)
    for k in range(_SAMPLES):
        y[k + 1] = _A * y[k] + _B * u[k]
    plain, weighted = np.empty((runs, 2)), np.empty((runs, 2))
    for run in range(runs):
        z = y + _STD * rng.standard_normal(_SAMPLES + 1)
        H = np.column_stack([z[:-1], u])
        plain[run], _ = least_squares(H, z[1:], _STD**2 * np.eye(_SAMPLES))
        R = difference_noise_covariance(plain[run, :1], _STD, _SAMPLES)
        weighted[run], _ = least_squares(H, z[1:], R)
    return plain, weighted


def _regression_table(runs: int) -> Table:
    rows: list[list[Any]] = []
    for name, found in zip(("R = sigma^2 I", "R of the readings"), regressions(runs), strict=True):
        for column, (letter, known) in enumerate((("a", _A), ("b", _B))):
            values = found[:, column]
            rows.append(
                [name, letter, known, float(np.mean(values)), float(np.std(values, ddof=1)) if runs > 1 else None]
            )
    return Table(
        "correlated_noise", "S 2.4: regression with and without the noise's correlation",
        ("weight", "parameter", "true", "mean", "scatter"), rows, {"true": ".2f", "mean": ".4f", "scatter": ".4f"},
        note=f"y+ = a y + b u, u = +-1, readings with a standard deviation of {_STD:g}, {_SAMPLES} samples, {runs} records; scatter: "
        "standard deviation of the estimates.",
    )  # fmt: skip


def both_forms(z: Array, u: Array, process: tuple[float, float]) -> tuple[float, float, float]:
    """Return K-hat by recursion, by regression, and the recursion's sigma, over a record of the thesis's experiment.

    Args:
        z: (N, 2) readings of alpha, rad, and pitch rate, rad/s, from the second sample on.
        u: (N,) mean deflection over the period before each reading, rad.
        process: standard deviations of the process noise in the filter: alpha rate, rad/s, and pitch acceleration, rad/s^2.

    """
    discrete = load_linear_aircraft("sillence").design.discrete(100.0)
    settings: dict[str, Array] = {
        "Q": np.diag(np.square(process)) * 0.01**2,
        "R": np.diag([(0.03 * DEG) ** 2, (0.1108 * DEG) ** 2]),
        "u": u,
        "z": z,
        "x0": np.array([0.0, 0.0, 0.8]),
        "P0": np.diag([DEG**2, DEG**2, 0.4]),
    }
    recursion = estimate_record(discrete.A, discrete.b, np.eye(2), **settings)
    theta, _ = batch_estimate(discrete.A, discrete.b, np.eye(2), **settings)
    return float(recursion.effectiveness[-1]), float(theta[2]), float(np.sqrt(recursion.P[-1][2, 2]))


def _batch_table(flown: Flown) -> Table:
    alpha, q, elevator = (flown.columns[c][: _BATCH + 1] * DEG for c in flown.columns)
    rows: list[list[Any]] = []
    for process in ((0.0, 0.0), (0.5 * DEG, 10.0 * DEG)):
        recursive, batch, sigma = both_forms(np.column_stack([alpha, q])[1:], elevator[1:], process)
        rows.append(
            [
                f"{process[0] / DEG:g} deg/s, {process[1] / DEG:g} deg/s^2",
                recursive,
                batch,
                abs(recursive - batch),
                sigma,
            ]
        )
    return Table(
        "batch", "S 4.4: the batch form", ("process noise assumed", "K-hat, recursion", "K-hat, regression", "difference", "sigma"), rows,
        {"K-hat, recursion": ".6f", "K-hat, regression": ".6f", "difference": ".0e", "sigma": ".4f"},
        note=f"The first {_BATCH} samples of a flight with K = 0.4 from the start ({printed.SNR_DB} dB, seed 0), prior 0.8 with a "
        "variance of 0.4.",
    )  # fmt: skip
