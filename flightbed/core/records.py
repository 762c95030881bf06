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


def record(store: Array, at: int, record: np.dtype[Any]) -> Any:
    """Return the record that begins at an index of a contiguous array, without a copy; also in compiled code.

    Compiled, it is a pointer, valid as long as the store: it counts no references, which would cost more than the arithmetic of a tick.
    """
    return store[at : at + size(record)].view(record).view(np.recarray)[0]


if not PLAIN:
    from numba import types
    from numba.extending import intrinsic, overload

    @intrinsic
    def _pointer(_typing: Any, store: Any, at: Any, record: Any) -> Any:  # noqa: ARG001
        kind = record.dtype

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            array = context.make_array(signature.args[0])(context, builder, arguments[0])
            place = builder.gep(array.data, [arguments[1]])
            return builder.bitcast(place, context.get_value_type(kind))

        return kind(store, types.intp, record), generate

    @overload(record)
    def _compiled_record(store: Any, at: Any, record: Any) -> Callable[..., Any]:  # noqa: ARG001
        def point(store: Any, at: Any, record: Any) -> Any:
            return _pointer(store, at, record)  # type: ignore[call-arg]

        return point

    @overload(records)
    def _compiled_records(store: Any, record: Any) -> Callable[..., Any]:  # noqa: ARG001
        def view(store: Any, record: Any) -> Any:
            return store.view(record)

        return view
