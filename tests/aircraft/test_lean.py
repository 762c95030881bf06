"""The lean overlay: without the elements that have no effect in flight the F-16 flies the same traces bit for bit."""

from __future__ import annotations

import re
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import jsbsim
import numpy as np
import pytest

from flightbed.aircraft.overlay import Aircraft, load_aircraft
from flightbed.analysis.result import Result
from flightbed.core import data
from flightbed.core.errors import AircraftError
from flightbed.core.units import DEG
from flightbed.fdm.jsbsim import Fdm
from flightbed.plant.properties import LATERAL, READ
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from tests.flights import ShippedFlight, representative

REMOVALS = 6  # the last edits of the overlay
# The removals of the version before, and what they had to declare.
EARLIER = """
[[edits]]
do = "declare"
property = "gear/unit[1]/WOW"
value = 0.0
[[edits]]
do = "declare"
property = "gear/unit[2]/WOW"
value = 0.0
[[edits]]
do = "remove"
elements = "ground_reactions/contact"
count = 10
[[edits]]
do = "remove"
elements = "flight_control/channel"
names = ["Hook", "Canopy"]
"""


def _overlay(folder: Path, removals: str) -> Path:
    """Write the overlay with other removals; return its folder."""
    shutil.copytree(data.find("aircraft", "f16"), folder)
    head, *edits = re.sub(r"equal_to = \[[^]]*\]\n", "", (folder / "aircraft.toml").read_text()).split("[[edits]]\n")
    assert all("remove" in edit or "gear-wow" in edit for edit in edits[-REMOVALS:])
    kept = "[[edits]]\n".join([head, *edits[:-REMOVALS]])
    (folder / "aircraft.toml").write_text(kept + removals)
    return folder


@pytest.fixture(scope="module")
def full_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The overlay without the removals, in a folder."""
    return _overlay(tmp_path_factory.mktemp("full") / "f16", "")


@pytest.fixture(scope="module")
def full(full_folder: Path) -> Aircraft:
    return load_aircraft(str(full_folder))


def test_the_overlay_lists_those_that_it_equals(f16: Aircraft, full: Aircraft, tmp_path: Path) -> None:
    """The flights below are compared with exactly the overlay that has the first fingerprint in equal_to."""
    earlier = load_aircraft(str(_overlay(tmp_path / "f16", EARLIER)))
    assert f16.equal_to == (full.sha256, earlier.sha256)
    assert f16.sha256 not in f16.equal_to
    assert len(f16.edits) == len(full.edits) + REMOVALS


def test_what_is_gone_and_that_nothing_else_is(f16: Aircraft, full: Aircraft) -> None:
    stock = Path(jsbsim.get_default_root_dir(), f16.stock_file).read_bytes()
    lean, whole = (ET.fromstring(aircraft.patch(stock)) for aircraft in (f16, full))
    assert [len(root.findall("ground_reactions/contact")) for root in (whole, lean)] == [10, 0]
    assert [len(root.findall("external_reactions/force")) for root in (whole, lean)] == [2, 0]
    channels = [[c.get("name") for c in root.findall("flight_control/channel")] for root in (whole, lean)]
    gone = {"Flaps", "Landing Gear", "Hook", "Canopy"}
    assert channels[1] == [name for name in channels[0] if name not in gone]
    assert len(channels[0]) == len(channels[1]) + len(gone)
    tables = [[f.get("name") for f in root.findall("aerodynamics/axis/function")] for root in (whole, lean)]
    assert set(tables[0]) - set(tables[1]) == {"aero/coefficient/CDgear"}


def test_every_channel_element_that_is_left_reaches_a_force_or_the_harness(f16: Aircraft) -> None:
    """An element acts if a table, the engine, the harness, or an element that acts reads its output; the speedbrake's tables read radians."""
    stock = Path(jsbsim.get_default_root_dir(), f16.stock_file).read_bytes()
    root = ET.fromstring(f16.patch(stock))
    elements = [e for channel in root.findall("flight_control/channel") for e in channel]

    def read_by(element: ET.Element) -> set[str]:
        words = " ".join(f"{e.text or ''} {' '.join(e.attrib.values())}" for e in element.iter() if e.tag != "output")
        return {word.lstrip("-") for word in words.split() if "/" in word}

    def outputs(element: ET.Element) -> set[str]:
        return {element.get("name", ""), *((e.text or "").strip() for e in element.iter("output"))}

    wanted = {*f16.properties.values(), "fcs/throttle-pos-norm", "fcs/speedbrake-pos-norm"}
    for section in root:
        if section.tag != "flight_control":
            wanted |= read_by(section)
    acting: set[str] = set()
    while new := [e for e in elements if e.get("name") not in acting and outputs(e) & wanted]:
        acting |= {e.get("name", "") for e in new}
        wanted = wanted.union(*(read_by(e) for e in new))
    assert [e.get("name") for e in elements if e.get("name") not in acting] == []


def test_every_frame_is_equal(f16: Aircraft, full: Aircraft) -> None:
    """Elevator pulses in turbulence, near the ground and at altitude: all properties that the plant reads are equal in every frame."""

    def frames(aircraft: Aircraft, altitude_m: float) -> np.ndarray:
        fdm = Fdm(aircraft, 0.005)
        fdm.configure(altitude_m=altitude_m, cg_shift_cbar=0.02)
        fdm.set("ic/mach", 0.5)
        fdm.set("ic/alpha-deg", 4.0)
        fdm.set("ic/phi-deg", 30.0)
        fdm.set("fcs/throttle-cmd-norm", 0.4)
        fdm.settle()
        fdm.set("simulation/randomseed", 3)
        fdm.set("atmosphere/turbulence/milspec/severity", 4)
        fdm.set("atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps", 50.0)
        fdm.set("atmosphere/turb-type", 4)
        getters = [fdm.getter(path) for path in (*READ, *LATERAL, "fcs/elevator-pos-rad")]
        rows = []
        for k in range(600):
            fdm.set("fcs/elevator-cmd-rad", (-6.0 if k % 200 < 100 else 2.0) * DEG)
            fdm.exec.run()
            rows.append([get() for get in getters])
        return np.array(rows)

    for altitude_m in (0.0, 6096.0):
        lean, whole = frames(f16, altitude_m), frames(full, altitude_m)
        assert np.ptp(lean[:, 0]) > 5 * DEG  # the motion is large, so the comparison is meaningful
        assert lean.tobytes() == whole.tobytes()


def _assert_equal(lean: Result, whole: Result) -> None:
    assert lean.summary.ended == whole.summary.ended
    assert list(lean.trace.columns) == list(whole.trace.columns)
    for name, values in lean.trace.columns.items():
        assert np.asarray(values).tobytes() == np.asarray(whole.trace[name]).tobytes(), name


_OF_F16 = [name for name in data.names("scenario") if load_scenario(name).aircraft.model == "f16"]


@pytest.mark.parametrize(
    "name", representative(_OF_F16, ("elevator-and-aileron", "elevator-hardover", "turbulent-loss"))
)
def test_shipped_flights_are_equal(shipped_flight: ShippedFlight, full_folder: Path, name: str) -> None:
    """All columns of all shipped flights, most of them in the long suite; the golden table holds the lean ones to stored hashes."""
    whole = run(load_scenario(name, [f"aircraft.model={full_folder}"]), rerun=False)
    assert whole.summary.aircraft_sha256 != shipped_flight(name).summary.aircraft_sha256
    _assert_equal(shipped_flight(name), whole)


def test_a_dive_from_sea_level_ends_where_it_did(full_folder: Path) -> None:
    """The loop ends it 300 m below sea level; the terrain, and the contacts that are gone, lie another 310 m lower."""
    dive = [
        "condition.altitude_ft=0", "condition.mach=0.6", "command.kind=constant", "command.amplitude_deg_s=-4",
        "duration_s=20",
    ]  # fmt: skip
    lean = run(load_scenario("nominal", dive))
    assert lean.summary.ended == "ground"
    assert lean.trace["altitude_ft"][-1] < -984.0 < lean.trace["altitude_ft"][-2]
    _assert_equal(lean, run(load_scenario("nominal", [*dive, f"aircraft.model={full_folder}"])))


def test_a_flight_in_which_the_speedbrake_opens_is_equal(full_folder: Path) -> None:
    """Trimmed above alpha = 28 deg a flight can exceed 53 deg, where the stock law opens the speedbrake, before it has departed."""
    slow = [
        "condition.mach=0.16", "condition.altitude_ft=5000", "aircraft.cg_shift_cbar=0.05", "command.kind=constant",
        "command.amplitude_deg_s=20", "duration_s=4", "adaptation.enabled=false",
        "estimators=[{name='x', model='short-period'}]",
    ]  # fmt: skip
    lean = run(load_scenario("nominal", slow))
    assert lean.trace["alpha_deg"].max() > 54.0
    _assert_equal(lean, run(load_scenario("nominal", [*slow, f"aircraft.model={full_folder}"])))


@pytest.mark.parametrize(
    ("old", "new", "property_"),
    [
        ('property = "fcs/gear-wow"', 'property = "fcs/another"', "fcs/gear-wow"),
        ('["Flaps", ', '["Wing leveller", "Flaps", ', "fcs/roll-command-norm"),
    ],
)
def test_a_removal_that_leaves_a_reader_is_an_error(tmp_path: Path, old: str, new: str, property_: str) -> None:
    """JSBSim would raise in its first frame, and end the process with it."""
    own = tmp_path / "own"
    shutil.copytree(data.find("aircraft", "f16"), own)
    text = (own / "aircraft.toml").read_text()
    assert text.count(old) == 1
    (own / "aircraft.toml").write_text(text.replace(old, new))
    with pytest.raises(AircraftError) as caught:
        Fdm(load_aircraft(str(own)), 0.005)
    assert str(caught.value) == (
        f"aircraft f16: the patched model reads {property_}, which does not exist; "
        "keep the element that gives it, or declare the property"
    )
