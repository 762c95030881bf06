"""Runs side by side: labels, differences, settings, the recording, the page, the command."""

from __future__ import annotations

import json
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.padding import Padding

from flightbed.analysis import comparison
from flightbed.cli.compare import comparison_lines
from flightbed.core.errors import OutputError
from flightbed.document.html import render
from flightbed.report.comparison_report import comparison_report
from flightbed.runs.folder import recording_of
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from flightbed.telemetry import viewer
from tests.command_line import assert_one_clear_line, call, flightbed
from tests.lateral_flight import SOON, rolling
from tests.telemetry.reading import series
from tests.telemetry.viewers import needs_viewer

NAMES = ("nominal", "elevator-loss", "elevator-loss-fixed")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    root = tmp_path_factory.mktemp("runs")
    return [run(load_scenario(name), root / name, rerun=False, report=False).folder or root for name in NAMES]


@pytest.fixture(scope="module")
def runs(folders: list[Path]) -> tuple[comparison.Run, ...]:
    return comparison.load_runs(folders)


def _row(table, name: str) -> list:  # type: ignore[no-untyped-def, type-arg]
    return next(list(row[1:]) for row in table.rows if row[0] == name)


def test_differences_are_from_the_first(runs: tuple[comparison.Run, ...]) -> None:
    shown = _row(comparison.metrics_table(runs), "RMS from 4.8 s, deg/s")
    rms = list(comparison.tracking(runs)["RMS from 4.8 s, deg/s"])
    assert shown == [f"{rms[0]:.3g}", *(f"{v:.3g} ({v - rms[0]:+.2g})" for v in rms[1:])]
    differences = comparison.to_dict(runs)["differences"]["elevator-loss-fixed"]
    assert not {"scenario", "seed", "tracking_rms_pre_deg_s", "tracking_rms_post_deg_s"} & set(differences)
    nis = [r.summary.metrics.estimators["scheduled"].nis_mean for r in runs]
    assert differences["estimators"]["scheduled"]["nis_mean"] == nis[2] - nis[0]


def test_runs_of_different_sources_are_named_in_one_line(runs: tuple[comparison.Run, ...]) -> None:
    def of(sha256: str | None) -> comparison.Run:
        return replace(runs[1], label="other", summary=replace(runs[1].summary, source_sha256=sha256))

    ours = str(runs[0].summary.source_sha256)
    assert comparison.different_sources(runs) is None
    assert comparison.different_sources([of(None), of(None)]) is None
    line = f"Flown by different sources of flightbed (SHA-256: nominal {ours[:12]}, other 0123456789ab)."
    pair = [runs[0], of("0123456789abcdef")]
    assert comparison.different_sources(pair) == line
    assert "other not recorded" in str(comparison.different_sources([runs[0], of(None)]))
    assert line in render(comparison_report(pair))
    assert line in list(comparison_report(pair).sections[2].text)
    assert "different sources" not in render(comparison_report(runs))
    assert line in [item.renderable for item in comparison_lines(pair, Path("x")) if isinstance(item, Padding)]


def test_tracking_is_over_the_same_time_in_all_runs(runs: tuple[comparison.Run, ...]) -> None:
    """The flights with and without a failure are equal until its onset, and so is their tracking."""
    before, after = comparison.tracking(runs).values()
    assert list(comparison.tracking(runs)) == ["RMS before 4.5 s, deg/s", "RMS from 4.8 s, deg/s"]
    assert before[0] == before[1] == runs[1].summary.metrics.tracking_rms_pre_deg_s
    assert after[1:] == [pytest.approx(r.summary.metrics.tracking_rms_post_deg_s, rel=1e-12) for r in runs[1:]]
    late = runs[0].trace["t_s"] >= 4.8 - 1e-9
    error = (runs[0].trace["q_deg_s"] - runs[0].trace["q_ref_deg_s"])[late]
    assert after[0] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert list(comparison.tracking(runs[:1] * 2)) == ["RMS, deg/s"]


def test_runs_of_other_rates_and_lengths_keep_their_own_truth(tmp_path: Path) -> None:
    """Both fail at tick 450: the same values, and not the same line."""
    fast = ["duration_s=6", "failures.0.at_s=4.5"]
    slow = ["duration_s=12", "failures.0.at_s=9", "rates.control_hz=50", "rates.plant_hz=200"]
    for name, keys in (("fast", fast), ("slow", slow)):
        run(load_scenario("elevator-loss", keys), tmp_path / name, rerun=False, report=False)
    done = call("compare", "fast", "slow", "--out", "both", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for entity in ("K_true/1_fast", "K_true/2_slow", "1_fast", "2_slow"):
        times, _ = series(tmp_path / "both" / "comparison.rrd", f"/effectiveness/{entity}", "Scalars:scalars")
        assert times[1] == pytest.approx(0.01 if "fast" in entity else 0.02)
    times, _ = series(tmp_path / "both" / "comparison.rrd", "/alpha/failure", "Scalars:scalars")
    np.testing.assert_allclose(times, [4.5, 4.5, 9.0, 9.0])


def test_failures_that_no_run_reached_are_not_marked(tmp_path: Path) -> None:
    late = ["failures.1.kind=effectiveness", "failures.1.at_s=35", "failures.1.to=0.1", "duration_s=40"]
    result = run(load_scenario("elevator-loss-fixed", late), tmp_path / "departs", rerun=False, report=False)
    assert result.summary.metrics.departed
    run(load_scenario("nominal", ["duration_s=1"]), tmp_path / "nominal", rerun=False, report=False)
    departs, _ = comparison.load_runs([tmp_path / "departs", tmp_path / "nominal"])
    assert departs.failures_s == (4.5,)


def test_any_folder_name_will_do(tmp_path: Path) -> None:
    names = ("_x", "y", r"$\foo$", "日本", "中")
    for name in names:
        run(load_scenario("nominal", ["duration_s=0.2"]), tmp_path / name, rerun=False, report=False)
    done = flightbed("compare", *names, cwd=tmp_path)  # matplotlib may warn of a font without these characters
    assert done.returncode == 0, done.stderr
    (folder,) = (tmp_path / "comparisons").iterdir()
    page = (folder / "report.html").read_text()
    assert all(page.count(name) >= 2 for name in names)  # in the table and in the legend


def test_the_outcome_and_the_largest_alpha_are_those_of_the_flights(runs: tuple[comparison.Run, ...]) -> None:
    table = comparison.metrics_table(runs)
    assert _row(table, "outcome")[0] == "flown to 16.5 s"
    assert _row(table, "outcome")[2] == f"departed at {runs[2].summary.metrics.departed_at_s:.2f} s"
    assert _row(table, "largest |alpha|, deg")[1].endswith("(same)")  # it is before the failure
    largest = [float(np.max(np.abs(r.trace["alpha_deg"]))) for r in runs]
    assert [float(text.split()[0]) for text in _row(table, "largest |alpha|, deg")] == pytest.approx(largest, rel=5e-3)


def test_settings_that_differ_and_only_those(runs: tuple[comparison.Run, ...]) -> None:
    rows = {str(row[0]): list(row[1:]) for row in comparison.differing(runs).rows}
    assert rows["adaptation.enabled"] == ["true", "true", "false"]
    assert rows["failures.0.to"] == ["-", "0.2", "0.2"]
    # Keys that a failure of this kind, or a law that does not adapt, leaves without effect are no difference.
    assert set(rows) == {"adaptation.enabled", *(f"failures.0.{key}" for key in ("kind", "surface", "at_s", "to"))}
    assert comparison.differing(runs[:1] * 2).rows == []


def test_labels_tell_runs_apart(tmp_path: Path) -> None:
    scenario = load_scenario("nominal", ["duration_s=0.2"])
    for place in ("a/one", "a/two", "b/one"):
        run(scenario, tmp_path / place, rerun=False, report=False)
    labels = [r.label for r in comparison.load_runs([tmp_path / "a/one", tmp_path / "a/two"])]
    assert labels == ["one", "two"]
    places = [tmp_path / "a/one", tmp_path / "b/one"]
    assert [r.label for r in comparison.load_runs(places)] == [str(p) for p in places]


def test_runs_without_estimators_and_of_other_aircraft_are_compared(tmp_path: Path) -> None:
    bare = ["duration_s=1", "estimators=[]", "adaptation.enabled=false"]
    run(load_scenario("nominal", bare), tmp_path / "bare", rerun=False, report=False)
    run(load_scenario("thesis-loss", ["duration_s=5"]), tmp_path / "linear", rerun=False, report=False)
    read = comparison.load_runs([tmp_path / "bare", tmp_path / "linear"])
    assert read[0].estimator is None
    assert "Compared" in render(comparison_report(read))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "compare: needs at least two runs' folders (got 0)"),
        (["nowhere", "nowhere-2"], "nowhere: not a run's folder (no metrics.json)"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], message: str, tmp_path: Path) -> None:
    assert_one_clear_line(["compare", *arguments], 2, message, cwd=tmp_path)


def test_one_folder_twice_and_a_broken_one_are_refused(folders: list[Path], tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="is named twice"):
        comparison.load_runs([folders[0], folders[1], folders[0].parent / "." / folders[0].name])
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "metrics.json").write_text("{")
    with pytest.raises(OutputError, match="broken: not a run's folder"):
        comparison.load_runs([folders[0], broken])
    for file in ("scenario.toml", "trace.parquet"):
        (broken / file).write_bytes((folders[0] / file).read_bytes())
    with pytest.raises(OutputError, match="broken: cannot be read"):
        comparison.load_runs([folders[0], broken])


def test_the_page_overlays_all_runs(runs: tuple[comparison.Run, ...]) -> None:
    page = render(comparison_report(runs))
    for r in runs:
        assert r.label in page
        assert page.count(f"stroke: {r.color}") >= 4
    assert "<script" not in page
    assert "departed at 10.17 s" in page


@pytest.fixture(scope="module")
def compared(folders: list[Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    place = tmp_path_factory.mktemp("compared")
    done = call("compare", *map(str, folders), "--json", cwd=place)
    assert done.returncode == 0, done.stderr
    return place, done.stdout


def test_the_command_leaves_a_folder(compared: tuple[Path, str], runs: tuple[comparison.Run, ...]) -> None:
    place, printed = compared
    folder = place / "comparisons" / "nominal-elevator-loss-elevator-loss-fixed"
    assert {p.name for p in folder.iterdir()} == {"comparison.json", "comparison.rrd", "report.html"}
    stored = json.loads(printed)
    assert Path(stored.pop("folder")) == folder.relative_to(place)
    assert (
        stored
        == json.loads((folder / "comparison.json").read_text())
        == json.loads(json.dumps(comparison.to_dict(runs)))
    )
    assert recording_of(folder) == folder / "comparison.rrd"


def test_an_earlier_comparison_is_replaced_and_nothing_else(folders: list[Path], tmp_path: Path) -> None:
    for _ in range(2):
        done = call("compare", *map(str, folders[:2]), "--out", "both", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert "In brackets: difference from the first run." in " ".join(done.stdout.split())
    (tmp_path / "both" / "mine.txt").write_text("keep")
    done = call("compare", *map(str, folders[:2]), "--out", "both", cwd=tmp_path)
    assert done.returncode == 2
    assert "holds 'mine.txt', which is not from a comparison" in done.stderr


def test_the_recording_has_every_run_on_one_time_axis(
    compared: tuple[Path, str], runs: tuple[comparison.Run, ...]
) -> None:
    path = recording_of(compared[0] / "comparisons" / "nominal-elevator-loss-elevator-loss-fixed")
    done = subprocess.run([viewer.executable(), "rrd", "verify", str(path)], check=False)
    assert done.returncode == 0
    columns = {"pitch_rate": "q_deg_s", "elevator": "elevator_deg", "alpha": "alpha_deg", "mach": "mach",
               "altitude": "altitude_ft", "load_factor": "nz_g", "attitude": "theta_deg",
               "effectiveness": "scheduled.effectiveness_smoothed"}  # fmt: skip
    for i, r in enumerate(runs):
        slug = f"{i + 1}_{r.label.replace('-', '_')}"
        for plot, column in columns.items():
            times, values = series(path, f"/{plot}/{slug}", "Scalars:scalars")
            np.testing.assert_allclose(times, r.trace["t_s"], atol=1e-12)
            np.testing.assert_array_equal(values, r.trace[column])
        _, position = series(path, f"/world/{slug}/cg", "Transform3D:translation")
        np.testing.assert_allclose(position.reshape(-1, 3)[:, 1], r.trace["east_m"] + 20.0 * i, atol=1e-5)
        _, states = series(path, f"/mode/{slug}", "StateChange:state")
        assert (
            list(states) == (["healthy", "over"], ["healthy", "failed", "over"], ["healthy", "failed", "departed"])[i]
        )
        times, _ = series(path, "/alpha/failure", "Scalars:scalars")
        np.testing.assert_allclose(times, [4.5] * 2)


@needs_viewer
def test_the_viewer_shows_it_without_complaint(compared: tuple[Path, str]) -> None:
    path = recording_of(compared[0] / "comparisons" / "nominal-elevator-loss-elevator-loss-fixed")
    with viewer.headless() as client:
        client.open(str(path))
        for _ in range(2):
            time.sleep(0.5)
            client.take_screenshot()
        views = client.get_state().views
        assert len(views) == 11
        assert [view.reports for view in views] == [[]] * len(views)
        assert [entry for entry in client.get_logs() if entry.level == "ERROR"] == []


def test_runs_with_roll_and_yaw_are_compared_with_one_without(tmp_path: Path) -> None:
    """Tracking of p and beta, K of each surface against its own truth; no such values for the run without roll and yaw."""
    fixed = [*SOON, "adaptation.enabled=false", "failures.1.to=0.7"]
    run(rolling(SOON), tmp_path / "oracle", rerun=False, report=False)
    run(rolling(fixed), tmp_path / "fixed", rerun=False, report=False)
    run(load_scenario("nominal", ["duration_s=3"]), tmp_path / "pitch", rerun=False, report=False)
    done = call("compare", "oracle", "fixed", "pitch", "--out", "all", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    read = comparison.load_runs([tmp_path / name for name in ("oracle", "fixed", "pitch")])
    assert [r.lateral for r in read] == [True, True, False]
    rms = comparison.tracking(read)
    assert [text for text in rms if " of " in text] == [
        "RMS of p before 1 s, deg/s", "RMS of p from 1.3 s, deg/s", "RMS of beta before 1 s, deg", "RMS of beta from 1.3 s, deg",
    ]  # fmt: skip
    assert rms["RMS of p from 1.3 s, deg/s"][0] == pytest.approx(
        read[0].summary.metrics.tracking_rms_post_p_deg_s, rel=1e-12
    )
    assert rms["RMS of p from 1.3 s, deg/s"][2] is None
    assert not [text for text in comparison.tracking(read[2:] * 2) if " of " in text]
    table = comparison.metrics_table(read)
    assert ["surfaces.aileron", "", "", ""] in table.rows
    differences = comparison.to_dict(read)["differences"]["fixed"]
    assert not [key for key in differences if key.startswith("tracking_rms")]
    recording = tmp_path / "all" / "comparison.rrd"
    for entity, column, names in (
        ("/roll_rate", "p_deg_s", ("1_oracle", "2_fixed")),
        ("/sideslip", "beta_deg", ("1_oracle", "2_fixed")),
        ("/aileron", "aileron_deg", ("1_oracle", "2_fixed")),
        ("/effectiveness_rudder", "surfaces.rudder.effectiveness_smoothed", ("1_oracle", "2_fixed")),
        ("/effectiveness_rudder/K_true", "effectiveness_rudder_true", ("1_oracle", "2_fixed")),
        ("/effectiveness_aileron/K_true", "effectiveness_aileron_true", ("1_oracle",)),  # the same line in both
    ):
        for name in names:
            _, values = series(recording, f"{entity}/{name}", "Scalars:scalars")
            np.testing.assert_array_equal(values, read[int(name[0]) - 1].trace[column], err_msg=entity)
    page = render(comparison_report(read))
    assert all(text in page for text in ("Roll rate, deg/s", "Sideslip, deg", "Aileron K, share", "Rudder K, share"))
    alone = render(comparison_report(read[2:] * 2))
    assert "Roll rate" not in alone
