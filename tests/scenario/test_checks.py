"""Checks between keys: conflicts, and keys without effect under another setting."""

from __future__ import annotations

import tomllib
from collections.abc import Callable

import numpy as np
import pytest

from flightbed.config.own_code import using
from flightbed.core.errors import ScenarioError
from flightbed.core.units import DEG
from flightbed.runs.run import run
from flightbed.scenario.own_code import named_extensions
from flightbed.scenario.reading import load_scenario
from tests.lateral_flight import rolling

PLACE = "scenarios/thesis-loss.toml"
RLS = "estimators.1={name='expanding', kind='differentiated-rls', model='short-period'}"


@pytest.mark.parametrize(
    ("overrides", "problems"),
    [
        (["control.poles=[[-1,0],[-5,5],[-5,-5]]"], [f"{PLACE}: control.poles: cannot be combined with control.gains, which replace the design; give one of them"]),
        (["control.state_from=windw"], [f"{PLACE}: control.state_from: no estimator is named 'windw'; did you mean window?; known: window, expanding"]),
        (["control.state_from=x", "adaptation.enabled=false", "estimators=[]"], [f"{PLACE}: control.state_from: no estimator is named 'x'; known: none"]),
        (["control.gains.q=1"], ["--set: unknown key control.gains.q; did you mean q_s?"]),
        (["estimators.0.input_at=middle"], ["--set estimators.0.input_at: must be 'mean', 'start' or 'end' (got 'middle')"]),
        (["estimators.0.prior.first_reading=kept"], ["--set estimators.0.prior.first_reading: must be 'left-out' or 'used' (got 'kept')"]),
        (["process_noise.q_std_deg_s2=-1"], ["--set process_noise.q_std_deg_s2: must be between 0 and 1000000 (got -1)"]),
        (["process_noise.q_std_deg_s=1"], ["--set: unknown key process_noise.q_std_deg_s; did you mean q_std_deg_s2?"]),
        # idle
        (["control.integral_pole_rad_s=-1"], ["--set: control.integral_pole_rad_s: 'proportional' has no such key ('proportional-integral' has it); remove it"]),
        (["control={law='lq'}", "control.poles=[[-1,0]]"], ["--set: control.poles: 'lq' has no such key ('nz-adaptive', 'nz-scheduled', 'proportional', 'proportional-integral' have it); remove it"]),
        (["control.weights.q_deg_s=1"], ["--set: control.weights: 'proportional' has no such key ('lq' has it); remove it"]),
        (["command.amplitude_g=2"], ["--set command.amplitude_g: has no effect with control.law = 'proportional'"]),
        (["sensors.nz_std_g=0.1"], ["--set sensors.nz_std_g: has no effect with control.law = 'proportional'"]),
        (["control.law=proportional-integral", "control.integral_pole_rad_s=-1"], ["--set control.integral_pole_rad_s: has no effect with control.gains"]),
        (["control.gains.integral=-3"], ["--set: control.gains.integral: 'proportional' has no such key ('proportional-integral' has it); remove it"]),
        (["estimators.1.prior.state=measurement", "estimators.1.prior.first_reading=used"], ["--set estimators.1.prior.first_reading: has no effect with estimators.1.prior.state = 'measurement'"]),
        ([RLS, "estimators.1.input_at=start"], ["--set: estimators.1.input_at: 'differentiated-rls' has no such key ('loop-gain' has it); remove it"]),
        ([RLS, "estimators.1.prior.first_reading=used"], ["--set: estimators.1.prior.first_reading: 'differentiated-rls' has no such key ('loop-gain' has it); remove it"]),
        ([RLS, "estimators.1.options.x=1"], ["--set: estimators.1.options: 'differentiated-rls' has no such key (own code has it); remove it"]),
        ([RLS, "estimators.1.widnow=1"], ["--set: unknown key estimators.1.widnow; 'differentiated-rls' has: name, kind, model, smoothing, bounds, forgetting, prior"]),
    ],
)  # fmt: skip
def test_each_problem_is_one_line_with_place_value_and_cure(overrides: list[str], problems: list[str]) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("thesis-loss", overrides)
    assert list(caught.value.problems) == problems


def test_the_error_names_a_missing_gain() -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("nominal", ["control.gains={alpha=1, q_s=1, elevator=0}"])
    assert [p.partition(": ")[2] for p in caught.value.problems] == ["control.gains.reference_s: is missing"]


def test_the_same_keys_are_accepted_where_they_have_an_effect() -> None:
    sets = ["control.law=proportional-integral", "control.gains.integral=-3", "control.state_from=expanding"]
    sets += ["estimators.0.input_at=start", "estimators.0.prior.first_reading=used", "process_noise.q_std_deg_s2=1"]
    idle = load_scenario("thesis-loss", sets).idle_keys()
    assert not {text.partition("=")[0] for text in sets} & set(idle)
    assert "control.integral_pole_rad_s" in idle
    assert (
        "control.integral_pole_rad_s" not in load_scenario("nominal", ["control.law=proportional-integral"]).idle_keys()
    )


TWO = "estimators.0={name='two', kind='two-stage', memory='variable'}"
FADING = "estimators.0={name='two', kind='two-stage', memory='fading'}"


ONLY_RLS = "estimators.0={name='scheduled', kind='differentiated-rls'}"


OTHERS = ("differentiated-rls", "input-kalman", "loop-gain", "plid", "retrospective-cost")


def _kind(name: str, *have: str) -> str:
    kinds = ", ".join(f"'{kind}'" for kind in have)
    return f"'{name}' has no such key ({kinds} {'has' if len(have) == 1 else 'have'} it); remove it"


@pytest.mark.parametrize(
    ("overrides", "problem"),
    [
        (["estimators.0={name='two', kind='two-stage', memory='window'}"], "estimators.0.memory: must be 'expanding', 'fading' or 'variable' (got 'window')"),
        (["estimators.0.memory=variable"], "estimators.0.memory: must be 'window', 'expanding' or 'fading' (got 'variable')"),
        ([TWO, "estimators.0.variance_min=2"], "estimators.0.variance_min: must be below variance_max = 1 (got 2)"),
        ([TWO, "estimators.0.model=short-period", "lateral.enabled=true"], "estimators.0.model: must be 'scheduled' with kind = 'two-stage' and lateral.enabled = true (got 'short-period')"),
        ([TWO, "estimators.0.input=deviation"], f"estimators.0.input: {_kind('two-stage', 'loop-gain')}"),
        ([TWO, "estimators.0.input_at=start"], f"estimators.0.input_at: {_kind('two-stage', 'loop-gain')}"),
        ([TWO, "estimators.0.alarm_threshold=9"], f"estimators.0.alarm_threshold: {_kind('two-stage', 'loop-gain')}"),
        ([TWO, "estimators.0.hold_std=0.1"], f"estimators.0.hold_std: {_kind('two-stage', 'loop-gain')}"),
        ([TWO, "estimators.0.prior.state=fixed"], f"estimators.0.prior.state: {_kind('two-stage', 'loop-gain')}"),
        ([TWO, "estimators.0.prior.effectiveness=0.5"], f"estimators.0.prior.effectiveness: {_kind('two-stage', *OTHERS)}"),
        ([TWO, "estimators.0.forgetting=0.9"], "estimators.0.forgetting: has no effect with estimators.0.memory = 'variable'"),
        ([FADING, "estimators.0.variance_max=2"], "estimators.0.variance_max: has no effect with estimators.0.memory = 'fading'"),
        ([TWO, "estimators.0.p_disturbance_deg_s2=2"], "estimators.0.p_disturbance_deg_s2: has no effect with lateral.enabled = false"),
        *(([f"estimators.0.{key}=0.1"], f"estimators.0.{key}: {_kind('loop-gain', 'two-stage')}") for key in ("variance_min", "variance_max", "walk_std", "beta_disturbance_deg_s", "p_disturbance_deg_s2", "r_disturbance_deg_s2")),
        (["estimators.0.false_alarm=0.1"], f"estimators.0.false_alarm: {_kind('loop-gain', 'input-kalman', 'retrospective-cost', 'two-stage')}"),
        *(([ONLY_RLS, f"estimators.0.{key}=0.1"], f"estimators.0.{key}: {_kind('differentiated-rls', 'two-stage')}") for key in ("variance_min", "walk_std", "r_disturbance_deg_s2")),
        (["lateral.p_deg_s=5"], "lateral.p_deg_s: has no effect with lateral.enabled = false"),
        (["sensors.beta_std_deg=0.1"], "sensors.beta_std_deg: has no effect with lateral.enabled = false"),
        (["lateral.enabled=true", "lateral.roll.amplitude_deg_s=5"], "lateral.roll.amplitude_deg_s: 'none' has no such key ('3-2-1-1', 'chirp', 'constant', 'dither', 'doublet', 'multisine', 'pulse', 'random' have it); remove it"),
        (["lateral.enabled=true", "lateral.sideslip.kind=constant", "lateral.sideslip.period_s=2"], "lateral.sideslip.period_s: 'constant' has no such key ('3-2-1-1', 'chirp', 'dither', 'doublet', 'multisine', 'pulse' have it); remove it"),
        (["failures.0.side=low"], "failures.0.side: 'effectiveness' has no such key ('hardover' has it); remove it"),
    ],
)  # fmt: skip
def test_keys_of_three_surfaces_and_of_the_two_stage_filter(overrides: list[str], problem: str) -> None:
    fixed = ["adaptation.enabled=false"] if {TWO, FADING} & set(overrides) else []
    with pytest.raises(ScenarioError) as caught:
        load_scenario("elevator-loss", [*overrides, *fixed])
    assert any(text.endswith(problem) for text in caught.value.problems), caught.value.problems


def test_the_default_memory_of_a_two_stage_filter_is_variable() -> None:
    named = {"adaptation.estimator=two", "estimators.0={name='two', kind='two-stage'}"}
    (first, *_) = load_scenario("elevator-loss", sorted(named)).estimators
    assert (first.memory, first.window) == ("variable", 3)
    again = load_scenario(tomllib.loads(load_scenario("elevator-loss", sorted(named)).to_toml())).estimators[0]
    assert again == first


def test_the_keys_of_the_two_stage_filter_are_accepted_where_they_have_an_effect() -> None:
    keys = (
        "window",
        "variance_min",
        "variance_max",
        "walk_std",
        "false_alarm",
        "p_disturbance_deg_s2",
        "smoothing",
        "prior.effectiveness_std",
    )
    sets = [f"estimators.0.{key}={3 if key == 'window' else 0.1}" for key in keys if key != "variance_max"]
    idle = rolling(sets).idle_keys()
    assert not {f"estimators.0.{key}" for key in keys} & set(idle)
    faded = rolling(["estimators.0.memory=fading", "estimators.0.forgetting=0.95"])
    assert "estimators.0.forgetting" not in faded.idle_keys()


def test_external_roll_and_sideslip_commands_are_listed_only_with_lateral_axes() -> None:
    def mine(_settings: object) -> Callable[[np.ndarray], np.ndarray]:
        return lambda t_s: np.where(t_s >= 0.5, 0.1, 0.0)

    keys = ["lateral.roll.kind=mine", "lateral.sideslip.kind=mine", "duration_s=1", "failures=[]"]
    with using({"mine": mine}):
        scenario = rolling(keys)
        assert [own.name for own in named_extensions(scenario)] == ["mine"]
        result = run(scenario)
        assert [own.name for own in result.summary.extensions] == ["mine"]
        assert result.trace["p_cmd_deg_s"][60] == pytest.approx(0.1 / DEG)
        assert result.trace["beta_cmd_deg"][60] == pytest.approx(0.1 / DEG)
        assert named_extensions(load_scenario("nominal")) == ()
