"""The multisine: its spectrum by numpy's FFT, its peak factor against Schroeder's, a brute search, and sums that are known."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from math import inf
from pathlib import Path

import numpy as np
import pytest

from flightbed.command.base import Vector, relative_peak_factor
from flightbed.command.multisine import flat_phases, multisine, one_period, schroeder_phases
from flightbed.core.harmonics import harmonics

ROOT = Path(__file__).resolve().parents[2]


def _peak_factors(numbers: range) -> tuple[float, float]:
    schroeder = schroeder_phases(len(numbers))
    return tuple(relative_peak_factor(one_period(numbers, p)) for p in (schroeder, flat_phases(numbers)))  # type: ignore[return-value]


def _summed(numbers: range, phases: Vector, samples: int) -> Vector:
    """The sum of cosines without an FFT."""
    turn = 2 * np.pi * np.arange(samples) / samples
    total: Vector = np.cos(np.outer(turn, np.array(numbers)) + phases).sum(axis=1)
    return total


@pytest.mark.parametrize(
    ("low_hz", "high_hz", "period_s", "numbers"),
    [
        (0.2, 2.0, 4.5, range(1, 10)),
        (0.3, 2.1, 10.0, range(3, 22)),
        (0.0, 0.5, 2.0, range(1, 2)),
        (0.5, 0.9, 1.0, range(0)),
    ],
)
def test_harmonics_of_a_band_with_both_ends(low_hz: float, high_hz: float, period_s: float, numbers: range) -> None:
    """0.3 * 10 and 2.1 * 10 miss 3 and 21 by round-off; both belong."""
    assert list(harmonics(low_hz=low_hz, high_hz=high_hz, period_s=period_s)) == list(numbers)


@pytest.mark.parametrize(
    ("low_hz", "high_hz", "period_s"), [(0.2, 2.0, 4.5), (0.3, 2.1, 10.0), (1.0, 1.0, 1.0), (0.1, 4.0, 20.0)]
)
def test_spectrum_is_the_harmonics_asked_for_and_nothing_else(low_hz: float, high_hz: float, period_s: float) -> None:
    samples = round(period_s * 100)
    q = multisine(amplitude_rad_s=0.1, low_hz=low_hz, high_hz=high_hz, period_s=period_s, count=1)(
        np.arange(samples) / 100
    )
    lines = np.abs(np.fft.rfft(q)) * 2 / samples
    asked = list(harmonics(low_hz=low_hz, high_hz=high_hz, period_s=period_s))
    np.testing.assert_allclose(lines[asked], lines[asked[0]], rtol=1e-9)  # equal power
    assert lines[asked[0]] > 0.0999 / len(asked)  # of n sines of amplitude a the peak is at most n a
    assert np.max(np.delete(lines, asked)) < 1e-12  # line 0 too: zero mean


@pytest.mark.parametrize("numbers", [range(1, 11), range(2, 12), range(1, 21), range(1, 32)])
def test_peak_factor_is_well_below_schroeders(numbers: range) -> None:
    """At least 15 % below, and about that of a sine or better."""
    schroeder, ours = _peak_factors(numbers)
    assert ours < 0.85 * schroeder
    assert ours < 1.02


@pytest.mark.parametrize(
    ("numbers", "expected"), [(range(1, 2), 1.0), (range(7, 8), 1.0), (range(1, 3), 3.125 / np.sqrt(8))]
)
def test_peak_factors_that_are_known(numbers: range, expected: float) -> None:
    """A sine has 1. cos x + cos 2x goes from -9/8, where cos x = -1/4, to 2, its rms is 1, and no other phase makes the range smaller."""
    assert _peak_factors(numbers)[1] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("numbers", [range(1, 3), range(1, 4), range(2, 5)])
def test_no_phases_of_a_brute_search_are_better(numbers: range) -> None:
    """A shift of time frees one phase and a change of sign halves another; the grid of the rest is 1.5 deg fine."""
    grid = np.arange(0.0, 2 * np.pi, np.pi / 120)
    rest = np.stack(np.meshgrid(*[grid] * (len(numbers) - 1), indexing="ij"), axis=-1).reshape(-1, len(numbers) - 1)
    best = inf
    for block in np.array_split(rest, max(1, len(rest) // 2000)):
        total = np.zeros((len(block), 240))
        for n, phase in zip(numbers, np.hstack([np.zeros((len(block), 1)), block]).T, strict=True):
            total += np.cos(n * np.linspace(0.0, 2 * np.pi, 240, endpoint=False) + phase[:, None])
        best = min(best, float(np.min(np.ptp(total, axis=1))) / (2 * np.sqrt(2) * np.sqrt(len(numbers) / 2)))
    ours = _peak_factors(numbers)[1]
    assert ours <= best * 1.001  # 240 samples of a period see 1 - (4 pi / 240)^2 / 2 of a peak of harmonic 4
    assert ours >= best * 0.99  # and the grid itself has nearly as good ones


def test_never_worse_than_schroeder_and_always_rising_from_zero(rng: np.random.Generator) -> None:
    for first, more in zip(rng.integers(1, 30, 12), rng.integers(0, 25, 12), strict=True):
        numbers = range(int(first), int(first + more + 1))
        schroeder, ours = _peak_factors(numbers)
        assert ours <= schroeder + 1e-4, numbers
        phases = flat_phases(numbers)
        assert abs(np.sum(np.cos(phases))) < 1e-12, numbers
        assert np.sum(np.array(numbers) * np.sin(phases)) < 0.0, numbers  # minus the slope
        np.testing.assert_allclose(one_period(numbers, phases, per_cycle=16), _summed(numbers, phases, len(one_period(numbers, phases, per_cycle=16))), atol=1e-11)  # fmt: skip


def test_amplitude_is_the_peak_and_nothing_jumps() -> None:
    fine = np.arange(0.0, 16.0, 1e-4)
    q = multisine(amplitude_rad_s=0.2, low_hz=0.2, high_hz=2.0, period_s=4.5, count=3, start_s=1.0)(fine)
    flown = (fine >= 1.0) & (fine < 14.5)
    assert np.max(np.abs(q)) == pytest.approx(0.2, rel=1e-4)
    assert not q[~flown].any()
    assert (
        np.max(np.abs(np.diff(q))) < 0.2 * 2 * np.pi * 2.0 * 1e-4
    )  # Bernstein: the slope is at most peak * highest frequency
    assert abs(np.mean(q[flown])) < 1e-9
    np.testing.assert_allclose(q[10000:55000], q[55000:100000], atol=1e-11)


def test_dither_is_the_multisine_for_ever() -> None:
    ten_hours = np.arange(36000.0, 36004.5, 0.01)
    for_ever = multisine(amplitude_rad_s=0.01, low_hz=0.2, high_hz=2.0, period_s=4.5, count=inf, start_s=0.0)
    np.testing.assert_allclose(for_ever(ten_hours), for_ever(ten_hours - 36000.0), atol=1e-12)
    assert np.max(for_ever(ten_hours)) > 0.009


def test_a_band_without_harmonics_is_refused() -> None:
    with pytest.raises(ValueError, match=r"no multiple of 1/1 Hz lies between 0\.5 and 0\.9 Hz; widen the band"):
        multisine(amplitude_rad_s=0.1, low_hz=0.5, high_hz=0.9, period_s=1.0, count=1)


def test_phases_are_the_same_to_the_last_bit_in_any_process() -> None:
    code = (
        "import hashlib; from flightbed.command.multisine import flat_phases\n"
        "print(hashlib.sha256(b''.join(flat_phases(n).tobytes() for n in (range(1, 10), range(3, 60)))).hexdigest())"
    )
    here = hashlib.sha256(b"".join(flat_phases(n).tobytes() for n in (range(1, 10), range(3, 60)))).hexdigest()
    for threads in ("1", "2"):
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads}
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT, env=environment
        )
        assert done.stdout.strip() == here
