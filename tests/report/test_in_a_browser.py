"""Pages as a browser shows them: nothing to complain of, nothing from the network, every figure drawn and seen."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from flightbed.analysis import comparison
from flightbed.campaigns import run as campaign
from flightbed.document import palette
from flightbed.document.html import render
from flightbed.report.comparison_report import comparison_report
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from tests.flights import campaigns_in_this_process

_BROWSER = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
pytestmark = pytest.mark.skipif(
    _BROWSER is None and os.environ.get("CI") != "true", reason="no Chromium to show pages with"
)

# Loads the page in a frame, and writes down where its figures are, what the page loaded, and what was wrong.
_PROBE = """<!doctype html><script>
const wrong = [];
function look() {
  const page = document.querySelector("iframe").contentWindow;
  const boxes = [...page.document.querySelectorAll("figure svg")].map(svg => {
    const box = svg.getBoundingClientRect();
    return [box.x, box.y, box.width, box.height, svg.querySelectorAll("path").length].map(Math.round).join(" ");
  });
  const loaded = page.performance.getEntriesByType("resource").map(entry => entry.name);
  const wide = page.document.documentElement.scrollWidth > page.innerWidth ? "wide" : "";
  document.querySelector("pre").textContent = "BOXES" + boxes.join(";") + "LOADED" + loaded.join(";") + "WIDE" + wide + "END";
}
</script><iframe width=1100 height=4000 src="PAGE" onload="look()"></iframe><pre></pre>"""


def _chromium(*arguments: str, page: Path, home: Path) -> subprocess.CompletedProcess[str]:
    options = [
        "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--allow-file-access-from-files", "--enable-logging=stderr",
        "--log-level=0", f"--user-data-dir={home}",
    ]  # fmt: skip
    assert _BROWSER is not None
    command = [_BROWSER, *options, *arguments, page.as_uri()]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)


def _pages(folder: Path) -> dict[str, Path]:
    names = ("elevator-loss", "elevator-loss-fixed")
    folders = [run(load_scenario(name), folder / name, rerun=False).folder or folder for name in names]
    compared = folder / "compared.html"
    compared.write_text(render(comparison_report(comparison.load_runs(folders))))
    _, flights = campaign.run(load_scenario("elevator-loss"), folder / "campaign", runs=6, workers=1)
    return {
        "run": folders[0] / "report.html",
        "departed": folders[1] / "report.html",
        "campaign": flights / "report.html",
        "comparison": compared,
    }


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    with campaigns_in_this_process():
        return _pages(tmp_path_factory.mktemp("pages"))


@pytest.mark.parametrize(
    ("kind", "figures"),
    [("run", 7), pytest.param("departed", 7, marks=pytest.mark.long), ("campaign", 7), ("comparison", 1)],
)
def test_a_page_is_shown_whole(pages: dict[str, Path], kind: str, figures: int, tmp_path: Path) -> None:
    probe = tmp_path / "probe.html"
    probe.write_text(_PROBE.replace("PAGE", pages[kind].as_uri()))
    shown = _chromium("--virtual-time-budget=5000", "--dump-dom", page=probe, home=tmp_path / "home")
    assert "CONSOLE" not in shown.stderr, shown.stderr
    found = re.search(r"BOXES(.*?)LOADED(.*?)WIDE(.*?)END</pre>", shown.stdout)
    assert found, shown.stdout[-500:]
    assert found[2] == ""  # nothing but the page itself
    assert found[3] == ""  # nothing beyond its right edge
    boxes = [tuple(map(int, box.split())) for box in found[1].split(";")]
    assert len(boxes) >= figures
    height = max(y + h for _, y, _, h, _ in boxes) + 200
    picture = tmp_path / "page.png"
    _chromium(f"--screenshot={picture}", f"--window-size=1100,{height}", page=pages[kind], home=tmp_path / "home")
    pixels = (matplotlib.image.imread(picture)[..., :3] * 255).astype(int)
    for x, y, width, tall, paths in boxes:
        assert width > 500, "a figure is as wide as the text"
        assert tall > 100
        assert paths > 10
        part = pixels[y : y + tall, x : x + width]
        colored = {
            color
            for color in (palette.ACTUAL, palette.COMMAND, palette.REFERENCE, palette.TRUTH, palette.OTHER)
            if np.sum(np.abs(part - np.array(palette.rgb(color))).sum(axis=-1) < 40) > 20
        }
        assert colored, (kind, x, y)  # something is drawn in it


def test_a_page_prints(pages: dict[str, Path], tmp_path: Path) -> None:
    printed = tmp_path / "page.pdf"
    _chromium(f"--print-to-pdf={printed}", page=pages["run"], home=tmp_path / "home")
    assert printed.read_bytes().startswith(b"%PDF")
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", printed.read_bytes())) <= 12
