"""JSBSim's FDM executive: load a model, read and write its properties. The only module that imports jsbsim.

This module handles undocumented properties of JSBSim: the step must be set before the model is loaded (components copy it);
hidden states (actuator, kinematics) settle only while the trim flag is set; engines must run before the last run_ic;
sea level is ground contact unless the terrain is lowered; JSBSim creates a mistyped property silently and ignores writes to a
read-only one; a reused FDM is not bit-identical to a fresh one; one FDM loads one model.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Protocol

os.environ.setdefault("JSBSIM_DEBUG", "0")  # before the import: the banner is printed by the constructor

import jsbsim

from flightbed.core.errors import AircraftError, UnknownNameError
from flightbed.core.units import FT, INCH, LB
from flightbed.fdm.stock import StockAircraft, compact, engine_names, read_stock, references, without_io
from flightbed.fdm.tables import breakpoints

_TERRAIN_FT = -2000.0  # below sea level: no ground contact, no ground effect at h = 0
_REFERENCE = "metrics/aero-rp-x-in"  # reference point of the aerodynamic moments


class _Silent(jsbsim.DefaultLogger):
    """Discards JSBSim's messages; errors reach the caller as exceptions or return values."""

    def file_location(self, filename: str, line: int) -> None:
        """Discard the location."""

    def message(self, message: str) -> None:
        """Discard the message."""


# JSBSim keeps one logger per thread; a logger set in a worker thread crashes the process when that thread ends.
if threading.current_thread() is threading.main_thread():
    jsbsim.set_logger(_Silent())

_STEP = r"[A-Za-z_][A-Za-z0-9_.-]*(\[[0-9]{1,6}\])?"
_PATH = re.compile(rf"/?{_STEP}(/{_STEP})*")  # of a property, as SimGear's property tree reads it

Getter = Callable[[], float]
Setter = Callable[[float], object]


class Overlay(Protocol):
    """An aircraft that is a patched stock model; hashable by its content."""

    @property
    def name(self) -> str:
        """Name of the patched model."""

    @property
    def stock_file(self) -> str:
        """Path of the stock model inside the jsbsim package."""

    def patch(self, stock: bytes) -> bytes:
        """Return the stock model with all edits applied."""

    def references(self) -> list[tuple[str, str]]:
        """Return (file, property) for every property that the edits refer to."""

    def __hash__(self) -> int:
        """Return the hash of the content."""


def version() -> str:
    """Return the version of the installed jsbsim."""
    return str(jsbsim.__version__)


def stock_names() -> tuple[str, ...]:
    """Return the names of the aircraft that ship with JSBSim."""
    folder = Path(jsbsim.get_default_root_dir()) / "aircraft"
    return tuple(sorted(p.name for p in folder.iterdir() if (p / f"{p.name}.xml").is_file()))


def stock_aircraft(name: str) -> StockAircraft:
    """Read an aircraft that ships with JSBSim. Raises UnknownNameError, AircraftError."""
    if name not in stock_names():
        raise UnknownNameError("JSBSim aircraft", name, stock_names())
    root = Path(jsbsim.get_default_root_dir())

    def engine(file: str) -> bytes:
        places = (root / "aircraft" / name, root / "aircraft" / name / "Engines", root / "engine")
        return next(((p / f"{file}.xml").read_bytes() for p in places if (p / f"{file}.xml").is_file()), b"")

    return read_stock(name, (root / "aircraft" / name / f"{name}.xml").read_bytes(), engine)


_CHECKED: set[Overlay] = set()  # overlays whose references all exist


class Fdm:
    """One FGFDMExec with one model loaded; gives access to its properties by name."""

    def __init__(self, aircraft: Overlay | StockAircraft, dt_s: float) -> None:
        root = Path(jsbsim.get_default_root_dir())
        self.exec = jsbsim.FGFDMExec(str(root))
        self.exec.set_debug_level(0)
        self.exec.set_dt(dt_s)  # before the load
        try:
            loaded = self.exec.load_model_with_paths(
                aircraft.name, str(_model_folder(aircraft)), str(root / "engine"), str(root / "systems")
            )
        except jsbsim.BaseError as error:
            reason = " ".join(str(error).split())
            raise AircraftError(f"aircraft {aircraft.name}: JSBSim cannot load it: {reason}") from None
        if not loaded:
            kind = "stock" if isinstance(aircraft, StockAircraft) else "patched"
            raise AircraftError(f"aircraft {aircraft.name}: JSBSim cannot load the {kind} model")
        self._manager = self.exec.get_property_manager()
        # A missing property would abort the process at run time, so all references are checked here. A stock aircraft may refer
        # to properties of an enclosing simulator: they are created with the value 0.
        self.absent: tuple[str, ...] = ()
        if isinstance(aircraft, StockAircraft):
            files = [file.read_bytes() for file in sorted((_model_folder(aircraft) / aircraft.name).rglob("*.xml"))]
            self.absent = tuple(p for p in sorted(references(files)) if self._manager.get_node(p) is None)
            for path in self.absent:
                self._manager.get_node(path, True)
        elif aircraft not in _CHECKED:
            for file, path in aircraft.references():
                if self._find(path) is None:
                    raise AircraftError(f"aircraft {aircraft.name}: {file}: JSBSim has no property {path}")
            for path in _model_references(aircraft):
                if self._find(path) is None:
                    raise AircraftError(
                        f"aircraft {aircraft.name}: the patched model reads {path}, which does not exist; "
                        "keep the element that gives it, or declare the property"
                    )
            _CHECKED.add(aircraft)

    def _find(self, path: str) -> jsbsim.FGPropertyNode | None:
        """Return a property's node, None if there is none; a path with other characters would abort the process."""
        return self._manager.get_node(path) if _PATH.fullmatch(path) else None

    def has(self, path: str) -> bool:
        """Return whether the property exists."""
        return self._find(path) is not None

    def node(self, path: str) -> jsbsim.FGPropertyNode:
        """Return a property's node. Raises AircraftError if the property does not exist."""
        node = self._find(path)
        if node is None:
            raise AircraftError(f"JSBSim has no property {path}")
        return node

    def getter(self, path: str) -> Getter:
        """Return a function that reads a property. Raises AircraftError if the property does not exist."""
        return self.node(path).get_double_value

    def setter(self, path: str) -> Setter:
        """Return a function that writes a property. Raises AircraftError for a read-only or missing property."""
        node = self.node(path)
        if not node.get_attribute(jsbsim.Attribute.WRITE):
            raise AircraftError(f"JSBSim's property {path} is read-only")
        return node.set_double_value

    def set(self, path: str, value: float) -> None:
        """Write a property."""
        self.setter(path)(value)

    def configure(self, *, altitude_m: float, cg_shift_cbar: float, gear_up: bool = True) -> None:
        """Set a clean configuration out of ground effect, engines running; shift the c.g. aft by ``cg_shift_cbar`` mean chords."""
        self.set("ic/terrain-elevation-ft", _TERRAIN_FT)
        if gear_up:
            self.set("gear/gear-cmd-norm", 0.0)
            self.set("gear/gear-pos-norm", 0.0)
        self.set("ic/h-sl-ft", altitude_m / FT)
        self.cg_shifter()(cg_shift_cbar)
        if self.has("propulsion/set-running"):  # not in a glider
            self.set("propulsion/set-running", -1)

    def cg_shifter(self) -> Setter:
        """Return a setter of the c.g. shift, in mean chords aft of the current position; usable before and during flight.

        Moving the aerodynamic reference point forward represents an aft c.g. shift: same moments, same weight.
        """
        put, here, chord_ft = self.setter(_REFERENCE), self.getter(_REFERENCE)(), self.getter("metrics/cbarw-ft")()
        return lambda shift_cbar: put(here - shift_cbar * chord_ft * FT / INCH)

    def add_fuel(self, fuel_kg: float) -> None:
        """Add fuel to the tanks, or remove it (negative), in proportion to their contents. Raises AircraftError below empty tanks."""
        if not fuel_kg:
            return
        paths = [f"propulsion/tank[{i}]/contents-lbs" if i else "propulsion/tank/contents-lbs" for i in range(99)]
        held = {path: self.getter(path)() for path in paths if self.has(path)}
        total = sum(held.values())
        if total <= 0.0 or total + fuel_kg / LB < 0.0:
            raise AircraftError(
                f"model_error.fuel_lbs: the tanks hold only {total:.0f} lb (got {fuel_kg / LB:.0f}); remove less fuel"
            )
        for path, pounds in held.items():
            self.set(path, pounds * (1.0 + fuel_kg / LB / total))

    def settle_engines(self) -> None:
        """Run engines and propellers to their steady state, the motion of the aircraft held."""
        self.exec.get_propulsion().get_steady_state()

    def engines_running(self, count: int) -> int:
        """Return the number of running engines among the first ``count``."""
        paths = [
            "propulsion/engine/set-running" if i == 0 else f"propulsion/engine[{i}]/set-running" for i in range(count)
        ]
        return sum(self.has(path) and self.getter(path)() != 0.0 for path in paths)

    def settle(self) -> None:
        """Apply the initial conditions, with actuators and kinematics at their targets."""
        self.exec.set_trim_status(True)
        self.exec.run_ic()
        self.exec.set_trim_status(False)


@cache
def _patched(aircraft: Overlay) -> bytes:
    stock = Path(jsbsim.get_default_root_dir()) / aircraft.stock_file
    try:
        return aircraft.patch(stock.read_bytes())
    except OSError as error:
        raise AircraftError(f"aircraft {aircraft.name}: stock model {aircraft.stock_file}: {error.strerror}") from None


@cache
def _model_references(aircraft: Overlay) -> tuple[str, ...]:
    """Return the properties that the patched model refers to; JSBSim's output elements may name properties that do not exist."""
    return tuple(sorted(references([without_io(_patched(aircraft))])))


@cache
def kinks(aircraft: Overlay | StockAircraft, path: str) -> tuple[float, ...]:
    """Return the breakpoints of tables and thresholds of switches over a property, in the aircraft's and its engines' files."""
    if isinstance(aircraft, StockAircraft):
        files = [aircraft.file, *aircraft.engine_files]
    else:
        engines = Path(jsbsim.get_default_root_dir()) / "engine"
        model = _patched(aircraft)
        files = [model, *((engines / f"{name}.xml").read_bytes() for name in engine_names(model))]
    return tuple(sorted({value for file in files if file for value in breakpoints(file, path)}))


@cache
def _workspace() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="flightbed-")


@cache
def _model_folder(aircraft: Overlay | StockAircraft) -> Path:
    """Write the model where JSBSim can load it; the folder goes with the process.

    A stock aircraft is copied with its systems and engines, without the elements that write output files.
    """
    folder = Path(tempfile.mkdtemp(dir=_workspace().name))
    place = folder / aircraft.name
    if isinstance(aircraft, StockAircraft):
        shutil.copytree(Path(jsbsim.get_default_root_dir()) / "aircraft" / aircraft.name, place)
    else:
        place.mkdir()
    model = aircraft.without_io if isinstance(aircraft, StockAircraft) else compact(_patched(aircraft))
    (place / f"{aircraft.name}.xml").write_bytes(model)
    return folder
