"""Reading of scenarios: TOML -> frozen Scenario, with --set overrides; all problems are reported at once.

A key without effect is a problem: one that the kind of its table does not have, and one that another key leaves without effect. There are
three exceptions. A key of the file that an override leaves without effect is dropped and named. So is a value at a point of a campaign
where another axis leaves it without effect. A file that version 0.1 resolved holds every key (``version_0_1.py``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flightbed.config.messages import brief
from flightbed.config.overrides import override
from flightbed.config.reading import (
    display_path,
    given_keys,
    key_of,
    read_toml,
    validation_lines,
    value_at,
    with_tuples,
    without,
)
from flightbed.config.table import ValidationError
from flightbed.core import data
from flightbed.core.errors import ScenarioError
from flightbed.scenario import version_0_1
from flightbed.scenario.checks import conflicts, references
from flightbed.scenario.tables import Scenario

__all__ = ["Scenario", "load_scenario"]


@dataclass(frozen=True)
class Reading:
    """A scenario as it was read.

    Attributes:
        raw: contents of the file, overrides applied, keys without effect left out.
        scenario: the scenario.
        dropped: keys of the file that an override leaves without effect -> the setting that disables them, or the kind without them.

    """

    raw: Mapping[str, Any]
    scenario: Scenario
    dropped: Mapping[str, str] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[str, ...]:
        """One line that names the dropped keys; none if there are none."""
        if not self.dropped:
            return ()
        reasons = dict.fromkeys(self.dropped.values())
        parts = [
            f"{', '.join(key for key, why in self.dropped.items() if why == reason)} (no effect with {reason})"
            for reason in reasons
        ]
        return (f"dropped from the file: {'; '.join(parts)}",)


def load_scenario(source: str | Path | Mapping[str, Any], overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario and apply overrides.

    Args:
        source: path, shipped name, or mapping.
        overrides: KEY=VALUE, such as ``"failures.0.to=0.35"``.

    Raises:
        UnknownNameError: no such scenario.
        ScenarioError: the scenario is invalid; lists every problem.

    """
    return read_scenario(source, overrides).scenario


def read_scenario(source: str | Path | Mapping[str, Any], overrides: Sequence[str] = ()) -> Reading:
    """Read a scenario as ``load_scenario``, and return it with the keys that the overrides leave without effect."""
    if isinstance(source, Mapping):
        return read(source, "scenario", overrides)
    path = data.find("scenario", str(source))
    return read(read_toml(path), display_path(path), overrides)


def read(raw: Mapping[str, Any], place: str, overrides: Sequence[str] = ()) -> Reading:
    """Return the scenario of a file's contents with overrides, which its description names.

    Args:
        raw: contents of the file.
        place: name of the file in errors.
        overrides: KEY=VALUE.

    Raises:
        ScenarioError: the scenario is invalid; lists every problem.

    """
    is_old = version_0_1.is_resolved(raw)
    if is_old:
        raw = _without_old_defaults(raw)
    cure = "remove it, or let `flightbed upgrade` do so" if is_old else "remove it"
    changed, overridden = override(raw, overrides)
    if not overridden:
        return _settled(raw, place, {}, lambda _key: False, cure)
    origins, alone = dict.fromkeys(overridden, "--set"), _Read(raw)
    bad = alone.without_effect
    found = _settled(changed, place, origins, lambda key: key not in bad and not _is_from(origins, key), cure)
    missing = {} if alone.scenario is None else references(alone.scenario)
    if problems := [f"{place}: {problem}" for key, problem in missing.items() if key in found.dropped]:
        raise ScenarioError(problems)
    return found if "description" in overridden else _described(found, overrides)


def settle(raw: Mapping[str, Any], place: str, origins: Mapping[str, str]) -> Reading:
    """Return the scenario of nested plain values; values without effect are dropped, as at a point of a campaign.

    Args:
        raw: contents of a file, overrides and values of axes applied.
        place: name of the file in errors.
        origins: key set elsewhere -> its origin in errors, a place in a campaign file.

    Raises:
        ScenarioError: the scenario is invalid; lists every problem.

    """
    return _settled(raw, place, origins, lambda _key: True)


class _Read:
    """One attempt to read nested plain values.

    Attributes:
        scenario: the scenario; None if it is invalid.
        error: why it is invalid.
        without_effect: keys that are given and have no effect -> the setting that disables them, or the kind without them.

    """

    def __init__(self, raw: Mapping[str, Any]) -> None:
        self.scenario: Scenario | None = None
        self.error: ValidationError | None = None
        try:
            self.scenario = Scenario.model_validate(with_tuples(raw))
            idle = self.scenario.idle_keys()
        except ValidationError as error:
            self.error, idle = error, _foreign(error)
        tables = idle if self.error else ()  # a table that the kind does not have is one key
        keys = dict.fromkeys([*given_keys(raw), *tables])
        self.without_effect = {key: idle[key] for key in keys if key in idle}


def _settled(
    raw: Mapping[str, Any],
    place: str,
    origins: Mapping[str, str],
    may_drop: Callable[[str], bool],
    cure: str = "remove it",
) -> Reading:
    """Return the scenario of nested plain values; keys without effect are dropped or, where they may not be, reported."""
    dropped: dict[str, str] = {}
    while True:
        found = _Read(raw)
        droppable = {key: why for key, why in found.without_effect.items() if may_drop(key)}
        if droppable:
            raw = _without(raw, droppable)
            dropped |= droppable
            continue
        if found.error is not None:
            lines = validation_lines(found.error, place, origins, model=Scenario)
            raise ScenarioError([_with_cure(line, cure) for line in lines]) from None
        assert found.scenario is not None
        problems = [
            f"--set {key}: has no effect with {why}"
            if _is_from(origins, key)
            else f"{place}: {key}: has no effect with {why} (got {_got(raw, key)}); {cure}"
            for key, why in found.without_effect.items()
        ]
        problems += [f"{place}: {line}" for line in conflicts(found.scenario)]
        if problems:
            raise ScenarioError(problems)
        return Reading(raw, found.scenario, dropped)


def _without_old_defaults(raw: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a file that version 0.1 resolved without the keys that have no effect and the default of that version."""
    while old := [key for key in _Read(raw).without_effect if version_0_1.at_default(raw, key)]:
        raw = _without(raw, old)
    return raw


def _described(found: Reading, overrides: Sequence[str]) -> Reading:
    """Return a reading whose description names the overrides and the keys that they leave without effect."""
    dropped = f"; dropped: {', '.join(found.dropped)}" if found.dropped else ""
    description = f"{found.scenario.description} (changed: {', '.join(overrides)}{dropped})".strip()
    scenario = found.scenario.model_copy(update={"description": description})
    return Reading({**found.raw, "description": description}, scenario, found.dropped)


def _without(raw: Mapping[str, Any], keys: Iterable[str]) -> Mapping[str, Any]:
    for key in keys:
        raw = without(raw, key.split("."))
    return raw


def _foreign(error: ValidationError) -> dict[str, str]:
    """Return the keys of a validation error that the kind of their table does not have, but another kind has -> the kind."""
    items = [item for item in error.errors(include_url=False) if item["type"] == "foreign"]
    return {key_of(item): f"{item['ctx']['key']} = '{item['ctx']['kind']}'" for item in items if item["ctx"]["have"]}


def _with_cure(line: str, cure: str) -> str:
    """Return a problem whose cure is to remove a key with the cure of its file."""
    return line.removesuffix("remove it") + cure if line.endswith("; remove it") else line


def _got(raw: Mapping[str, Any], key: str) -> str:
    return brief(with_tuples(value_at(raw, key.split("."))))


def _is_from(origins: Mapping[str, str], key: str) -> bool:
    """Return whether a key, a table around it or a key inside it was set elsewhere."""
    return any(key == o or key.startswith(f"{o}.") or o.startswith(f"{key}.") for o in origins)
