"""Options: settings of code that is not flightbed's, an immutable mapping of what TOML has: text, numbers, true and false, lists."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite
from types import MappingProxyType
from typing import Any


class Options(Mapping[str, Any]):
    """A free-form table of a scenario, frozen: hashable, equal by value, and the same in another process.

    Args:
        values: name -> text, number, true or false, or a list of these; lists are kept as tuples.

    """

    __slots__ = ("_values",)

    def __init__(self, values: Mapping[str, Any] = MappingProxyType({})) -> None:
        self._values = {name: _frozen(value) for name, value in values.items()}

    def __getitem__(self, name: str) -> Any:
        try:
            return self._values[name]
        except KeyError:
            raise KeyError(f"there is no option {name}; there is: {', '.join(self._values) or 'none'}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __hash__(self) -> int:
        return hash(frozenset(self._values.items()))

    def __repr__(self) -> str:
        return f"Options({self._values!r})"


def is_option(value: object) -> bool:
    """Tell whether a value may be an option."""
    if isinstance(value, list | tuple):
        return all(is_option(inner) for inner in value)
    return isinstance(value, str | bool | int) or (isinstance(value, float) and isfinite(value))


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value
