"""Every shipped scenario against the table in ``tests/golden/``: by SHA-256 where it knows the environment, elsewhere by samples."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flightbed.core import data
from flightbed.runs.run import Result, run
from flightbed.scenario.reading import load_scenario
from tests.bits import compare
from tests.flights import ShippedFlight, once
from tests.golden_flights import (
    GOLDEN,
    GOLDEN_PROPERTY,
    Columns,
    Compared,
    Flight,
    Table,
    deviation,
    environment,
    identifier,
    sampled,
    scale,
    sha256,
    summary,
)

TABLE, KEY = Table.read(), identifier(environment())
HERE = {"jsbsim": "1", "libc": "glibc 2"}
ELSEWHERE = {"jsbsim": "1", "libc": "glibc 3"}
TICKS = 400


@pytest.mark.parametrize("name", list(data.names("scenario")))
def test_a_shipped_flight_is_the_golden_one(
    name: str, shipped_flight: ShippedFlight, record_property: Callable[[str, object], None]
) -> None:
    columns = shipped_flight(name).trace.columns
    compared = TABLE.flights[name].compared(columns, KEY)
    record_property(GOLDEN_PROPERTY, list(dataclasses.astuple(compared)))
    assert not compared.problems, "\n".join(compared.problems)
    assert compared.by_sha256 + compared.by_samples == len(columns)


def test_the_table_holds_the_shipped_scenarios_and_is_small() -> None:
    assert list(TABLE.flights) == list(data.names("scenario"))
    assert all(identifier(found) == key for key, found in TABLE.environments.items())
    assert sum(path.stat().st_size for path in GOLDEN.glob("flights.*")) < 1.5e6


def test_a_known_flight_also_agrees_with_its_samples(shipped_flight: ShippedFlight) -> None:
    """An unknown environment's comparison, in this one: the SHA-256 and the samples are of the same flight."""
    columns = shipped_flight("elevator-loss").trace.columns
    compared = TABLE.flights["elevator-loss"].compared(columns, "unknown")
    assert compared.problems == []
    assert compared.by_sha256 == 0
    assert compared.by_samples == len(columns)
    assert f"0 columns compared by SHA-256, {len(columns)} with samples" in summary([compared])


def test_a_flight_is_flown_once_and_kept_as_it_is(tmp_path: Path) -> None:
    flown: list[str] = []

    def fly(name: str) -> Result:
        flown.append(name)
        return run(load_scenario(name, ["duration_s=0.5", "failures.0.at_s=0.2"]))

    first = once(tmp_path, fly)("straight-and-level")
    again = once(tmp_path, fly)("straight-and-level")  # as of another worker: read from the folder
    assert flown == ["straight-and-level"]
    assert compare("", first.trace.columns, again.trace.columns).same
    assert again.summary == first.summary


def test_the_environment_names_versions_features_and_kernel() -> None:
    found = environment()
    assert {"jsbsim", "numpy", "scipy", "numba", "llvmlite", "libc", "numpy features", "compiled for"} <= found.keys()
    assert any(name.startswith("BLAS") for name in found)
    assert found == environment()
    assert identifier(found) != identifier({**found, "numpy": "0"})


@pytest.fixture
def columns(rng: np.random.Generator) -> dict[str, np.ndarray]:
    t = np.arange(TICKS) / 100
    gaps = rng.normal(size=TICKS)
    gaps[:50] = np.nan
    return {
        "t_s": t,
        "q_deg_s": rng.normal(size=TICKS),
        "constant": np.full(TICKS, 0.07),
        "zero": np.zeros(TICKS),
        "gaps": gaps,
    }


@pytest.fixture
def table(columns: Columns) -> Table:
    made = Table()
    assert made.add({"a": columns, "b": columns}, HERE) == 10
    return made


def _compared(table: Table, columns: Columns, found: dict[str, str]) -> Compared:
    return table.flights["a"].compared(columns, identifier(found))


@pytest.mark.parametrize("column", ["q_deg_s", "constant", "zero", "gaps"])
def test_one_ulp_at_one_tick_is_found_where_the_environment_is_known(
    table: Table, columns: Columns, column: str
) -> None:
    changed = columns[column].copy()
    changed[123] = np.nextafter(changed[123], np.inf)
    compared = _compared(table, {**columns, column: changed}, HERE)
    assert [problem.partition(":")[0] for problem in compared.problems] == [column]
    assert compared.by_sha256 == 5
    assert _compared(table, columns, HERE) == Compared([], 5, 0, 0.0)


@pytest.mark.parametrize(
    ("column", "by", "passes"),
    [
        ("q_deg_s", 0.9e-9, True),
        ("q_deg_s", 1.1e-9, False),
        ("constant", 0.9e-9, True),
        ("constant", 1.1e-9, False),
        ("gaps", 0.9e-9, True),
        ("gaps", 1.1e-9, False),
    ],
)
def test_elsewhere_samples_may_deviate_by_1e_9_of_the_range(
    table: Table, columns: Columns, column: str, by: float, passes: bool
) -> None:
    changed = {**columns, column: columns[column] + by * scale(columns[column])}
    compared = _compared(table, changed, ELSEWHERE)
    assert (compared.problems == []) is passes
    assert compared.by_samples == 5
    assert compared.largest == pytest.approx(by, rel=1e-3)  # the sum rounds at 2e-16 of a value near 1


def test_a_column_of_zeros_stays_zero_elsewhere(table: Table, columns: Columns) -> None:
    compared = _compared(table, {**columns, "zero": columns["zero"] + 1e-300}, ELSEWHERE)
    assert compared.problems == ["zero: samples deviate by inf of the range, at most 1e-09"]


@pytest.mark.parametrize(("tick", "value"), [(0, 0.0), (-1, np.nan), (-1, np.inf)])
def test_values_that_are_not_finite_stay_where_they_are(
    table: Table, columns: Columns, tick: int, value: float
) -> None:
    changed = columns["gaps"].copy()
    changed[tick] = value
    compared = _compared(table, {**columns, "gaps": changed}, ELSEWHERE)
    assert compared.problems == ["gaps: samples deviate by inf of the range, at most 1e-09"]


@pytest.mark.parametrize("found", [HERE, ELSEWHERE])
def test_columns_and_ticks_too_many_or_too_few_are_found(table: Table, columns: Columns, found: dict[str, str]) -> None:
    fewer = {name: values for name, values in columns.items() if name != "zero"}
    assert _compared(table, fewer, found).problems == ["zero: in the table, not in the flight"]
    more = {**columns, "new": columns["zero"]}
    assert _compared(table, more, found).problems == ["new: a new column, not in the table"]
    shorter = {name: values[:-1] for name, values in columns.items()}
    assert len(_compared(table, shorter, found).problems) == 5
    assert "t_s: 399 ticks, 400 in the table" in _compared(table, shorter, found).problems


def test_a_table_is_read_as_it_was_written_and_written_to_the_same_bytes(
    table: Table, columns: Columns, tmp_path: Path
) -> None:
    (tmp_path / "again").mkdir()
    table.write(tmp_path)
    read = Table.read(tmp_path)
    assert _compared(read, columns, HERE) == Compared([], 5, 0, 0.0)
    assert _compared(read, columns, ELSEWHERE) == Compared([], 0, 5, 0.0)
    read.write(tmp_path / "again")
    for name in ("flights.json", "flights.npz"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / name).read_bytes()
    assert Table.read(tmp_path / "nowhere") == Table()


def test_a_new_column_and_a_new_environment_add_entries_and_change_none(table: Table, columns: Columns) -> None:
    before = {name: dict(flight.sha256[identifier(HERE)]) for name, flight in table.flights.items()}
    more = {**columns, "new": columns["zero"] + 1.0}
    assert table.add({"a": more, "b": columns}, HERE) == 1
    near = {**columns, "q_deg_s": columns["q_deg_s"] * (1 + 1e-12)}
    samples = table.flights["b"].samples["q_deg_s"].copy()
    assert table.add({"a": more, "b": near}, ELSEWHERE) == 11
    assert table.changes == []
    np.testing.assert_array_equal(table.flights["b"].samples["q_deg_s"], samples)
    assert table.flights["b"].sha256[identifier(HERE)] == before["b"]
    assert table.flights["a"].sha256[identifier(HERE)] == {**before["a"], "new": sha256(more["new"])}
    assert table.flights["b"].compared(near, identifier(ELSEWHERE)).problems == []


def test_an_entry_changes_only_with_a_reason_which_is_recorded(table: Table, columns: Columns) -> None:
    table.add({"a": columns, "b": columns}, ELSEWHERE)
    changed = {**columns, "zero": columns["zero"] + 1.0}
    with pytest.raises(ValueError, match=r"entries would change \(a: zero\); find out why"):
        table.add({"a": changed, "b": columns}, HERE)
    assert _compared(table, columns, HERE).problems == []
    assert table.add({"a": changed, "b": columns}, HERE, changed="zero is one now") == 1
    assert table.changes == [{"why": "zero is one now", "columns": {"a": ["zero"]}}]
    assert _compared(table, changed, HERE) == Compared([], 5, 0, 0.0)
    assert _compared(table, changed, ELSEWHERE) == Compared([], 4, 1, 0.0)  # its SHA-256 there was of the old column
    with pytest.raises(ValueError, match=r"\(b: constant, gaps, q_deg_s, t_s, zero\)"):
        table.add({"a": changed}, HERE)
    with pytest.raises(ValueError, match=r"\(a: zero\)"):
        table.add({"a": {name: values for name, values in changed.items() if name != "zero"}, "b": columns}, HERE)
    shorter = {name: values[:-1] for name, values in columns.items()}
    assert table.add({"a": changed, "b": shorter}, HERE, changed="b is shorter") == 5
    assert table.flights["b"].compared(shorter, identifier(HERE)) == Compared([], 5, 0, 0.0)


def test_scale_and_samples() -> None:
    assert scale(np.array([1.0, np.nan, 3.5, np.inf])) == 2.5
    assert scale(np.array([-0.25, -0.25])) == 0.25
    assert scale(np.full(3, np.nan)) == 0.0
    taken = sampled(np.arange(1650.0))
    assert (taken[0], taken[-1], len(taken)) == (0.0, 1649.0, 41)
    assert set(np.diff(taken)) <= {41.0, 42.0}
    assert deviation(np.arange(1650.0), taken, 1.0) == 0.0
    assert Flight(0).compared({}, "any") == Compared([], 0, 0, 0.0)
