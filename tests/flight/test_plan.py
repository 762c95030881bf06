"""Plans of the linear aircraft: models, and settings that it does not support."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from flightbed.aircraft.overlay import Aircraft
from flightbed.config import families
from flightbed.control.base import Law
from flightbed.core import data
from flightbed.core.atmosphere import standard_air
from flightbed.core.errors import AircraftError, DesignError, ScenarioError
from flightbed.core.signals import Measurement
from flightbed.core.units import DEG, FT
from flightbed.flight.plan import bind, plan
from flightbed.models.linear_aircraft import LinearAircraft
from flightbed.models.trim import TrimPoint
from flightbed.plant.base import Controls, Motion
from flightbed.scenario.reading import load_scenario
from tests.command_line import call

# override -> error message; estimators on the schedule use the absolute input
BEYOND = {
    "failures.1={kind='cg-shift', at_s=5, shift_cbar=0.03}": "failures.1.kind: 'cg-shift' moves the c.g., which the linear aircraft sillence does not model; choose another kind",
    "condition.mach=0.8": "condition.mach: must be 0.9 with the linear aircraft sillence (got 0.8)",
    "condition.altitude_ft=10000": "condition.altitude_ft: must be 20000.0 with the linear aircraft sillence (got 10000.0)",
    "condition.gamma_deg=5": "condition.gamma_deg: must be 0.0 with the linear aircraft sillence (got 5.0)",
    "aircraft.cg_shift_cbar=0.01": "aircraft.cg_shift_cbar: must be 0.0 with the linear aircraft sillence (got 0.01)",
    "atmosphere.turbulence=light": "atmosphere.turbulence: must be 'none' with the linear aircraft sillence (got 'light')",
    "model_error.cg_shift_cbar=0.02": "model_error.cg_shift_cbar: must be 0.0 with the linear aircraft sillence (got 0.02)",
    "model_error.fuel_lbs=-300": "model_error.fuel_lbs: must be 0.0 with the linear aircraft sillence (got -300.0)",
    "estimators.1={name='expanding', memory='expanding'}": "estimators.1.model: must be 'short-period' with the linear aircraft sillence (got 'scheduled')",
}  # fmt: skip


@pytest.mark.parametrize("override", list(BEYOND))
def test_each_unsupported_setting_of_a_linear_aircraft_is_an_error(override: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        plan(load_scenario("thesis-loss", [override]))
    assert caught.value.problems == (BEYOND[override],)


def test_all_unsupported_settings_are_reported_at_once(tmp_path: Path) -> None:
    sets = [text for override in BEYOND for text in ("--set", override)]
    done = call("run", "thesis-loss", *sets, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.splitlines() == [f"flightbed: {line}" for line in BEYOND.values()]
    assert list(tmp_path.iterdir()) == []


def test_the_plan_of_the_shipped_scenario() -> None:
    scenario = load_scenario("thesis-loss")
    found = plan(scenario)
    assert isinstance(found.aircraft, LinearAircraft)
    assert found.design is found.aircraft.design
    assert found.schedule is None
    assert found.scenario.aircraft.model == "sillence"
    assert found.scenario.aircraft.sha256 == found.aircraft.sha256
    level = Motion(found.aircraft.airspeed_m_s, 0.0, 0.0, 0.0, 20000 * FT)
    assert found.trim == TrimPoint(level, Controls(0.0, 0.0), residual=0.0)
    assert plan(found.scenario).design.A.tolist() == found.design.A.tolist()  # the bound path loads the same aircraft


def test_an_aircraft_with_another_fingerprint_is_an_error() -> None:
    with pytest.raises(AircraftError, match=r"sillence is not the aircraft of this scenario"):
        plan(load_scenario("thesis-loss", ["aircraft.sha256=ab12"]))


def test_a_scenario_of_an_equal_overlay_is_accepted_with_a_note(f16: Aircraft) -> None:
    """An overlay lists earlier ones that fly the same traces; the plan names the one that flies."""
    earlier = f16.equal_to[0]
    found = plan(load_scenario("nominal", [f"aircraft.sha256={earlier}"]))
    assert found.scenario.aircraft.sha256 == f16.sha256
    assert found.notes == (
        f"aircraft.sha256: the scenario names {earlier[:12]}..., an earlier version of f16; "
        f"its equal_to lists that version as flying the same traces, so {f16.sha256[:12]}... flies",
    )
    assert plan(found.scenario).notes == ()
    assert plan(load_scenario("nominal")).notes == ()


def test_only_another_fingerprint_of_the_list_gives_a_note(tmp_path: Path, f16: Aircraft) -> None:
    own = tmp_path / "own"
    shutil.copytree(data.find("aircraft", "f16"), own)
    text = (own / "aircraft.toml").read_text()
    (own / "aircraft.toml").write_text(text.replace("equal_to = [", f'equal_to = ["{f16.sha256}", "{"0" * 64}", '))
    for named, notes in ((f16.sha256, 0), ("", 0), ("0" * 64, 1), (f16.equal_to[0], 1)):
        scenario = load_scenario("nominal", [f"aircraft.model={own}"]).with_aircraft(str(own), named)
        bound, aircraft, found = bind(scenario)
        assert (bound.aircraft.sha256, aircraft, len(found)) == (f16.sha256, f16, notes)


@pytest.mark.parametrize("other", ["0" * 64, "184b8ab0"])
def test_a_scenario_of_any_other_overlay_is_refused(other: str) -> None:
    with pytest.raises(AircraftError, match=r"f16 is not the aircraft of this scenario \(aircraft\.sha256 differs\)"):
        plan(load_scenario("nominal", [f"aircraft.sha256='{other}'"]))


@pytest.mark.parametrize("key", ["alpha_std_deg_s", "q_std_deg_s2"])
def test_process_noise_of_a_nonlinear_aircraft_is_an_error(key: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        plan(load_scenario("nominal", [f"process_noise.{key}=0.1"]))
    assert caught.value.problems == (
        "process_noise: only linear aircraft have process noise; set atmosphere.turbulence instead",
    )
    assert caught.value.exit_code == 2


def test_the_trim_point_matches_the_condition() -> None:
    """In a climb gamma = theta - alpha; values in the units of the scenario. The solver's residual is about 1e-9 deg."""
    point = plan(
        load_scenario("nominal", ["condition.gamma_deg=3", "condition.altitude_ft=12000", "condition.mach=0.7"])
    ).trim
    assert (point.theta_rad - point.alpha_rad) / DEG == pytest.approx(3.0, abs=1e-6)
    assert point.gamma_rad / DEG == pytest.approx(3.0, abs=1e-6)
    assert point.altitude_m == pytest.approx(12000 * FT, rel=1e-12)
    # JSBSim's atmosphere; its speed of sound is the standard's within 1 in 1000.
    assert point.airspeed_m_s == pytest.approx(0.7 * standard_air(12000 * FT).sound_m_s, rel=1e-3)


class _Silent:
    """A law without the attribute gains."""

    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:
        return 0.0


def silent(_settings: object, _design: object, _control_hz: int) -> Law:
    """Test law."""
    return _Silent()


def test_limit_command_needs_a_law_with_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(families._BUILT_IN["laws"], "silent", "tests.flight.test_plan:silent")
    assert plan(load_scenario("thesis-loss", ["control.law=silent"])).gains is None
    with pytest.raises(DesignError, match=r"adaptation\.limit_command: needs a law with gains \(got 'silent'\)"):
        plan(load_scenario("thesis-loss", ["control.law=silent", "adaptation.limit_command=true"]))
    assert plan(load_scenario("thesis-loss", ["adaptation.limit_command=true"])).gains is not None


def test_the_schedule_is_loaded_only_for_a_scheduled_estimator() -> None:
    short = ["adaptation.enabled=false", "estimators=[{name='x', model='short-period'}]"]
    assert plan(load_scenario("nominal", short)).schedule is None
    more = "estimators.1={name='y', model='scheduled'}"
    assert plan(load_scenario("nominal", [*short, more])).schedule is not None
