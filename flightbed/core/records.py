"""Named records on flat float64 arrays: a flat array crosses the border to compiled code fastest, and inside its numbers have names."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from flightbed.core.compiled import PLAIN, Array


def layout(names: Iterable[str]) -> np.dtype[Any]:
    """Return the dtype of a record of float64 fields with these names."""
    return np.dtype([(name, "f8") for name in names])


def size(record: np.dtype[Any]) -> int:
    """Return the number of floats in a record."""
    return record.itemsize // 8


def packed(record: np.dtype[Any], **values: float) -> Array:
    """Return one record as a flat array, (n,), from values by name; the others are 0. Raises ValueError for an unknown name."""
    names = record.names or ()
    if unknown := values.keys() - set(names):
        raise ValueError(f"the record has no fields {', '.join(sorted(unknown))}")
    return np.array([values.get(name, 0.0) for name in names], dtype=np.float64)


def records(store: Array, record: np.dtype[Any]) -> Any:
    """Return a contiguous array as an array of records, without a copy; also in compiled code.

    Args:
        store: (n,), n a multiple of the record's number of floats.
        record: as from ``layout``.

    """
    return store.view(record).view(np.recarray)


if not PLAIN:
    from numba.extending import overload

    @overload(records)
    def _compiled_records(store: Any, record: Any) -> Callable[..., Any]:  # noqa: ARG001
        def view(store: Any, record: Any) -> Any:
            return store.view(record)

        return view
