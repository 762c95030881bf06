"""Ten-state models: modes against free flight, turns, pull-ups, stock aircraft, parts, engines, sweeps."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pandas as pd
import pytest

from flightbed.aircraft.overlay import Aircraft
from flightbed.core.errors import InputError, NoTrimError, UnknownNameError
from flightbed.core.units import DEG, G0, KT
from flightbed.models.linearize import LATERAL, LONGITUDINAL, PARTS, LinearModel
from flightbed.models.modes import lateral_modes, modes
from flightbed.models.survey.condition import Query, find_aircraft, linearize_at, nearest_feasible, trim_at
from flightbed.models.survey.rows import document, row
from flightbed.models.survey.stability_map import draw
from flightbed.models.survey.sweep import trim_all
from flightbed.models.trim import TrimPoint, trim
from flightbed.plant.base import Controls, Motion
from tests.command_line import assert_one_clear_line, call

SCHEMA = json.loads((Path(__file__).parents[1] / "golden" / "linearize.schema.json").read_text())
LEVEL = Query(altitude_ft=20500, mach=0.72)
CESSNA = Query(altitude_ft=3000, cas_kt=100)


def _identified(signal: np.ndarray, every: int, hz: int) -> complex:
    """Eigenvalue of one oscillation: least squares on y[k+2] + a y[k+1] + b y[k] = 0 of the decimated record (Prony)."""
    y = signal[::every]
    a, b = np.linalg.lstsq(np.column_stack([y[1:-1], y[:-2]]), -y[2:], rcond=None)[0]
    return complex(np.log(np.roots([1.0, a, b])[0]) * hz / every)


@pytest.mark.parametrize(
    ("name", "query", "mode_name", "state"),
    [
        ("f16", Query(altitude_ft=20500, mach=0.62), "short period", "q"),
        ("f16", Query(altitude_ft=10500, mach=0.5), "short period", "q"),
        ("f16", LEVEL, "Dutch roll", "r"),
        ("f16", Query(altitude_ft=10500, mach=0.5), "Dutch roll", "r"),
        ("c172x", CESSNA, "short period", "q"),
        ("c172x", CESSNA, "Dutch roll", "r"),
    ],
)
def test_modes_against_the_aircrafts_free_response(name: str, query: Query, mode_name: str, state: str) -> None:
    """Released from the mode's shape, the nonlinear aircraft oscillates with the eigenvalue within 2 %."""
    point = linearize_at(find_aircraft(name), query)
    (mode,) = [m for m in modes(point.model) if m.name == mode_name]
    values, vectors = np.linalg.eig(point.model.A)
    shape = np.real(vectors[:, np.argmin(np.abs(values - mode.eigenvalue))])
    names = [name for name, _ in point.model.states]
    shape *= 0.05 * DEG / np.max(np.abs(shape[[names.index(n) for n in ("alpha", "beta")]]))
    hz, start = 1000, point.trim
    commands = [start.controls] * round(2.5 / mode.omega_n_rad_s * hz * 2)
    moved, still = (
        point.airframe.free_flight(Motion(*(np.array(start.motion) + offset)), start.controls, commands, hz=hz)
        for offset in (shape, 0.0 * shape)
    )
    found = _identified((moved - still)[:, names.index(state)], every=40, hz=hz)
    found = complex(found.real, abs(found.imag))
    assert abs(found - mode.eigenvalue) < 0.02 * abs(mode.eigenvalue)


def test_a_turn_is_steady_and_coordinated(f16: Aircraft) -> None:
    airframe, point = trim_at(f16, Query(altitude_ft=20500, mach=0.6, bank_deg=50.0))
    response = airframe.respond(point.motion, point.controls)
    turn = G0 * np.tan(50 * DEG) / point.airspeed_m_s
    assert response.rates.psi == pytest.approx(turn, rel=1e-9)
    assert np.max(np.abs(np.array(response.rates)[:9])) < 1e-7  # all other states are steady
    assert response.nz_g == pytest.approx(1 / np.cos(50 * DEG), rel=0.01)
    assert abs(response.ny_g) < 0.02  # coordinated turn
    flown = airframe.free_flight(point.motion, point.controls, [point.controls] * 800, hz=400)
    assert flown[-1, 9] == pytest.approx(2.0 * turn, rel=2e-3)
    assert flown[-1, 6] == pytest.approx(50 * DEG, abs=0.1 * DEG)


def test_a_climbing_turn_climbs_at_the_angle_asked_for(f16: Aircraft) -> None:
    _, point = trim_at(f16, Query(altitude_ft=10500, mach=0.6, bank_deg=30.0, gamma_deg=4.0))
    assert point.gamma_rad == pytest.approx(4 * DEG, abs=1e-12)
    assert point.motion.climb_m_s == pytest.approx(point.airspeed_m_s * np.sin(4 * DEG))


def test_a_pull_up_has_the_load_factor_asked_for(f16: Aircraft) -> None:
    airframe, point = trim_at(f16, Query(altitude_ft=20500, mach=0.7, load_factor=3.0))
    response = airframe.respond(point.motion, point.controls)
    assert point.motion.q_rad_s == pytest.approx(2.0 * G0 / point.airspeed_m_s)
    # Normal to the flight path: body-axis nz and nx turned by alpha (JSBSim's g is local, a little less than standard).
    assert response.nz_g * np.cos(point.alpha_rad) == pytest.approx(3.0, rel=0.04)
    assert max(abs(response.rates.airspeed), abs(response.rates.alpha), abs(response.rates.q)) < 1e-7
    assert point.alpha_rad > trim_at(f16, Query(altitude_ft=20500, mach=0.7))[1].alpha_rad


def test_load_factor_and_bank_exclude_each_other(f16: Aircraft) -> None:
    with pytest.raises(InputError, match="in a turn it follows from the bank"):
        trim_at(f16, Query(altitude_ft=20500, mach=0.7, load_factor=2.0, bank_deg=30.0))


def test_parts_are_the_blocks_of_the_full_model(f16: Aircraft) -> None:
    model = linearize_at(f16, LEVEL).model
    eigenvalues = np.sort_complex(model.eigenvalues())
    halves = [model.subset(name) for name in ("longitudinal", "lateral")]
    together = np.sort_complex(np.concatenate([half.eigenvalues() for half in halves]))
    np.testing.assert_allclose(together, eigenvalues, atol=2e-4)  # weak coupling by the earth's rotation
    for name, (states, inputs, loads) in PARTS.items():
        part = model.subset(name)
        assert [n for n, _ in part.states] == list(states)
        assert [n for n, _ in part.inputs] == list(inputs)
        assert [n for n, _ in part.outputs] == [*states, *loads]
        assert part.C.shape == (len(states) + len(loads), len(states))
        np.testing.assert_array_equal(part.C[: len(states)], np.eye(len(states)))


def test_the_actuator_is_a_state_when_asked_for(f16: Aircraft) -> None:
    import control

    model = linearize_at(f16, LEVEL).model
    with_lag = model.with_actuator("elevator", 20.2)
    assert with_lag.states[-1] == ("elevator_position", "rad")
    assert with_lag.inputs[0] == ("elevator_cmd", "rad")
    series = model.to_control()["q", "elevator"] * control.tf([20.2], [1, 20.2])
    omega = np.array([0.3, 3.0, 30.0])
    ours = with_lag.to_control()["q", "elevator_cmd"](1j * omega)
    np.testing.assert_allclose(ours, series(1j * omega), rtol=1e-9)
    nz = model.to_control()["nz", "elevator"](3j) * 20.2 / (3j + 20.2)
    assert with_lag.to_control()["nz", "elevator_cmd"](3j) == pytest.approx(nz)


def _lateral(A: list[list[float]]) -> LinearModel:
    point = TrimPoint(Motion(200.0, 0.0, 0.0, 0.0, 6000.0), Controls(0.0, 0.5), 0.0)
    return LinearModel(
        LATERAL, (("rudder", "rad"),), LATERAL, np.array(A), np.zeros((5, 1)), np.eye(5), np.zeros((5, 1)), point
    )


def test_lateral_modes_have_their_names() -> None:
    def names(n_beta: float, l_p: float, l_beta: float) -> list[str]:
        rows = [
            [-0.2, 0.05, 0, -1, 0],
            [0, 0, 1, 0, 0],
            [l_beta, 0, l_p, 0.5, 0],
            [n_beta, 0, 0, -0.4, 0],
            [0, 0, 0, 1, 0],
        ]
        return sorted(m.name for m in lateral_modes(_lateral([[float(v) for v in r] for r in rows])))

    assert names(7.0, -2.0, -10.0) == ["Dutch roll", "heading", "roll", "spiral"]
    assert names(-2.0, -2.0, -10.0).count("Dutch roll, real root") + names(-2.0, -2.0, -10.0).count("Dutch roll") >= 1
    assert "lateral phugoid" in names(7.0, -0.1, -40.0)


def test_stock_aircraft_report_their_control_system(tmp_path: Path) -> None:
    done = call("linearize", "c172x", "--cas-kt", "100", "--altitude-ft", "3000", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "the model includes the aircraft's own control system" in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert list(tmp_path.iterdir()) == []  # JSBSim writes no output files
    printed = json.loads(
        call(
            "linearize", "jsbsim:f16", "--mach", "0.62", "--altitude-ft", "20500", "--format", "json", cwd=tmp_path
        ).stdout
    )
    jsonschema.validate(printed, SCHEMA)
    assert [i["unit"] for i in printed["inputs"]] == ["1"] * 4
    assert printed["trim"]["elevator_deg"] == pytest.approx(
        -1.2, abs=0.3
    )  # position of the surface; the input is a command
    assert "own, included" in printed["sources"]["control_system"]


def test_steady_and_frozen_engines_differ_where_they_should() -> None:
    cessna = find_aircraft("c172x")
    steady, frozen = (
        linearize_at(cessna, Query(altitude_ft=3000, cas_kt=100, engine=e)).model for e in ("steady", "frozen")
    )
    # At constant propeller speed thrust decreases faster with airspeed than at a propeller speed that follows.
    assert frozen.A[0, 0] < 1.1 * steady.A[0, 0] < 0.0
    np.testing.assert_allclose(frozen.A[3, [1, 3]], steady.A[3, [1, 3]], rtol=1e-3)
    assert ("throttle", "1") in steady.inputs
    assert ("throttle", "1") not in frozen.inputs


def test_a_glider_glides_at_its_drag_over_lift() -> None:
    airframe, point = trim_at(find_aircraft("sgs126"), Query(altitude_ft=3000, cas_kt=50))
    fdm = airframe._fdm.exec
    airframe.respond(point.motion, point.controls)
    drag, lift = -fdm["forces/fwx-aero-lbs"], -fdm["forces/fwz-aero-lbs"]
    assert np.tan(point.gamma_rad) == pytest.approx(-abs(drag) / abs(lift), rel=1e-3)
    assert "throttle" not in dict(
        linearize_at(find_aircraft("sgs126"), Query(altitude_ft=3000, cas_kt=50)).model.inputs
    )
    with pytest.raises(InputError, match="which has no engine"):
        trim_at(find_aircraft("sgs126"), Query(altitude_ft=3000, cas_kt=50, gamma_deg=2.0))


def test_an_asymmetric_aircraft_is_trimmed_on_all_six_equations() -> None:
    """Propeller torque needs aileron; JSBSim's own full trim agrees."""
    airframe, point = trim_at(find_aircraft("c172x"), CESSNA)
    assert point.residual < 1e-8
    assert point.airspeed_m_s == pytest.approx(airframe.airspeed_m_s)
    assert abs(point.controls.aileron) > 0.01
    response = airframe.respond(point.motion, point.controls)
    assert np.max(np.abs(np.array(response.rates)[:9])) < 1e-6
    assert 100 * KT < point.airspeed_m_s < 1.1 * 100 * KT  # calibrated, at 3000 ft


def test_the_nearest_feasible_condition_is_one(f16: Aircraft, tmp_path: Path) -> None:
    query = Query(altitude_ft=40000, mach=0.30)
    near = nearest_feasible(f16, query)
    assert set(near) == {"mach_above", "altitude_ft"}
    trim_at(f16, Query(altitude_ft=40000, mach=near["mach_above"]))
    with pytest.raises(NoTrimError):
        trim_at(f16, Query(altitude_ft=40000, mach=near["mach_above"] - 0.002))
    trim_at(f16, Query(altitude_ft=near["altitude_ft"], mach=0.30))
    with pytest.raises(NoTrimError):
        trim_at(f16, Query(altitude_ft=near["altitude_ft"] + 40, mach=0.30))
    with pytest.raises(NoTrimError, match="nearest conditions with a trim: Mach ") as caught:
        trim_all(f16, [query], "table", None)
    assert caught.value.feasible == near
    done = call("trim", "f16", "--mach", "0.6", "--load-factor", "9", cwd=tmp_path)
    assert done.returncode == 3
    assert " g" in done.stderr.partition("nearest conditions with a trim")[2]


def test_every_kind_of_model_validates_against_the_schema(f16: Aircraft) -> None:
    point = linearize_at(f16, LEVEL)
    for part in ("full", "longitudinal", "lateral", "short-period"):
        model = document(point, part=part, actuator=part != "lateral")
        jsonschema.validate(json.loads(json.dumps(model)), SCHEMA)
    turning = linearize_at(f16, Query(altitude_ft=20500, mach=0.6, bank_deg=45.0))
    jsonschema.validate(json.loads(json.dumps(document(turning))), SCHEMA)
    broken = document(point)
    broken["states"][0]["unit"] = "furlong"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(broken, SCHEMA)


def test_a_sweep_to_parquet_with_its_picture(tmp_path: Path) -> None:
    arguments = ["linearize", "f16", "--mach", "0.3:0.9:0.2", "--altitude-ft", "10500,40500", "--format", "parquet"]
    done = call(*arguments, "-o", "sweep.parquet", "--picture", "map.png", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    table = pd.read_parquet(tmp_path / "sweep.parquet")
    assert len(table) == 8
    assert {
        "mach",
        "altitude_ft",
        "alpha_deg",
        "elevator_deg",
        "fastest_unstable_rad_s",
        "effectiveness_min_hold",
    } <= set(table)
    assert (table["no_trim"] != "").sum() == table["alpha_deg"].isna().sum() == 1
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["map.png", "sweep.parquet"]


def test_the_picture_marks_conditions_without_a_trim(f16: Aircraft) -> None:
    queries = [Query(altitude_ft=h, mach=m) for h in (20000, 30000) for m in (0.5, 0.6)]
    rows = [row(linearize_at(f16, q)) for q in queries]
    whole = draw("f16", queries, rows, ".svg")
    rows[0] = {"mach": 0.5, "altitude_ft": 20000, "no_trim": "no"}
    assert draw("f16", queries, rows, ".svg") != whole
    line = draw("f16", queries[:2], rows[:2], ".svg")
    assert line.startswith(b"<?xml")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["linearize", "c172x", "--cas-kt", "100", "--effectiveness", "0.5"], "effectiveness: c172x is a stock aircraft"),
        (["linearize", "c172x", "--cas-kt", "100", "--altitude-ft", "3000", "--actuator"], "--actuator: stock aircraft c172x has no actuator data"),
        (["linearize", "f16", "--mach", "0.7", "--actuator", "--part", "lateral"], "--actuator: adds the actuator of the elevator"),
        (["linearize", "f16", "--mach", "0.6,0.7", "--part", "lateral"], "--part, --actuator: the table of a sweep has no matrices"),
        (["linearize", "f16", "--mach", "0.7", "--picture", "a.png"], "--picture: needs a sweep with at least two speeds"),
        (["linearize", "f16", "--mach", "0.6,0.7", "--picture", "a.bmp"], "--picture a.bmp: must end in .png, .svg, .pdf"),
        (["trim", "f16", "--mach", "0.7", "--bank-deg", "90"], "--bank-deg: must be between -85 and 85 (got 90)"),
        (["trim", "f16", "--mach", "0.7", "--load-factor", "50"], "--load-factor: must be between -10 and 20 (got 50)"),
        (["trim", "f16", "--mach", "0.7", "--format", "parquet"], "--format parquet: is a binary format; name a file with -o"),
        (["trim", "blank", "--mach", "0.7"], "aircraft blank: has no wing area or no aerodynamics"),
        (["trim", "jsbsim:f61", "--mach", "0.7"], "unknown JSBSim aircraft 'f61'; did you mean f16?"),
    ],
)  # fmt: skip
def test_invalid_options_are_rejected(tmp_path: Path, arguments: list[str], message: str) -> None:
    assert_one_clear_line(arguments, 2, message, cwd=tmp_path)


def test_names_of_aircraft_lead_to_overlays_first(f16: Aircraft) -> None:
    assert find_aircraft("f16") == f16
    assert find_aircraft("jsbsim:f16").name == "f16"
    assert not isinstance(find_aircraft("jsbsim:f16"), Aircraft)
    with pytest.raises(UnknownNameError, match="c172"):
        find_aircraft("c172")


def test_trim_in_python_needs_no_command_line(f16: Aircraft) -> None:
    from flightbed import JsbsimAirframe

    airframe = JsbsimAirframe(f16, mach=0.6, altitude_m=6096.0)
    assert trim(airframe, bank_rad=0.5).motion.phi_rad == 0.5
    assert [n for n, _ in LONGITUDINAL] == ["airspeed", "alpha", "theta", "q", "altitude"]
