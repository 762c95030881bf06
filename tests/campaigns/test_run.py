"""Campaigns: equal to flights flown one by one, on any workers; the worst flight is repeated; folders are written atomically."""

from __future__ import annotations

import dataclasses
import io
import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from flightbed.analysis.metrics import EstimatorMetrics
from flightbed.analysis.seeds import processes
from flightbed.campaigns import run as campaigns
from flightbed.campaigns.folder import finish
from flightbed.campaigns.journal import Journal, journal
from flightbed.campaigns.report.page import campaign_report
from flightbed.campaigns.result import Campaign, worst_of
from flightbed.campaigns.settings import Criterion
from flightbed.campaigns.summary import QuantitySummary
from flightbed.campaigns.table import Quantity, Row, passes
from flightbed.campaigns.worker import HISTORIES
from flightbed.cli.campaign import campaign_lines
from flightbed.core.errors import InputError, OutputError
from flightbed.document import drawing
from flightbed.document.html import render
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from flightbed.statistics.intervals import median_interval, share
from tests.command_line import call
from tests.document.test_html import assert_self_contained, assert_sound, words
from tests.flights import campaigns_in_this_process
from tests.lateral_flight import NAMES, SOON, rolling

SHORT = ["duration_s=3", "failures.0.at_s=1.5", "seed=7"]
RUNS = 12  # more than a job's


@pytest.fixture(scope="module")
def flown() -> Campaign:
    return campaigns.fly(load_scenario("elevator-loss", SHORT), RUNS)


@pytest.fixture(scope="module")
def folder(flown: Campaign, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("campaigns") / "x"
    with journal(target, flown.programme, replace=True, resume=False) as book:
        assert isinstance(book, Journal)
        finish(flown, book)
    return target


def _summary(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return found


def test_the_table_is_that_of_flights_flown_one_by_one(flown: Campaign, folder: Path) -> None:
    table = pq.read_table(folder / "table.parquet").to_pylist()
    assert [row["seed"] for row in table] == list(range(7, 7 + RUNS))
    for row in (table[0], table[4], table[-1]):
        alone = run(load_scenario("elevator-loss", [*SHORT, f"seed={row['seed']}"])).metrics
        assert (row["departed"], row["departed_at_s"]) == (alone.departed, alone.departed_at_s)
        assert row["tracking_rms_pre_deg_s"] == alone.tracking_rms_pre_deg_s
        assert row["tracking_rms_post_deg_s"] == alone.tracking_rms_post_deg_s
        for name, measured in alone.estimators.items():
            ours = {k.removeprefix(f"{name}."): v for k, v in row.items() if k.startswith(f"{name}.")}
            assert ours == dataclasses.asdict(measured)


def test_columns_tell_their_units(folder: Path) -> None:
    schema = pq.read_schema(folder / "table.parquet")
    assert schema.field("tracking_rms_post_deg_s").metadata == {b"unit": b"deg/s"}
    assert schema.field("scheduled.detected_at_s").metadata == {b"unit": b"s"}
    assert schema.names[:7] == ["index", "point", "seed", "hash", "error", "passed", "departed"]


def test_the_flights_do_not_depend_on_the_workers(flown: Campaign) -> None:
    done: list[tuple[int, int]] = []
    with processes(2) as executor:
        other = campaigns.fly(
            load_scenario("elevator-loss", SHORT), RUNS, executor=executor, progress=lambda n, of: done.append((n, of))
        )
    assert done[-1] == (RUNS, RUNS)
    assert other.rows == flown.rows
    same = dataclasses.replace(other, wall_time_s=flown.wall_time_s)
    assert same.summary.to_dict() == flown.summary.to_dict()
    assert render(campaign_report(same)) == render(campaign_report(flown))


def test_only_the_columns_that_histories_need_are_kept(flown: Campaign) -> None:
    (histories,) = flown.histories.values()
    assert (
        set(histories.moments.mean)
        == set(histories.percentiles)
        == {
            *HISTORIES,
            "effectiveness_true",
            "scheduled.effectiveness_smoothed",
            "expanding.effectiveness_smoothed",
        }
    )
    assert set(histories.moments.flying) == {RUNS}
    assert histories.sampled == RUNS


def test_the_worst_flight_flies_again_by_its_command(folder: Path) -> None:
    worst = _summary(folder)["worst"]
    table = pq.read_table(folder / "table.parquet").to_pylist()
    assert worst["seed"] == max(table, key=lambda row: row["tracking_rms_post_deg_s"])["seed"]
    program, command, scenario, option, override = shlex.split(worst["command"].replace("FOLDER", str(folder)))
    assert (program, command, option) == ("flightbed", "run", "--set")
    again = run(load_scenario(scenario, [override]))
    assert again.plan.scenario.seed == worst["seed"]
    assert again.metrics.to_dict() == worst["metrics"]
    row = next(row for row in table if row["seed"] == worst["seed"])
    assert row["tracking_rms_post_deg_s"] == again.metrics.tracking_rms_post_deg_s


def test_the_summary_is_medians_with_intervals(folder: Path, flown: Campaign) -> None:
    found, rows = _summary(folder), flown.rows
    assert (found["flights"], found["first_seed"], found["departed"]["count"]) == (RUNS, 7, 0)
    gone = share(0, RUNS)
    assert (found["departed"]["low"], found["departed"]["high"]) == (gone.low, gone.high)
    for stored, column in (
        (found["tracking_rms_post_deg_s"], "tracking_rms_post_deg_s"),
        (found["estimators"]["scheduled"]["nis_mean"], "scheduled.nis_mean"),
    ):
        values = [float(row[column]) for row in rows]  # type: ignore[arg-type]
        middle = median_interval(values)
        assert (stored["median"], stored["low"], stored["high"]) == (middle.estimate, middle.low, middle.high)
        assert stored["low"] > min(values) - 1e-12
        assert stored["flights"] == RUNS
    assert "detected_at_s" not in found["estimators"]["expanding"]  # it tests for no change
    assert found["estimators"]["scheduled"]["detected_at_s"]["flights"] == RUNS


def test_what_never_happened_is_infinite_and_what_cannot_be_said_is_left_out() -> None:
    quantity = Quantity("x.detected_at_s", (0.1, np.inf, None, 0.3, np.inf, np.inf))
    assert quantity.never == 3
    assert quantity.median.runs == 5
    assert quantity.median.estimate == np.inf
    assert quantity.percentile(50).estimate == 0.2
    assert QuantitySummary.of(quantity).to_dict()["median"] is None


def test_the_report_says_what_the_summary_says(folder: Path, flown: Campaign) -> None:
    page, found = (folder / "report.html").read_text(encoding="utf-8"), _summary(folder)
    assert_self_contained(page)
    assert_sound(page)
    text = words(page)
    start = text.partition("Settings")[0]
    assert f"0 of {RUNS} flights departed: 0.0% (95 % interval 0.0% to {found['departed']['high']:.1%})" in start
    middle = found["tracking_rms_post_deg_s"]
    assert f"{middle['median']:.3g} (95 % interval {middle['low']:.3g} to {middle['high']:.3g}) deg/s" in start
    assert found["worst"]["command"] in text
    assert f"seed {found['worst']['seed']}" in start
    pictures = {p.key: p for p in campaign_report(flown).pictures()}
    assert {"tracking", "median-abs-error-post", "first-within-20pct-s", "detected-at-s", "motion", "gain"} < set(
        pictures
    )
    for key in ("motion", "motion-about", "gain", "gain-about", "pitch-rate", "effectiveness"):
        svg = pictures[key].svg
        axes = len(re.findall(r'id="[^"]*axes_\d+"', svg))
        assert len(re.findall(rf"stroke: {drawing.FAILURE}", svg)) >= axes, key
    assert "still flying" not in pictures["motion"].svg


def _row(index: int, flown_s: float, ended: str = "time", pre: float | None = 1.0, post: float | None = 2.0) -> Row:
    gone = flown_s if ended == "departed" else None
    return {
        "index": index, "error": None, "ended": ended, "departed_at_s": gone, "flown_s": flown_s, "tracking_rms_pre_deg_s": pre,
        "tracking_rms_post_deg_s": post,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("rows", "index", "reason"),
    [
        ([_row(0, 3), _row(1, 3, post=3.0)], 1, "largest RMS of q - q_ref from 0.3 s after the failure, 3 deg/s"),
        ([_row(0, 3, pre=9.0, post=None), _row(1, 3, post=None)], 0, "largest RMS of q - q_ref over the whole flight, 9 deg/s"),
        ([_row(0, 3, post=9.0), _row(1, 2.5, "ground")], 1, "hit the ground first, at 2.50 s"),
        ([_row(0, 0.9, "ground"), _row(1, 2.5, "departed"), _row(2, 2.0, "departed")], 2, "departed first, at 2.00 s"),
        ([_row(4, 3), _row(5, 3)], 4, "largest RMS of q - q_ref from 0.3 s after the failure, 2 deg/s"),
        ([{**_row(0, 1, "departed"), "error": "lost"}, _row(1, 3)], 1, "largest RMS of q - q_ref from 0.3 s after the failure, 2 deg/s"),
        ([{**_row(0, 1), "error": "lost"}], -1, "every flight failed"),
    ],
)  # fmt: skip
def test_which_flight_is_the_worst(rows: list[Row], index: int, reason: str) -> None:
    assert worst_of(rows) == (index, reason)


@pytest.mark.parametrize(
    ("criterion", "value", "expected"),
    [
        ({"equals": False}, False, True), ({"equals": False}, True, False), ({"equals": "time"}, "time", True),
        ({"max": 3.0}, 3.0, True), ({"max": 3.0}, 3.1, False), ({"min": 1}, 0.9, False), ({"min": 1, "max": 2}, 1.5, True),
        ({"max": 3.0}, None, False), ({"equals": False}, None, False),
    ],
)  # fmt: skip
def test_what_passes(criterion: dict[str, Any], value: Any, expected: bool) -> None:
    criteria = [Criterion.model_validate({"metric": "m", **criterion})]
    assert passes({"m": value}, criteria) is expected
    assert passes({"m": value}, []) is None


def test_flights_that_depart_are_counted_and_the_first_is_the_worst() -> None:
    flown = campaigns.fly(load_scenario("elevator-loss-fixed", ["failures.0.at_s=2", "failures.0.to=0.1"]), 6)
    found = flown.summary
    assert found.flights.departed is not None
    assert found.worst is not None
    assert (found.flights.departed.count, found.flights.departed.share.estimate) == (6, 1.0)
    assert found.worst.metrics.departed_at_s == min(float(r["departed_at_s"] or 0.0) for r in flown.rows)
    document = campaign_report(flown)
    (motion,) = (p for p in document.pictures() if p.key == "motion")
    assert "still flying" in motion.svg
    assert document.lead.text[0].startswith("6 of 6 flights departed: 100.0%")
    assert "departed" in next(p.svg for p in document.pictures() if p.key == "tracking")


def test_where_nothing_fails_the_whole_flight_counts() -> None:
    bare = ["estimators=[]", "adaptation.enabled=false", "duration_s=0.5"]
    flown = campaigns.fly(load_scenario("nominal", bare), 2)
    document = campaign_report(flown)
    assert_sound(render(document))
    assert "Median RMS of q - q_ref: " in document.lead.text[0]
    assert "too few flights for an interval" in document.lead.text[0]
    assert flown.reason.startswith("largest RMS of q - q_ref over the whole flight")
    assert [p.key for p in document.pictures()] == ["tracking", "motion", "motion-about", "pitch-rate"]


def test_only_a_campaign_is_replaced_and_that_is_told_before_anything_flies(tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "metrics.json").write_text("{}")
    with pytest.raises(OutputError, match=r"holds 'metrics\.json', which is not from a campaign; name a new folder"):
        campaigns.run(load_scenario("nominal"), tmp_path / "x", runs=10**9)
    with pytest.raises(InputError, match=r"--runs: must be at least 1 \(got 0\)"):
        campaigns.fly(load_scenario("nominal"), 0)


@pytest.mark.usefixtures("in_this_process")
def test_on_the_command_line(tmp_path: Path) -> None:
    short = [text for o in ("duration_s=0.4", "failures.0.at_s=0.1") for text in ("--set", o)]
    done = call("campaign", "elevator-loss", "--runs", "2", "--workers", "1", "--json", *short, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    stored = json.loads(done.stdout)
    assert stored.pop("folder") == "campaigns/elevator-loss"
    assert stored == _summary(tmp_path / "campaigns" / "elevator-loss")


def test_what_a_terminal_shows(flown: Campaign) -> None:
    screen = Console(width=80, record=True, file=io.StringIO())
    for line in campaign_lines(flown, Path("campaigns/x")):
        screen.print(line, soft_wrap=isinstance(line, str))
    shown = screen.export_text()
    assert max(map(len, shown.splitlines())) <= 80
    assert f"0 of {RUNS} flights departed" in shown
    assert flown.summary.worst is not None
    seed = flown.summary.worst.seed
    assert f"worst flight: flightbed run campaigns/x/scenario.toml --set seed={seed}\n" in shown
    error = flown.quantity("scheduled.median_abs_error_post").median.estimate
    (row,) = (line.split() for line in shown.splitlines() if line.startswith("  scheduled "))
    assert row[1] == f"{error:.3g}"


def test_own_code_flies_in_workers_and_in_the_worst_flights_command(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from flightbed.estimation.loop_gain.estimator import LoopGain, LoopGainSettings\n\n\n"
        "def make(settings, onboard):\n    return LoopGain(LoopGainSettings(name=settings.name).config(), onboard)\n"
    )
    keys = ["--set", "estimators.0.kind=mine.py:make", "--set", "duration_s=1", "--set", "failures.0.at_s=0.5"]
    command = [
        "campaign",
        "elevator-loss",
        "--runs",
        "2",
        *keys,
        "--use",
        "mine.py:make",
        "--workers",
        "1",
        "--json",
        "--out",
        "c",
    ]
    done = call(*command, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    seed = json.loads(done.stdout)["worst"]["seed"]
    again = json.loads(done.stdout)["worst"]["command"]
    assert again == f"flightbed run FOLDER/scenario.toml --set seed={seed} --use mine.py:make"
    assert again in (tmp_path / "c" / "report.html").read_text()
    with campaigns_in_this_process():
        shown = call(*(word for word in command if word != "--json"), cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert f"worst flight: {again.replace('FOLDER', 'c')}\n" in shown.stdout
    refused = call("campaign", "elevator-loss", "--runs", "2", *keys, cwd=tmp_path)
    assert refused.returncode == 2
    assert "add --use mine.py:make to allow it" in refused.stderr


def test_only_what_tests_for_a_change_can_never_find_one() -> None:
    keys = ["duration_s=1", "failures.0.at_s=0.97", "failures.0.to=0.999"]  # too late and too small to be found
    flown = campaigns.fly(load_scenario("elevator-loss", keys), 2)
    assert flown.quantity("scheduled.detected_at_s").never == 2
    assert not flown.quantity("expanding.detected_at_s").known
    assert flown.summary.quantity("expanding.detected_at_s") is None


@pytest.mark.usefixtures("in_this_process")
def test_a_campaign_of_flights_with_roll_and_yaw(tmp_path: Path) -> None:
    """Each surface has its columns and its own truth; a flight that raised has them empty."""
    scenario = rolling(SOON)
    campaign, folder = campaigns.run(scenario, tmp_path / "c", runs=3, workers=1)
    assert campaign is not None
    assert campaign.estimators == NAMES
    rows = pq.read_table(folder / "table.parquet").to_pylist()
    assert all(row["tracking_rms_post_p_deg_s"] > 0.0 < row["tracking_rms_pre_beta_deg"] for row in rows)
    for name in NAMES:
        assert [row[f"{name}.final"] for row in rows] == [r[f"{name}.final"] for r in campaign.rows]
    (histories,) = campaign.histories.values()
    for surface, at_s, to in (("aileron", 1.0, 0.4), ("rudder", 1.5, 0.5)):
        truth = histories.moments.mean[f"effectiveness_{surface}_true"]
        np.testing.assert_array_equal(truth, np.where(np.arange(300) >= 100 * at_s, to, 1.0))
    stored = _summary(folder)
    assert set(stored["estimators"]) == set(NAMES)
    assert {key.partition(".")[0] for key in stored["estimators"]["surfaces"]} <= {
        f.name for f in dataclasses.fields(EstimatorMetrics)
    }
    assert stored["tracking_rms_post_beta_deg"]["median"] == pytest.approx(
        np.median([row["tracking_rms_post_beta_deg"] for row in rows])
    )
    page = (folder / "report.html").read_text()
    assert "RMS of beta - beta_ref" in page
    assert "surfaces.rudder" in page


def test_the_columns_of_roll_and_yaw_are_empty_in_campaigns_of_pitch_alone(folder: Path) -> None:
    table = pq.read_table(folder / "table.parquet")
    for key in ("tracking_rms_pre_p_deg_s", "tracking_rms_post_beta_deg"):
        assert table.column(key).null_count == len(table)
        assert key not in _summary(folder)
