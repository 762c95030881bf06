"""A linear model with an unknown input, and the observability of this input from the output."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InputModel:
    """x(k+1) = A x(k) + B u(k) + G v(k), y(k) = C x(k): u is unknown, v is known.

    An affine model, such as a schedule at an operating point, has its known part in G v: G = [b | c], v = (elevator, 1).

    Attributes:
        A: (n, n).
        B: (n, m), of the unknown input.
        C: (p, n).
        G: (n, l), of the known input; (n, 0) without one.

    Raises:
        ValueError: the shapes are inconsistent.

    """

    A: Array
    B: Array
    C: Array
    G: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        n = self.A.shape[0]
        if self.G.size == 0:
            object.__setattr__(self, "G", np.zeros((n, 0)))
        for name in ("A", "B", "C", "G"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))
        fits = self.A.shape == (n, n) and self.B.ndim == self.C.ndim == self.G.ndim == 2
        if not fits or self.B.shape[0] != n or self.C.shape[1] != n or self.G.shape[0] != n:
            shapes = ", ".join(f"{name} {getattr(self, name).shape}" for name in ("A", "B", "C", "G"))
            raise ValueError(f"the model needs A (n, n), B (n, m), C (p, n), G (n, l) (got {shapes})")

    @property
    def states(self) -> int:
        """Return n."""
        return int(self.A.shape[0])

    @property
    def inputs(self) -> int:
        """Return m, the number of unknown inputs."""
        return int(self.B.shape[1])

    @property
    def outputs(self) -> int:
        """Return p."""
        return int(self.C.shape[0])

    def markov(self, count: int) -> Array:
        """Return H_i = C A^(i-1) B, i = 1 ... count (Gupta et al. 2012, eq (7)): (count, p, m)."""
        found, row = [], self.C
        for _ in range(count):
            found.append(row @ self.B)
            row = row @ self.A
        return np.array(found).reshape(count, self.outputs, self.inputs)

    def known_part(self, known: Array | None) -> Array:
        """Return G v, (n,); zeros without a known input.

        Raises:
            ValueError: the length of v differs from the number of columns of G.

        """
        v = np.zeros(0) if known is None else np.atleast_1d(np.asarray(known, dtype=np.float64))
        if v.shape != (self.G.shape[1],):
            raise ValueError(f"the known input has {v.size} components, the model's G has {self.G.shape[1]} columns")
        return np.asarray(self.G @ v, dtype=np.float64)


def invariant_zeros(model: InputModel) -> npt.NDArray[np.complex128]:
    """Return the z at which [[A - z I, B], [C, 0]] loses rank, for equal numbers of inputs and outputs; largest modulus first.

    They are the finite generalized eigenvalues of this pencil (Emami-Naeini and Van Dooren, Automatica 18 (1982) 415). The output does
    not show an input at such a frequency; with |z| >= 1 no stable inverse exists, and y does not determine the input.

    Raises:
        ValueError: the numbers of inputs and outputs differ.

    """
    from scipy.linalg import eigvals  # slow to import

    if model.inputs != model.outputs:
        raise ValueError(f"zeros of a square system only: {model.inputs} unknown inputs, {model.outputs} outputs")
    n, m = model.states, model.inputs
    left = np.block([[model.A, model.B], [model.C, np.zeros((m, m))]])
    right = np.zeros_like(left)
    right[:n, :n] = np.eye(n)
    alpha, beta = eigvals(left, right, homogeneous_eigvals=True)
    finite = np.abs(beta) > 1e-6 * np.abs(alpha)
    zeros = alpha[finite] / beta[finite]
    return np.asarray(zeros[np.argsort(-np.abs(zeros))], dtype=np.complex128)
