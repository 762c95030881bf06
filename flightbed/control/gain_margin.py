"""Stability margin of a law against errors of the estimated effectiveness that it was designed with (Wu and others 2000, S 4).

The loop is M(gamma) = A - B (I + diag gamma) F, W eq (41). Its margin, W eq (46), is the largest eps for which M is stable for all
|gamma_i - gamma-hat_i| <= w_i eps. The coefficients of its characteristic polynomial are multilinear in gamma, eq (45), as the
mapping theorem requires (Bhattacharyya, Chapellat and Keel 1995, ch. 11): over a box of gamma they lie in the convex hull of their values
at the corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
import numpy.typing as npt

from flightbed.control.lq import spectral_radius
from flightbed.core.errors import DesignError

Array = npt.NDArray[np.float64]

_ON_CIRCLE = 1e-5  # largest distance from the unit circle of a computed eigenvalue that counts as on it; a double root moves by sqrt(eps)
_RAYS = 33  # grid points along each edge of a face of the box
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)


@dataclass(frozen=True, eq=False)
class Margin:
    """Lower and upper bound of the margin.

    Attributes:
        smallest: the loop is stable in the whole box of this eps, by the mapping theorem; 0 without margin.
        largest: eps at which an eigenvalue reaches the unit circle; infinite if none does up to the limit of the search.
        gamma: (l,), point at which it reaches the circle; nan if there is none.

    """

    smallest: float
    largest: float
    gamma: Array


def first_crossing(M0: Array, M1: Array, limit: float = np.inf) -> float:
    """Return the least t > 0 at which M0 + t M1 has an eigenvalue on the unit circle; infinite if there is none up to the limit.

    No search is needed: t solves det(M +- I) = 0, linear in t, or det(C(M) - I) = 0, quadratic in t, where C(M) is the second compound
    matrix; its eigenvalues are the products of two different eigenvalues of M (a complex pair on the circle has the product 1).

    Args:
        M0: (n, n), stable: eigenvalues inside the unit circle.
        M1: (n, n).
        limit: of t.

    """
    n = len(M0)
    one = np.eye(n)
    found = [*_pencil(M0 - one, M1), *_pencil(M0 + one, M1)]
    if n > 1:
        whole, start, end = _compound(M0 + M1), _compound(M0), _compound(M1)
        size = len(start)
        zero, identity = np.zeros((size, size)), np.eye(size)
        # (start - I) + t middle + t^2 end = 0 as a pencil of twice the size
        first = np.block([[zero, identity], [start - identity, whole - start - end]])
        found += _pencil(first, np.block([[-identity, zero], [zero, end]]))
    for t in sorted(found):
        if t > limit:
            break
        if np.min(np.abs(np.abs(np.linalg.eigvals(M0 + t * M1)) - 1.0)) < _ON_CIRCLE:
            return t
    return np.inf


def _pencil(X: Array, Y: Array) -> list[float]:
    """Return the real positive t with det(X + t Y) = 0."""
    from scipy.linalg import eigvals  # slow to import

    alpha, beta = eigvals(X, -Y, homogeneous_eigvals=True)
    finite = np.abs(beta) > 1e-13 * np.abs(alpha)
    t = alpha[finite] / beta[finite]
    near = np.abs(t.imag) <= _ON_CIRCLE * np.abs(t)
    return [float(x) for x in t.real[near] if x > 0.0]


def _compound(M: Array) -> Array:
    """Return the second compound matrix: all 2 x 2 minors, pairs of rows and of columns in order."""
    rows, columns = np.triu_indices(len(M), 1)
    return M[np.ix_(rows, rows)] * M[np.ix_(columns, columns)] - M[np.ix_(rows, columns)] * M[np.ix_(columns, rows)]


def stability_margin(
    A: Array,
    B: Array,
    F: Array,
    gamma: Array,
    *,
    weights: Array | None = None,
    limit: float = 10.0,
    tolerance: float = 1e-3,
) -> Margin:
    """Return the margin of W eq (46) around an estimate.

    With one input, ``largest`` is the margin itself: an eigenvalue of a fixed matrix pencil, to its numerical precision. With several
    inputs, the first crossing on each straight line from the estimate is such an eigenvalue; a grid on the faces of the box and a
    golden-section search around its best point find the line with the earliest crossing. The mapping theorem proves that the box of
    ``smallest`` = (1 - tolerance) ``largest`` has no unstable point between the lines; boxes that the theorem does not decide are
    divided. If a corner of a part is unstable, the search continues from the line through this corner.

    Args:
        A, B: (n, n) and (n, l), of the healthy system over a sample.
        F: (l, n), of the law u = -F x.
        gamma: (l,), the estimate that F was designed with.
        weights: (l,), w, not negative, deviation of each input at eps = 1; ones if None. 0: the input's effectiveness is known.
        limit: largest eps considered.
        tolerance: relative difference of ``smallest`` and ``largest``.

    Raises:
        DesignError: the mapping theorem does not prove the margin to this tolerance at the finest division of the box.

    """
    w = np.ones(len(gamma)) if weights is None else np.asarray(weights, dtype=np.float64)
    M0 = A - B @ ((1.0 + gamma)[:, None] * F)
    directions = [-w[i] * np.outer(B[:, i], F[i]) for i in range(len(w))]
    active = [i for i, E in enumerate(directions) if np.any(E)]
    nowhere = np.full(len(gamma), np.nan)
    if spectral_radius(M0) >= 1.0:
        return Margin(0.0, 0.0, np.array(gamma))
    if not active:
        return Margin(limit, np.inf, nowhere)
    E = np.array([directions[i] for i in active])
    crossing, at = _search(M0, E, limit)
    while True:
        reach = limit if np.isinf(crossing) else crossing
        proved = (1.0 - tolerance) * reach
        unstable = _prove(M0, E, proved, tolerance * reach / 16.0)
        if unstable is None:
            break
        size = float(np.max(np.abs(unstable)))
        t = first_crossing(M0, np.tensordot(unstable / size, E, 1), size)
        crossing, at = min(t, size), unstable / size
    point = nowhere
    if np.isfinite(crossing):
        point = np.array(gamma, dtype=np.float64)
        point[active] += crossing * at * w[active]
    return Margin(proved, crossing, point)


def _search(M0: Array, E: Array, limit: float) -> tuple[float, Array]:
    """Return the first crossing over the lines through the faces of the unit box, and the line's point on its face."""
    inputs = len(E)

    def crossing(point: Array) -> float:
        return first_crossing(M0, np.tensordot(point, E, 1), limit)

    grid = np.linspace(-1.0, 1.0, _RAYS)
    best, at = np.inf, np.ones(inputs)
    for face, side in product(range(inputs), (-1.0, 1.0)):
        for inside in product(grid, repeat=inputs - 1):
            point = np.insert(np.array(inside), face, side)
            found = crossing(point)
            if found < best:
                best, at = found, point
    face = int(np.argmax(np.abs(at)))
    for axis in (i for i in range(inputs) if i != face and np.isfinite(best)):
        low, high = max(-1.0, at[axis] - 2.0 / (_RAYS - 1)), min(1.0, at[axis] + 2.0 / (_RAYS - 1))
        for _ in range(40):
            thirds = [high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)]
            tried = []
            for value in thirds:
                point = at.copy()
                point[axis] = value
                tried.append(crossing(point))
            low, high = (low, thirds[1]) if tried[0] < tried[1] else (thirds[0], high)
            if min(tried) < best:
                best = min(tried)
                at = at.copy()
                at[axis] = thirds[int(np.argmin(tried))]
    return best, at


def _prove(M0: Array, E: Array, eps: float, finest: float) -> Array | None:
    """Prove that the box of half width eps is stable and return None, or return an unstable point inside it.

    Raises:
        DesignError: the theorem does not decide a part of half width ``finest``.

    """
    inputs = len(E)
    corners = np.array(list(product((-1.0, 1.0), repeat=inputs)))
    boxes = [(np.zeros(inputs), np.full(inputs, eps))]
    while boxes:
        center, half = boxes.pop()
        points = center + corners * half
        matrices = [M0 + np.tensordot(p, E, 1) for p in points]
        for point, M in zip(points, matrices, strict=True):
            if spectral_radius(M) >= 1.0:
                return np.asarray(point, dtype=np.float64)
        if _hull_is_stable(matrices):
            continue
        widest = int(np.argmax(half))
        if half[widest] < finest:
            place = ", ".join(f"{x:.4g}" for x in center)
            raise DesignError(
                f"stability margin: not proved around ({place}) from the estimate; ask for a larger tolerance"
            )
        half = half.copy()
        half[widest] *= 0.5
        for side in (-1.0, 1.0):
            shifted = center.copy()
            shifted[widest] += side * half[widest]
            boxes.append((shifted, half))
    return None


def _hull_is_stable(matrices: list[Array]) -> bool:
    """Return whether the convex hull of the characteristic polynomials of stable matrices is stable.

    It is stable if every segment between two of them is stable (edge theorem).
    """
    companions = [_companion(np.poly(M).astype(np.float64)) for M in matrices]
    return all(np.isinf(first_crossing(p, q - p, 1.0)) for p, q in combinations(companions, 2))


def _companion(polynomial: Array) -> Array:
    n = len(polynomial) - 1
    companion = np.eye(n, k=-1)
    companion[0] = -polynomial[1:]
    return companion
