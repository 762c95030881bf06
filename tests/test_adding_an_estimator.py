"""A new estimator in the package: one file of 40 lines and one line in a table, nothing else.

The test makes both in a copy of the source tree and uses them as a user would: settings, errors, list of keys, schema, flight, trace, page.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TABLE_LINE = '            "pitch-ratio": "flightbed.estimation.pitch_ratio:PitchRatioSettings",\n'
ALGORITHM = '''"""K by recursive least squares with constant forgetting on the pitch rate that the short-period model predicts."""

from math import sqrt
from typing import Annotated, Literal

from flightbed.avionics.onboard import OnBoard
from flightbed.config.kinds import EstimatorSettings
from flightbed.config.table import between
from flightbed.core.signals import Estimate, Measurement


class PitchRatio:
    """An Estimator: q+ = A_q x + b_q (K u - u_trim), solved for K."""

    def __init__(self, settings: "PitchRatioSettings", onboard: OnBoard) -> None:
        self._settings, self._design = settings, onboard.design
        self._discrete = onboard.design.discrete(onboard.control_hz)
        self._noise, self._last = onboard.noise.q_rad_s, None
        self._sum, self._weight, self._smoothed = 1e-9, 1e-9, 1.0

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate at that tick."""
        alpha, q = measurement.alpha_rad - self._design.alpha_trim_rad, measurement.q_rad_s
        if self._last is not None:
            (a_alpha, a_q), b = self._discrete.A[1], self._discrete.b[1]
            rest = q - a_alpha * self._last[0] - a_q * self._last[1] + b * self._design.elevator_trim_rad
            slope, keep = b * measurement.elevator_mean_rad, self._settings.forgetting
            self._sum, self._weight = keep * self._sum + slope * rest, keep * self._weight + slope * slope
        self._last = alpha, q
        raw, (low, high), s = self._sum / self._weight, self._settings.bounds, self._settings.smoothing
        bounded = min(max(raw, low), high)
        self._smoothed = s * self._smoothed + (1.0 - s) * bounded
        return Estimate(bounded, self._noise / sqrt(self._weight), self._smoothed, raw, measurement.alpha_rad, q, 1.0)


class PitchRatioSettings(EstimatorSettings):
    """Recursive least squares on the predicted pitch rate."""

    kind: Literal["pitch-ratio"] = "pitch-ratio"
    forgetting: Annotated[float, between(0.5, 1)] = 0.98
    """Forgetting factor per tick."""

    def build(self, onboard: OnBoard) -> PitchRatio:
        """Return the estimator."""
        return PitchRatio(self, onboard)
'''


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package with the estimator."""
    tree = tmp_path_factory.mktemp("tree")
    for name in ("flightbed", "aircraft", "scenarios"):
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    (tree / "flightbed" / "estimation" / "pitch_ratio.py").write_text(ALGORITHM)
    families = tree / "flightbed" / "config" / "families.py"
    text, after = (
        families.read_text(),
        '"input-kalman": "flightbed.estimation.reconstruction.kinds:InputKalmanSettings",\n',
    )
    assert text.count(after) == 1
    families.write_text(text.replace(after, after + TABLE_LINE))
    return tree


def _there(tree: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-P", "-m", "flightbed", *arguments], cwd=tree, env=os.environ | {"PYTHONPATH": str(tree)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_it_has_forty_lines_of_code() -> None:
    assert sum(1 for line in ALGORITHM.splitlines() if line.strip() and not line.strip().startswith('"""')) <= 40


def test_it_flies_and_finds_k(tree: Path) -> None:
    table = '[{name="mine", kind="pitch-ratio", model="short-period"}]'
    done = _there(tree, "run", "thesis-loss", "--set", f"estimators={table}", "--set", "adaptation.estimator=mine",
                  "--set", "control.state_from=mine", "--out", "x", "--rerun", "off", "--report", "off", "--json")  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads((tree / "x" / "metrics.json").read_text())["estimators"]["mine"]

    assert found["final"] == pytest.approx(0.2, abs=0.1)  # it uses readings as if they had no noise


def test_its_keys_are_listed_checked_and_in_the_schema(tree: Path) -> None:
    listed = _there(tree, "keys", "Forgetting factor per tick").stdout
    assert "pitch-ratio" in listed
    schema = json.loads(_there(tree, "schema", "scenario").stdout)
    assert "Forgetting factor per tick." in json.dumps(schema)
    wrong = _there(tree, "run", "thesis-loss", "--set", 'estimators=[{name="mine", kind="pitch-ratio", window=60}]')
    assert wrong.returncode == 2
    assert "estimators.0.window: 'pitch-ratio' has no such key" in wrong.stderr
