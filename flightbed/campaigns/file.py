"""Campaign file or plain scenario -> Programme; all problems of the file are reported before the first flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from flightbed.campaigns.plan import Programme, Values, grid, with_values
from flightbed.campaigns.settings import CampaignSettings
from flightbed.campaigns.table import metric_columns
from flightbed.config.reading import display_path, read_toml, validation_lines, with_tuples
from flightbed.config.table import ValidationError
from flightbed.core import data
from flightbed.core.errors import InputError, ScenarioError, did_you_mean
from flightbed.flight.plan import bind, plan
from flightbed.models.linear_aircraft import load_flyable
from flightbed.scenario.estimates import estimates
from flightbed.scenario.own_code import named_extensions
from flightbed.scenario.reading import Reading, read, settle
from flightbed.scenario.tables import Scenario

RUNS = 100  # default, of a plain scenario
_LAST_SEED = 2**63 - 1
_MOST_POINTS = 100_000
_CHECKED = 2_000  # most points whose scenarios are checked before the flights; takes about 1 s
_FIXED = ("schema", "name", "description", "seed", "estimators", "failures", "aircraft", "aircraft.sha256")


def load_programme(source: str | Path, overrides: Sequence[str] = (), runs: int | None = None) -> Programme:
    """Read a campaign file or a scenario.

    Args:
        source: path or shipped name.
        overrides: KEY=VALUE, of the (base) scenario.
        runs: flights per point; None: the value of the campaign file, or 100 for a scenario.

    Raises:
        UnknownNameError, InputError: no such file; ScenarioError: lists all problems of the file; AircraftError; for a scenario also the
            errors of ``plan``.

    """
    path = data.find_flights(str(source))
    raw = read_toml(path)
    if "base" not in raw and "axes" not in raw:
        found = read(raw, display_path(path), overrides)
        programme = plain(found.scenario, RUNS if runs is None else runs)
        return replace(programme, notes=(*found.notes, *programme.notes))
    place = display_path(path)
    if runs is not None:
        raw["runs"] = _at_least_one(runs)
    try:
        settings = CampaignSettings.model_validate(with_tuples(raw))
    except ValidationError as error:
        raise ScenarioError(validation_lines(error, place, model=CampaignSettings)) from None
    base = path.parent / Path(settings.base).expanduser()
    if not base.is_file():
        base = data.find("scenario", settings.base)
    found = read(read_toml(base), display_path(base), overrides)
    return _programme(settings, found, place, [text.partition("=")[0] for text in overrides])


def plain(scenario: Scenario, runs: int) -> Programme:
    """Return ``runs`` flights of a scenario with successive seeds, its own first.

    Raises:
        InputError: runs < 1, or seeds beyond the largest; and the errors of ``plan``.

    """
    _at_least_one(runs)
    if scenario.seed > _LAST_SEED - runs + 1:
        raise InputError(f"seed: must be at most {_LAST_SEED - runs + 1} with {runs} flights (got {scenario.seed})")
    planned = plan(scenario)  # errors appear before workers start
    scenario = planned.scenario  # complete
    return Programme(
        scenario, scenario.to_dict(), runs, extensions=named_extensions(scenario), aircraft=(scenario.aircraft.sha256,),
        notes=planned.notes,
    )  # fmt: skip


def _at_least_one(runs: int) -> int:
    if runs < 1:
        raise InputError(f"--runs: must be at least 1 (got {runs})")
    return runs


def _programme(settings: CampaignSettings, base: Reading, place: str, overridden: Sequence[str]) -> Programme:
    scenario = base.scenario
    found = [*_axis_problems(settings, place, overridden), *_criteria_problems(settings, scenario, place)]
    lengths = 1
    for axis in settings.axes if settings.combine == "crossed" else settings.axes[:1]:
        lengths *= len(axis.values) if axis.values is not None else axis.count or 1
    if lengths > _MOST_POINTS:
        found.append(f"{place}: axes: must have at most {_MOST_POINTS} points (got {lengths})")
    if found:
        raise ScenarioError(found)
    points = grid(settings)
    total = settings.runs * len(points)
    if unknown := [i for i in settings.traces.indices if i >= total]:
        found.append(f"{place}: traces.indices: must be below {total}, the number of flights (got {unknown[0]})")
    if unknown := [p for p in settings.histories.points if p >= len(points)]:
        found.append(f"{place}: histories.points: must be below {len(points)}, the number of points (got {unknown[0]})")
    models = [axis.values or () for axis in settings.axes if axis.key == "aircraft.model"]
    raw, fingerprints, notes = _bound(base.raw, scenario, [str(v) for values in models for v in values])
    problems, dropped = _point_problems(settings, raw, points, place, estimates(scenario))
    found += problems
    if found:
        raise ScenarioError(found)
    complete = settle(raw, place, {}).scenario
    notes = (*base.notes, *Reading(raw, complete, dropped).notes, *notes)
    return Programme(complete, raw, settings.runs, points, settings, named_extensions(complete), fingerprints, notes)


def _bound(
    raw: Mapping[str, Any], scenario: Scenario, models: Sequence[str]
) -> tuple[Mapping[str, Any], tuple[str, ...], tuple[str, ...]]:
    """Return the base with its aircraft's path and fingerprint, unless it is varied, all fingerprints, and notes. Raises AircraftError."""
    if models:
        return raw, tuple(load_flyable(model).sha256 for model in models), ()
    bound, _, notes = bind(scenario)
    pinned = {"model": bound.aircraft.model, "sha256": bound.aircraft.sha256}
    return {**raw, "aircraft": {**raw.get("aircraft", {}), **pinned}}, (bound.aircraft.sha256,), notes


def _axis_problems(settings: CampaignSettings, place: str, overridden: Sequence[str]) -> list[str]:
    found = []
    for i, axis in enumerate(settings.axes):
        last = axis.key.rpartition(".")[2]
        if axis.key in _FIXED or (axis.key.startswith("estimators.") and last == "name"):
            found.append(
                f"{place}: axes.{i}.key: '{axis.key}' cannot be varied; name the key of a single number or text"
            )
        found += [
            f"--set {key}: is varied by the campaign, see axes.{i} in {place}"
            for key in overridden
            if key == axis.key or key.startswith(f"{axis.key}.") or axis.key.startswith(f"{key}.")
        ]
    return found


def _criteria_problems(settings: CampaignSettings, scenario: Scenario, place: str) -> list[str]:
    known = metric_columns(scenario)
    return [
        f"{place}: criteria.{i}.metric: there is no metric '{c.metric}'{did_you_mean(c.metric, known)}; docs/campaigns.md lists them"
        for i, c in enumerate(settings.criteria)
        if c.metric not in known
    ]


def _point_problems(
    settings: CampaignSettings, raw: Mapping[str, Any], points: Sequence[Values], place: str, columns: Sequence[str]
) -> tuple[list[str], dict[str, str]]:
    """Return the problems of the points' scenarios and of the limits of drawn values, each once, and the dropped keys of the base.

    All points must have the same estimates, because the estimates are columns of the table.
    """
    origins = {axis.key: f"{place}: axes.{i}" for i, axis in enumerate(settings.axes)}
    ends: list[Values] = [
        {**points[0], axis.key: float(end)}
        for axis in settings.axes
        if axis.is_drawn
        for end in (axis.low, axis.high, axis.mean)
        if end is not None
    ]
    found: dict[str, None] = {}
    idle: dict[str, str] = {}
    effective: set[str] = set()
    checked = [*points[:_CHECKED], *ends]
    for values in checked:
        try:
            for key, value in values.items():
                with_values(raw, {key: value}, origins[key])
            reading = settle(with_values(raw, values, place), place, origins)
        except ScenarioError as error:
            found.update(dict.fromkeys(error.problems))
            continue
        for name in sorted(set(estimates(reading.scenario)) ^ set(columns)):
            there_is = "no" if name in columns else "an"
            varied = ", ".join(f"{key} = {value}" for key, value in values.items())
            problem = f"{place}: axes: {varied}: there is {there_is} estimate '{name}', unlike in the base; split it into two campaigns"
            found[problem] = None
        idle.update(reading.dropped)
        effective.update(key for key in values if key not in reading.dropped)
    useless = [
        f"{origins[k]}.key: {k} has no effect with {why}"
        for k, why in idle.items()
        if k in origins and k not in effective
    ]
    return [*found, *([] if found else useless)], {k: why for k, why in idle.items() if k not in origins}
