"""Names in a scenario or on the command line -> the code behind them: a built-in table, and entry points of installed packages.

A package adds its own by an entry point in the group ``flightbed.estimators`` (or ``laws``, ``commands``, ``failures``)
that names a factory with the signature of the built-in ones in ``factories.py``; in ``flightbed.studies``, one without arguments that
returns a ``studies.base.Study``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any

from flightbed.errors import UnknownNameError

_BUILT_IN = MappingProxyType(
    {
        "commands": {
            "doublet": "doublet",
            "3-2-1-1": "three_two_one_one",
            "chirp": "chirp",
            "multisine": "multisine",
            "random": "random",
            "dither": "dither",
            "constant": "constant",
            "none": "none",
        },
        "laws": {"proportional": "proportional", "proportional-integral": "proportional_integral"},
        "failures": {
            "effectiveness": "effectiveness",
            "ramp": "ramp",
            "structural": "structural",
            "cg-shift": "cg_shift",
        },
        "estimators": {"loop-gain": "loop_gain", "differentiated-rls": "differentiated_rls"},
        "studies": {"sillence": "flightbed.studies.sillence.study:sillence"},
    }
)

FAMILIES = tuple(_BUILT_IN)


def names(family: str) -> tuple[str, ...]:
    """Return the sorted names of a family."""
    return tuple(sorted({*_BUILT_IN[family], *_installed(family)}))


def factory(family: str, name: str) -> Callable[..., Any]:
    """Return the factory behind a name. Raises UnknownNameError."""
    if name in _BUILT_IN[family]:
        module, _, attribute = _BUILT_IN[family][name].rpartition(":")
        built_in: Callable[..., Any] = getattr(import_module(module or "flightbed.factories"), attribute)
        return built_in
    if name in _installed(family):
        loaded: Callable[..., Any] = _installed(family)[name].load()
        return loaded
    raise UnknownNameError("study" if family == "studies" else family.removesuffix("s"), name, names(family))


def summary(family: str, name: str) -> str:
    """Return the first line of a factory's docstring."""
    return (factory(family, name).__doc__ or "").strip().partition("\n")[0]


@cache
def _installed(family: str) -> dict[str, Any]:
    return {entry.name: entry for entry in entry_points(group=f"flightbed.{family}")}
