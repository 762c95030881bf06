"""The words on a flight: what failed, what blew, and when."""

from __future__ import annotations

import pytest

from flightbed.card import plan_card, run_card
from flightbed.event_log import events, failures
from flightbed.mission import run
from flightbed.scenario import load_scenario


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (
            "kind='structural', to=0.4, force_to=0.85",
            "at 3 s the elevator keeps 40% of its moment and 85% of its lift and drag",
        ),
        (
            "kind='cg-shift', shift_cbar=0.025",
            "at 3 s the c.g. moves to 2.5% of the chord aft of where it was at take-off",
        ),
        (
            "kind='cg-shift', shift_cbar=-0.01",
            "at 3 s the c.g. moves to 1.0% of the chord ahead of where it was at take-off",
        ),
        ("kind='ramp', to=0.4, over_s=3", "at 3 s the elevator begins to go to 40% of its effect, over 3 s"),
        ("to=0.4", "at 3 s the elevator keeps 40% of its effect"),
    ],
)
def test_failures_in_words(keys: str, words: str) -> None:
    assert failures(load_scenario("nominal", [f"failures.0={{at_s=3, {keys}}}"])) == [words]


def test_gusts_and_failures_are_told_at_their_times() -> None:
    gusts = ["gusts.0={at_s=0.5, up_fps=-9, rise_s=0.25}", "gusts.1={at_s=1.0, up_fps=12.5, rise_s=2, hold_s=1}"]
    cg = "failures.1={kind='cg-shift', at_s=0.3, shift_cbar=0.01}"
    result = run(load_scenario("elevator-loss", ["failures.0.at_s=1.5", cg, *gusts, "duration_s=3"]))
    scenario, summary = result.plan.scenario, result.summary
    told = {text: t for t, text, _ in events(scenario, result.trace, summary, result.plan.actuators)}
    assert told["gust: a gust of 9 ft/s down, rising for 0.25 s"] == 0.5
    assert told["gust: a gust of 12.5 ft/s up, rising for 2 s, held for 1 s"] == 1.0
    assert told["FAILURE: the c.g. moves to 1.0% of the chord aft of where it was at take-off"] == 0.3
    # Of K, times count from the elevator's failure, not from that of the c.g.
    within = summary["estimators"]["scheduled"]["first_within_20pct_s"]
    assert told["K of 'scheduled' within 20 % of the truth"] == pytest.approx(1.5 + within)
    card = run_card(scenario, summary)
    assert (
        "- air: turbulence none; gusts at 0.5 s a gust of 9 ft/s down, rising for 0.25 s; at 1 s a gust of 12.5" in card
    )
    assert "- air: turbulence none; gusts none" in run_card(load_scenario("nominal"), summary)


def test_the_card_of_a_flight_says_nothing_of_what_it_has_not() -> None:
    result = run(
        load_scenario(
            "nominal", ["duration_s=1", "estimators=[]", "adaptation.enabled=false", "atmosphere.turbulence=light"]
        )
    )
    card = run_card(result.plan.scenario, result.summary)
    rms = result.summary["tracking_rms_pre_deg_s"]
    assert f"- tracking RMS: {rms:.2f} deg/s\n" in card
    assert "turbulence light" in card
    assert "| estimator |" not in card
    assert "own code" not in card
    assert "turbulence light" in plan_card(result.plan.scenario)


def test_the_card_names_own_code() -> None:
    scenario = load_scenario("nominal", ["duration_s=0.2"])
    summary = run(scenario).summary | {"extensions": [{"name": "mine.py:E", "sha256": "0123456789abcdef"}]}
    assert "- own code: mine.py:E, SHA-256 0123456789ab\n" in run_card(scenario, summary)
