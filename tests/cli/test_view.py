"""`flightbed view`: errors without a display or a recording."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from tests.command_line import COMMAND, call


def test_view_without_a_display_names_the_alternatives(tmp_path: Path) -> None:
    call("run", "nominal", "--set", "duration_s=0.2", "--report", "off", "--out", "x", cwd=tmp_path)
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [*COMMAND, "view", "x"], capture_output=True, text=True, check=False, cwd=tmp_path, env=environment
    )
    assert done.returncode == 2
    alternatives = "write a picture with --picture FILE.png, copy x/flight.rrd to a machine with a display, or serve it"
    assert f"the viewer has no display; {alternatives}" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_view_reports_a_missing_recording(tmp_path: Path) -> None:
    call("run", "nominal", "--set", "duration_s=0.2", "--rerun", "off", "--report", "off", "--out", "x", cwd=tmp_path)
    done = call("view", "x", cwd=tmp_path)
    assert done.returncode == 2
    assert "there is no recording; fly the scenario again with --rerun save" in done.stderr
