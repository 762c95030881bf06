"""Text summary and events of a flight: failures, gusts and their times."""

from __future__ import annotations

from dataclasses import replace

import pytest

from flightbed.analysis.events import events, failures
from flightbed.analysis.metrics import PHASES
from flightbed.analysis.summary import ExtensionSummary
from flightbed.analysis.summary_text import plan_text, run_text, settings_rows
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from tests.lateral_flight import rolling


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (
            "kind='structural', to=0.4, force_to=0.85",
            "at 3 s the elevator moment falls to 40%, its lift and drag to 85%",
        ),
        (
            "kind='cg-shift', shift_cbar=0.025",
            "at 3 s the c.g. moves to 2.5% of the chord aft of its position at take-off",
        ),
        (
            "kind='cg-shift', shift_cbar=-0.01",
            "at 3 s the c.g. moves to 1.0% of the chord ahead of its position at take-off",
        ),
        ("kind='ramp', to=0.4, over_s=3", "at 3 s the elevator effectiveness ramps to 40% over 3 s"),
        ("to=0.4", "at 3 s the elevator effectiveness steps to 40%"),
        ("surface='aileron', to=0.4", "at 3 s the aileron effectiveness steps to 40%"),
        ("surface='rudder', kind='ramp', to=0.1", "at 3 s the rudder effectiveness ramps to 10% over 2 s"),
        ("surface='rudder', kind='stuck'", "at 3 s the rudder is stuck at its current position"),
        ("kind='floating'", "at 3 s the elevator is disconnected from its actuator and floats in the airstream"),
        (
            "surface='aileron', kind='hardover', side='low'",
            "at 3 s the aileron runs to its lowest stop, regardless of the command",
        ),
        (
            "surface='rudder', kind='hardover', side='high'",
            "at 3 s the rudder runs to its highest stop, regardless of the command",
        ),
        ("surface='aileron', kind='rate-limit', to=0.25", "at 3 s the aileron rate limit falls to 25%"),
        (
            "surface='rudder', kind='bias', bias_deg=-2.5",
            "at 3 s the rudder has a bias of -2.5 deg that its position feedback does not show",
        ),
    ],
)
def test_failures_in_words(keys: str, words: str) -> None:
    settings = ["lateral.enabled=true", f"failures.0={{at_s=3, {keys}}}"]
    assert failures(load_scenario("nominal", settings)) == [words]


def test_gusts_and_failures_are_reported_at_their_times() -> None:
    gusts = ["gusts.0={at_s=0.5, up_fps=-9, rise_s=0.25}", "gusts.1={at_s=1.0, up_fps=12.5, rise_s=2, hold_s=1}"]
    cg = "failures.1={kind='cg-shift', at_s=0.3, shift_cbar=0.01}"
    result = run(load_scenario("elevator-loss", ["failures.0.at_s=1.5", cg, *gusts, "duration_s=3"]))
    scenario, summary = result.plan.scenario, result.summary
    times = {text: t for t, text, _ in events(scenario, result.trace, summary, result.plan.actuators)}
    assert times["gust: a gust of 9 ft/s down, rising for 0.25 s"] == 0.5
    assert times["gust: a gust of 12.5 ft/s up, rising for 2 s, held for 1 s"] == 1.0
    assert times["FAILURE: the c.g. moves to 1.0% of the chord aft of its position at take-off"] == 0.3
    # Of K, times count from the elevator's failure, not from that of the c.g.
    within = summary.metrics.estimators["scheduled"].first_within_20pct_s
    assert times["K of 'scheduled' within 20 % of the truth"] == pytest.approx(1.5 + within)
    text = run_text(scenario, summary)
    assert (
        "- air: turbulence none; gusts at 0.5 s a gust of 9 ft/s down, rising for 0.25 s; at 1 s a gust of 12.5" in text
    )
    assert "- air: turbulence none; gusts none" in run_text(load_scenario("nominal"), summary)


def test_the_card_of_a_flight_says_nothing_of_what_it_has_not() -> None:
    result = run(
        load_scenario(
            "nominal", ["duration_s=1", "estimators=[]", "adaptation.enabled=false", "atmosphere.turbulence=light"]
        )
    )
    text = run_text(result.plan.scenario, result.summary)
    rms = result.summary.metrics.tracking_rms_pre_deg_s
    assert f"- tracking RMS: {rms:.2f} deg/s\n" in text
    assert "turbulence light" in text
    assert "| estimator |" not in text
    assert "own code" not in text
    assert "turbulence light" in plan_text(result.plan.scenario)


def test_the_card_names_own_code() -> None:
    scenario = load_scenario("nominal", ["duration_s=0.2"])
    summary = replace(run(scenario).summary, extensions=(ExtensionSummary("mine.py:E", "0123456789abcdef"),))
    assert "- own code: mine.py:E, SHA-256 0123456789ab\n" in run_text(scenario, summary)


def test_events_and_card_of_a_flight_with_roll_and_yaw() -> None:
    """Times of an estimate count from the change of its own surface; the healthy elevator is found by no estimator."""
    result = run(rolling())
    scenario, summary = result.plan.scenario, result.summary
    happened = events(scenario, result.trace, summary, result.plan.actuators)
    times = {text: t for t, text, _ in happened}
    assert (
        times["FAILURE: the aileron effectiveness steps to 40%"],
        times["FAILURE: the rudder effectiveness steps to 50%"],
    ) == (4.0, 6.0)
    for name, at_s in (("surfaces.aileron", 4.0), ("surfaces.rudder", 6.0)):
        within = summary.metrics.estimators[name].first_within_20pct_s
        assert times[f"K of '{name}' within 20 % of the truth"] == pytest.approx(at_s + within)
        declared = f"'{name}' declares a change of K"
        alarm = next(t for t, text, _ in happened if text.startswith(declared) and t >= at_s)
        assert alarm == pytest.approx(at_s + summary.metrics.estimators[name].detected_at_s)
    assert not any(text.startswith(("K of 'surfaces' ", "K of 'pitch' ")) for text in times)
    text = run_text(scenario, summary)
    before, after = (summary.metrics.tracking_rms(phase, "beta_deg") for phase in PHASES)
    assert f"beta - beta_ref {before:.2f} deg before, {after:.2f} deg from 0.3 s after the failure" in text
    assert "| surfaces.rudder |" in text
    rows = dict(settings_rows(scenario, "f16"))
    assert rows["roll-rate command"].startswith("doublet, amplitude 20 deg/s, period 4.5 s")
    assert rows["sideslip command"].startswith("doublet, amplitude 2 deg, period 4.5 s")
    assert "aileron 10 deg" in rows["roll and yaw"]
    assert "of beta 0.03 deg" in rows["sensors"]
    assert "roll and yaw" not in dict(settings_rows(load_scenario("nominal"), "f16"))


def test_every_surface_that_reaches_its_stop_is_told() -> None:
    hard = ["failures=[]", "duration_s=2", "lateral.roll.amplitude_deg_s=300", "lateral.roll.filter_rad_s=0"]
    result = run(rolling(hard))
    texts = [text for _, text, _ in events(result.plan.scenario, result.trace, result.summary, result.plan.actuators)]
    assert "aileron command at its stop" in texts
    assert "elevator command at its stop" not in texts
