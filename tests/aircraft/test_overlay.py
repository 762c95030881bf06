"""The overlay: K = 1 equals the stock aircraft, pitch has no feedback, and every edit is verified."""

from __future__ import annotations

import dataclasses
import re
import shutil
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

import jsbsim
import numpy as np
import pytest

from flightbed.aircraft.overlay import Aircraft, load_aircraft
from flightbed.core import data
from flightbed.core.errors import AircraftError, InputError, UnknownNameError
from flightbed.core.units import DEG
from flightbed.fdm.jsbsim import Fdm

LOADS = [f"forces/fb{axis}-{kind}-lbs" for axis in "xyz" for kind in ("aero", "total")] + [
    f"moments/{axis}-{kind}-lbsft" for axis in "lmn" for kind in ("aero", "total")
]
# Mach, altitude ft, alpha deg, beta deg, p, q, r in rad/s, elevator deg, throttle
POINTS = [
    (0.8, 20000, 0.85, 0.0, 0.0, 0.0, 0.0, -0.97, 0.34),
    (0.6, 20000, 2.75, 0.0, 0.0, 0.1, 0.0, -6.0, 0.3),
    (0.4, 5000, 8.0, 2.0, 0.1, -0.1, 0.05, 4.0, 0.5),
    (0.3, 10000, 14.0, -3.0, 0.0, 0.2, -0.1, -20.0, 0.6),
    (0.95, 30000, -2.0, 1.0, -0.3, -0.2, 0.0, 8.0, 0.9),
    (1.2, 35000, 4.0, 0.0, 0.0, 0.0, 0.0, 10.0, 1.0),
]


def _stock() -> jsbsim.FGFDMExec:
    fdm = jsbsim.FGFDMExec(jsbsim.get_default_root_dir())
    fdm.set_debug_level(0)
    fdm.set_dt(0.005)
    assert fdm.load_model("f16")
    fdm["fcs/fbw-override"] = 1  # direct elevator and aileron in the stock control system
    return fdm


def _settle(fdm: jsbsim.FGFDMExec, point: tuple[float, ...]) -> None:
    mach, altitude, alpha, beta, p, q, r, _, throttle = point
    fdm["ic/terrain-elevation-ft"] = -2000
    fdm["gear/gear-cmd-norm"] = 0
    fdm["gear/gear-pos-norm"] = 0
    fdm["ic/h-sl-ft"] = altitude
    fdm["ic/mach"] = mach
    fdm["ic/alpha-deg"] = alpha
    fdm["ic/beta-deg"] = beta
    fdm["ic/p-rad_sec"], fdm["ic/q-rad_sec"], fdm["ic/r-rad_sec"] = p, q, r
    fdm["fcs/throttle-cmd-norm"] = throttle
    fdm["propulsion/set-running"] = -1
    fdm.set_trim_status(True)
    fdm.run_ic()
    fdm.set_trim_status(False)


@pytest.mark.parametrize("point", POINTS)
def test_full_effectiveness_equals_the_stock_aircraft(f16: Aircraft, point: tuple[float, ...]) -> None:
    """Equal deflections give equal forces and moments, in symmetric and asymmetric flight."""
    stock, ours = _stock(), Fdm(f16, 0.005).exec
    ours["fcs/fbw-override"] = 1
    stock["fcs/elevator-cmd-norm"] = point[7] / 25.0
    _settle(stock, point)
    ours["fcs/elevator-cmd-rad"] = stock["fcs/elevator-pos-rad"]
    _settle(ours, point)
    assert stock["fcs/elevator-pos-rad"] == pytest.approx(point[7] * DEG, abs=0.01)
    assert ours["fcs/elevator-pos-rad"] == pytest.approx(stock["fcs/elevator-pos-rad"], abs=1e-15)
    # Yaw damper and ailerons of the stock model stay in both; only the flaperon's lift and drag is taken out, and
    # with no roll command it is nil in the stock model too.
    for name in LOADS:
        assert ours[name] == pytest.approx(stock[name], rel=1e-12, abs=1e-6), name


def _tables(aircraft: Aircraft, elevator_deg: float, *, moment: float, force: float) -> dict[str, float]:
    """Return drag, lift and pitching moment of the tail's tables, and all loads, for the two shares."""
    fdm = Fdm(aircraft, 0.005).exec
    fdm[aircraft.properties["effectiveness"]], fdm[aircraft.properties["elevator_force"]] = moment, force
    fdm["fcs/elevator-cmd-rad"] = elevator_deg * DEG
    _settle(fdm, POINTS[1])
    assert fdm["fcs/elevator-pos-rad"] == pytest.approx(elevator_deg * DEG)
    return {name: fdm[name] for name in (*_FUNCTION.values(), *LOADS)}


_FUNCTION = {name: f"aero/coefficient/{name}" for name in ("CDDh", "CLDh", "CmDh")}


def test_the_shares_scale_the_deflection_each_in_its_tables(f16: Aircraft) -> None:
    """A share of 0.4 at 10 deg equals a share of 1 at 4 deg: in the moment's table, in those of drag and lift, and in all loads."""
    ten, four = (_tables(f16, deg, moment=1.0, force=1.0) for deg in (10.0, 4.0))
    assert all(abs(ten[path] / four[path] - 1.0) > 0.01 for path in _FUNCTION.values())
    moment, force = _tables(f16, 10.0, moment=0.4, force=1.0), _tables(f16, 10.0, moment=1.0, force=0.4)
    for name, path in _FUNCTION.items():
        assert moment[path] == pytest.approx((four if name == "CmDh" else ten)[path], rel=1e-12), name
        assert force[path] == pytest.approx((ten if name == "CmDh" else four)[path], rel=1e-12), name
    both = _tables(f16, 10.0, moment=0.4, force=0.4)
    for name in LOADS:
        assert both[name] == pytest.approx(four[name], rel=1e-12, abs=1e-9), name


def test_trim_and_linearization_scale_moment_and_force_alike(f16: Aircraft) -> None:
    """K = 0.5 at twice the deflection has all derivatives of the healthy aircraft, and half of b."""
    from flightbed.models.linearize import linearize
    from flightbed.models.trim import trim
    from flightbed.plant.airframe import JsbsimAirframe

    full, half = (JsbsimAirframe(f16, mach=0.6, altitude_m=6096.0, effectiveness=K) for K in (1.0, 0.5))
    points = trim(full), trim(half)
    assert points[1].alpha_rad == pytest.approx(points[0].alpha_rad, abs=1e-10)
    assert points[1].elevator_rad == pytest.approx(2.0 * points[0].elevator_rad, rel=1e-8)
    (_, b), (_, weak) = (
        linearize(a, p).part(("airspeed", "alpha", "q"), ("elevator",))
        for a, p in zip((full, half), points, strict=True)
    )
    assert weak == pytest.approx(0.5 * b, rel=1e-4)


def test_the_aircraft_has_no_pitch_feedback_of_its_own(f16: Aircraft) -> None:
    """d(elevator)/d(alpha) = d(elevator)/d(q) = 0, settled and in flight."""
    fdm = Fdm(f16, 0.005).exec
    fdm["fcs/elevator-cmd-rad"] = -0.03
    positions = set()
    for alpha in (-5.0, 0.0, 2.0, 12.0, 25.0):
        for q in (-0.5, 0.0, 0.5):
            _settle(fdm, (0.6, 20000, alpha, 0.0, 0.0, q, 0.0, 0.0, 0.3))
            positions.add(fdm["fcs/elevator-pos-rad"])
    assert positions == {-0.03}
    for _ in range(200):
        fdm.run()
    assert abs(fdm["velocities/q-rad_sec"] - 0.5) > 0.05  # the aircraft has moved
    assert fdm["fcs/elevator-pos-rad"] == -0.03


def test_ailerons_no_longer_push_or_lift(f16: Aircraft) -> None:
    """In the stock model full aileron changes drag and lift by sign; in the overlay it does not at all."""

    def change(fdm: jsbsim.FGFDMExec) -> list[float]:
        fdm["fcs/fbw-override"] = 1
        loads = []
        for aileron in (-0.5, 0.5):
            fdm["fcs/aileron-cmd-norm"] = aileron
            _settle(fdm, POINTS[1])
            loads.append([fdm["forces/fbx-aero-lbs"], fdm["forces/fbz-aero-lbs"]])
        return list(np.abs(np.subtract(*loads)))

    assert min(change(_stock())) > 500.0
    assert max(change(Fdm(f16, 0.005).exec)) < 1e-6


def test_cg_shift_makes_it_less_stable(f16: Aircraft) -> None:
    from flightbed.models.linearize import linearize
    from flightbed.models.trim import trim
    from flightbed.plant.airframe import JsbsimAirframe

    def m_alpha(shift: float) -> float:
        airframe = JsbsimAirframe(f16, mach=0.6, altitude_m=6096.0, cg_shift_cbar=shift)
        return float(linearize(airframe, trim(airframe)).A[3, 1])

    # Regression values from a manual move of the reference point: -0.465, +2.16, +4.60.
    assert [m_alpha(s) for s in (0.0, 0.05, 0.10)] == pytest.approx([-0.465, 2.16, 4.60], abs=0.01)


def test_a_stock_model_with_another_hash_is_refused(f16: Aircraft) -> None:
    other = dataclasses.replace(f16, stock_sha256="0" * 64)
    stock = Path(jsbsim.get_default_root_dir(), f16.stock_file).read_bytes()
    with pytest.raises(AircraftError, match="must have sha256 000000000000.*got 78edd9053433"):
        other.patch(stock)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ({"do": "replace-channel", "channel": "Pich", "with": "pitch.xml"}, "expected one channel Pich, found 0"),
        ({"do": "rewire", "from": "fcs/elevator-pos-rad", "to": {"x": ["aero/coefficient/CmDh"]}}, "found it in"),
        (
            {"do": "rewire", "from": "fcs/elevator-pos-rad", "to": "x"},
            "to: must list the functions of each new property",
        ),
        ({"do": "remove-functions", "functions": ["aero/nope"]}, "no function aero/nope"),
        ({"do": "remove-systems", "systems": ["nope"]}, "no system nope"),
        (
            {"do": "remove", "elements": "ground_reactions/contact", "count": 9},
            r"edits\.0 \(remove\): expected 9 times ground_reactions/contact, found 10; correct elements or count$",
        ),
        (
            {"do": "remove", "elements": "ground_reaction/contact", "count": 10},
            "expected 10 times ground_reaction/contact, found 0; correct elements or count$",
        ),
        (
            {"do": "remove", "elements": "flight_control/channel", "names": ["Hook", "Canopi"]},
            r"expected one flight_control/channel named Canopi, found 0; did you mean Canopy\?$",
        ),
        (
            {"do": "remove", "elements": "flight_control/channel", "names": ["zzz"]},
            "expected one flight_control/channel named zzz, found 0; correct elements or names$",
        ),
        (
            {"do": "remove", "elements": "external_reactions/force/location", "names": [""]},
            r"expected one external_reactions/force/location named , found \d; correct elements or names$",
        ),
        ({"do": "remove", "elements": "flight_control/channel"}, r"needs either names or count \(got neither\)$"),
        ({"do": "remove", "elements": "system", "names": ["x"], "count": 1}, r"either names or count \(got both\)$"),
        ({"do": "remove", "elements": "system", "count": 0}, r"count: must be a whole number of at least 1 \(got 0\)$"),
        ({"do": "remove", "elements": "system", "count": True}, r"at least 1 \(got True\)$"),
        ({"do": "remove", "elements": "system", "count": "2"}, r"at least 1 \(got '2'\)$"),
        ({"do": "remove", "elements": "flight_control/channel", "names": "Hook"}, r"list of texts \(got 'Hook'\)$"),
        ({"do": "remove", "elements": "flight_control/channel", "names": [1]}, r"list of texts \(got \[1\]\)$"),
        ({"do": "remove", "elements": "flight_control/channel[1]", "count": 1}, "elements: must be tags from the root"),
        ({"do": "remove", "elements": 3, "count": 1}, r"elements: must be tags from the root.*\(got 3\)$"),
        ({"do": "remove", "count": 3}, "needs 'elements'"),
        ({"do": "frobnicate"}, "frobnicate"),
        ({"do": "declare", "value": 1.0}, "needs 'property'"),
    ],
)
def test_an_edit_that_does_not_fit_names_itself(f16: Aircraft, edit: dict[str, object], message: str) -> None:
    broken = dataclasses.replace(f16, edits=(edit,))
    stock = Path(jsbsim.get_default_root_dir(), f16.stock_file).read_bytes()
    with pytest.raises(AircraftError, match=message) as caught:
        broken.patch(stock)
    assert "\n" not in str(caught.value)


def test_remove_takes_the_named_elements_or_all_and_nothing_else(f16: Aircraft) -> None:
    stock = Path(jsbsim.get_default_root_dir(), f16.stock_file).read_bytes()

    def tags(*edits: dict[str, object]) -> Counter[str]:
        return Counter(e.tag for e in ET.fromstring(dataclasses.replace(f16, edits=edits).patch(stock)).iter())

    whole = tags()
    by_count = {"do": "remove", "elements": "system", "count": 2}
    assert whole - tags(by_count) == Counter(system=2, property=3)  # with what they hold
    named = {"do": "remove", "elements": "aerodynamics/axis/function", "names": ["aero/coefficient/CDgear"]}
    missing = whole - tags(named)
    assert missing["function"] == 1
    assert missing["table"] == 0
    assert whole - tags(by_count, named) == missing + Counter(system=2, property=3)


def test_a_folder_of_the_users_own_works(tmp_path: Path) -> None:
    """A copied folder with a slower actuator: the model has the changed numbers."""
    own = tmp_path / "slow"
    own.mkdir()
    for file in data.find("aircraft", "f16").iterdir():
        (own / file.name).write_bytes(file.read_bytes())
    text = (own / "aircraft.toml").read_text().replace("lag_rad_s = 20.2", "lag_rad_s = 5.5")
    (own / "aircraft.toml").write_text(text)
    slow = load_aircraft(str(own))
    assert slow.actuator.lag_rad_s == 5.5
    assert Fdm(slow, 0.005).getter("fcs/elevator-lag-rad_s")() == 5.5
    assert slow.sha256 != load_aircraft("f16").sha256


def test_the_list_of_equal_overlays_is_not_part_of_the_fingerprint(tmp_path: Path, f16: Aircraft) -> None:
    own = tmp_path / "own"
    shutil.copytree(data.find("aircraft", "f16"), own)
    text = (own / "aircraft.toml").read_text()
    for entries in ([], ["0" * 64, "ab" * 32]):
        (own / "aircraft.toml").write_text(re.sub(r"equal_to = .*", f"equal_to = {entries}", text))
        found = load_aircraft(str(own))
        assert found.equal_to == tuple(entries)
        assert found.sha256 == f16.sha256


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("aircraft.toml", "lag_rad_s = 20.2", "lag_rad_s = 0", r"aircraft\.toml: elevator\.lag_rad_s: must be above 0 \(got 0\)"),
        ("aircraft.toml", "max_deg = 25.0", "max_deg = -30", r"elevator\.min_deg, max_deg: must be in ascending order \(got -25\.0, -30\)"),
        ("aircraft.toml", "lag_rad_s = 20.2", "lag_rads = 20.2", r"unknown key elevator\.lag_rads; did you mean lag_rad_s\?"),
        ("aircraft.toml", "rate_limit_deg_s = 60.0", "", r"elevator\.rate_limit_deg_s is missing"),
        ("aircraft.toml", '"pitch.xml"', '"pich.xml"', r"refers to the file pich\.xml; put it into the same folder"),
        ("aircraft.toml", "name =", "name", r"aircraft\.toml: "),
        ("aircraft.toml", 'equal_to = ["1', 'equal_to = ["G', r"aircraft\.toml: equal_to\.0: must be a fingerprint, 64 digits of 0-9 and a-f \(got 'G"),
        ("aircraft.toml", 'equal_to = ["1', 'equal_to = ["11', r"equal_to\.0: must be a fingerprint"),
        ("aircraft.toml", 'equal_to = ["', 'equal_to = [7, "', r"equal_to\.0: must be a fingerprint.*\(got 7\); copy aircraft\.sha256"),
        ("aircraft.toml", 'equal_to = [', 'equal_to = "x" # [', r"aircraft\.toml: equal_to: must be a list of fingerprints \(got 'x'\)"),
        ("aircraft.toml", 'equal_to = [', 'equals_to = [', r"unknown key equals_to"),
        ("pitch.xml", "fcs/elevator-effectiveness", "fcs/elevator-effectivenes", r"pitch\.xml: JSBSim has no property fcs/elevator-effectivenes"),
        ("pitch.xml", "</channel>", "", r"edits\.\d+ \(replace-channel\): no element found|aircraft own: "),
    ],
)  # fmt: skip
def test_mistakes_in_a_copied_folder_are_one_line(tmp_path: Path, file: str, old: str, new: str, message: str) -> None:
    own = tmp_path / "own"
    shutil.copytree(data.find("aircraft", "f16"), own)
    text = (own / file).read_text()
    assert old in text
    (own / file).write_text(text.replace(old, new))
    with pytest.raises(AircraftError, match=message) as caught:
        Fdm(load_aircraft(str(own)), 0.005)
    assert "\n" not in str(caught.value)


def test_invalid_folders_are_reported(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown aircraft 'f61'.*did you mean f16"):
        load_aircraft("f61")
    with pytest.raises(InputError, match=r"has no aircraft\.toml"):
        load_aircraft(str(tmp_path))
    with pytest.raises(InputError, match="there is no such folder"):
        load_aircraft(str(tmp_path / "nope"))
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file; name the folder"):
        load_aircraft(str(tmp_path / "file"))


def test_wings_are_levelled_and_nothing_else(f16: Aircraft) -> None:
    """From a bank of 5 deg the wings level within seconds; at zero bank the aileron does not move at all."""
    level = (0.6, 20000, 2.754, 0.0, 0.0, 0.0, 0.0, 0.0, 0.273)  # trimmed, and stable in pitch
    fdm = Fdm(f16, 0.005).exec
    fdm["fcs/elevator-cmd-rad"] = -1.241 * DEG
    _settle(fdm, level)
    assert fdm["fcs/roll-command-norm"] == 0.0
    fdm["ic/phi-deg"] = 5.0
    _settle(fdm, level)
    for _ in range(1200):
        fdm.run()
    assert abs(fdm["attitude/phi-deg"]) < 0.5


def test_nothing_of_the_stock_file_is_shipped() -> None:
    """The overlay folder contains no table of the GPL model."""
    for file in data.find("aircraft", "f16").iterdir():
        assert "tableData" not in file.read_text()
