"""Options: settings of external code, an immutable mapping of TOML values (text, numbers, booleans, lists)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite
from types import MappingProxyType
from typing import Any


class Options(Mapping[str, Any]):
    """A free-form table of a scenario: immutable, hashable, compared by value, picklable.

    Args:
        values: name -> text, number, boolean, or a list of these; lists are stored as tuples.

    """

    __slots__ = ("_values",)

    def __init__(self, values: Mapping[str, Any] = MappingProxyType({})) -> None:
        self._values = {name: _frozen(value) for name, value in values.items()}

    def __getitem__(self, name: str) -> Any:
        try:
            return self._values[name]
        except KeyError:
            raise KeyError(f"no option {name}; options: {', '.join(self._values) or 'none'}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __hash__(self) -> int:
        return hash(frozenset(self._values.items()))

    def __repr__(self) -> str:
        return f"Options({self._values!r})"


def is_option(value: object) -> bool:
    """Return whether a value is valid as an option: text, a finite number, a boolean, or a list of these."""
    if isinstance(value, list | tuple):
        return all(is_option(inner) for inner in value)
    return isinstance(value, str | bool | int) or (isinstance(value, float) and isfinite(value))


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value
