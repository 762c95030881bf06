"""The study of all estimators; docs/estimators.md has its rows and columns of today, its numbers are not compared.

Errors, delays and counts are checked on numbers made by hand.
"""

from __future__ import annotations

import json
import re
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from math import inf, isnan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from flightbed.analysis.seeds import Job, fly_jobs
from flightbed.avionics.schedule import Schedule
from flightbed.cli import main as cli
from flightbed.config import families
from flightbed.document.document import Document, show
from flightbed.flight import plan as planning
from flightbed.scenario.estimates import detectors
from flightbed.studies.base import Trials, reproduce, run_trials
from flightbed.studies.estimators import choice, measures, tables
from flightbed.studies.estimators.comparison import CORRECTED, Comparison, Key
from flightbed.studies.estimators.entrants import CHANGED, ENTRANTS, FIXED, HEALTHY, TRUE_K
from flightbed.studies.estimators.flights import FLIGHTS, Course
from flightbed.studies.estimators.measures import Corrected, Estimates, Healthy, Results, measured
from flightbed.studies.estimators.study import SECTIONS, study
from flightbed.testing import check as contract
from tests.command_line import assert_one_clear_line
from tests.flights import studies_in_this_process
from tests.studies.short_comparison import SHORT

ROOT = Path(__file__).resolve().parents[2]
PAGE, README = ROOT / "docs" / "estimators.md", ROOT / "README.md"
QUICK = Comparison(course=Course(("duration_s=6",)), rounds=1)


@pytest.fixture(scope="module")
def tool() -> Any:
    """The script that writes the tables into the documents."""
    spec = spec_from_file_location("tables_of_estimators", ROOT / "tools" / "tables" / "estimators.py")
    assert spec
    assert spec.loader
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _fly(compared: Comparison, runs: int = 1, correcting: set[str] | None = None) -> Results:
    """Fly a comparison here and now; after its first flight only the estimators that are given correct the law."""
    unfit = compared.unfit()
    jobs = compared.jobs(runs, unfit)
    flights = {key: job for key, job in jobs.items() if isinstance(job, Job)}
    trials = {key: job for key, job in jobs.items() if isinstance(job, Trials)}
    first = compared.flights[0].name
    skipped = {
        key
        for key in flights
        if key[0] == CORRECTED and key[1] != first and key[2] not in (correcting or {key[2]}) | {FIXED, TRUE_K}
    }
    flown = [key for key in flights if key not in skipped]
    found: dict[Key, list[Any]] = dict(zip(flown, fly_jobs([flights[key] for key in flown]), strict=True))
    found |= {key: found[CORRECTED, key[1], FIXED] for key in skipped}
    tried = run_trials(list(trials.values()), executor=None, progress=lambda _: None)
    return measured(compared, runs, unfit, {**found, **dict(zip(trials, tried, strict=True))})


def _document(results: Results) -> Document:
    return Document("", [section(results) for section in SECTIONS], {"runs_of_each_case": results.runs})


@contextmanager
def _schedules_once() -> Iterator[None]:
    """Tabulate each condition once; every estimator that a flight may have is planned for itself."""
    load, known = planning.load_schedule, dict[Any, Schedule]()

    def once(airframe: Any, *, throttle: float, fingerprint: Any, standard: Any) -> Schedule:
        key = (airframe.mach, airframe.altitude_m, throttle, fingerprint)
        if key not in known:
            known[key] = load(airframe, throttle=throttle, fingerprint=fingerprint, standard=standard)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "load_schedule", once)
        yield


@pytest.fixture(scope="module", params=["few", pytest.param("all", marks=pytest.mark.long)])
def smoke(request: pytest.FixtureRequest) -> Results:
    """The whole set, flown once, each flight cut short. Few: in all flights all estimators in parallel, and two correct the law.

    The first flight is whole; in the others the place of a flight that another estimator corrects has the one without correction.
    """
    correcting = {"scheduled", "input-kalman"} if request.param == "few" else {e.name for e in ENTRANTS}
    with _schedules_once():
        return _fly(QUICK, correcting=correcting)


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


def test_every_estimator_of_the_registry_is_compared() -> None:
    compared = {entrant.settings["kind"] for entrant in ENTRANTS}
    assert compared == {name for name in families.names("estimators") if families.is_built_in("estimators", name)}


@pytest.mark.parametrize("piece", ["assumed", "flights", "results", "alarms", "choice", "short"])
def test_the_page_has_the_tables_rows_and_columns_that_the_command_makes_today(
    tool: Any, smoke: Results, piece: str
) -> None:
    path = README if piece == "short" else PAGE
    written = tool.between_markers(path.read_text(encoding="utf-8"), piece)
    made = tool.pieces(_document(smoke))[piece]
    assert _skeleton(written) == _skeleton(made), "run: python tools/tables/estimators.py --write"
    assert _skeleton(made)


@pytest.mark.parametrize("piece", ["assumed", "flights"])
def test_words_of_the_page_are_those_of_the_rows(tool: Any, smoke: Results, piece: str) -> None:
    """All but the last cell of what is assumed, which is a time, and but the number of flights."""
    written = tool.between_markers(PAGE.read_text(encoding="utf-8"), piece)
    for line in tool.pieces(_document(smoke))[piece].splitlines():
        if line.startswith("| "):
            assert (line.rpartition(" | ")[0] if piece == "assumed" else line) in written


def test_a_page_that_lacks_an_estimator_is_found_out(tool: Any, smoke: Results) -> None:
    """The comparison above can fail: another estimator, another row."""
    newcomer = replace(ENTRANTS[1], name="newcomer")
    more = replace(smoke, entrants=(*smoke.entrants, newcomer), cost_us={**smoke.cost_us, "newcomer": [1.0]})
    one, other = tool.pieces(_document(smoke)), tool.pieces(_document(more))
    for piece in ("assumed", "results", "alarms", "short"):
        assert _skeleton(one[piece]) != _skeleton(other[piece])
    row = next(line for line in other["results"].splitlines() if line.startswith("| newcomer |"))
    assert set(row.removeprefix("| newcomer |")) <= set("|- ")  # never flown: dashes


def test_an_estimator_that_cannot_serve_is_a_dash_with_the_words_of_the_refusal() -> None:
    able = ENTRANTS[0]
    unable = replace(able, name="unable", settings={"kind": "loop-gain", "memory": "variable"})
    found = _fly(replace(QUICK, entrants=(able, unable), flights=FLIGHTS[:1]))
    table = tables.one_flight(found, FLIGHTS[0])
    row = next(row for row in table.rows if row[0] == "unable")
    assert set(row[1:]) == {"-"}
    assert "unable: " in table.note
    assert "memory" in table.note
    assert next(row for row in table.rows if row[0] == able.name)[1] != "-"
    assert list(tables.short(found).rows[1][1:4]) == ["-"] * 3
    assert found.cost_us.keys() == {able.name}


def test_flights_that_are_the_same_without_their_failure_are_flown_and_named_once() -> None:
    course, entrants = Course(), ENTRANTS
    named: dict[str, Any] = {}
    for flight in FLIGHTS:
        healthy = course.healthy(flight, entrants).model_copy(update={"name": "x", "description": ""})
        assert named.setdefault(flight.without, healthy) == healthy
    assert len({scenario.model_dump_json() for scenario in named.values()}) == len(named)


def test_nobody_but_the_truth_corrects_the_law_of_the_flights_in_parallel() -> None:
    course, entrants, flight = Course(), ENTRANTS, FLIGHTS[0]
    together = course.together(flight, entrants)
    assert together.adaptation.oracle
    assert [e.name for e in together.estimators] == [e.name for e in entrants]
    alone = course.corrected(flight, entrants[2])
    assert not alone.adaptation.oracle
    assert alone.adaptation.estimator == entrants[2].name == alone.estimators[0].name
    assert not course.corrected(flight, FIXED).adaptation.enabled


def test_flights_in_parallel_are_the_same_whoever_rides_along() -> None:
    course, entrants, flight = QUICK.course, ENTRANTS, FLIGHTS[4]
    many, few = (
        fly_jobs([Job(course.together(flight, some), 1, ("q_deg_s",))])[0][0] for some in (entrants, entrants[1:2])
    )
    np.testing.assert_array_equal(many.columns["q_deg_s"], few.columns["q_deg_s"])


def test_errors_and_settling_are_what_they_say() -> None:
    t = np.arange(10) / 10.0
    error = np.array([9.0, 9.0, 3.0, -4.0, 0.1, 0.1, 3.0, 0.1, 0.1, 0.1])
    band = np.full(10, 0.2)
    assert measures.rms_after(t, error, 0.2) == pytest.approx(np.sqrt((9 + 16 + 9 + 5 * 0.01) / 8))
    assert measures.rms_after(t, error, 1.0) is None
    assert measures.settled_after(t, error, band, 0.2) == pytest.approx(0.5)  # thrown out once more at 0.6 s
    assert measures.settled_after(t, error, band, 0.7) == 0.0
    assert measures.settled_after(t[:7], error[:7], band[:7], 0.2) == inf


def test_a_number_a_flight_is_that_of_its_metrics_where_these_have_one() -> None:
    """The RMS over the flight's own "post" is the one of the metrics, and so is the median error; another way to the same number."""
    flight, entrants = FLIGHTS[0], ENTRANTS[:2]
    columns = ("t_s", "effectiveness_true", "scheduled.effectiveness_smoothed", "scheduled.effectiveness")
    (flown,) = fly_jobs([Job(QUICK.course.together(flight, entrants), 1, columns)])[0]
    metrics = flown.metrics.estimators["scheduled"]
    error = flown.columns["scheduled.effectiveness_smoothed"] - flown.columns["effectiveness_true"]
    assert measures.rms_after(flown.columns["t_s"], error, 4.5 + 0.3) == pytest.approx(
        metrics.rms_error_smoothed_post, rel=1e-12
    )
    found = measures.estimated([flown], "scheduled", tests=True)
    assert found.alarm_s == [metrics.detected_at_s]
    assert found.final == [pytest.approx(abs(metrics.final - 0.2), rel=1e-12)]
    assert measures.estimated([flown], "scheduled", tests=False).alarm_s is None


def test_what_was_flown_hangs_together(smoke: Results) -> None:
    names = [e.name for e in ENTRANTS]
    assert smoke.steady == {"stuck", "bias", "c.g. shift"}
    every = {(f.name, n) for f in FLIGHTS for n in names}
    assert set(smoke.estimates) == every - set(smoke.unfit)
    rows = (TRUE_K, FIXED, HEALTHY)
    assert set(smoke.corrected) == set(smoke.estimates) | {(f.name, n) for f in FLIGHTS for n in rows}
    assert set(smoke.healthy) == {f.without for f in FLIGHTS}
    loss = {n: smoke.estimates["elevator loss", n] for n in names}
    assert loss["scheduled"].rms[0] < loss["expanding"].rms[0]  # all data is too much after a change
    assert {n for n in names if loss[n].alarm_s is not None} == smoke.tested
    assert smoke.tested == {"scheduled", "two-stage", "retrospective-cost", "input-kalman"}
    known = detectors(QUICK.course.together(FLIGHTS[0], ENTRANTS))
    assert {e.name for e in ENTRANTS if e.alarm == CHANGED} == set(known)
    assert not smoke.tested & {"short-period", "expanding", "differentiated-rls"}  # have no test for a change
    assert smoke.corrected["elevator loss", "nothing fails"].tracking_deg_s[0] < 3.0


def test_a_stuck_elevator_is_no_lost_effectiveness_and_only_a_test_against_the_commands_finds_it() -> None:
    """The page says so: position is measured, K stays 1; a reconstruction holds the position against the commands."""
    flight = next(f for f in FLIGHTS if f.name == "stuck")
    names = ("scheduled", "differentiated-rls", "two-stage", "retrospective-cost", "input-kalman")
    columns = ("t_s", *(f"{n}.effectiveness" for n in names))
    scenario = Course().together(flight, ENTRANTS)
    (flown,) = fly_jobs([Job(scenario, 1, columns)])[0]
    assert not flown.metrics.departed
    late = flown.columns["t_s"] >= scenario.failures[0].at_s
    for name in names:
        assert np.all(np.abs(flown.columns[f"{name}.effectiveness"][late] - 1.0) < 0.1), name
        found = flown.metrics.estimators[name].detected_at_s
        assert (found is not None) == (name in ("retrospective-cost", "input-kalman")), name


def test_cells_say_median_interval_and_what_never_happened() -> None:
    def middle(values: measures.Values, spec: str) -> str:
        return show(tables.middle(values, spec), spec)

    assert middle([float(v) for v in range(1, 12)], ".0f") == "6 (2 to 10)"  # sign test, n = 11: 2nd and 10th
    assert middle([1.0] * 9 + [inf] * 2, ".1f") == "1.0 (1.0 to inf), never in 2 of 11"
    assert middle([inf] * 6 + [1.0], ".1f") == "never in 6 of 7"
    assert middle([inf] * 3, ".1f") == "never"
    assert middle([None, None], ".1f") == "-"
    bounds = binomtest(1, 40).proportion_ci(0.95, method="exact")
    assert show(tables.percent(1, 40), ".1f") == f"2.5 ({100 * bounds.low:.1f} to {100 * bounds.high:.1f})"


def test_the_best_is_named_with_those_that_the_flights_do_not_tell_from_it(rng: np.random.Generator) -> None:
    common = rng.normal(5.0, 1.0, 40)  # seeds: large, and the same for all
    values = {
        "a": list(common),
        "b": list(common + rng.normal(0.0, 0.01, 40) + 1e-3),
        "c": list(common + 0.1),  # worse in every flight, by far less than flights differ
        "never": [inf] * 40,
        "absent": [None] * 40,
    }
    names = choice.not_worse(values)
    assert set(names) == {"a", "b"}
    assert choice.not_worse({"never": values["never"]}) == ()
    nothing = choice._apart([None], [1.0])
    assert isnan(nothing.estimate)
    assert (nothing.low, nothing.high) == (-inf, inf)


def _shown(smoke: Results, **changes: Any) -> str:
    return "\n".join(choice.reading(replace(smoke, **changes)))


def test_sentences_follow_from_the_figures(smoke: Results) -> None:
    """Change a figure, and the sentence that rests on it changes."""
    changing = [f.name for f in FLIGHTS if f.name not in smoke.steady]
    exact = Estimates([1e-6], [1e-6], [0.0], None)
    perfect = {(name, "expanding"): exact for name in changing}
    assert "changes: expanding, with the smallest" in _shown(smoke, estimates={**smoke.estimates, **perfect})
    assert "changes: expanding, with the smallest" not in _shown(smoke)
    blind = {(changing[0], "expanding"): Estimates([0.9], [0.9], [0.0], None)}
    hangs = _shown(smoke, estimates={**smoke.estimates, **perfect, **blind})
    assert "It depends on the set of flights: " in hangs
    assert f"without {changing[0]} expanding, 0.000" in hangs
    loud = {
        name: replace(flown, alarmed={"scheduled": 1, "two-stage": 0, "retrospective-cost": 1, "input-kalman": 1})
        for name, flown in smoke.healthy.items()
    }
    assert "without a failure: two-stage." in _shown(smoke, healthy=loud)
    quiet = {"x": Healthy(1, 0.1, {"scheduled": 0, "two-stage": 1, "retrospective-cost": 1, "input-kalman": 1})}
    assert "without a failure: scheduled." in _shown(smoke, healthy=quiet)
    assert "retrospective-cost in 1 of 1 (level)" not in _shown(smoke)  # it need not say that K has changed
    missed = replace(smoke.estimates["level", "scheduled"], alarm_s=[inf])
    said = _shown(smoke, estimates={**smoke.estimates, ("level", "scheduled"): missed})
    assert "scheduled in 1 of 1 (level)" in said
    gone = {("level", "scheduled"): Corrected([None], [9.0])}
    total = len(tables.survivable(smoke))
    assert f"scheduled 1 of {total}" in _shown(smoke, corrected={**smoke.corrected, **gone})


def test_pieces_are_written_between_their_markers_and_nowhere_else(tool: Any, smoke: Results, tmp_path: Path) -> None:
    page, readme = tmp_path / "estimators.md", tmp_path / "README.md"
    page.write_text(PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    readme.write_text(README.read_text(encoding="utf-8"), encoding="utf-8")
    output = tool.pieces(_document(smoke))
    tool.write(output, page=page, readme=readme)
    for path, original, names in ((page, PAGE, set(output) - {"short"}), (readme, README, {"short"})):
        after, before = path.read_text(encoding="utf-8"), original.read_text(encoding="utf-8")
        for name in names:
            assert tool.between_markers(after, name) == output[name]
        blocks = r"(<!-- estimators\.py: \w+ -->\n).*?(<!-- end -->)"
        assert re.sub(blocks, r"\1\2", after, flags=re.DOTALL) == re.sub(blocks, r"\1\2", before, flags=re.DOTALL)
    readme.write_text("no markers", encoding="utf-8")
    with pytest.raises(ValueError, match="one pair of markers 'short'"):
        tool.write(output, page=page, readme=readme)


def test_the_tool_runs(tool: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tool, "QUICK", SHORT)
    assert tool.main(["--runs", "1", "--workers", "1", "--quick"]) == 0
    printed = capsys.readouterr().out
    assert "1 flights of each kind" in printed
    assert all(f"| {entrant.name} | " in printed for entrant in SHORT.entrants)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["--runs", "0"], "must be at least 1"), (["--quick", "--write"], "figures of --quick mean nothing")],
)
def test_the_tool_refuses_arguments_that_make_no_sense(
    tool: Any, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    with pytest.raises(SystemExit) as refused:
        tool.main(arguments)
    assert refused.value.code == 2
    assert message in capsys.readouterr().err


def test_only_times_differ_from_run_to_run_and_without_rounds_nothing_does() -> None:
    first, second = (reproduce(study(replace(SHORT, rounds=0)), 2).to_dict() for _ in range(2))
    assert first["tables"] == second["tables"]
    assert {row["an update, us"] for row in first["tables"]["short"]} == {"-"}
    timed = reproduce(study(SHORT), 2).to_dict()["tables"]
    for key, column in (("short", "an update, us"), ("assumed", "an update, us")):
        for row, untimed in zip(timed[key], first["tables"][key], strict=True):
            assert 0.0 < float(row.pop(column))
            assert row == {name: cell for name, cell in untimed.items() if name != column}
    assert {key: timed[key] for key in timed.keys() - {"assumed", "short"}} == {
        key: first["tables"][key] for key in timed.keys() - {"assumed", "short"}
    }


# The user's own estimator

OWN = '''\
from flightbed import Estimate


class Mine:
    """The share that its options say, whatever is measured."""

    def __init__(self, settings, onboard):
        self.k, self.alarm_at, self.tick = settings.options.get("k", 1.0), settings.options.get("alarm_at", 10**9), -1

    def update(self, measurement):
        self.tick += 1
        alarms = float(self.tick >= self.alarm_at)
        return Estimate(self.k, 0.1, self.k, self.k, measurement.alpha_rad, measurement.q_rad_s, 0.0, alarms=alarms)


class Plain(Mine):
    pass


class Broken:
    def __init__(self, settings, onboard):
        pass

    def update(self, measurement):
        return measurement.q_rad_s
'''


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with mine.py in it, and the study over one short flight; the contract is checked over less time."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(contract, "_LONG", 200)
    monkeypatch.setattr(contract, "_INTERVAL", 100)
    monkeypatch.setitem(families._BUILT_IN["studies"], "estimators", "tests.studies.short_comparison:estimators")
    (tmp_path / "mine.py").write_text(OWN)
    return tmp_path


def _call(*arguments: str, workers: str = "") -> int:
    """Run the command, with its workers if there are any, else in this process."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        with (
            nullcontext() if workers else studies_in_this_process(),
            pytest.raises(SystemExit) as ended,
        ):
            cli.main(
                ["reproduce", "estimators", "--runs", "1", *arguments, *(["--workers", workers] if workers else [])]
            )
    finally:
        signal.signal(signal.SIGTERM, before)
    return int(str(ended.value.code))


def _reproduced(capsys: pytest.CaptureFixture[str], *arguments: str, workers: str = "") -> dict[str, Any]:
    assert _call(*arguments, "--json", workers=workers) == 0
    output: dict[str, Any] = json.loads(capsys.readouterr().out)
    return output


def test_an_estimator_of_the_users_own_is_a_row_like_the_others(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "mine.toml").write_text('name = "fifth"\n[options]\nk = 0.25\n')
    output = _reproduced(capsys, "--use", "mine.py:Mine", "--settings", "mine.toml")
    names = [entrant.name for entrant in SHORT.entrants]
    assert [row["estimator"] for row in output["tables"]["short"]] == [*names, "fifth"]
    row = output["tables"][FLIGHTS[0].name][2]
    assert row["estimator"] == "fifth"
    assert row["RMS error of K"]["estimate"] == pytest.approx(0.05, abs=1e-12)  # K is 0.2
    assert row["within 20 % to stay, s"] == "never"
    assert row["tracking, deg/s"]["estimate"] > 0.0
    assert row["alarm after, s"] == "-"
    assumed = output["tables"]["assumed"][2]
    assert assumed["known"] == "The share that its options say, whatever is measured."
    assert "mine.py:Mine" in assumed["settings"]
    assert output["again"] == "flightbed reproduce estimators --runs 1 --use mine.py:Mine --settings mine.toml"
    assert list(output["extensions"]) == ["mine.py:Mine"]
    other = _reproduced(capsys, "--use", "mine.py:Mine", "--settings", "mine.toml", workers="1")
    assert other["tables"][FLIGHTS[0].name] == output["tables"][FLIGHTS[0].name]  # it is carried to another process
    without = json.loads(json.dumps(reproduce(study(SHORT), 1).to_dict()))
    assert "extensions" not in without
    for flight in (FLIGHTS[0].name, "alarms"):
        rows = {row["estimator"]: row for row in output["tables"][flight]}
        assert all(rows[row["estimator"]] == row for row in without["tables"][flight])  # the others' are the same


def test_several_are_compared_and_one_under_two_settings(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "a.toml").write_text('name = "a"\nkind = "mine.py:Mine"\noptions = {k = 0.5}\n')
    (here / "b.toml").write_text('name = "b"\nkind = "mine.py:Mine"\noptions = {k = 0.25, alarm_at = 460}\n')
    (here / "c.toml").write_text('name = "long"\nkind = "loop-gain"\nwindow = 60\n')
    files = ["--settings", "a.toml", "--settings", "b.toml", "--settings", "c.toml"]
    output = _reproduced(capsys, "--use", "mine.py:Mine", "--use", "mine.py:Plain", *files)
    rows = {row["estimator"]: row for row in output["tables"][FLIGHTS[0].name]}
    assert list(rows)[2:6] == ["a", "b", "long", "Plain"]
    assert [rows[name]["RMS error of K"]["estimate"] for name in ("a", "b", "Plain")] == pytest.approx([0.3, 0.05, 0.8])
    assert rows["b"]["alarm after, s"]["estimate"] == pytest.approx(0.1)  # raised at 4.6 s
    assert rows["a"]["alarm after, s"] == "-"
    known = {row["estimator"]: row["known"] for row in output["tables"]["assumed"]}
    assert known["Plain"] == "user's own estimator"


@pytest.mark.parametrize(
    ("arguments", "table", "message"),
    [
        (["--use", "none.py:Mine"], "", "own code none.py:Mine: none.py cannot be read: No such file or directory"),
        (["--use", "mine.py:Mime"], "", "has no 'Mime'; did you mean Mine?"),
        (["--use", "mine.py:Broken"], "", "--use mine.py:Broken: breaks the contract of an estimator: estimate: update returns a float"),
        (["--use", "mine.py:Mine", "--settings", "none.toml"], "", "none.toml: cannot be read"),
        (["--use", "mine.py:Mine", "--settings", "own.toml"], "smothing = 0.5", "own.toml: unknown key smothing; did you mean smoothing?"),
        (["--use", "mine.py:Mine", "--settings", "own.toml"], "smoothing = 1.0", "own.toml: smoothing: must be"),
        (["--use", "mine.py:Mine", "--settings", "own.toml"], "name = 'scheduled'", "own.toml: name: is that of another estimator"),
        (["--settings", "own.toml"], "name = 'x'", "own.toml: kind: is missing; name the estimator that these settings are for"),
        (["--settings", "own.toml"], "kind = 'mine.py:Mine'", "is code outside flightbed; add --use mine.py:Mine to allow it"),
        (["--use", "mine.py:Mine", "--settings", "own.toml"], "window = 30", "own.toml: window: 'mine.py:Mine' has no such key"),
        (["--settings", "own.toml"], "kind = 'loop-gain'\ninput = 'deviation'\nname = 'x'", "own.toml: no flight of the study takes it: "),
    ],
)  # fmt: skip
def test_what_cannot_be_compared_is_refused_in_one_line_before_anything_is_flown(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], table: str, message: str
) -> None:
    (here / "own.toml").write_text(table)
    assert _call(*arguments) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert len(captured.err.splitlines()) == 1
    assert not (here / "studies").exists()


def test_other_studies_take_no_code(tmp_path: Path) -> None:
    message = "the study gupta takes no code or settings of your own; leave it out, or reproduce estimators"
    assert_one_clear_line(["reproduce", "gupta", "--use", "json:dumps"], 2, message, cwd=tmp_path)
