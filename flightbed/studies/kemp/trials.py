"""Simulations of single runs from a seed and plain arguments, for worker processes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flightbed.control.load_factor.integral_placement import AckermannConfig, IntegralPlacement
from flightbed.estimation.plid.identify import Plid, PlidConfig, Tracking
from flightbed.studies.kemp import methods, plants, printed
from flightbed.studies.kemp.plants import Record

Array = npt.NDArray[np.float64]

LOST = 1e12  # |output| at which a closed loop counts as lost and the run ends
ROUND_OFF = 1e-9  # errors below this are treated as equal
SETTLED = 0.25  # an estimate has settled within this share of |theta| around its value at sample 150


class IdentificationRun(NamedTuple):
    """One run of an identifier on a plant with constant parameters.

    Attributes:
        errors: (marks, 2n) estimated less true parameters at the marks.
        settled: sample from which the estimate stays near its value at sample 150 (or at the last mark, if earlier).
        left_stability: whether C of RML had to be projected into the unit circle.
        largest_output: (marks,) |y| at the marks.

    """

    errors: Array
    settled: int
    left_stability: bool
    largest_output: Array


def identify(seed: int, plant: str, case: int, method: str, marks: tuple[int, ...]) -> IdentificationRun:
    """Identify a plant in a noise case, from rest to the last mark.

    Args:
        seed: seed of input and noises.
        plant: ``"A"`` to ``"D"``.
        case: 1 to 7, see ``printed.NOISES``.
        method: name of the identifier, see ``methods``.
        marks: samples at which the errors are returned, ascending.

    """
    r, q = printed.NOISES[case]
    record = plants.record(plant, r, q, marks[-1] + 1, seed)
    identifier = methods.make(method, record.theta.shape[1] // 2, r, q)
    found = methods.estimates(identifier, record)
    shown = found[: printed.SAMPLES + 1]
    away = np.linalg.norm(shown - shown[-1], axis=1) > SETTLED * np.linalg.norm(record.theta[0])
    settled = int(np.flatnonzero(away)[-1]) + 1 if away.any() else 0
    at = list(marks)
    return IdentificationRun(
        found[at] - record.theta[at], settled, bool(getattr(identifier, "projections", 0)), np.abs(record.y[at])
    )


class Deadbeat(NamedTuple):
    """Time of identification of a plant without noise.

    Attributes:
        found: sample of the largest decrease, by factor, of the largest error of a parameter, errors limited below by ``ROUND_OFF``.
        observable: first sample at which the observability matrix (2.26) of the extended state has full rank; -1 for never.
        error: largest error of a parameter at ``observable``.

    """

    found: int
    observable: int
    error: float


def deadbeat(seed: int, order: int, idle: int) -> Deadbeat:
    """Identify a random minimal plant without noise.

    Args:
        seed: seed of plant and input.
        order: order n of the plant.
        idle: number of first samples with input 0.

    """
    rng = np.random.default_rng(seed)
    theta = random_plant(rng, order)
    u = rng.standard_normal(4 * order + idle)
    u[:idle] = 0.0
    samples = len(u)
    still, many = np.zeros((samples, order)), np.tile(theta, (samples, 1))
    record = Record(many, u, plants.respond(many, u, still, still[:, 0]))
    error = np.max(np.abs(methods.estimates(methods.make(methods.UD, order, 0.0, 0.0), record) - theta), axis=1)
    observable = full_rank_at(record)
    fallen = error[:-1] / np.maximum(error[1:], ROUND_OFF)
    return Deadbeat(int(np.argmax(fallen)) + 1, observable, float(error[observable]))


_PRIME = 2**61 - 1


def full_rank_at(record: Record) -> int:
    """Return the first k at which the observability matrix of the extended state, Kemp eqs (2.26), (2.27), has full rank; -1 for never.

    The entries of the matrix are the numbers of the record. Elimination modulo a large prime gives the rank without round-off; it can only
    underestimate the rank, with a probability of about 1e-17.
    """
    n = record.theta.shape[1] // 2
    y, u = ([_residue(value) for value in column.tolist()] for column in (record.y, record.u))
    pivots: dict[int, list[int]] = {}  # column -> row whose first nonzero entry is a 1 there
    for k in range(len(y)):
        row = [int(i == n - 1 - k) for i in range(n)]
        for column in (y, u):
            row += [column[k - n + i] if k - n + i >= 0 else 0 for i in range(n)]
        for i in range(3 * n):
            if row[i] == 0:
                continue
            if i not in pivots:
                inverse = pow(row[i], -1, _PRIME)
                pivots[i] = [entry * inverse % _PRIME for entry in row]
                break
            factor = row[i]
            row = [(entry - factor * other) % _PRIME for entry, other in zip(row, pivots[i], strict=True)]
        if len(pivots) == 3 * n:
            return k
    return -1


def _residue(value: float) -> int:
    numerator, denominator = value.as_integer_ratio()
    return numerator * pow(denominator, -1, _PRIME) % _PRIME


def random_plant(rng: np.random.Generator, order: int) -> Array:
    """Return the parameters, (2n,), of a random minimal plant: |poles| below 0.9, every zero at least 0.1 from every pole."""
    while True:
        poles, zeros = _roots(rng, order), _roots(rng, order - 1)
        if order == 1 or np.min(np.abs(poles[:, None] - zeros)) > 0.1:
            break
    a = -np.real(np.poly(poles))[:0:-1]
    b = rng.uniform(0.5, 2.0) * np.real(np.atleast_1d(np.poly(zeros)))[::-1]
    return np.concatenate([a, b])


def _roots(rng: np.random.Generator, count: int) -> npt.NDArray[np.complex128]:
    pairs = count // 2
    upper = rng.uniform(0.2, 0.9, pairs) * np.exp(1j * rng.uniform(0.3, 2.8, pairs))
    return np.concatenate([upper, upper.conj(), rng.uniform(-0.9, 0.9, count % 2)])


def track(seed: int, plant: str, case: int, method: str) -> Array:
    """Identify plant E and return the largest error of a parameter at every sample, (N,)."""
    r, q = printed.E_CASES[case]
    record = plants.record(plant, r, q, printed.E_SAMPLES + 1, seed)
    found = methods.estimates(methods.make(method, 3, r, q), record)
    errors: Array = np.max(np.abs(found - record.theta), axis=1)
    return errors


def difference(seed: int, plant: str, case: int) -> float:
    """Identify plant E with PLID and U-D, both with the block fade, and return the largest difference of a parameter at any sample."""
    r, q = printed.E_CASES[case]
    record = plants.record(plant, r, q, printed.E_SAMPLES + 1, seed)
    plain, factored = (methods.estimates(methods.make(m, 3, r, q), record) for m in (methods.BLOCK, methods.UD_BLOCK))
    return float(np.max(np.abs(plain - factored)))


class PrecisionComparison(NamedTuple):
    """Comparison of a form of the filter with U-D in double precision.

    Attributes:
        lost: first sample at which P has a negative eigenvalue; None for never.
        difference: largest difference of a parameter from U-D in double precision at the last sample.

    """

    lost: int | None
    difference: float


def compare_precision(seed: int, method: str, r: float, q: float, samples: int) -> PrecisionComparison:
    """Identify plant A in noises of variances r and q with a form of the filter and with U-D in double precision, and compare."""
    record = plants.record("A", r, q, samples + 1, seed)
    form, reference = (methods.make(name, 3, r, q) for name in (method, methods.UD))
    assert isinstance(form, Plid)
    lost, u_before = None, 0.0
    for k, (y, u) in enumerate(zip(record.y.tolist(), record.u.tolist(), strict=True)):
        form.update(y, u_before)
        reference.update(y, u_before)
        if lost is None and np.linalg.eigvalsh(form.covariance)[0] < 0.0:
            lost = k
        u_before = u
    return PrecisionComparison(lost, float(np.max(np.abs(form.parameters - reference.parameters))))


@dataclass(frozen=True)
class Controller:
    """Settings of the closed loop around plant F.

    Attributes:
        adaptive: whether the gains follow the estimates.
        first: gains (K, K_e) at the start; constant if not adaptive.
        patience: ``patience`` of ``AckermannConfig``.
        limit, learning: limit of |input| during the first ``learning`` samples.
        fade: fade of the tracking PLID.
        prior, prior_var: prior of the tracking PLID; with a variance of 0 for the parameters it is an observer with a fixed model.

    """

    adaptive: bool = True
    first: tuple[float, ...] = (0.0, 0.0, printed.FIRST_INTEGRAL_GAIN)
    patience: int = 0
    limit: float = np.inf
    learning: int = 0
    fade: float = printed.FADE
    prior: tuple[float, ...] = ()
    prior_var: float | tuple[float, ...] = printed.PRIOR_VAR


class LoopRun(NamedTuple):
    """History of one run of a closed loop over N samples; a lost loop ends at the loss.

    Attributes:
        output: (N,) noise-free output x_n.
        input: (N,) input u.
        estimates: (N, 4) estimates of a_0, a_1, b_0, b_1.
        gains: (N, 3) gains (K, K_e).

    """

    output: Array
    input: Array
    estimates: Array
    gains: Array


F_SAMPLES = 400
# Samples of the reference at 1 and at 0 in turn; the thesis gives its sequence neither in words nor in numbers.
HALF_PERIOD = 50


def reference(samples: int) -> Array:
    """Return the reference r(k), (samples,)."""
    return np.where((np.arange(samples) // HALF_PERIOD) % 2 == 0, 1.0, 0.0)


def plant_f(case: int) -> Array:
    """Return the parameters of plant F at every sample, (N, 4)."""
    theta = plants.history("F", F_SAMPLES)
    for at, name in zip(printed.F_CHANGES[case], ("unstable", "last"), strict=False):
        theta[at:, 1] = printed.F_SUMS[name]
    return theta


def control(seed: int, case: int, controller: Controller) -> LoopRun:
    """Simulate the closed loop around plant F, Kemp S 5.4.

    Args:
        seed: seed of the noises.
        case: 1 to 5, see ``printed.ADAPTIVE``.
        controller: settings of the loop.

    """
    r, q, filtered = printed.ADAPTIVE[case]
    theta, reference_ = plant_f(case), reference(F_SAMPLES)
    w, v = plants.noise(np.random.default_rng(seed), F_SAMPLES, 2, r, q)
    law = IntegralPlacement(
        AckermannConfig((printed.POLE[case],) * 3, controller.first, (0, 0, -1), patience=controller.patience)
    )
    config = PlidConfig(
        2,
        process_var=q,
        output_var=r,
        prior=controller.prior,
        prior_var=controller.prior_var,
        tracking=Tracking(controller.fade),
    )
    plid, x, u = Plid(config), np.zeros(2), 0.0
    out = LoopRun(*(np.zeros((F_SAMPLES, *shape)) for shape in ((), (), (4,), (3,))))
    for k in range(F_SAMPLES):
        y = float(x[1] + v[k])
        plid.update(y, u)
        if controller.adaptive:
            law.design(plid.parameters)
        limit = controller.limit if k < controller.learning else np.inf
        state = plid.state
        u = law.demand(state, reference_[k] - (float(state[1]) if filtered else y), (-limit, limit))
        out.output[k], out.input[k], out.estimates[k], out.gains[k] = x[1], u, plid.parameters, law.gains
        plants.advance(x, theta[k], u, w[k])
        if not abs(x[1]) < LOST:
            return LoopRun(*(column[: k + 1] for column in out))
    return out
