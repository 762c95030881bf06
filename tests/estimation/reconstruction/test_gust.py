"""A harmonic gust of unknown frequency, reconstructed in flight with the elevator known."""

from __future__ import annotations

import numpy as np
import pytest

from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario

NAMES = ("retrospective", "random-walk")


def _harmonic(values: np.ndarray, t_s: np.ndarray, hz: float) -> complex:
    """Amplitude and phase by least squares, with a constant and a slope beside them."""
    columns = [np.cos(2 * np.pi * hz * t_s), np.sin(2 * np.pi * hz * t_s), np.ones_like(t_s), t_s]
    a, b, *_ = np.linalg.lstsq(np.column_stack(columns), values, rcond=None)[0]
    return complex(a, -b)


@pytest.mark.parametrize("hz", [0.3, 0.7, 1.5])
def test_amplitude_and_phase_are_found_at_any_frequency(hz: float) -> None:
    for seed in range(2):
        trace = run(load_scenario("harmonic-gust", [f"gusts.0.frequency_hz={hz}", f"seed={seed}"])).trace
        k = slice(500, 1650)
        t_s, gust = trace["t_s"][k], trace["gust_alpha_deg"][k]
        truth = _harmonic(gust, t_s, hz)
        assert abs(truth) == pytest.approx(0.72, abs=0.03)  # 10 ft/s at 243 m/s
        for name, share, phase_deg, rms in zip(NAMES, (0.15, 0.06), (15.0, 8.0), (0.25, 0.1), strict=True):
            found = np.roll(trace[f"{name}.reconstructed_deg"], -1)[:-1]  # one tick late
            error = found[500:1649] - gust[:-1]
            ratio = _harmonic(found[500:1649], t_s[:-1], hz) / truth
            assert abs(ratio) == pytest.approx(1.0, abs=share), (name, seed)
            assert abs(np.angle(ratio, deg=True)) < phase_deg, (name, seed)
            assert np.sqrt(np.mean(error**2)) < rms, (name, seed)
            assert np.all(np.isnan(trace[f"{name}.effectiveness_smoothed"]))  # K is not estimated


def test_steady_motion_of_the_air_is_forgotten_because_it_is_unobservable() -> None:
    """A zero of the outputs at 1: w/V of a lasting gust appears at its onset and decays after about 5 s."""
    gust = "gusts.0={at_s=3.0, up_fps=10.0, rise_s=0.5, hold_s=30.0}"
    trace = run(load_scenario("harmonic-gust", ["gusts=[]", gust, "command.kind=none", "duration_s=25"])).trace
    there = trace["gust_alpha_deg"][400]
    for name in NAMES:
        found = trace[f"{name}.reconstructed_deg"]
        assert np.mean(found[360:400]) == pytest.approx(there, rel=0.35)
        assert abs(np.mean(found[2300:])) < 0.3 * there


def test_calm_air_gives_no_gust() -> None:
    trace = run(load_scenario("harmonic-gust", ["gusts=[]"])).trace
    for name, rms_deg in zip(NAMES, (0.15, 0.05), strict=True):
        assert np.sqrt(np.mean(trace[f"{name}.reconstructed_deg"][200:] ** 2)) < rms_deg


def test_a_gust_is_no_k_and_no_verdict() -> None:
    trace = run(load_scenario("harmonic-gust", ["duration_s=4"])).trace
    for name in NAMES:
        assert np.all(np.isnan(trace[f"{name}.verdict"]))
        assert np.all(np.isnan(trace[f"{name}.offset_deg"]))
        assert trace[f"{name}.alarms"][-1] == 0.0
