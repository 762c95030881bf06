"""Mean and standard deviation of histories over flights that are not kept: no bit of them depends on who flew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Moments:
    """Of some flights, at every tick at which one still flies.

    Attributes:
        flying: (n,) how many still fly.
        mean: column -> (n,).
        squares: column -> (n,), sum of the squared deviations from the mean.

    """

    flying: npt.NDArray[np.int64]
    mean: Mapping[str, Vector]
    squares: Mapping[str, Vector]

    @classmethod
    def of(cls, columns: Mapping[str, Vector]) -> Moments:
        """Return those of one flight: column -> values, of one length."""
        length = len(next(iter(columns.values())))
        zero = {name: np.zeros(length) for name in columns}
        return cls(
            np.ones(length, dtype=np.int64), {n: np.array(v, dtype=np.float64) for n, v in columns.items()}, zero
        )

    def __add__(self, other: Moments) -> Moments:
        """Return those of both sets of flights (Chan, Golub and LeVeque 1983); the order of adding shows in the last bits."""
        length = max(len(self.flying), len(other.flying))
        a, b = (_padded(m.flying, length).astype(np.int64) for m in (self, other))
        flying = a + b
        mean, squares = {}, {}
        with np.errstate(invalid="ignore", over="ignore"):  # a column may be infinite: then so is its mean, or nan
            for name in self.mean:
                first, second = _padded(self.mean[name], length), _padded(other.mean[name], length)
                # Where only one of them flies its numbers stay as they are.
                change = np.where((a > 0) & (b > 0), second - first, 0.0)
                both = np.where(first == second, first, first + change * (b / flying))  # infinite ones are equal, too
                mean[name] = np.where(a > 0, both, second)
                within = _padded(self.squares[name], length) + _padded(other.squares[name], length)
                squares[name] = within + change**2 * (a * b / flying)
        return Moments(flying, mean, squares)

    def std(self, column: str) -> Vector:
        """Return the standard deviation over the flights (n - 1 in the divisor); 0 where one flies, nan where the mean is infinite."""
        std = np.sqrt(self.squares[column] / np.maximum(self.flying - 1, 1))
        return np.where(np.isfinite(self.mean[column]), std, np.nan)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all of it as arrays by name, for a file."""
        kinds = {"mean": self.mean, "squares": self.squares}
        return {"flying": self.flying, **{f"{kind}/{n}": v for kind, named in kinds.items() for n, v in named.items()}}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Moments:
        """Return what ``arrays`` gave."""
        return cls(arrays["flying"], within(arrays, "mean/"), within(arrays, "squares/"))


def within(arrays: Mapping[str, npt.NDArray[Any]], start: str) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays whose names start so, by the rest of their names."""
    return {name.removeprefix(start): array for name, array in arrays.items() if name.startswith(start)}


def total(parts: Sequence[Moments]) -> Moments:
    """Return the sum of one or more, from the first to the last."""
    whole = parts[0]
    for part in parts[1:]:
        whole = whole + part
    return whole


def _padded(values: npt.NDArray[np.float64] | npt.NDArray[np.int64], length: int) -> Vector:
    return np.pad(values.astype(np.float64), (0, length - len(values)))
