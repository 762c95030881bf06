"""Code from outside the package that a scenario names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flightbed.config import families
from flightbed.config.own_code import Extension, installed_sha256
from flightbed.core.errors import InputError, did_you_mean
from flightbed.scenario.tables import Scenario


def named_extensions(scenario: Scenario) -> tuple[Extension, ...]:
    """Return the permitted external code named by a scenario, without duplicates."""
    own = families.in_use()
    found = (own.get(kind) for kind in dict.fromkeys(kind for _, kind in _kinds(scenario)))
    return tuple(extension for extension in found if isinstance(extension, Extension))


def named_plug_ins(scenario: Scenario) -> dict[str, str | None]:
    """Return the kinds of installed packages that a scenario names -> SHA-256 of their sources."""
    named = (kind for kind in _kinds(scenario) if families.installed_module(*kind) is not None)
    return {name: installed_sha256(family, name) for family, name in named}


def _kinds(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield family and kind of every part of a flight."""
    lateral = (scenario.lateral.roll.kind, scenario.lateral.sideslip.kind) if scenario.lateral.enabled else ()
    yield from (("commands", kind) for kind in (scenario.command.kind, *lateral))
    yield from (("failures", failure.kind) for failure in scenario.failures)
    yield "laws", scenario.control.law
    yield from (("estimators", estimator.kind) for estimator in scenario.estimators)
    yield from (("gusts", gust.shape) for gust in scenario.gusts)


def check_named(scenario: Scenario, names: Sequence[str]) -> None:
    """Check that the scenario names every ``--use``. Raises InputError."""
    named = [extension.name for extension in named_extensions(scenario)]
    for name in names:
        if name not in named:
            near = did_you_mean(name, named)
            raise InputError(
                f"--use {name}: the scenario does not name it{near}; name it, as in --set estimators.0.kind={name}, or leave it out"
            )
