"""The real viewer, headless: every view exists, has data, reports no error, and is drawn."""

from __future__ import annotations

import io
import time
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from flightbed.analysis.result import Result
from flightbed.core.errors import InputError, OutputError
from flightbed.document import palette
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from flightbed.telemetry import viewer
from flightbed.telemetry.flight_info import result_info
from flightbed.telemetry.layout import TABS
from flightbed.telemetry.recording import write_recording
from tests.flights import representative
from tests.lateral_flight import SOON, rolling
from tests.telemetry.viewers import needs_viewer

pytestmark = needs_viewer

VIEWS = {
    "Overview": {
        "Chase view, m; stabilators: blue K = 1, red K = 0": "/world/cg",
        "Modes": "/mode",
        "Summary": "/run_card",
        "Events": "/events",
        "Pitch rate, deg/s": "/pitch_rate",
        "Elevator effectiveness K, share; bands +-2 sigma": "/effectiveness",
        "Elevator, deg": "/elevator",
        "Angle of attack, deg": "/alpha",
    },
    "Estimators": {
        "scheduled: innovations over their sigma, 1; clipped at 5": "/innovation/scheduled",
        "expanding: innovations over their sigma, 1; clipped at 5": "/innovation/expanding",
        "scheduled: NIS, 1; clipped at 15": "/nis/scheduled",
        "expanding: NIS, 1; clipped at 15": "/nis/expanding",
        "log10 of sigma of K, share": "/sigma",
        "Excitation, deg/s^2": "/excitation",
    },
    "Airframe": {
        "Mach number, 1": "/mach",
        "Altitude, ft": "/altitude",
        "Load factor nz, g": "/load_factor",
        "Attitude, deg": "/attitude",
        "Forces, N": "/forces",
    },
}
# Colours that a view must contain: those of its lines and of the failure.
COLORS = {
    "/pitch_rate": (palette.REFERENCE, palette.ACTUAL, palette.FAILURE),
    "/effectiveness": (palette.TRUTH, palette.ACTUAL, palette.COMMAND, palette.FAILURE),
    "/elevator": (palette.COMMAND, palette.ACTUAL, palette.OTHER, palette.FAILURE),
    "/alpha": (palette.ACTUAL, palette.FAILURE),
    "/sigma": (palette.ACTUAL, palette.COMMAND, palette.OTHER, palette.FAILURE),
    "/forces": (palette.ACTUAL, palette.COMMAND, palette.REFERENCE, palette.FAILURE),
}


def _pixels(png: bytes) -> np.ndarray:
    return (matplotlib.image.imread(io.BytesIO(png))[..., :3] * 255).astype(int)


def _near(pixels: np.ndarray, color: str, reach: int = 30) -> int:
    return int(np.sum(np.abs(pixels - np.array(palette.rgb(color))).sum(axis=-1) < reach))


def _paint(client: Any) -> None:
    for _ in range(2):
        time.sleep(0.3)
        client.take_screenshot()


@pytest.fixture(scope="module")
def client(recording: Path):  # type: ignore[no-untyped-def]
    with viewer.headless() as client:
        client.open(str(recording))
        client.set_time("time", duration=9.0, play_state="paused")
        _paint(client)
        yield client


@pytest.fixture(scope="module")
def drawn(client: Any) -> dict[str, dict[str, np.ndarray]]:
    """Open each page once; return the pixels of its plots against time, by page and origin."""
    found: dict[str, dict[str, np.ndarray]] = {}
    for tab in TABS:
        viewer.show_tab(client, tab)
        _paint(client)
        plots = [v for v in client.get_state().views if v.name in VIEWS[tab] and v.view_class == "TimeSeries"]
        found[tab] = {v.origin: _pixels(client.take_screenshot(v.view_id)) for v in plots}
    return found


def test_every_view_is_there_and_none_complains(client: Any, drawn: dict[str, dict[str, np.ndarray]]) -> None:
    assert set(VIEWS) == set(TABS) == set(drawn)
    views = client.get_state().views
    assert {view.name: view.origin for view in views} == {k: v for tab in VIEWS.values() for k, v in tab.items()}
    assert [view.reports for view in views] == [[]] * len(views)
    assert [entry for entry in client.get_logs() if entry.level == "ERROR"] == []


def test_every_plot_is_drawn_with_its_colours_and_the_failure(drawn: dict[str, dict[str, np.ndarray]]) -> None:
    assert set(COLORS) < {origin for plots in drawn.values() for origin in plots}
    for plots in drawn.values():
        for origin, pixels in plots.items():
            for color in COLORS.get(origin, (palette.FAILURE,)):
                assert _near(pixels, color) > 30, (origin, color)


def test_the_stabilators_are_red_after_the_failure_and_blue_before(client: Any) -> None:
    viewer.show_tab(client, "Overview")
    chase = next(view for view in client.get_state().views if view.view_class == "3D")
    found = {}
    for t_s in (3.0, 9.0):
        client.set_time("time", duration=t_s, play_state="paused")
        _paint(client)
        pixels = _pixels(client.take_screenshot(chase.view_id))
        red = np.sum((pixels[..., 0] > 120) & (pixels[..., 2] < 90))
        blue = np.sum((pixels[..., 2] > 150) & (pixels[..., 0] < 80))
        found[t_s] = red, blue
    assert found[3.0][0] < 50 < found[3.0][1]
    assert found[9.0][1] < 50 < found[9.0][0]


def test_time_runs_from_zero_to_the_end_of_the_flight(client: Any) -> None:
    (timeline,) = (t for t in client.get_state().recordings[0].timelines if t.name == "time")
    assert (timeline.start, timeline.end) == (0, 16_490_000_000)


def test_an_unknown_tab_is_refused(client: Any) -> None:
    with pytest.raises(InputError, match=r"--tab: must be one of Overview, Estimators, Airframe \(got Engine\)"):
        viewer.show_tab(client, "Engine")
    with pytest.raises(InputError, match=r"--tab: .*got scheduled"):  # a part of a page
        viewer.show_tab(client, "scheduled")


def test_a_picture_is_written_whole(recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer, "_SETTLING_S", 0.5)  # by then it is drawn; notifications may still be there
    viewer.picture(recording, tmp_path / "shot.png", at_s=9.0, tab="airframe")
    pixels = _pixels((tmp_path / "shot.png").read_bytes())
    assert pixels.shape == (1080, 1920, 3)
    assert _near(pixels, palette.FAILURE) > 100


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"at_s": -3.0}, "--at-s -3: must be within the flight, 0 to 16.49"),
        ({"at_s": float("nan")}, "--at-s nan: must be within the flight"),
        ({"at_s": 17.0}, "--at-s 17: must be within the flight"),
    ],
)
def test_times_beyond_the_flight_are_refused(
    recording: Path, tmp_path: Path, options: dict[str, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        viewer.picture(recording, tmp_path / "shot.png", **options)  # type: ignore[arg-type]


def test_a_file_that_is_no_recording_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "flight.rrd").write_bytes(b"junk")
    with pytest.raises(OutputError, match="the viewer cannot read this recording"):
        viewer.picture(tmp_path / "flight.rrd", tmp_path / "shot.png")
    with pytest.raises(InputError, match="shot.jpg: must end in .png"):
        viewer.picture(tmp_path / "flight.rrd", tmp_path / "shot.jpg")
    with pytest.raises(OutputError, match="does not exist; create it first"):
        viewer.picture(tmp_path / "flight.rrd", tmp_path / "nowhere" / "shot.png")
    assert {p.name for p in tmp_path.iterdir()} == {"flight.rrd"}


FLIGHTS = {
    "linear": lambda: load_scenario("thesis-loss", ["duration_s=6"]),
    "bare": lambda: load_scenario("nominal", ["duration_s=2", "estimators=[]", "adaptation.enabled=false"]),
    "gust": lambda: load_scenario("elevator-and-cg"),
    "rolling": lambda: rolling(SOON),
}


@pytest.mark.parametrize("name", representative(FLIGHTS, ("bare", "rolling")))
def test_flights_without_estimators_forces_or_failures_are_shown_too(name: str, tmp_path: Path) -> None:
    result: Result = run(FLIGHTS[name]())
    write_recording(tmp_path / f"{name}.rrd", result.trace, result_info(result))
    with viewer.headless() as client:
        client.open(str(tmp_path / f"{name}.rrd"))
        _paint(client)
        views = client.get_state().views
        assert [view.reports for view in views] == [[]] * len(views)
        assert [entry for entry in client.get_logs() if entry.level == "ERROR"] == []
        assert len(views) > 8


def test_a_ten_minute_flight_opens_at_once(tmp_path: Path) -> None:
    """Opening takes one second; the limit is ten for busy machines. benchmarks/viewer.py measures the time."""
    overrides = ["duration_s=600", "command.count=1000", "failures.0.at_s=300", "failures.0.to=0.9"]
    result = run(load_scenario("elevator-loss", overrides))
    write_recording(tmp_path / "long.rrd", result.trace, result_info(result))
    with viewer.headless() as client:
        began = time.perf_counter()
        client.open(str(tmp_path / "long.rrd"))
        client.take_screenshot()
        opened = time.perf_counter() - began
        print(f"opened and drawn in {opened:.2f} s")
        assert opened < 10.0
        views = client.get_state().views
        assert [view.reports for view in views] == [[]] * len(views)
