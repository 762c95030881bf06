"""Code from outside the package that a scenario names."""

from __future__ import annotations

from collections.abc import Sequence

from flightbed.config import families
from flightbed.config.own_code import Extension
from flightbed.core.errors import InputError, did_you_mean
from flightbed.scenario.tables import Scenario


def named_extensions(scenario: Scenario) -> tuple[Extension, ...]:
    """Return the permitted external code named by a scenario, without duplicates."""
    lateral = (scenario.lateral.roll.kind, scenario.lateral.sideslip.kind) if scenario.lateral.enabled else ()
    kinds = (scenario.command.kind, *lateral, *(f.kind for f in scenario.failures), scenario.control.law)
    own = families.in_use()
    found = (own.get(kind) for kind in dict.fromkeys((*kinds, *(e.kind for e in scenario.estimators))))
    return tuple(extension for extension in found if isinstance(extension, Extension))


def check_named(scenario: Scenario, names: Sequence[str]) -> None:
    """Check that the scenario names every ``--use``. Raises InputError."""
    named = [extension.name for extension in named_extensions(scenario)]
    for name in names:
        if name not in named:
            near = did_you_mean(name, named)
            raise InputError(
                f"--use {name}: the scenario does not name it{near}; name it, as in --set estimators.0.kind={name}, or leave it out"
            )
