"""Aircraft that ship with JSBSim, used unchanged, without an overlay."""

from __future__ import annotations

import hashlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from flightbed.core.errors import AircraftError


@dataclass(frozen=True)
class StockAircraft:
    """An aircraft as JSBSim ships it, with its own control system; the controls are normalized commands.

    Attributes:
        name: name of its folder in the jsbsim package.
        file: content of the aircraft file.
        engine_files: content of the engine files, one per engine; empty for a missing file.
        engines: kind of each engine, ``"turbine"``, ``"piston"``, ``"turboprop"``, ``"rocket"``, ``"electric"``, ...
        retractable: whether any leg of the landing gear can be retracted.

    """

    name: str
    file: bytes
    engine_files: tuple[bytes, ...]
    engines: tuple[str, ...]
    retractable: bool

    @property
    def without_io(self) -> bytes:
        """The aircraft file without its output and input elements, for which JSBSim would write files and open sockets."""
        return without_io(self.file)

    @property
    def sha256(self) -> str:
        """SHA-256 of the aircraft and engine files, hexadecimal."""
        return hashlib.sha256(b"".join((self.file, *self.engine_files))).hexdigest()


_PROSE = ("description", "note", "license", "reference", "limitation", "author", "documentation")
_PATH = re.compile(r"-?(/?[a-z][\w-]*(?:/[A-Za-z_][\w-]*(?:\[\d+\])?)+)")


def without_io(model: bytes) -> bytes:
    """Return an aircraft file without its output and input elements."""
    root = ET.fromstring(model)
    for element in root.findall("output") + root.findall("input"):
        root.remove(element)
    return ET.tostring(root, encoding="unicode").encode()


def compact(model: bytes) -> bytes:
    """Return an aircraft file without prose and with single spaces, which JSBSim reads in 0.9 of the time; lines of tables stay lines."""
    root = ET.fromstring(model)
    for element in list(root.iter()):
        lines = [" ".join(line.split()) for line in (element.text or "").splitlines()]
        element.text, element.tail = "\n".join(line for line in lines if line), None
        for child in [c for c in element if c.tag in _PROSE and element is not root]:
            element.remove(child)
    return ET.tostring(root, encoding="unicode").encode()


def references(files: Iterable[bytes]) -> set[str]:
    """Return every property that model files refer to by its full path."""
    found = set()
    for file in files:
        try:
            elements = list(ET.fromstring(file).iter())
        except ET.ParseError:  # not a model file
            continue
        for element in elements:
            if element.tag in _PROSE:
                continue
            found |= {m[1] for word in (element.text or "").split() if (m := _PATH.fullmatch(word))}
    return found


def engine_names(model: bytes) -> list[str]:
    """Return the names of the engine files that an aircraft file refers to, one per engine."""
    propulsion = ET.fromstring(model).find("propulsion")
    return [] if propulsion is None else [e.get("file", "") for e in propulsion.findall("engine")]


def read_stock(name: str, model: bytes, engine: Callable[[str], bytes]) -> StockAircraft:
    """Read an aircraft file; ``engine`` returns the content of an engine file by name.

    Raises AircraftError for a file that is not XML, or has no wing area or aerodynamics.
    """
    try:
        root = ET.fromstring(model)
        files = tuple(engine(file) for file in engine_names(model))
        kinds = tuple(ET.fromstring(file).tag.removesuffix("_engine") if file else "unknown" for file in files)
    except ET.ParseError as error:
        raise AircraftError(f"aircraft {name}: not readable: {error}") from None
    if root.find("aerodynamics") is None or root.find("metrics/wingarea") is None:
        raise AircraftError(
            f"aircraft {name}: has no wing area or no aerodynamics; choose an aircraft that can be trimmed"
        )
    retractable = any((e.text or "").strip() not in ("", "0") for e in root.iter("retractable"))
    return StockAircraft(name, model, files, kinds, retractable)
