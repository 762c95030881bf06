"""A short commented scenario to start from."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

from flightbed.config import families
from flightbed.config.catalogue import Key, catalogue
from flightbed.config.kinds import LAWS, LawSettings
from flightbed.core.errors import InputError, did_you_mean
from flightbed.scenario.tables import Scenario

# family -> its table in a scenario, the heading of the table, the key of the kind
_PLACES = {
    "commands": ("command", "[command]", "kind"),
    "failures": ("failures", "[[failures]]", "kind"),
    "gusts": ("gusts", "[[gusts]]", "shape"),
    "laws": ("control", "[control]", "law"),
    "estimators": ("estimators", "[[estimators]]", "kind"),
}
_USUAL = {"commands": "doublet", "failures": "effectiveness", "laws": "proportional", "estimators": "loop-gain"}
_HEAD = """#:schema {schema}
schema = 1
name = "{name}"
description = ""
duration_s = 16.5
seed = 0

[aircraft]
model = "f16"                   # `flightbed list aircraft`

[condition]                     # trimmed
mach = 0.8
altitude_ft = 20000
"""
_ADAPTATION = """
[adaptation]                    # the law is corrected by 1/K of this estimator
enabled = true
estimator = "{estimator}"
"""


def template(name: str, kinds: Sequence[str], schema: str) -> str:
    """Return the TOML text of a scenario with a failure, a law and an estimator that corrects it.

    Args:
        name: of the scenario.
        kinds: kinds to use instead of the usual ones, of any family; several failures, gusts and estimators are possible.
        schema: address of the JSON Schema, for editors.

    Raises:
        InputError: there is no such kind, or a table that takes one kind is given two.

    """
    chosen, named = _chosen(kinds), set(kinds)
    law = LAWS.of(chosen["laws"][0])
    corrected = issubclass(law, LawSettings) and not law.identifies
    idle = f"command.amplitude_{'deg_s' if issubclass(law, LawSettings) and law.in_g else 'g'}"
    keys = catalogue(Scenario)
    parts = [_HEAD.format(name=name, schema=schema)]
    for family, names in chosen.items():
        if family == "estimators" and corrected:
            parts.append(_ADAPTATION.format(estimator=names[0]))
        parts += [_table(keys, family, kind, listed=kind in named, without=idle) for kind in names]
    return "".join(parts)


def _chosen(kinds: Sequence[str]) -> dict[str, list[str]]:
    """Return family -> its kinds in the scenario. Raises InputError."""
    chosen: dict[str, list[str]] = {family: [] for family in _PLACES}
    for kind in kinds:
        known = list(chain.from_iterable(families.built_in(family) for family in _PLACES))
        family = next((f for f in _PLACES if kind in families.built_in(f)), None)
        if family is None:
            raise InputError(
                f"--kind {kind}: there is no such kind{did_you_mean(kind, known)}; flightbed list names them"
            )
        if chosen[family] and family in ("commands", "laws"):
            raise InputError(f"--kind {kind}: a scenario has one of the {family} (got '{chosen[family][0]}' too)")
        chosen[family].append(kind)
    for family, usual in _USUAL.items():
        chosen[family] = chosen[family] or [usual]
    return chosen


def _table(keys: Sequence[Key], family: str, kind: str, *, listed: bool, without: str) -> str:
    """Return the table of a kind: required keys with an example and, if ``listed``, the others as comments with their defaults.

    ``without`` is the path of a key that has no effect with the law.
    """
    place, heading, selector = _PLACES[family]
    lines = ["", heading, f'{selector} = "{kind}"']
    for key in keys:
        if kind not in key.kinds or not key.path.startswith(f"{place}.") or key.path in without:
            continue
        name = key.path.removeprefix(f"{place}.")
        unit = f" [{key.unit}]" if key.unit and listed else ""
        only = f" Only with {key.condition}." if key.condition else ""
        if key.required and "." not in name:
            value = f'"{kind}"' if family == "estimators" and name == "name" else key.example
            lines.append(f"{name} = {value}".ljust(31) + f" # {key.description}{unit}")
        elif listed and key.default:
            lines.append(f"# {name} = {key.default}".ljust(31) + f" # {key.description}{only}{unit}")
    return "\n".join(lines) + "\n"
