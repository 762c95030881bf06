"""Registry of factories by name: built-in, installed as entry points, and permitted by the user.

A package registers a factory by an entry point in the group ``flightbed.estimators`` (or ``laws``, ``commands``, ``failures``); the
factory has the signature of the built-in ones, the functions ``build`` beside the algorithms. A factory in ``flightbed.studies`` takes no
arguments and returns a ``studies.base.Study``. Code that is not installed, ``module:Attribute``, is registered while it is permitted
(``config/own_code.py``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any, Protocol

from flightbed.core.errors import ExtensionError, UnknownNameError

_BUILT_IN = MappingProxyType(
    {
        "commands": {
            "doublet": "flightbed.command.doublet:Doublet",
            "3-2-1-1": "flightbed.command.three_two_one_one:ThreeTwoOneOne",
            "chirp": "flightbed.command.chirp:Chirp",
            "multisine": "flightbed.command.multisine:Multisine",
            "random": "flightbed.command.random:PseudoRandom",
            "dither": "flightbed.command.multisine:Dither",
            "constant": "flightbed.command.constant:Constant",
            "pulse": "flightbed.command.pulses:Pulse",
            "none": "flightbed.command.constant:Silent",
        },
        "laws": {
            "proportional": "flightbed.control.proportional:ProportionalSettings",
            "proportional-integral": "flightbed.control.proportional_integral:ProportionalIntegralSettings",
            "lq": "flightbed.control.redesign:LqSettings",
            "nz-adaptive": "flightbed.control.load_factor.adaptive:NzAdaptiveSettings",
            "nz-scheduled": "flightbed.control.load_factor.scheduled:NzScheduledSettings",
        },
        "failures": {
            "effectiveness": "flightbed.failures.surface:EffectivenessLoss",
            "ramp": "flightbed.failures.surface:Ramp",
            "structural": "flightbed.failures.surface:StructuralDamage",
            "cg-shift": "flightbed.failures.cg_shift:CgShift",
            "stuck": "flightbed.failures.surface:Stuck",
            "floating": "flightbed.failures.surface:Floating",
            "hardover": "flightbed.failures.surface:Hardover",
            "rate-limit": "flightbed.failures.surface:RateLimit",
            "bias": "flightbed.failures.surface:Bias",
        },
        "gusts": {
            "1-cos": "flightbed.plant.gusts:OneMinusCosine",
            "sine": "flightbed.plant.gusts:Sine",
        },
        "estimators": {
            "loop-gain": "flightbed.estimation.loop_gain.estimator:LoopGainSettings",
            "differentiated-rls": "flightbed.estimation.differentiated_rls:DifferentiatedRlsSettings",
            "two-stage": "flightbed.estimation.two_stage.estimator:TwoStageSettings",
            "plid": "flightbed.estimation.plid.estimator:PlidSettings",
            "retrospective-cost": "flightbed.estimation.reconstruction.kinds:RetrospectiveCostSettings",
            "input-kalman": "flightbed.estimation.reconstruction.kinds:InputKalmanSettings",
        },
        "studies": {
            "estimators": "flightbed.studies.estimators.study:estimators",
            "gupta": "flightbed.studies.gupta.study:gupta",
            "kemp": "flightbed.studies.kemp.study:kemp",
            "sillence": "flightbed.studies.sillence.study:sillence",
            "wu": "flightbed.studies.wu.study:wu",
        },
    }
)

FAMILIES = tuple(_BUILT_IN)


class Permitted(Protocol):
    """Code from outside the package that is permitted: see ``own_code.Extension``."""

    @property
    def name(self) -> str:
        """Name by which scenarios refer to it."""

    @property
    def factory(self) -> Callable[..., Any]:
        """The class or function itself."""

    @property
    def files(self) -> frozenset[str]:
        """Source files in which its frames are found."""

    @property
    def sha256(self) -> str | None:
        """Hash of its source file as it was loaded; None where there is no file."""

    def maker(self, family: str) -> Callable[..., Any]:
        """Return the factory that builds its objects."""


_NOTHING: Mapping[str, Permitted] = MappingProxyType({})
_PERMITTED: ContextVar[Mapping[str, Permitted]] = ContextVar("flightbed external code", default=_NOTHING)


def names(family: str) -> tuple[str, ...]:
    """Return the sorted names of a family, permitted external code included."""
    return tuple(sorted({*_BUILT_IN[family], *_installed(family), *in_use()}))


def built_in(family: str) -> tuple[str, ...]:
    """Return the sorted names of the built-in members of a family."""
    return tuple(sorted(_BUILT_IN[family]))


def is_built_in(family: str, name: str) -> bool:
    """Return whether a name is built in."""
    return name in _BUILT_IN[family]


def is_taken(family: str, name: str) -> bool:
    """Return whether a name is built in or registered by an installed package."""
    return name in _BUILT_IN[family] or name in _installed(family)


def installed_module(family: str, name: str) -> str | None:
    """Return the module of a factory that an installed package registers; None for other names."""
    if is_built_in(family, name) or name not in _installed(family):
        return None
    return str(_installed(family)[name].module)


def in_use() -> Mapping[str, Permitted]:
    """Return the external code that is permitted in this thread, by name."""
    return _PERMITTED.get()


@contextmanager
def permit(extensions: Mapping[str, Permitted]) -> Iterator[None]:
    """Permit these extensions and no others inside the ``with`` block, in this thread."""
    token = _PERMITTED.set(MappingProxyType(dict(extensions)))
    try:
        yield
    finally:
        _PERMITTED.reset(token)


def permission_problem(name: str) -> str | None:
    """Return the error text for a name of external code that is not permitted; None for other names."""
    if ":" not in name or name in in_use():
        return None
    return (
        f"'{name}' is code outside flightbed; add --use {name} to allow it, or in Python fly it "
        f'within flightbed.using("{name}")'
    )


def factory(family: str, name: str) -> Callable[..., Any]:
    """Return the factory registered under a name. Raises UnknownNameError, and ExtensionError for external code that is not permitted."""
    if name in _BUILT_IN[family]:
        module, _, attribute = _BUILT_IN[family][name].rpartition(":")
        built_in: Callable[..., Any] = getattr(import_module(module), attribute)
        return built_in
    if name in _installed(family):
        loaded: Callable[..., Any] = _installed(family)[name].load()
        return loaded
    if name in in_use():
        return in_use()[name].maker(family)
    if problem := permission_problem(name):
        raise ExtensionError(problem)
    raise UnknownNameError("study" if family == "studies" else family.removesuffix("s"), name, names(family))


def summary(family: str, name: str) -> str:
    """Return the first line of a factory's docstring."""
    return (factory(family, name).__doc__ or "").strip().partition("\n")[0]


@cache
def _installed(family: str) -> dict[str, Any]:
    return {entry.name: entry for entry in entry_points(group=f"flightbed.{family}")}
