"""Modes, flying qualities, kinks, files and commands of the linear models."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

from flightbed.aircraft.overlay import Aircraft
from flightbed.core.errors import InputError, NoTrimError
from flightbed.core.units import DEG, FT
from flightbed.fdm.tables import breakpoints
from flightbed.models.linearize import LOADS, LONGITUDINAL, STATES, LinearModel
from flightbed.models.modes import flying_qualities, longitudinal_modes, modes
from flightbed.models.survey.condition import Query, axis, linearize_at, trim_at
from flightbed.models.survey.formats import binary
from flightbed.models.survey.rows import document
from flightbed.models.trim import TrimPoint
from flightbed.models.validate import validate
from flightbed.plant.base import Controls, Motion
from tests.command_line import assert_one_clear_line, call


def _names(model: LinearModel) -> list[str]:
    return sorted(mode.name for mode in longitudinal_modes(model.subset("longitudinal")))


def test_modes_of_the_f16_have_their_names(f16: Aircraft) -> None:
    oscillating = linearize_at(f16, Query(altitude_ft=20500, mach=0.5)).model
    assert _names(oscillating) == ["altitude", "phugoid", "short period"]
    split = linearize_at(f16, Query(altitude_ft=20000, mach=0.8)).model
    assert _names(split) == ["altitude", "phugoid", "short period, real root", "short period, real root"]
    tucked = linearize_at(f16, Query(altitude_ft=20500, mach=0.85)).model
    assert _names(tucked).count("phugoid, real root") == 2  # speed-unstable: Mach tuck
    mixed = linearize_at(f16, Query(altitude_ft=20500, mach=0.72)).model
    assert "third oscillation" in _names(mixed)  # a root of the short period forms a pair with one of the phugoid


def test_modes_against_python_control(f16: Aircraft) -> None:
    model = linearize_at(f16, Query(altitude_ft=20500, mach=0.5)).model
    omega, zeta, poles = __import__("control").damp(model.to_control(), doprint=False)
    theirs = sorted({(round(float(w), 6), round(float(z), 6)) for w, z, p in zip(omega, zeta, poles, strict=True)})
    ours = sorted({(round(m.omega_n_rad_s, 6), round(m.zeta, 6)) for m in modes(model)})
    np.testing.assert_allclose(ours, theirs, rtol=1e-4)


def test_phugoid_is_near_lanchesters(f16: Aircraft) -> None:
    """omega = sqrt(2) g / V for constant-energy exchange: within 15 % at moderate speed and thrust fixed."""
    point = linearize_at(f16, Query(altitude_ft=20500, mach=0.5))
    (phugoid,) = [m for m in modes(point.model) if m.name == "phugoid"]
    assert phugoid.omega_n_rad_s == pytest.approx(np.sqrt(2) * 9.80665 / point.trim.airspeed_m_s, rel=0.15)


def _model(A: list[list[float]]) -> LinearModel:
    trim = TrimPoint(Motion(200.0, 0.0, 0.0, 0.0, 6000.0), Controls(0.0, 0.5), 0.0)
    inputs, outputs = (("elevator", "rad"),), (*LONGITUDINAL, *LOADS)
    return LinearModel(
        LONGITUDINAL, inputs, outputs, np.array(A), np.zeros((5, 1)), np.zeros((9, 5)), np.zeros((9, 1)), trim
    )


def _with_short_period(omega: float, zeta: float, n_alpha: float) -> LinearModel:
    """A model with given short period and n/alpha; speed and attitude are decoupled and slow."""
    z = -n_alpha * 9.80665 / 200.0
    m_q = -2 * zeta * omega - z
    m_alpha = z * m_q - omega**2
    return _model(
        [[-0.01, 0, -9.8, 0, 0], [0, z, 0, 1, 0], [0, 0, 0, 1, 0], [0, m_alpha, 0, m_q, 0], [0, 0, 0, 0, -1e-3]]
    )


@pytest.mark.parametrize(
    ("omega", "zeta", "n_alpha", "level"),
    [
        (3.0, 0.7, 20.0, 1),  # CAP 0.45
        (2.0, 0.7, 20.0, 2),  # CAP 0.20: below 0.28
        (3.0, 0.3, 20.0, 2),  # damping below 0.35
        (3.0, 0.2, 20.0, 3),  # damping below 0.25
        (9.0, 0.7, 10.0, 2),  # CAP 8.1: above 3.6
        (0.9, 0.7, 2.0, 2),  # CAP 0.41, but omega_n below 1
        (1.0, 0.7, 20.0, None),  # CAP 0.05
        (3.0, 0.1, 20.0, None),  # damping below all
    ],
)
def test_flying_qualities_by_the_limits_of_the_specification(
    omega: float, zeta: float, n_alpha: float, level: int | None
) -> None:
    q = flying_qualities(_with_short_period(omega, zeta, n_alpha))
    assert q.omega_n_rad_s == pytest.approx(omega)
    assert q.zeta == pytest.approx(zeta)
    assert q.cap == pytest.approx(omega**2 / n_alpha)
    assert q.level == level


def test_two_real_roots_have_no_cap(f16: Aircraft) -> None:
    q = linearize_at(f16, Query(altitude_ft=20000, mach=0.8)).qualities
    assert (q.cap, q.level, q.zeta) == (None, None, None)


@pytest.mark.parametrize(
    ("mach", "altitude_ft", "row", "column", "where"),
    [
        (0.8, 20500, "q'", "airspeed", "Mach 0.8"),
        (0.6, 20500, "q'", "airspeed", "Mach 0.6"),
        (0.9, 20500, "airspeed'", "airspeed", "Mach 0.9"),
    ],
)
def test_kinks_are_found_and_named(
    f16: Aircraft, mach: float, altitude_ft: float, row: str, column: str, where: str
) -> None:
    model = linearize_at(f16, Query(altitude_ft=altitude_ft, mach=mach)).model
    (kink,) = [k for k in model.kinks if (k.row, k.column) == (row, column)]
    assert kink.where == where
    average = model.A[[n for n, _ in STATES].index(row.strip("'")), [n for n, _ in STATES].index(column)]
    assert average == pytest.approx((kink.below + kink.above) / 2, rel=0.01)
    assert str(kink).endswith(f"at {where}")


def test_a_flap_switch_under_the_point_is_found(f16: Aircraft) -> None:
    """Trimmed at the alpha of the leading-edge flap's switch, 5.00 deg: the slopes differ by the step of the switch."""
    target = 0.0873 + 8e-6  # just above the switch, where the forces are discontinuous and no trim exists
    low, high = 0.45, 0.52
    while high - low > 1e-9:
        middle = (low + high) / 2
        try:
            _, point = trim_at(f16, Query(altitude_ft=20500, mach=middle))
        except NoTrimError:
            high = middle
        else:
            low, high = (middle, high) if point.alpha_rad > target else (low, middle)
    point_there = linearize_at(f16, Query(altitude_ft=20500, mach=low))
    kinks, here, airframe = point_there.model.kinks, point_there.trim, point_there.airframe
    at = [
        airframe.respond(here.motion._replace(alpha_rad=a, theta_rad=a), here.controls)
        for a in (0.0873 - 1e-7, 0.0873 + 1e-7)
    ]
    found = [k for k in kinks if k.column == "alpha" and k.row == "airspeed'"]
    assert len(found) == 1
    # Forces directly above and below the switch.
    assert found[0].jump == pytest.approx(at[1].rates.airspeed - at[0].rates.airspeed, rel=0.02)
    assert "alpha 5 deg" in found[0].where


def test_away_from_kinks_none_is_reported(f16: Aircraft) -> None:
    assert linearize_at(f16, Query(altitude_ft=20500, mach=0.72)).model.kinks == ()


def test_breakpoints_are_read_from_tables_and_switches() -> None:
    model = b"""<fdm_config><aerodynamics>
      <table><independentVar lookup="row">a/x</independentVar><independentVar lookup="column">b/y</independentVar>
        <tableData> 1.0 2.0
          -0.5 3 4
           0.5 5 6 </tableData></table>
      <table><independentVar>b/y</independentVar><tableData> 7 0
          8 1 </tableData></table></aerodynamics>
      <flight_control><switch><test value="1"> a/x gt 0.25 </test><test value="2"> b/yy lt 9 </test></switch></flight_control>
      </fdm_config>"""
    assert breakpoints(model, "a/x") == (-0.5, 0.25, 0.5)
    assert breakpoints(model, "b/y") == (1.0, 2.0, 7.0, 8.0)


def test_the_three_speeds_agree(f16: Aircraft) -> None:
    by_mach = linearize_at(f16, Query(altitude_ft=15000, mach=0.55))
    tas_fps = by_mach.trim.airspeed_m_s / FT
    assert linearize_at(f16, Query(altitude_ft=15000, tas_fps=tas_fps)).trim.alpha_rad == pytest.approx(
        by_mach.trim.alpha_rad
    )
    # Calibrated airspeed by its definition: the impact pressure at sea level.
    delta = (1 - 6.8755856e-6 * 15000) ** 5.2558797
    impact = delta * ((1 + 0.2 * 0.55**2) ** 3.5 - 1)
    cas_kt = 661.4786 * np.sqrt(5 * ((impact + 1) ** (2 / 7) - 1))
    assert linearize_at(f16, Query(altitude_ft=15000, cas_kt=cas_kt)).airframe.mach == pytest.approx(0.55, abs=2e-4)


def test_lost_effectiveness_needs_more_elevator_and_leaves_less(f16: Aircraft) -> None:
    full, half = (linearize_at(f16, Query(altitude_ft=20500, mach=0.72, effectiveness=k)) for k in (1.0, 0.5))
    assert half.trim.elevator_rad == pytest.approx(2 * full.trim.elevator_rad, rel=1e-6)
    assert half.design.b == pytest.approx(0.5 * full.design.b, rel=1e-6)
    assert half.trim.alpha_rad == pytest.approx(full.trim.alpha_rad, rel=1e-6)


SCHEMA: dict[str, Any] = {
    "aircraft": str, "condition": dict, "trim": dict, "states": list, "inputs": list, "A": list, "B": list, "C": list, "D": list,
    "modes": list, "short_period": dict, "discrete": dict, "sources": dict,
}  # fmt: skip


def test_json_has_the_keys_of_the_contract(tmp_path: Path) -> None:
    done = call("linearize", "f16", "--mach", "0.7", "--altitude-ft", "20500", "--format", "json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    d = json.loads(done.stdout)
    for key, kind in SCHEMA.items():
        assert isinstance(d[key], kind), key
    assert set(d["trim"]) >= {"alpha_deg", "elevator_deg", "throttle_norm", "theta_deg", "residual"}
    assert set(d["states"][0]) == {"name", "unit"}
    assert set(d["modes"][0]) == {"name", "eigenvalue", "omega_n_rad_s", "zeta", "time_constant_s"}
    assert {"A", "B", "states", "inputs", "eigenvalues"} <= set(d["short_period"])
    assert set(d["discrete"]) == {"control_hz", "A", "B"}
    n, m, p = len(d["states"]), len(d["inputs"]), len(d["outputs"])
    assert (np.shape(d["A"]), np.shape(d["B"]), np.shape(d["C"]), np.shape(d["D"])) == ((n, n), (n, m), (p, n), (p, m))
    eigenvalues = np.sort_complex(np.linalg.eigvals(np.array(d["discrete"]["A"])))
    assert eigenvalues == pytest.approx(np.sort_complex(np.exp(np.linalg.eigvals(np.array(d["A"])) * 0.01)))


def test_npz_and_mat_hold_named_arrays(f16: Aircraft, tmp_path: Path) -> None:
    model = linearize_at(f16, Query(altitude_ft=20000, mach=0.7)).model
    for kind in ("npz", "mat"):
        done = call("linearize", "f16", "--mach", "0.7", "--format", kind, "-o", f"m.{kind}", cwd=tmp_path)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    loaded = np.load(tmp_path / "m.npz")
    mat = loadmat(tmp_path / "m.mat")
    for name in "ABCD":
        np.testing.assert_array_equal(loaded[name], getattr(model, name))
        np.testing.assert_array_equal(mat[name], getattr(model, name))
    assert list(loaded["states"]) == [n for n, _ in STATES]
    assert [str(cell[0]) for cell in mat["states"].ravel()] == [n for n, _ in STATES]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["m.mat", "m.npz"]
    assert binary({"x": np.eye(2)}, "npz") == binary({"x": np.eye(2)}, "npz")


def test_a_sweep_marks_conditions_without_a_trim(tmp_path: Path) -> None:
    arguments = ["linearize", "f16", "--mach", "0.3:0.7:0.2", "--altitude-ft", "10500,40000"]
    done = call(*arguments, "--format", "csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    assert [(float(r["mach"]), float(r["altitude_ft"])) for r in rows] == [
        (pytest.approx(m), h) for h in (10500, 40000) for m in (0.3, 0.5, 0.7)
    ]
    assert [bool(r["no_trim"]) for r in rows] == [False, False, False, True, False, False]
    assert "residual" in rows[3]["no_trim"]
    documents = json.loads(call(*arguments, "--format", "json", cwd=tmp_path).stdout)
    assert [("A" in d) for d in documents] == [True, True, True, False, True, True]
    table = call(*arguments, cwd=tmp_path).stdout
    assert "no trim at Mach 0.30, 40000 ft" in table
    assert max(map(len, table.splitlines())) <= 80


def test_the_table_fits_80_columns_and_warns_of_kinks(tmp_path: Path) -> None:
    text = call("linearize", "f16", "--mach", "0.8", cwd=tmp_path).stdout
    assert max(map(len, text.splitlines())) <= 80
    assert "short period, real root" in text
    assert "warning: kink, mean slope" in text
    assert "level" not in text
    rated = call("linearize", "f16", "--mach", "0.85", cwd=tmp_path).stdout
    assert "CAP" in rated
    assert "level" in rated
    assert "K 0.5" in call("trim", "f16", "--mach", "0.7", "--effectiveness", "0.5", cwd=tmp_path).stdout


def test_trim_command_climbs_and_prints_json(f16: Aircraft, tmp_path: Path) -> None:
    done = call("trim", "f16", "--mach", "0.6", "--gamma-deg", "5", "--format", "json", cwd=tmp_path)
    printed = json.loads(done.stdout)
    assert printed["trim"]["theta_deg"] - printed["trim"]["alpha_deg"] == pytest.approx(5.0)
    _, point = trim_at(f16, Query(altitude_ft=20000, mach=0.6, gamma_deg=5.0))
    assert printed["trim"]["alpha_deg"] == pytest.approx(point.alpha_rad / DEG)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["trim", "f16"], 2, "give exactly one of --mach, --tas-fps and --cas-kt"),
        (["trim", "f16", "--mach", "0.5", "--cas-kt", "300"], 2, "give exactly one of"),
        (["linearize", "f61", "--mach", "0.5"], 2, "unknown aircraft 'f61'"),
        (["linearize", "f16", "--mach", "fast"], 2, "--mach: must be a number, a list like 0.6,0.8 or a range like 0.6:0.9:0.1 (got 'fast')"),
        (["linearize", "f16", "--mach", "0.9:0.6:0.1"], 2, "--mach: must be a number"),
        (["linearize", "f16", "--mach", "-1"], 2, "--mach: must be above 0 (got -1)"),
        (["linearize", "f16", "--mach", "0.5", "--altitude-ft", "-9"], 2, "--altitude-ft: must be between 0 and 100000 (got -9)"),
        (["linearize", "f16", "--mach", "0.5", "--effectiveness", "0"], 2, "--effectiveness: must be above 0 and at most 1 (got 0)"),
        (["linearize", "f16", "--mach", "0.5", "--format", "mat"], 2, "--format mat: is a binary format; name a file with -o"),
        (["linearize", "f16", "--mach", "0.5,0.6", "--format", "npz", "-o", "x"], 2, "must have a single condition (got 2)"),
        (["linearize", "f16", "--mach", "0.5", "--validate", "--format", "csv"], 2, "--validate: needs --format json"),
        (["linearize", "f16", "--mach", "0.5,0.6", "--validate"], 2, "--validate: needs --format json"),
        (["linearize", "f16", "--mach", "0.5", "--control-hz", "50"], 2, "--control-hz: --format table has no discrete model"),
        (["linearize", "f16", "--mach", "0.5", "--control-hz", "0", "--format", "json"], 2, "--control-hz: must be above 0 (got 0)"),
        (["linearize", "f16", "--mach", "0.1:1:0.001", "--altitude-ft", "0:40000:10"], 2, "sweep: must have at most 100000 conditions"),
        (["linearize", "f16", "--mach", "0.5", "-o", "no/such/file"], 2, "-o no/such/file: cannot be written"),
        (["linearize", "f16", "--mach", "0.3", "--altitude-ft", "45000"], 3, "no trim at Mach 0.30, 45000 ft"),
        (["trim", "f16", "--mach", "1.5", "--altitude-ft", "0"], 3, "at the limit of throttle max"),
    ],
)  # fmt: skip
def test_errors_are_one_clear_line(tmp_path: Path, arguments: list[str], code: int, message: str) -> None:
    assert_one_clear_line(arguments, code, message, cwd=tmp_path)


def test_axes_include_their_end() -> None:
    assert axis("0.6:0.9:0.1", "--mach") == (0.6, 0.7, 0.8, 0.9)
    assert axis("0.9:0.6:-0.1", "--mach") == (0.9, 0.8, 0.7, 0.6)
    assert axis("1,2.5", "--mach") == (1.0, 2.5)
    for bad in ("", "1:2", "1:2:0", "1:2:3:4", "nan", "1,x", "0:1e9:1"):
        with pytest.raises(InputError, match="must be a number"):
            axis(bad, "--mach")


def test_python_gives_what_the_command_prints(f16: Aircraft) -> None:
    point = linearize_at(f16, Query(altitude_ft=20500, mach=0.72))
    printed = document(point, control_hz=50.0)
    assert printed["discrete"]["control_hz"] == 50.0
    assert printed["A"] == point.model.A.tolist()


def test_the_aircraft_follows_the_linear_model_with_an_error_of_first_order_in_the_step(f16: Aircraft) -> None:
    """JSBSim's frame delay and Euler rates are first order: halving the step halves the error of every state."""
    for mach in (0.5, 0.78):
        point = linearize_at(f16, Query(altitude_ft=20500, mach=mach))
        coarse, fine = validate(point.airframe, point.model, amplitude=0.02 * DEG)
        assert (coarse.plant_hz, fine.plant_hz) == (200, 400)
        for state in ("alpha", "theta", "q", "beta", "phi", "p", "r", "psi"):
            assert coarse.errors[state] < 0.05
            assert coarse.errors[state] / fine.errors[state] == pytest.approx(2.0, abs=0.15)


def test_validate_is_printed(tmp_path: Path) -> None:
    arguments = ["linearize", "f16", "--mach", "0.72", "--altitude-ft", "20500", "--validate"]
    text = call(*arguments, cwd=tmp_path).stdout
    assert "error against the aircraft at 200 Hz: airspeed" in text
    assert max(map(len, text.splitlines())) <= 80
    printed = json.loads(call(*arguments, "--format", "json", cwd=tmp_path).stdout)
    assert [v["plant_hz"] for v in printed["validation"]] == [200, 400]


def test_authority_to_trim_is_where_the_trim_deflection_meets_the_stop(f16: Aircraft) -> None:
    point = linearize_at(f16, Query(altitude_ft=20500, mach=0.72))
    least = point.authority.trim
    _, barely = trim_at(f16, Query(altitude_ft=20500, mach=0.72, effectiveness=least * 1.001))
    assert barely.elevator_rad == pytest.approx(-25 * DEG, rel=2e-3)
    with pytest.raises(NoTrimError, match="at the limit of elevator min .* in pitch"):
        trim_at(f16, Query(altitude_ft=20500, mach=0.72, effectiveness=least * 0.98))
    weak = linearize_at(f16, Query(altitude_ft=20500, mach=0.72, effectiveness=0.5))
    assert weak.authority.trim == pytest.approx(least, rel=1e-6)  # the same aircraft, evaluated at another K


def test_authority_to_hold_is_where_full_elevator_just_brings_the_mode_back(f16: Aircraft) -> None:
    """Fly the short period from 1 deg off trim with the elevator at its stop: 2 % more K recovers, 2 % less departs."""
    point = linearize_at(f16, Query(altitude_ft=20500, mach=0.78))
    design, hold = point.design, point.authority.hold
    assert hold is not None
    values, right = np.linalg.eig(design.A)
    left = np.linalg.inv(right)[int(np.argmax(values.real))].real
    discrete = design.discrete(1000)

    def recovers(K: float, side: float) -> bool:
        x = np.array([side * 1 * DEG, 0.0])
        start = left @ x
        stop = -np.sign(start * (left @ design.b)) * 25 * DEG
        for _ in range(3000):
            x = discrete.A @ x + discrete.b * (K * stop - design.elevator_trim_rad)
        return bool((left @ x) * np.sign(start) < abs(start))

    assert [recovers(1.02 * hold, side) for side in (1.0, -1.0)] == [True, True]
    # The trim deflection is nose-up: recovery from below trim, also nose-up, is the critical side.
    assert [recovers(0.98 * hold, side) for side in (1.0, -1.0)] == [True, False]
