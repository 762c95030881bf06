"""The report of a flight: its numbers are the metrics, it marks the failure everywhere, and every shipped scenario has one."""

from __future__ import annotations

import dataclasses
import json
import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flightbed.analysis.metrics import EstimatorMetrics
from flightbed.analysis.result import Result
from flightbed.analysis.trace import Trace
from flightbed.core import data
from flightbed.document import drawing, palette
from flightbed.document.document import Document, Listing, show
from flightbed.document.html import render
from flightbed.report.figures import pictures
from flightbed.report.flight_report import ESTIMATOR_METRICS, run_report
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from flightbed.statistics.intervals import chi_square_bound
from tests.document.test_html import assert_self_contained, assert_sound, words
from tests.flights import representative
from tests.lateral_flight import rolling


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return run(load_scenario("elevator-loss"), tmp_path_factory.mktemp("runs") / "x", rerun=False)


@pytest.fixture(scope="module")
def report(flown: Result) -> Document:
    return run_report(flown)


def _table(document: Document, key: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = document.to_dict()["tables"][key]
    return rows


def _strokes(svg: str, color: str) -> int:
    return len(re.findall(rf'style="[^"]*stroke: {color}', svg))


def _axes(svg: str) -> int:
    return len(re.findall(r'id="[^"]*axes_\d+"', svg))


def test_the_page_lies_in_the_folder_and_is_small(flown: Result, report: Document) -> None:
    assert flown.folder is not None
    page = (flown.folder / "report.html").read_text(encoding="utf-8")
    assert page == render(report)
    assert len(page) < 400_000
    assert_self_contained(page)
    assert_sound(page)


def test_all_numbers_are_those_of_metrics_json(flown: Result, report: Document) -> None:
    assert flown.folder is not None
    metrics = json.loads((flown.folder / "metrics.json").read_text())
    table = {row["metric"]: row for row in _table(report, "estimators")}
    assert set(table) == set(metrics["estimators"]["scheduled"])
    for name, values in metrics["estimators"].items():
        assert {key: row[name] for key, row in table.items()} == values
    for row in _table(report, "flight"):
        assert row["value"] == metrics[row["metric"]], row
    (key,) = _table(report, "key")
    assert key["RMS q - reference after it, deg/s"] == metrics["tracking_rms_post_deg_s"]
    assert key["RMS q - reference before the failure, deg/s"] == metrics["tracking_rms_pre_deg_s"]
    page = words(render(report))
    for value in (
        metrics["estimators"]["expanding"]["nis_mean"],
        metrics["tracking_rms_post_deg_s"],
        metrics["snr_db"],
    ):
        assert show(value) in page
    trim = {row[""]: row["value"] for row in _table(report, "trim")}
    assert (trim["alpha"], trim["elevator"]) == (metrics["trim"]["alpha_deg"], metrics["trim"]["elevator_deg"])
    assert f"{metrics['short_period']['A'][1][0]:.5g} 1/s^2" in page
    assert {row["of"]: row["value"] for row in _table(report, "gains")} == metrics["gains"]


def test_every_metric_of_an_estimator_has_a_unit_and_a_word() -> None:
    assert set(ESTIMATOR_METRICS) == {f.name for f in dataclasses.fields(EstimatorMetrics)}
    assert all(unit and meaning for unit, meaning in ESTIMATOR_METRICS.values())


def test_the_first_lines_say_what_failed_and_how_it_ended(report: Document) -> None:
    start = words(render(report)).partition("Settings")[0]
    assert "At 4.5 s the elevator effectiveness steps to 20%." in start
    assert "The proportional law is corrected by 1/K of 'scheduled'. Outcome: flown to 16.5 s." in start
    assert "f16 at Mach 0.8, 20,000 ft, seed 0" in start


def test_the_failure_is_marked_in_every_figure(flown: Result, report: Document) -> None:
    assert [p.key for p in report.pictures()] == [
        "pitch-rate",
        "alpha",
        "elevator",
        "effectiveness",
        "nis",
        "sigma",
        "condition",
    ]
    for picture in report.pictures():
        assert _strokes(picture.svg, drawing.FAILURE) >= _axes(picture.svg) > 0, picture.key
        assert picture.facts, picture.key
        assert "time, s" in picture.svg
    (never,) = pictures(run(load_scenario("nominal", ["duration_s=1"])), ("pitch-rate",))
    assert drawing.FAILURE not in never.svg


def test_the_same_thing_has_the_same_colour(report: Document) -> None:
    svg = {p.key: p.svg for p in report.pictures()}
    for key in ("effectiveness", "nis", "sigma"):
        assert all(color in svg[key] for color in palette.ESTIMATES[:2]), key
    assert drawing.ACTUAL in svg["alpha"]
    assert drawing.TRUTH in svg["effectiveness"]
    assert drawing.REFERENCE in svg["pitch-rate"]
    assert drawing.COMMAND in svg["pitch-rate"]
    assert drawing.COMMAND in svg["elevator"]


def test_facts_are_computed_from_what_is_drawn(flown: Result, report: Document) -> None:
    facts = {p.key: p.facts for p in report.pictures()}
    error = np.abs(flown.trace["q_deg_s"] - flown.trace["q_ref_deg_s"])
    assert (
        f"largest |q - reference| {error.max():.2f} deg/s, at {flown.trace['t_s'][error.argmax()]:.2f} s"
        in facts["pitch-rate"]
    )
    nis = flown.trace["scheduled.nis"][1:]
    bound = chi_square_bound(2)
    assert f"'scheduled': mean {nis.mean():.2f}, above the bound 5.99 in {np.mean(nis > bound):.1%}" in facts["nis"]
    assert pytest.approx(1.0 - np.exp(-bound / 2.0)) == 0.95  # chi-square with 2 degrees of freedom
    assert "stops at -25 and +25 deg" in facts["elevator"]


def test_the_scenario_and_the_commands_are_there(flown: Result, report: Document) -> None:
    listings = {i.title: i.text for s in report.sections for i in s.items if isinstance(i, Listing)}
    assert listings["scenario.toml, complete"] == flown.plan.scenario.to_toml()
    assert "flightbed run FOLDER/scenario.toml\n" in listings["Commands"]
    assert f"jsbsim=={flown.summary.versions['jsbsim']}" in listings["Commands"]


def test_the_same_flight_is_the_same_page_but_for_the_clock(flown: Result, report: Document) -> None:
    again = run_report(run(load_scenario("elevator-loss")))
    slow = dataclasses.replace(again, facts={**again.facts, "flown": report.facts["flown"]})
    assert render(slow) == render(report)


def _soon(name: str) -> list[str]:
    """Overrides that bring all failures and gusts of a scenario into a short flight."""
    scenario = load_scenario(name)
    fail = [f"failures.{i}.at_s={0.5 + 0.2 * i}" for i in range(len(scenario.failures))]
    fail += ["control.autothrottle.then_at_s=0.5"] if scenario.control.times else []
    return ["duration_s=1.2", *fail, *(f"gusts.{i}.at_s={0.4 + 0.2 * i}" for i in range(len(scenario.gusts)))]


@pytest.mark.parametrize("name", representative(data.names("scenario")))
def test_every_shipped_scenario_has_a_sound_page(name: str) -> None:
    result = run(load_scenario(name, _soon(name)))
    document = run_report(result)
    page = render(document)
    assert_sound(page)
    assert_self_contained(page)
    assert "nan" not in words(page)
    for picture in document.pictures():
        marks = _strokes(picture.svg, drawing.FAILURE)
        wanted = len(result.plan.scenario.failures) * _axes(picture.svg)
        assert marks >= wanted, picture.key
    assert len(_table(document, "events")) >= len(result.plan.scenario.failures)


@pytest.mark.parametrize(
    ("name", "column"), [("elevator-stuck", "elevator_acting_deg"), ("harmonic-gust", "gust_alpha_deg")]
)
def test_a_reconstruction_is_drawn_beside_what_acts(name: str, column: str) -> None:
    result = run(load_scenario(name))
    pictures = {picture.key: picture for picture in run_report(result).pictures()}
    assert _axes(pictures["reconstruction"].svg) == 2
    error = result.trace["random-walk.reconstructed_deg"] - result.trace[column]
    rms = np.sqrt(np.mean(error[np.isfinite(error)] ** 2))
    assert f"'random-walk': RMS error {rms:.3f} deg" in pictures["reconstruction"].facts
    says_k = 1 if name == "harmonic-gust" else 3  # a reconstructed gust says nothing of K
    assert _axes(pictures["effectiveness"].svg) == says_k


def test_a_flight_that_departs_says_so_first() -> None:
    result = run(load_scenario("elevator-loss-fixed"))
    document = run_report(result)
    gone = f"departed at {result.summary.metrics.departed_at_s:.2f} s"
    assert gone in document.lead.text[0]
    assert "not corrected" in document.lead.text[0]
    assert any("DEPARTED" in row["event"] for row in _table(document, "events"))


def test_without_estimators_there_are_no_figures_of_them() -> None:
    bare = ["estimators=[]", "adaptation.enabled=false", "duration_s=1"]
    document = run_report(run(load_scenario("elevator-loss", [*bare, "failures.0.at_s=0.5"])))
    assert [p.key for p in document.pictures()] == ["pitch-rate", "alpha", "elevator", "condition"]
    assert "No estimator flew." in words(render(document))


def test_values_that_are_not_finite_are_drawn_around(flown: Result) -> None:
    columns = {k: v.copy() for k, v in flown.trace.columns.items()}
    for name in (
        "q_deg_s",
        "alpha_deg",
        "nz_g",
        "scheduled.effectiveness",
        "scheduled.nis",
        "expanding.effectiveness_std",
    ):
        columns[name][-3:] = [np.nan, np.inf, -np.inf]
    for name in ("expanding.nis", "expanding.effectiveness_smoothed", "effectiveness_bound"):
        columns[name][:] = np.nan
    broken = dataclasses.replace(flown, trace=Trace(columns, flown.trace.estimators))
    assert_sound(render(run_report(broken)))


def test_of_very_many_events_the_severe_ones_stay(flown: Result) -> None:
    columns = {**flown.trace.columns, "expanding.alarms": np.floor(np.arange(len(flown.trace)) / 3.0)}
    scenario = flown.plan.scenario
    failure = scenario.failures[0].model_copy(update={"at_s": 16.0})
    plan = dataclasses.replace(flown.plan, scenario=scenario.model_copy(update={"failures": (failure,)}))
    many = dataclasses.replace(flown, plan=plan, trace=Trace(columns, flown.trace.estimators))
    (table,) = (t for t in run_report(many).tables() if t.key == "events")
    assert len(table.rows) == 101
    assert str(table.rows[-1][1]).startswith("FAILURE")
    assert "more events are not listed" in table.note


def test_a_run_without_a_report(tmp_path: Path) -> None:
    run(load_scenario("nominal", ["duration_s=0.2"]), tmp_path / "x", rerun=False, report=False)
    assert not (tmp_path / "x" / "report.html").exists()


def test_a_flight_with_roll_and_yaw_has_figures_and_numbers_of_them() -> None:
    result = run(rolling())
    document = run_report(result)
    metrics, stored, svg = result.metrics, result.summary.to_dict(), {p.key: p.svg for p in document.pictures()}
    assert list(svg) == [
        "pitch-rate", "alpha", "elevator", "roll", "aileron-and-rudder", "effectiveness", "nis", "sigma", "condition",
    ]  # fmt: skip
    axes = {"roll": 3, "aileron-and-rudder": 2, "effectiveness": 4, "nis": 2, "sigma": 3}
    assert {key: _axes(svg[key]) for key in axes} == axes
    for key, count in axes.items():
        assert _strokes(svg[key], drawing.FAILURE) >= 2 * count, key
    (key,) = _table(document, "key")
    assert key["RMS p - reference after it, deg/s"] == metrics.tracking_rms_post_p_deg_s
    assert key["RMS beta - reference before the failure, deg"] == metrics.tracking_rms_pre_beta_deg
    for row in _table(document, "flight"):
        assert row["value"] == stored[row["metric"]], row
    estimates = {row["estimator"]: row for row in _table(document, "estimates")}
    assert {name: row["true K"] for name, row in estimates.items()} == {
        "surfaces": 1.0, "surfaces.aileron": 0.4, "surfaces.rudder": 0.5, "pitch": 1.0,
    }  # fmt: skip
    assert [row["corrects the law"] for row in estimates.values()] == ["yes", "yes", "yes", "no"]
    facts = {p.key: p.facts for p in document.pictures()}
    assert (
        f"'surfaces.rudder' ends at {metrics.estimators['surfaces.rudder'].final:.3f} (truth 0.500)"
        in facts["effectiveness"]
    )
    assert "above the bound 11.07 in" in facts["nis"]  # of five readings
    worst = np.abs(result.trace["p_deg_s"] - result.trace["p_ref_deg_s"])
    assert f"largest |p - reference| {worst.max():.2f} deg/s" in facts["roll"]
    assert "stops at -21.5 and +21.5 deg" in facts["aileron-and-rudder"]
    assert "stops at -30 and +30 deg" in facts["aileron-and-rudder"]
    page = render(document)
    assert_sound(page)
    assert_self_contained(page)
    assert "nan" not in words(page)


KINDS, SURFACES = ("stuck", "floating", "hardover", "rate-limit", "bias"), ("elevator", "aileron", "rudder")
EACH_ONCE = tuple(zip(KINDS, (*SURFACES, *SURFACES[:2]), strict=True))


@pytest.mark.parametrize(("kind", "surface"), representative(product(KINDS, SURFACES), EACH_ONCE))
def test_every_failure_of_an_actuator_has_a_sound_page(kind: str, surface: str) -> None:
    own = {"hardover": ", side='high'", "rate-limit": ", to=0.2", "bias": ", bias_deg=1.5"}.get(kind, "")
    failure = f"{{kind='{kind}', surface='{surface}', at_s=0.5{own}}}"
    result = run(rolling([f"failures=[{failure}]", "duration_s=1.5"]))
    page = render(run_report(result))
    assert_sound(page)
    assert "nan" not in words(page)
    assert f"the {surface}" in words(page).partition("Settings")[0]
