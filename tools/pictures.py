"""Make the pictures of the README: a flight and a comparison in the viewer, and the report of the flight in a browser.

    python tools/pictures.py

The viewer needs a Vulkan driver (in software: mesa-vulkan-drivers), the report Chromium.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from flightbed import load_scenario, run
from flightbed.analysis import comparison
from flightbed.report.comparison_report import comparison_report
from flightbed.runs.comparison_folder import write_comparison
from flightbed.runs.folder import recording_of
from flightbed.telemetry import viewer

DOCS = Path(__file__).resolve().parents[1] / "docs"
NAMES = ("nominal", "elevator-loss", "elevator-loss-fixed")


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        folders = {name: run(load_scenario(name), Path(scratch) / name).folder or Path(scratch) for name in NAMES}
        runs = comparison.load_runs(list(folders.values()))
        compared = write_comparison(runs, comparison_report(runs), Path(scratch) / "compared", replace=False)
        viewer.picture(recording_of(folders["elevator-loss"]), DOCS / "viewer.png", at_s=7.0)
        viewer.picture(recording_of(compared), DOCS / "comparison.png", at_s=6.6)
        browser = shutil.which("chromium") or shutil.which("google-chrome")
        if browser is None:
            raise SystemExit("tools/pictures.py: no Chromium for the picture of the report; install chromium")
        page = (folders["elevator-loss"] / "report.html").as_uri()
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=1100,1500"]
        target = f"--screenshot={DOCS / 'report.png'}"
        subprocess.run([browser, *options, target, page], check=True, capture_output=True)


if __name__ == "__main__":
    main()
