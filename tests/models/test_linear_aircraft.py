"""Linear aircraft: against the thesis's printed numbers, and every error of its file."""

from __future__ import annotations

import json
import tomllib
from math import inf
from pathlib import Path

import control
import numpy as np
import pytest

from flightbed.aircraft.overlay import Aircraft, load_aircraft
from flightbed.cli import main as cli
from flightbed.core import data
from flightbed.core.errors import AircraftError, UnknownNameError
from flightbed.models.linear_aircraft import LinearAircraft, load_flyable, load_linear_aircraft
from tests.command_line import call

TEXT = (data.shipped("aircraft") / "sillence" / "aircraft.toml").read_text(encoding="utf-8")
GOLDEN = tomllib.loads((Path(__file__).parents[1] / "golden" / "sillence.toml").read_text())


def _folder(tmp_path: Path, text: str) -> Path:
    (tmp_path / "aircraft.toml").write_text(text, encoding="utf-8")
    return tmp_path


def _changed(tmp_path: Path, old: str, new: str) -> LinearAircraft:
    assert TEXT.count(old) == 1, old
    return load_linear_aircraft(str(_folder(tmp_path, TEXT.replace(old, new))))


def test_its_poles_are_the_ones_the_thesis_prints() -> None:
    """To the four printed decimals, the accuracy of coefficients rounded to four decimals."""
    design = load_linear_aircraft("sillence").design
    A, b = design.with_actuator()
    assert sorted(np.linalg.eigvals(A).real) == pytest.approx([-20.0, -3.0691, 0.6737], abs=0.5e-4)
    assert sorted(design.poles.real) == pytest.approx([-3.0691, 0.6737], abs=0.5e-4)
    assert np.linalg.matrix_rank(control.ctrb(A, b[:, None])) == 3


def test_its_numbers_are_the_printed_ones_each_in_its_place() -> None:
    aircraft, printed = load_linear_aircraft("sillence"), GOLDEN["plant"]
    A = [[printed["Z_alpha"], printed["Z_q"]], [printed["M_alpha"], printed["M_q"]]]
    assert aircraft.design.A.tolist() == A
    assert aircraft.design.b.tolist() == [printed["Z_delta"], printed["M_delta"]]
    assert aircraft.design.actuator_rad_s == printed["actuator_rad_s"]
    assert (aircraft.design.alpha_trim_rad, aircraft.design.elevator_trim_rad) == (0.0, 0.0)
    assert (aircraft.name, aircraft.mach, aircraft.altitude_ft) == ("sillence", 0.9, 20000.0)
    assert aircraft.description.startswith("Linear short period of an F-16 at Mach 0.9, 20,000 ft")


def test_its_actuator_has_no_limits_and_its_speed_is_that_of_the_standard_atmosphere() -> None:
    aircraft = load_linear_aircraft("sillence")
    actuator = aircraft.actuator
    assert (actuator.lag_rad_s, actuator.rate_limit_rad_s, actuator.min_rad, actuator.max_rad) == (20.0, inf, -inf, inf)
    # 20,000 ft in ISO 2533 is 6090.2 m of geopotential altitude: 248.56 K, a = sqrt(1.4 R T) = 316.05 m/s.
    assert aircraft.airspeed_m_s == pytest.approx(0.9 * 316.05, abs=0.01)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[elevator]\nlag_rad_s = 20.0\n", "", "elevator is missing"),
        ("[condition]", "[[condition]]", "[condition] is missing"),
        ("\n[short_period]", "\n[short_perod]", "unknown key short_perod; did you mean short_period?"),
        ("m_alpha_1_s2 = 3.5", "m_alpha_1_s = 3.5", "unknown key short_period.m_alpha_1_s; did you mean m_alpha_1_s2?"),
        ("z_q = 0.9946", "", "short_period.z_q is missing"),
        ("schema = 1", "", "schema is missing"),
        ("schema = 1", "schema = 2", "schema: must be 1 (got 2)"),
        ("schema = 1", "schema = true", "schema: must be 1 (got True)"),
        ('name = "sillence"', "name = 3", "name: must be one line of text (got 3)"),
        ('name = "sillence"', 'name = ""', "name: must be one line of text (got '')"),
        ('description = "', 'description = "Two\\nlines: ', "description: must be one line of text (got 'Two\\nlines: Linear short period of an F-16 at Mach 0.9, 20,000 ft, as in Sillence (1999); no limits, no trim')"),
        ("z_q = 0.9946", 'z_q = "fast"', "short_period.z_q: must be a number (got 'fast')"),
        ("z_q = 0.9946", "z_q = true", "short_period.z_q: must be a number (got True)"),
        ("z_q = 0.9946", "z_q = nan", "short_period.z_q: must be a number (got nan)"),
        ("z_q = 0.9946", "z_q = inf", "short_period.z_q: must be a number (got inf)"),
        ("lag_rad_s = 20.0", "lag_rad_s = 0", "elevator.lag_rad_s: must be above 0 (got 0)"),
        ("lag_rad_s = 20.0", "lag_rad_s = -20", "elevator.lag_rad_s: must be above 0 (got -20)"),
        ("mach = 0.9\n", "mach = 0\n", "condition.mach: must be above 0 (got 0)"),
        ("altitude_ft = 20000", "altitude_ft = [2]", "condition.altitude_ft: must be a number (got [2])"),
    ],
)  # fmt: skip
def test_each_error_is_one_clear_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(AircraftError) as caught:
        _changed(tmp_path, old, new)
    assert str(caught.value) == f"{tmp_path / 'aircraft.toml'}: {message}"
    assert caught.value.exit_code == 2


def test_a_file_that_is_not_utf_8(tmp_path: Path) -> None:
    (tmp_path / "aircraft.toml").write_bytes(TEXT.encode() + b"# \xff\n")
    for load in (load_linear_aircraft, load_flyable):
        with pytest.raises(AircraftError, match=r"aircraft\.toml: 'utf-8' codec can't decode") as caught:
            load(str(tmp_path))
        assert len(str(caught.value).splitlines()) == 1


def test_a_file_that_is_not_toml_or_is_missing(tmp_path: Path) -> None:
    folder = _folder(tmp_path, "schema = ")
    for load in (load_linear_aircraft, load_flyable):
        with pytest.raises(AircraftError, match=r"aircraft\.toml: Invalid value"):
            load(str(folder))
        with pytest.raises(UnknownNameError, match="unknown aircraft 'silence'.*did you mean sillence"):
            load("silence")


def test_the_fingerprint_is_of_the_numbers_and_of_nothing_else(tmp_path: Path) -> None:
    shipped = load_linear_aircraft("sillence").sha256
    assert _changed(tmp_path, "# what the model is of; speed is held", "# words").sha256 == shipped
    assert _changed(tmp_path, "altitude_ft = 20000", "altitude_ft = 20000.0").sha256 == shipped
    changes = [("m_q_1_s = -1.0521", "m_q_1_s = -1.0522"), ("lag_rad_s = 20.0", "lag_rad_s = 21.0"), ("mach = 0.9\n", "mach = 0.8\n")]  # fmt: skip
    assert len({shipped, *(_changed(tmp_path, *change).sha256 for change in changes)}) == 4


def test_load_flyable_picks_the_right_one(f16: Aircraft, tmp_path: Path) -> None:
    assert isinstance(load_flyable("sillence"), LinearAircraft)
    assert isinstance(load_flyable(str(_folder(tmp_path, TEXT))), LinearAircraft)
    assert load_flyable("f16") == f16
    with pytest.raises(AircraftError, match=r"kind: must be 'linear' \(got 'linera'\)"):
        load_flyable(str(_folder(tmp_path, TEXT.replace('kind = "linear"', 'kind = "linera"'))))


def test_load_linear_aircraft_refuses_another_kind(tmp_path: Path) -> None:
    with pytest.raises(AircraftError, match=r"aircraft\.toml: unknown key equal_to"):
        load_linear_aircraft("f16")
    with pytest.raises(AircraftError, match=r"aircraft\.toml: kind: must be 'linear' \(got 'f16'\)"):
        load_linear_aircraft(str(_folder(tmp_path, TEXT.replace('kind = "linear"', 'kind = "f16"'))))


def test_load_aircraft_refuses_a_linear_one() -> None:
    with pytest.raises(AircraftError) as caught:
        load_aircraft("sillence")
    assert str(caught.value).endswith(
        'sillence/aircraft.toml: kind: must be an overlay (got "linear"); fly a linear model with flightbed run, '
        "it cannot be trimmed or linearized"
    )


def test_it_is_listed(tmp_path: Path) -> None:
    listed = call("list", "aircraft", cwd=tmp_path).stdout.splitlines()
    assert [line.split()[0] for line in listed] == ["f16", "sillence"]
    assert listed[1].endswith(load_linear_aircraft("sillence").description)


@pytest.mark.parametrize(
    "arguments", [["trim"], ["linearize"], ["trim", "--mach", "0.9"], ["linearize", "--mach", "0.5:0.9:0.2"]]
)
def test_it_cannot_be_trimmed_or_linearized(
    tmp_path: Path, arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """This error comes first, whatever the other options."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    with pytest.raises(SystemExit) as ended:
        cli.main([arguments[0], "sillence", *arguments[1:]])
    printed = capsys.readouterr()
    assert (ended.value.code, printed.out, len(printed.err.splitlines())) == (2, "", 1)
    assert "sillence/aircraft.toml: kind: must be an overlay (got" in printed.err
    assert list(tmp_path.iterdir()) == []


def test_it_flies_from_a_folder_of_the_users_own(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    _folder(tmp_path / "mine", TEXT.replace("m_alpha_1_s2 = 3.5", "m_alpha_1_s2 = 3.0"))
    sets = ["--set", "aircraft.model=mine", "--set", "duration_s=5", "--rerun", "off", "--out", "x", "--json"]
    done = call("run", "thesis-loss", *sets, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["short_period"]["A"][1][0] == 3.0
    assert tomllib.loads((tmp_path / "x" / "scenario.toml").read_text())["aircraft"]["model"] == str(tmp_path / "mine")
