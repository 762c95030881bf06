"""Running mean and standard deviation of histories over flights that are not stored.

The results are equal to the last bit for any distribution of the flights over workers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Moments:
    """Mean and squared deviations of a set of flights, at every tick at which at least one still flies.

    Attributes:
        flying: (n,) number of flights that still fly.
        mean: column -> (n,).
        squares: column -> (n,), sum of the squared deviations from the mean.

    """

    flying: npt.NDArray[np.int64]
    mean: Mapping[str, Vector]
    squares: Mapping[str, Vector]

    @classmethod
    def of(cls, columns: Mapping[str, Vector]) -> Moments:
        """Return the moments of one flight: column -> values (n,)."""
        length = len(next(iter(columns.values())))
        zero = {name: np.zeros(length) for name in columns}
        return cls(
            np.ones(length, dtype=np.int64), {n: np.array(v, dtype=np.float64) for n, v in columns.items()}, zero
        )

    def __add__(self, other: Moments) -> Moments:
        """Return the moments of both sets (Chan, Golub and LeVeque 1983); the last bits depend on the order of addition."""
        length = max(len(self.flying), len(other.flying))
        a, b = (_padded(m.flying, length).astype(np.int64) for m in (self, other))
        flying = a + b
        mean, squares = {}, {}
        with np.errstate(invalid="ignore", over="ignore"):  # the mean of an infinite column is infinite or nan
            for name in self.mean:
                first, second = _padded(self.mean[name], length), _padded(other.mean[name], length)
                # Where only one set still flies, its numbers are unchanged.
                change = np.where((a > 0) & (b > 0), second - first, 0.0)
                both = np.where(
                    first == second, first, first + change * (b / flying)
                )  # equal also if both are infinite
                mean[name] = np.where(a > 0, both, second)
                within = _padded(self.squares[name], length) + _padded(other.squares[name], length)
                squares[name] = within + change**2 * (a * b / flying)
        return Moments(flying, mean, squares)

    def std(self, column: str) -> Vector:
        """Return the standard deviation over the flights (divisor n - 1), (n,); 0 where one flies, nan where the mean is infinite."""
        std = np.sqrt(self.squares[column] / np.maximum(self.flying - 1, 1))
        return np.where(np.isfinite(self.mean[column]), std, np.nan)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all fields as arrays by name, for a file."""
        kinds = {"mean": self.mean, "squares": self.squares}
        return {"flying": self.flying, **{f"{kind}/{n}": v for kind, named in kinds.items() for n, v in named.items()}}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Moments:
        """Return the moments stored by ``arrays``."""
        return cls(arrays["flying"], within(arrays, "mean/"), within(arrays, "squares/"))


def within(arrays: Mapping[str, npt.NDArray[Any]], start: str) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays whose names begin with a prefix, by the rest of their names."""
    return {name.removeprefix(start): array for name, array in arrays.items() if name.startswith(start)}


def total(parts: Sequence[Moments]) -> Moments:
    """Return the sum of one or more sets of moments, added in order."""
    whole = parts[0]
    for part in parts[1:]:
        whole = whole + part
    return whole


def _padded(values: npt.NDArray[np.float64] | npt.NDArray[np.int64], length: int) -> Vector:
    return np.pad(values.astype(np.float64), (0, length - len(values)))
