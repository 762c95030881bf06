"""Estimators of the user's own as further entrants: ``--use mine.py:Mine`` and tables of settings -> rows like the built-in ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flightbed.config.families import in_use, summary
from flightbed.config.kinds import ESTIMATORS, EstimatorSettings
from flightbed.config.reading import read_toml, validation_lines, with_tuples
from flightbed.config.table import ValidationError
from flightbed.core.errors import InputError, ScenarioError
from flightbed.studies.estimators.comparison import Comparison
from flightbed.studies.estimators.entrants import UNDECLARED, Entrant
from flightbed.testing.check import ContractError, check_estimator

OWN = "user's own estimator"
_UNSAID = "-"


def own_entrants(use: Sequence[str], files: Sequence[Path], compared: Comparison) -> tuple[Entrant, ...]:
    """Return the user's estimators, checked: they keep the contract of an estimator, and at least one of the flights takes them.

    Args:
        use: names of permitted code (``own_code.using``), each an entrant with its default settings unless a file has its ``kind``.
        files: TOML files, each with the keys of one ``[[estimators]]`` table, ``options`` among them. ``kind`` may be missing where
            one name is used, ``name`` always: it is then the attribute's.
        compared: estimators and flights beside them.

    Raises:
        InputError: a table is wrong, a name is taken, an estimator breaks its contract or can fly nowhere.

    """
    tables = [(str(file), _table(file, use)) for file in files]
    set_ = [table["kind"] for _, table in tables]
    tables += [(f"--use {name}", {"kind": name}) for name in dict.fromkeys(use) if name not in set_]
    taken = {entrant.name for entrant in compared.entrants}
    found = []
    for place, table in tables:
        entrant = _entrant(place, table)
        if entrant.name in taken:
            raise InputError(
                f"{place}: name: is that of another estimator of the study (got '{entrant.name}'); give it another in a file, "
                f'name = "{entrant.name}-2", with --settings FILE.toml'
            )
        taken.add(entrant.name)
        _check(place, entrant, compared)
        found.append(entrant)
    return tuple(found)


def _table(file: Path, use: Sequence[str]) -> dict[str, Any]:
    """Return the table of a settings file, with its kind."""
    table = read_toml(file)
    if "kind" not in table:
        if len(use) != 1:
            known = ", ".join(use) if use else "one of flightbed list estimators"
            raise InputError(f"{file}: kind: is missing; name the estimator that these settings are for: {known}")
        table["kind"] = use[0]
    return table


def _entrant(place: str, table: Mapping[str, Any]) -> Entrant:
    """Return a row of the tables for a table of settings."""
    name = str(table["kind"]).rpartition(":")[2].rpartition(".")[2]
    try:
        settings = ESTIMATORS.make(**with_tuples({"name": name, **table}))
    except ValidationError as error:
        raise ScenarioError(validation_lines(error, place, model=EstimatorSettings)) from None
    own = {key: value for key, value in table.items() if key != "name"}
    return Entrant(settings.name, own, _known(settings.kind), _UNSAID, _UNSAID, UNDECLARED)


def _known(kind: str) -> str:
    """Return the first line of the docstring of a kind."""
    if kind in in_use():
        return (in_use()[kind].factory.__doc__ or "").strip().partition("\n")[0] or OWN
    return summary("estimators", kind) or OWN


def _check(place: str, entrant: Entrant, compared: Comparison) -> None:
    """Raise InputError if an estimator breaks its contract, or no flight takes it."""
    kind = entrant.settings["kind"]
    if kind in in_use():
        try:
            check_estimator(in_use()[kind].factory, settings=entrant.table())
        except ContractError as broken:
            more = len(broken.violations) - 1
            also = f" (and {more} more: flightbed.testing.check_estimator lists them)" if more else ""
            raise InputError(f"{place}: breaks the contract of an estimator: {broken.violations[0]}{also}") from None
    refused = [compared.course.why_not(flight, entrant) for flight in compared.flights]
    if None not in refused:
        raise InputError(f"{place}: no flight of the study takes it: {refused[0]}")
