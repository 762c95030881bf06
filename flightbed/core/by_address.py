"""Compiled functions that are called by their address.

numba copies a called function into its caller and optimizes it there again. A function that is called by its address is compiled once, and
one caller serves all functions with the same arguments and result. The call costs a few nanoseconds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

from flightbed.core.compiled import PLAIN


class ByAddress(NamedTuple):
    """Functions with the same arguments and result.

    Attributes:
        address: compiled function -> its address in this process, as a float, which the records of ``core/records.py`` can hold; compiles
            the function, or loads it from the cache.
        call: (address, *arguments) -> result; for compiled functions, and for plain ones if FLIGHTBED_PLAIN is set.

    """

    address: Callable[[Callable[..., Any]], float]
    call: Callable[..., Any]


def _by_number() -> ByAddress:
    """Return the form of plain Python: a function's address is its number."""
    known: list[Callable[..., Any]] = []

    def address(function: Callable[..., Any]) -> float:
        if function not in known:
            known.append(function)
        return float(known.index(function))

    def call(at: float, *arguments: Any) -> Any:
        return known[int(at)](*arguments)

    return ByAddress(address, call)


if PLAIN:

    def by_address(arguments: Sequence[str], result: str) -> ByAddress:  # noqa: ARG001
        """Return address and call of functions with these arguments and result, as below."""
        return _by_number()

else:
    from numba import types
    from numba.extending import intrinsic

    _TYPES = MappingProxyType(
        {
            "array": types.float64[::1], "matrix": types.float64[:, ::1], "float": types.float64, "int": types.int64, "bool": types.boolean,
            "none": types.none,
        }
    )  # fmt: skip

    def by_address(arguments: Sequence[str], result: str) -> ByAddress:
        """Return address and call of functions with these arguments and result.

        Args:
            arguments: "array" (flat) or "matrix", both contiguous and float64, "float", "int" or "bool", one for each argument.
            result: the same, or "none".

        """
        taken, given = tuple(_TYPES[name] for name in arguments), _TYPES[result]

        @intrinsic
        def call(_typing: Any, at: Any, *values: Any) -> Any:

            def generate(context: Any, builder: Any, signature: Any, given_values: Any) -> Any:
                convention, (address, packed) = context.call_conv, given_values
                types_ = signature.args[1].types
                kind = convention.get_function_type(given, taken)
                whole = builder.fptoui(address, context.get_value_type(types.uint64))
                function = builder.inttoptr(whole, kind.as_pointer())
                each = [
                    context.cast(builder, builder.extract_value(packed, i), actual, wanted)
                    for i, (actual, wanted) in enumerate(zip(types_, taken, strict=True))
                ]
                status, out = convention.call_function(builder, function, given, taken, each)
                with builder.if_then(status.is_error, likely=False):
                    convention.return_status_propagate(builder, status)
                return context.get_dummy_value() if given is types.none else out

            return given(at, types.StarArgTuple.from_types(values)), generate  # type: ignore[no-untyped-call]

        @cache
        def address(function: Callable[..., Any]) -> float:
            dispatcher: Any = function
            dispatcher.compile(taken)
            form = dispatcher.overloads[taken]
            return float(form.library.get_pointer_to_function(form.fndesc.llvm_func_name))

        return ByAddress(address, call)
