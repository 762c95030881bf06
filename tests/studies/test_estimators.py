"""docs/estimators.md is what its command makes of today's estimators, flights and columns; the command works; the numbers are not compared.

What the command computes is checked on numbers made by hand.
"""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import import_module
from math import inf, isnan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from flightbed import registry
from flightbed.consistency import detectors
from flightbed.ensemble import Job, fly_jobs

ROOT = Path(__file__).resolve().parents[1]
PAGE, README = ROOT / "docs" / "estimators.md", ROOT / "README.md"


@pytest.fixture(scope="module")
def bench() -> Any:
    """The command and its parts, as they are when it is run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        parts = ("entrants", "flights", "measures", "tables", "choice", "page", "cost")
        yield SimpleNamespace(
            command=import_module("estimators"), **{p: import_module(f"side_by_side.{p}") for p in parts}
        )


@pytest.fixture(scope="module")
def smoke(bench: Any) -> Any:
    """The whole set, flown once, each flight cut short."""
    course, entrants = bench.command.QUICK, bench.entrants.ENTRANTS
    costs = bench.cost.costs_us(course.together(bench.flights.FLIGHTS[0], entrants), 1)
    return bench.measures.fly_set(bench.flights.FLIGHTS, entrants, costs, runs=1, course=course)


def _skeleton(text: str) -> list[tuple[list[str], list[str]]]:
    """Return heads and first columns of all tables in a text."""
    tables: list[tuple[list[str], list[str]]] = []
    inside = False
    for line in text.splitlines():
        if not line.startswith("| "):
            inside = False
            continue
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not inside:
            tables.append((cells, []))
        elif not set(line) <= set("|- "):
            tables[-1][1].append(cells[0])
        inside = True
    return tables


def test_every_estimator_of_the_registry_is_compared(bench: Any) -> None:
    compared = {entrant.settings["kind"] for entrant in bench.entrants.ENTRANTS}
    assert compared == {name for name in registry.names("estimators") if registry.is_built_in("estimators", name)}


@pytest.mark.parametrize("piece", ["assumed", "flights", "results", "alarms", "choice", "short"])
def test_the_page_has_the_tables_rows_and_columns_that_the_command_makes_today(
    bench: Any, smoke: Any, piece: str
) -> None:
    path = README if piece == "short" else PAGE
    written = bench.page.between_markers(path.read_text(encoding="utf-8"), piece)
    made = bench.page.pieces(smoke)[piece]
    assert _skeleton(written) == _skeleton(made), "run: python tools/tables/estimators.py --write"
    assert _skeleton(made)


@pytest.mark.parametrize("piece", ["assumed", "flights"])
def test_words_of_the_page_are_those_of_the_rows(bench: Any, smoke: Any, piece: str) -> None:
    """All but the last cell of what is assumed, which is a time, and but the number of flights."""
    written = bench.page.between_markers(PAGE.read_text(encoding="utf-8"), piece)
    for line in bench.page.pieces(smoke)[piece].splitlines():
        if line.startswith("| "):
            assert (line.rpartition(" | ")[0] if piece == "assumed" else line) in written


def test_a_page_that_lacks_an_estimator_is_found_out(bench: Any, smoke: Any) -> None:
    """The comparison above can fail: another estimator, another row."""
    newcomer = replace(bench.entrants.ENTRANTS[1], name="newcomer")
    more = replace(smoke, entrants=(*smoke.entrants, newcomer), cost_us={**smoke.cost_us, "newcomer": [1.0]})
    one, other = bench.page.pieces(smoke), bench.page.pieces(more)
    for piece in ("assumed", "results", "alarms", "short"):
        assert _skeleton(one[piece]) != _skeleton(other[piece])
    row = next(line for line in other["results"].splitlines() if line.startswith("| newcomer |"))
    assert set(row.removeprefix("| newcomer |")) <= set("|- ")  # never flown: dashes


def test_an_estimator_that_cannot_serve_is_a_dash_with_the_words_of_the_refusal(bench: Any) -> None:
    able = bench.entrants.ENTRANTS[0]
    unable = replace(able, name="unable", settings={"kind": "loop-gain", "memory": "variable"})
    flights = bench.flights.FLIGHTS[:1]
    found = bench.measures.fly_set(
        flights, (able, unable), {able.name: [1.0], "unable": [1.0]}, runs=1, course=bench.command.QUICK
    )
    table = bench.tables.one_flight(found, flights[0])
    row = next(row for row in table.rows if row[0] == "unable")
    assert set(row[1:]) == {"-"}
    assert "unable: " in table.note
    assert "memory" in table.note
    assert next(row for row in table.rows if row[0] == able.name)[1] != "-"
    assert bench.tables.short(found).rows[1][3] == "-"


def test_flights_that_are_the_same_without_their_failure_are_flown_and_named_once(bench: Any) -> None:
    course, entrants = bench.flights.Course(), bench.entrants.ENTRANTS
    named: dict[str, Any] = {}
    for flight in bench.flights.FLIGHTS:
        healthy = course.healthy(flight, entrants).model_copy(update={"name": "x", "description": ""})
        assert named.setdefault(flight.without, healthy) == healthy
    assert len({scenario.model_dump_json() for scenario in named.values()}) == len(named)


def test_nobody_but_the_truth_corrects_the_law_of_the_flights_in_parallel(bench: Any) -> None:
    course, entrants, flight = bench.flights.Course(), bench.entrants.ENTRANTS, bench.flights.FLIGHTS[0]
    together = course.together(flight, entrants)
    assert together.adaptation.oracle
    assert [e.name for e in together.estimators] == [e.name for e in entrants]
    alone = course.corrected(flight, entrants[2])
    assert not alone.adaptation.oracle
    assert alone.adaptation.estimator == entrants[2].name == alone.estimators[0].name
    assert not course.corrected(flight, bench.entrants.FIXED).adaptation.enabled


def test_flights_in_parallel_are_the_same_whoever_rides_along(bench: Any) -> None:
    course, entrants, flight = bench.command.QUICK, bench.entrants.ENTRANTS, bench.flights.FLIGHTS[4]
    many, few = (
        fly_jobs([Job(course.together(flight, some), 1, ("q_deg_s",))])[0][0] for some in (entrants, entrants[1:2])
    )
    np.testing.assert_array_equal(many.columns["q_deg_s"], few.columns["q_deg_s"])


def test_errors_and_settling_are_what_they_say(bench: Any) -> None:
    t = np.arange(10) / 10.0
    error = np.array([9.0, 9.0, 3.0, -4.0, 0.1, 0.1, 3.0, 0.1, 0.1, 0.1])
    band = np.full(10, 0.2)
    assert bench.measures.rms_after(t, error, 0.2) == pytest.approx(np.sqrt((9 + 16 + 9 + 5 * 0.01) / 8))
    assert bench.measures.rms_after(t, error, 1.0) is None
    assert bench.measures.settled_after(t, error, band, 0.2) == pytest.approx(0.5)  # thrown out once more at 0.6 s
    assert bench.measures.settled_after(t, error, band, 0.7) == 0.0
    assert bench.measures.settled_after(t[:7], error[:7], band[:7], 0.2) == inf


def test_a_number_a_flight_is_that_of_its_metrics_where_these_have_one(bench: Any) -> None:
    """The RMS over the flight's own "post" is the one of the metrics, and so is the median error; another way to the same number."""
    flight, entrants = bench.flights.FLIGHTS[0], bench.entrants.ENTRANTS[:2]
    columns = ("t_s", "effectiveness_true", "scheduled.effectiveness_smoothed", "scheduled.effectiveness")
    (flown,) = fly_jobs([Job(bench.command.QUICK.together(flight, entrants), 1, columns)])[0]
    told = flown.metrics.estimators["scheduled"]
    error = flown.columns["scheduled.effectiveness_smoothed"] - flown.columns["effectiveness_true"]
    assert bench.measures.rms_after(flown.columns["t_s"], error, 4.5 + 0.3) == pytest.approx(
        told.rms_error_smoothed_post, rel=1e-12
    )
    found = bench.measures.estimated([flown], "scheduled", tests=True)
    assert found.alarm_s == [told.detected_at_s]
    assert found.final == [pytest.approx(abs(told.final - 0.2), rel=1e-12)]
    assert bench.measures.estimated([flown], "scheduled", tests=False).alarm_s is None


def test_what_was_flown_hangs_together(bench: Any, smoke: Any) -> None:
    names = [e.name for e in bench.entrants.ENTRANTS]
    assert smoke.steady == {"stuck", "bias", "c.g. shift"}
    every = {(f.name, n) for f in bench.flights.FLIGHTS for n in names}
    assert set(smoke.estimates) == every - set(smoke.unfit)
    rows = (bench.entrants.TOLD, bench.entrants.FIXED, bench.entrants.HEALTHY)
    assert set(smoke.corrected) == set(smoke.estimates) | {(f.name, n) for f in bench.flights.FLIGHTS for n in rows}
    assert set(smoke.healthy) == {f.without for f in bench.flights.FLIGHTS}
    loss = {n: smoke.estimates["elevator loss", n] for n in names}
    assert loss["scheduled"].rms[0] < loss["expanding"].rms[0]  # all data is too much after a change
    assert {n for n in names if loss[n].alarm_s is not None} == smoke.tested
    assert smoke.tested == {"scheduled", "two-stage", "retrospective-cost", "input-kalman"}
    known = detectors(bench.command.QUICK.together(bench.flights.FLIGHTS[0], bench.entrants.ENTRANTS))
    assert {e.name for e in bench.entrants.ENTRANTS if e.alarm == bench.entrants.CHANGED} == set(known)
    assert not smoke.tested & {"short-period", "expanding", "differentiated-rls"}  # have no test for a change
    assert smoke.corrected["elevator loss", "nothing fails"].tracking_deg_s[0] < 3.0


def test_a_stuck_elevator_is_no_lost_effectiveness_and_only_a_test_against_the_commands_finds_it(bench: Any) -> None:
    """The page says so: position is measured, K stays 1; a reconstruction holds the position against the commands."""
    flight = next(f for f in bench.flights.FLIGHTS if f.name == "stuck")
    names = ("scheduled", "differentiated-rls", "two-stage", "retrospective-cost", "input-kalman")
    columns = ("t_s", *(f"{n}.effectiveness" for n in names))
    scenario = bench.flights.Course().together(flight, bench.entrants.ENTRANTS)
    (flown,) = fly_jobs([Job(scenario, 1, columns)])[0]
    assert not flown.metrics.departed
    late = flown.columns["t_s"] >= scenario.failures[0].at_s
    for name in names:
        assert np.all(np.abs(flown.columns[f"{name}.effectiveness"][late] - 1.0) < 0.1), name
        found = flown.metrics.estimators[name].detected_at_s
        assert (found is not None) == (name in ("retrospective-cost", "input-kalman")), name


def test_cells_say_median_interval_and_what_never_happened(bench: Any) -> None:
    middle = bench.tables.middle
    assert middle([float(v) for v in range(1, 12)], ".0f") == "6 (2 to 10)"  # sign test, n = 11: 2nd and 10th
    assert middle([1.0] * 9 + [inf] * 2, ".1f") == "1.0 (1.0 to inf), never in 2 of 11"
    assert middle([inf] * 6 + [1.0], ".1f") == "never in 6 of 7"
    assert middle([inf] * 3, ".1f") == "never"
    assert middle([None, None], ".1f") == "-"
    bounds = binomtest(1, 40).proportion_ci(0.95, method="exact")
    assert bench.tables.percent(1, 40) == f"2.5 ({100 * bounds.low:.1f} to {100 * bounds.high:.1f})"


def test_the_best_is_named_with_those_that_the_flights_do_not_tell_from_it(
    bench: Any, rng: np.random.Generator
) -> None:
    common = rng.normal(5.0, 1.0, 40)  # seeds: large, and the same for all
    values = {
        "a": list(common),
        "b": list(common + rng.normal(0.0, 0.01, 40) + 1e-3),
        "c": list(common + 0.1),  # worse in every flight, by far less than flights differ
        "never": [inf] * 40,
        "absent": [None] * 40,
    }
    names = bench.choice.not_worse(values)
    assert set(names) == {"a", "b"}
    assert bench.choice.not_worse({"never": values["never"]}) == ()
    nothing = bench.choice._apart([None], [1.0])
    assert isnan(nothing.estimate)
    assert (nothing.low, nothing.high) == (-inf, inf)


def _shown(bench: Any, smoke: Any, **changes: Any) -> str:
    return "\n".join(bench.choice.reading(replace(smoke, **changes)))


def test_sentences_follow_from_the_figures(bench: Any, smoke: Any) -> None:
    """Change a figure, and the sentence that rests on it changes."""
    Estimates, Corrected, Healthy = bench.measures.Estimates, bench.measures.Corrected, bench.measures.Healthy
    changing = [f.name for f in bench.flights.FLIGHTS if f.name not in smoke.steady]
    exact = Estimates([1e-6], [1e-6], [0.0], None)
    perfect = {(name, "expanding"): exact for name in changing}
    assert "**expanding**, whose error is smallest" in _shown(bench, smoke, estimates={**smoke.estimates, **perfect})
    assert "**expanding**, whose error is smallest" not in _shown(bench, smoke)
    blind = {(changing[0], "expanding"): Estimates([0.9], [0.9], [0.0], None)}
    hangs = _shown(bench, smoke, estimates={**smoke.estimates, **perfect, **blind})
    assert "It hangs on the set of flights: " in hangs
    assert f"without {changing[0]} expanding, 0.000" in hangs
    loud = {
        name: replace(flown, alarmed={"scheduled": 1, "two-stage": 0, "retrospective-cost": 1, "input-kalman": 1})
        for name, flown in smoke.healthy.items()
    }
    assert "without a failure: **two-stage**." in _shown(bench, smoke, healthy=loud)
    quiet = {"x": Healthy(1, 0.1, {"scheduled": 0, "two-stage": 1, "retrospective-cost": 1, "input-kalman": 1})}
    assert "without a failure: **scheduled**." in _shown(bench, smoke, healthy=quiet)
    assert "retrospective-cost in 1 of 1 (level)" not in _shown(bench, smoke)  # it need not say that K has changed
    missed = replace(smoke.estimates["level", "scheduled"], alarm_s=[inf])
    said = _shown(bench, smoke, estimates={**smoke.estimates, ("level", "scheduled"): missed})
    assert "scheduled in 1 of 1 (level)" in said
    gone = {("level", "scheduled"): Corrected([None], [9.0])}
    total = len(bench.tables.survivable(smoke))
    assert f"scheduled 1 of {total}" in _shown(bench, smoke, corrected={**smoke.corrected, **gone})


def test_pieces_are_written_between_their_markers_and_nowhere_else(bench: Any, smoke: Any, tmp_path: Path) -> None:
    page, readme = tmp_path / "estimators.md", tmp_path / "README.md"
    page.write_text(PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    readme.write_text(README.read_text(encoding="utf-8"), encoding="utf-8")
    told = bench.page.pieces(smoke)
    bench.page.write(told, page=page, readme=readme)
    for path, original, names in ((page, PAGE, set(told) - {"short"}), (readme, README, {"short"})):
        after, before = path.read_text(encoding="utf-8"), original.read_text(encoding="utf-8")
        for name in names:
            assert bench.page.between_markers(after, name) == told[name]
        blocks = r"(<!-- estimators\.py: \w+ -->\n).*?(<!-- end -->)"
        assert re.sub(blocks, r"\1\2", after, flags=re.DOTALL) == re.sub(blocks, r"\1\2", before, flags=re.DOTALL)
    readme.write_text("no markers", encoding="utf-8")
    with pytest.raises(ValueError, match="one pair of markers 'short'"):
        bench.page.write(told, page=page, readme=readme)


def test_the_command_runs(bench: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench.command, "FLIGHTS", bench.flights.FLIGHTS[:1])
    assert bench.command.main(["--runs", "1", "--workers", "1", "--quick"]) == 0
    printed = capsys.readouterr().out
    assert "1 flights of each kind" in printed
    assert all(f"| {entrant.name} | " in printed for entrant in bench.entrants.ENTRANTS)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["--runs", "0"], "must be at least 1"), (["--quick", "--write"], "figures of --quick mean nothing")],
)
def test_what_makes_no_sense_is_refused(
    bench: Any, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    with pytest.raises(SystemExit) as refused:
        bench.command.main(arguments)
    assert refused.value.code == 2
    assert message in capsys.readouterr().err
