"""Files in the wheel of the source tree. tests/long/test_installed.py installs it and flies."""

from __future__ import annotations

import zipfile
from pathlib import Path

from flightbed.core.sources import digest, is_source, source_sha256
from tests.wheels import ROOT, build_wheel


def test_the_wheel_holds_the_package_and_its_data_and_nothing_else(tmp_path: Path) -> None:
    with zipfile.ZipFile(build_wheel(tmp_path)) as wheel:
        files = [name.removeprefix("flightbed/") for name in wheel.namelist() if name.startswith("flightbed/")]
        installed = {name: wheel.read(f"flightbed/{name}") for name in files if is_source(name)}
        assert (
            digest(installed) == source_sha256()
        )  # the identity of a flight is the same from the tree and from the wheel
        names = {name for name in wheel.namelist() if not name.partition("/")[0].endswith(".dist-info")}
    expected = set()
    for folder, place in (("flightbed", "flightbed"), ("aircraft", "flightbed/aircraft_data"), ("scenarios", "flightbed/scenario_data")):  # fmt: skip
        files = [
            path
            for path in (ROOT / folder).rglob("*")
            if path.is_file() and path.suffix not in (".pyc", ".nbi", ".nbc")
        ]
        expected |= {f"{place}/{path.relative_to(ROOT / folder).as_posix()}" for path in files}
    expected.add("flightbed/scenarios/schema/aircraft.json")  # the path in aircraft.toml, from an aircraft's folder
    assert names == expected
    assert {
        "flightbed/py.typed",
        "flightbed/aircraft_data/f16/aircraft.toml",
        "flightbed/scenario_data/elevator-loss.toml",
        "flightbed/scenario_data/campaigns/effectiveness-grid.toml",
    } <= names
    assert not any(name.endswith("f16.xml") for name in names)  # the stock model is GPL and stays out
