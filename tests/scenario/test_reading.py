"""Scenario files: an override reaches every key; all problems are reported at once, each in one line with place, value and cure."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightbed.config import families
from flightbed.config.kinds import COMMANDS, ROLL_COMMANDS, SIDESLIP_COMMANDS
from flightbed.core import data
from flightbed.core.errors import InputError, ScenarioError, UnknownNameError
from flightbed.core.units import DEG
from flightbed.scenario.reading import Scenario, load_scenario

FILE = "scenarios/elevator-loss.toml"


@pytest.mark.parametrize("name", list(data.names("scenario")))
def test_shipped_scenarios_load_and_survive_a_round_trip(name: str, tmp_path: Path) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description
    written = tmp_path / "again.toml"
    written.write_text(scenario.to_toml())
    assert load_scenario(written) == scenario


@settings(max_examples=25)
@given(to=st.floats(0, 1), mach=st.floats(0.1, 2), seed=st.integers(0, 2**63 - 1), at=st.floats(0, 16))
def test_resolved_scenarios_keep_every_digit(to: float, mach: float, seed: int, at: float) -> None:
    overrides = [f"failures.0.to={to!r}", f"condition.mach={mach!r}", f"seed={seed}", f"failures.0.at_s={at!r}"]
    scenario = load_scenario("elevator-loss", overrides)
    assert (scenario.failures[0].to, scenario.condition.mach, scenario.seed) == (to, mach, seed)
    assert Scenario.model_validate(load_scenario(tomllib.loads(scenario.to_toml()))) == scenario


def test_overrides_of_the_contract() -> None:
    scenario = load_scenario(
        "elevator-loss",
        ["failures.0.to=0.35", "condition.mach=0.75", "adaptation.enabled=false", "command.kind=none"],
    )
    assert scenario.failures[0].to == 0.35
    assert scenario.condition.mach == 0.75
    assert not scenario.adaptation.enabled
    assert scenario.command.kind == "none"


def test_an_override_can_add_to_a_list() -> None:
    scenario = load_scenario(
        "nominal", ["failures.0.at_s=3", "failures.0.to=.5", "failures.1.at_s=6", "failures.1.to=0.2"]
    )
    assert [(f.at_s, f.to) for f in scenario.failures] == [(3.0, 0.5), (6.0, 0.2)]


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("failures.0.to=1.4", "--set failures.0.to: must be between 0 and 1 (got 1.4)"),
        ("failures.0.to=-0.1", "--set failures.0.to: must be between 0 and 1 (got -0.1)"),
        ("failures.0.to='x'", "--set failures.0.to: must be a number (got 'x')"),
        ("failures.0.to=true", "--set failures.0.to: must be a number (got True)"),
        ("failures.0.at_dg=1", "--set: unknown key failures.0.at_dg; did you mean at_s?"),
        ("failures.0.at_s=16.5", f"{FILE}: failures.0.at_s: must be no later than the last tick, 16.49 s (got 16.5)"),
        ("seed=abc", "--set seed: must be a whole number (got 'abc')"),
        ("seed=-1", "--set seed: must be between 0 and 9223372036854775807 (got -1)"),
        ("seed=1.5", "--set seed: must be a whole number (got 1.5)"),
        ("rates.plant_hz=150", f"{FILE}: rates: plant_hz must be an integer multiple of control_hz (got 150 and 100)"),
        ("duration_s=16.505", f"{FILE}: duration_s: must be a whole number of ticks of 1/100 s (got 16.505)"),
        ("duration_s=0", "--set duration_s: must be above 0 and at most 36000 (got 0)"),
        ("duration_s=nan", "--set duration_s: must be finite (got nan)"),
        ("estimators.0.kind=loopgain", "--set estimators.0.kind: unknown estimator; did you mean loop-gain?; known: differentiated-rls, input-kalman, loop-gain, plid, retrospective-cost, two-stage (got 'loopgain')"),
        ("estimators.0.model=schedule", "--set estimators.0.model: must be 'scheduled' or 'short-period' (got 'schedule')"),
        ("estimators.0.input=deviation", f"{FILE}: estimators.0.input: must be 'absolute' with model = 'scheduled', which has no trim point (got 'deviation')"),
        ("failures.0.over_s=3", "--set: failures.0.over_s: 'effectiveness' has no such key ('ramp' has it); remove it"),
        ("failures.0.shift_cbar=0.1", "--set: failures.0.shift_cbar: 'effectiveness' has no such key ('cg-shift' has it); remove it"),
        ("failures.0.force_to=0.1", "--set: failures.0.force_to: 'effectiveness' has no such key ('structural' has it); remove it"),
        ("failures.0.kind=structural", f"{FILE}: failures.0.force_to: is missing"),
        ("failures.0={kind='cg-shift', at_s=3}", f"{FILE}: failures.0.shift_cbar: is missing"),
        ("failures.0={kind='hardover', at_s=3}", f"{FILE}: failures.0.side: is missing"),
        ("failures.0={kind='bias', at_s=3}", f"{FILE}: failures.0.bias_deg: is missing"),
        ("failures.0={kind='rate-limit', at_s=3}", f"{FILE}: failures.0.to: is missing"),
        ("failures.0={kind='structural', at_s=3, to=0.5, force_to=0.5, surface='rudder'}", f"{FILE}: failures.0.surface: must be 'elevator' (got 'rudder')"),
        ("failures.0.surface=rudder", f"{FILE}: failures.0.surface: the stock laws control aileron and rudder (got 'rudder'); set lateral.enabled to true"),
        ("failures.1.at_s=5", f"{FILE}: failures.1.to: is missing"),
        ("failures.0.kind=cg-shft", "--set failures.0.kind: unknown failure; did you mean cg-shift?; known: bias, cg-shift, effectiveness, floating, hardover, ramp, rate-limit, structural, stuck (got 'cg-shft')"),
        ("gusts.0={at_s=16.5, up_fps=9, rise_s=1}", f"{FILE}: gusts.0.at_s: must be no later than the last tick, 16.49 s (got 16.5)"),
        ("gusts.0={at_s=1, up_fps=9, rise_s=0}", f"{FILE}: gusts.0.rise_s: must be above 0 and at most 1000000 (got 0)"),
        ("gusts.0={at_s=1, up_fps=900, rise_s=1}", f"{FILE}: gusts.0.up_fps: must be between -500 and 500 (got 900)"),
        ("gusts.0={at_s=1, rise_s=1}", f"{FILE}: gusts.0.up_fps: is missing"),
        ("estimators.1.alarm_threshold=9", "--set estimators.1.alarm_threshold: has no effect with estimators.1.memory = 'expanding'"),
        ("adaptation.caution=11", "--set adaptation.caution: must be between 0 and 10 (got 11)"),
        ("rates.delay_ticks=-1", "--set rates.delay_ticks: must be between 0 and 100 (got -1)"),
        ("model_error.cm_delta=-1", "--set model_error.cm_delta: must be between 0 and 10 (got -1)"),
        ("estimators.0.bounds=[1,0]", f"{FILE}: estimators.0: bounds must rise (got [1.0, 0.0])"),
        ("estimators.0.bounds=[0,1,2]", "--set estimators.0.bounds: must have 2 values (got [0, 1, 2])"),
        ("estimators.1.name=scheduled", f"{FILE}: estimators.1.name: must be unique (got 'scheduled' twice)"),
        ("adaptation.estimator=schedule", f"{FILE}: adaptation.estimator: no estimator is named 'schedule'; did you mean scheduled?; known: scheduled, expanding"),
        ("control.law=pid", "--set control.law: unknown law; known: lq, nz-adaptive, nz-scheduled, proportional, proportional-integral (got 'pid')"),
        ("command.kind=dublet", "--set command.kind: unknown command; did you mean doublet?; known: 3-2-1-1, chirp, constant, dither, doublet, multisine, none, pulse, random (got 'dublet')"),
        ("atmosphere.turbulence=heavy", "--set atmosphere.turbulence: must be 'none', 'light', 'moderate' or 'severe' (got 'heavy')"),
        ("failures=3", "--set failures: must be a list (got 3)"),
        ("aircraft=3", "--set aircraft: must be a table (got 3)"),
        ("name=a b", "--set name: must be letters, digits, - and _, and start with a letter or digit (got 'a b')"),
        ("failures.2.to=.1", "--set failures.2.to=.1: '2' must be an index from 0 to 1 (1 adds one)"),
        ("condition.mach.x=2", "--set condition.mach.x=2: 'x': the value that contains it is not a table; use a key of the scenario"),
        ("seed", "--set seed: must be KEY=VALUE, for example --set failures.0.to=0.35"),
        ("control.poles=[[1,0],[-2,2],[-2,-2]]", f"{FILE}: control: poles must lie in the left half plane (got [[1.0, 0.0], [-2.0, 2.0], [-2.0, -2.0]])"),
        ("failures.0.at_s=16.495", f"{FILE}: failures.0.at_s: must be no later than the last tick, 16.49 s (got 16.495)"),
        ("description=3", "--set description: must be a string (got 3)"),
        ("estimators.0.forgetting=0.9", "--set estimators.0.forgetting: has no effect with estimators.0.memory = 'window'"),
        ("estimators.1.window=20", "--set estimators.1.window: has no effect with estimators.1.memory = 'expanding'"),
        ("estimators.0.prior.alpha_deg=1", "--set estimators.0.prior.alpha_deg: has no effect with estimators.0.prior.state = 'measurement'"),
        ("control.integral_pole_rad_s=-1", "--set: control.integral_pole_rad_s: 'proportional' has no such key ('proportional-integral' has it); remove it"),
        ("estimators.0.forgetting=0.1", "--set estimators.0.forgetting: must be between 0.5 and 1 (got 0.1)"),
        ("estimators.0.prior.effectiveness_std=1e200", "--set estimators.0.prior.effectiveness_std: must be above 0 and at most 1000000 (got 1e+200)"),
        ("schema=2", "--set schema: must be 1 (got 2)"),
    ],
)  # fmt: skip
def test_each_problem_is_one_line_with_place_value_and_cure(override: str, message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("elevator-loss", [override])
    assert str(caught.value) == message
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("kind", "override", "message"),
    [
        ("chirp", "command.high_hz=50", f"{FILE}: command.high_hz: must be below 50, half of rates.control_hz (got 50)"),
        ("dither", "command.high_hz=50", f"{FILE}: command.high_hz: must be below 50, half of rates.control_hz (got 50)\n{FILE}: command.period_s: the band from low_hz to high_hz must hold 1 to 100 multiples of 1/period_s (got 225); narrow the band or shorten the period"),
        ("chirp", "command.low_hz=2.5", f"{FILE}: command.low_hz: must be no higher than high_hz = 2 (got 2.5)"),
        ("multisine", "command.low_hz=2.5", f"{FILE}: command.low_hz: must be no higher than high_hz = 2 (got 2.5)"),
        ("multisine", "command.period_s=0.4", f"{FILE}: command.period_s: the band from low_hz to high_hz must hold 1 to 100 multiples of 1/period_s (got 0); widen the band or lengthen the period"),
        ("dither", "command.period_s=60", f"{FILE}: command.period_s: the band from low_hz to high_hz must hold 1 to 100 multiples of 1/period_s (got 109); narrow the band or shorten the period"),
        ("3-2-1-1", "command.period_s=0.06", f"{FILE}: command.period_s: must be at least 0.07, so that each pulse lasts at least one tick (got 0.06)"),
        ("doublet", "command.period_s=0.01", f"{FILE}: command.period_s: must be at least 0.02, so that each pulse lasts at least one tick (got 0.01)"),
        ("random", "command.switch_s=0.005", f"{FILE}: command.switch_s: must be at least 0.01, so that each pulse lasts at least one tick (got 0.005)"),
        ("random", "command.register_bits=1", "--set command.register_bits: must be between 2 and 12 (got 1)"),
        ("random", "command.seed=-1", "--set command.seed: must be between 0 and 9223372036854775807 (got -1)"),
        ("random", "command.period_s=3", "--set: command.period_s: 'random' has no such key ('3-2-1-1', 'chirp', 'dither', 'doublet', 'multisine', 'pulse' have it); remove it"),
        ("random", "command.low_hz=1", "--set: command.low_hz: 'random' has no such key ('chirp', 'dither', 'multisine' have it); remove it"),
        ("dither", "command.count=2", "--set: command.count: 'dither' has no such key ('3-2-1-1', 'chirp', 'doublet', 'multisine', 'random' have it); remove it"),
        ("chirp", "command.seed=2", "--set: command.seed: 'chirp' has no such key ('random' has it); remove it"),
        ("multisine", "command.switch_s=2", "--set: command.switch_s: 'multisine' has no such key ('random' has it); remove it"),
        ("3-2-1-1", "command.high_hz=2", "--set: command.high_hz: '3-2-1-1' has no such key ('chirp', 'dither', 'multisine' have it); remove it"),
        ("doublet", "command.register_bits=5", "--set: command.register_bits: 'doublet' has no such key ('random' has it); remove it"),
        ("constant", "command.period_s=5", "--set: command.period_s: 'constant' has no such key ('3-2-1-1', 'chirp', 'dither', 'doublet', 'multisine', 'pulse' have it); remove it"),
        ("none", "command.amplitude_deg_s=5", "--set: command.amplitude_deg_s: 'none' has no such key ('3-2-1-1', 'chirp', 'constant', 'dither', 'doublet', 'multisine', 'pulse', 'random' have it); remove it"),
    ],
)  # fmt: skip
def test_contradictory_commands_and_idle_keys_of_commands_are_errors(kind: str, override: str, message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("elevator-loss", [f"command={{kind='{kind}'}}", override])
    assert str(caught.value) == message


def test_every_key_of_a_command_is_either_used_or_an_error() -> None:
    """Each key of a kind changes its sampled command; --set accepts no other."""
    t = np.arange(4000) / 100
    changes = {"amplitude_deg_s": 1.5, "period_s": 7.7, "count": 2, "start_s": 1.3, "low_hz": 0.6, "high_hz": 1.1, "switch_s": 0.4, "register_bits": 5, "seed": 3}  # fmt: skip
    for kind in families.names("commands"):
        plain = load_scenario("elevator-loss", [f"command={{kind='{kind}'}}"]).command
        for key, value in changes.items():
            override = [f"command={{kind='{kind}'}}", f"command.{key}={value}"]
            if key not in type(plain).model_fields:
                with pytest.raises(ScenarioError, match=f"command.{key}: '{kind}' has no such key"):
                    load_scenario("elevator-loss", override)
                continue
            changed = load_scenario("elevator-loss", override).command
            assert not np.array_equal(changed.rate()(t), plain.rate()(t)), (kind, key)


def test_each_command_has_the_amplitudes_of_its_place() -> None:
    """A load factor of 1 g and a rate of 1 rad/s are the same number; so are angle and rate in the same unit."""
    t = np.arange(400) / 100
    for kind in families.names("commands"):
        table = {"kind": kind} if kind == "none" else {"kind": kind, "amplitude_deg_s": 7.0}
        in_g = COMMANDS.make(kind=kind)
        pitch, roll = COMMANDS.make(**table), ROLL_COMMANDS.make(**table)
        sideslip = SIDESLIP_COMMANDS.make(
            **({"kind": kind} if kind == "none" else {"kind": kind, "amplitude_deg": 7.0})
        )
        assert np.array_equal(pitch.rate()(t), roll.rate()(t))
        assert np.array_equal(pitch.rate()(t), sideslip.angle()(t))
        np.testing.assert_allclose(7.0 * DEG * in_g.load_factor()(t), pitch.rate()(t), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(
    "key", ["command.amplitude_deg", "lateral.roll.amplitude_g", "lateral.sideslip.amplitude_deg_s"]
)
def test_an_amplitude_of_another_place_is_an_unknown_key(key: str) -> None:
    place, _, amplitude = key.rpartition(".")
    sets = ["lateral.enabled=true", f"{place}={{kind='doublet'}}"]
    with pytest.raises(ScenarioError) as caught:
        load_scenario("nominal", [*sets, f"{key}=1"])
    (problem,) = caught.value.problems
    assert problem.startswith(f"--set: unknown key {key}; did you mean amplitude_")
    table = tomllib.loads(load_scenario("nominal", sets).to_toml())
    for part in place.split("."):
        table = table[part]
    assert table["kind"] == "doublet"
    assert amplitude not in table


def test_dither_has_a_small_default_amplitude() -> None:
    assert load_scenario("level-loss", ["command.kind=dither"]).command.amplitude_deg_s == 0.5
    assert load_scenario("level-loss", ["command.kind=multisine"]).command.amplitude_deg_s == 5.0
    assert load_scenario("elevator-loss", ["command.kind=dither"]).command.amplitude_deg_s == 5.0  # set in the file


@pytest.mark.parametrize(
    ("failure", "problem"),
    [
        ('kind = "cg-shift"\nshift_cbar = 0.02\nto = 0.2', "to: 'cg-shift' has no such key ('effectiveness', 'ramp', 'rate-limit', 'structural' have it)"),
        ("to = 0.2\nover_s = 3.0", "over_s: 'effectiveness' has no such key ('ramp' has it)"),
        ('kind = "stuck"\nto = 0.2', "to: 'stuck' has no such key ('effectiveness', 'ramp', 'rate-limit', 'structural' have it)"),
        ('kind = "bias"\nbias_deg = 1.0\nside = "low"', "side: 'bias' has no such key ('hardover' has it)"),
    ],
)  # fmt: skip
def test_a_file_with_a_key_of_another_kind_of_failure_is_refused(tmp_path: Path, failure: str, problem: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'schema = 1\nname = "x"\nduration_s = 9.0\n[[failures]]\nat_s = 3.0\n{failure}\n')
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    assert caught.value.problems == (f"{path}: failures.0.{problem}; remove it",)


@pytest.mark.parametrize("key", ["to=0.5", "force_to=0.5", "over_s=3", "surface=elevator"])
def test_a_cg_shift_has_no_key_of_the_elevator(key: str) -> None:
    shift = ["failures.0.kind=cg-shift", "failures.0.at_s=3", "failures.0.shift_cbar=0.02"]
    with pytest.raises(
        ScenarioError,
        match=f"--set: failures.0.{key.partition('=')[0]}: 'cg-shift' has no such key",
    ):
        load_scenario("nominal", [*shift, f"failures.0.{key}"])


def test_a_required_key_may_have_its_default_value() -> None:
    """A share of 1 in the file is not missing."""
    whole = ["failures.0.kind=structural", "failures.0.at_s=3", "failures.0.to=1", "failures.0.force_to=1"]
    assert load_scenario("nominal", whole).failures[0].to == 1.0


def test_all_problems_are_reported_at_once(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text('schema = 1\nname = "x"\n[condition]\nmach = "fast"\naltitud_ft = 3\n[[failures]]\nto = 2\n')
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    assert sorted(caught.value.problems) == [
        f"{path}: condition.mach: must be a number (got 'fast')",
        f"{path}: duration_s: is missing",
        f"{path}: failures.0.at_s: is missing",
        f"{path}: failures.0.to: must be between 0 and 1 (got 2)",
        f"{path}: unknown key condition.altitud_ft; did you mean altitude_ft?",
    ]


def test_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="unknown scenario 'elevator-los' .*did you mean elevator-loss"):
        load_scenario("elevator-los")
    broken = tmp_path / "broken.toml"
    broken.write_text("name = \n")
    with pytest.raises(ScenarioError, match=r"broken\.toml: not TOML: Invalid value \(at line 1"):
        load_scenario(broken)
    broken.write_bytes(b"\xff\xfe")
    with pytest.raises(ScenarioError, match=r"broken\.toml: cannot be read"):
        load_scenario(broken)


def test_the_description_lists_the_overrides() -> None:
    scenario = load_scenario("elevator-loss", ["failures.0.to=0.35", "seed=2"])
    assert scenario.description.endswith("(changed: failures.0.to=0.35, seed=2)")
    assert load_scenario("elevator-loss", ["description=mine"]).description == "mine"
    broken = {"schema": 1, "name": "x", "duration_s": 1.0, "description": 3}
    with pytest.raises(ScenarioError, match="description: must be a string"):
        load_scenario(broken, ["seed=1"])


def test_errors_name_the_kind_of_an_unreadable_path(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a folder; name the TOML file in it"):
        load_scenario(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        load_scenario("~nosuchuser")
    with pytest.raises(InputError, match="cannot be read: File name too long"):
        load_scenario("x" * 300)
    with pytest.raises(InputError, match="there is no such file"):
        load_scenario("nope.toml")
    with pytest.raises(TypeError, match="not one string"):
        load_scenario("nominal", "seed=7")
    assert load_scenario("nominal", ["adaptation.enabled=False"]).adaptation.enabled is False


def test_a_scenario_cannot_be_changed() -> None:
    scenario = load_scenario("nominal")
    with pytest.raises(Exception, match="frozen"):
        scenario.seed = 3  # type: ignore[misc]
