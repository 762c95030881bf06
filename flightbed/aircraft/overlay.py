"""Overlay aircraft: edits of a stock JSBSim model, actuators, limits, and property names.

The stock file is not part of flightbed (the F-16's is GPL). flightbed reads the file from the installed jsbsim package, checks its
hash and applies the edits of ``aircraft.toml`` in memory; see ``aircraft/f16/README.md``.
"""

from __future__ import annotations

import hashlib
import re
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from string import Template
from typing import Any

from flightbed.aircraft.edits import EDITS, EditError, substitute
from flightbed.aircraft.schema import (
    LATERAL,
    LATERAL_PROPERTIES,
    OVERLAY,
    SURFACES,
    edit_keys,
    edits,
    keys_of,
    tables_of,
)
from flightbed.core import data
from flightbed.core.actuator import Actuator
from flightbed.core.errors import AircraftError, did_you_mean, printable
from flightbed.core.units import DEG


@dataclass(frozen=True)
class Limits:
    """Bounds of the trim search: (lowest, highest)."""

    alpha_rad: tuple[float, float]
    throttle_norm: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Aircraft:
    """An overlay aircraft, read from a folder.

    Attributes:
        name: name of the aircraft and of the patched model.
        description: one line.
        stock_file: path of the stock model inside the jsbsim package.
        stock_sha256: required SHA-256 of the stock model.
        actuator: actuator of the elevator.
        limits: bounds of the trim search.
        lateral: actuators of aileron and rudder; empty if the overlay has no direct roll and yaw commands.
        properties: flightbed name -> JSBSim property.
        edits: edits, in order of application.
        snippets: file name -> XML text with ``$names`` substituted.
        equal_to: fingerprints (``sha256``) of earlier overlays that fly the same traces; not part of its own fingerprint.

    """

    name: str
    description: str
    stock_file: str
    stock_sha256: str
    actuator: Actuator
    limits: Limits
    lateral: Mapping[str, Actuator]
    properties: Mapping[str, str]
    edits: tuple[Mapping[str, Any], ...]
    snippets: Mapping[str, str]
    equal_to: tuple[str, ...] = ()

    def patch(self, stock: bytes) -> bytes:
        """Return the stock model with all edits applied.

        Raises AircraftError if the hash of the stock model differs or an edit does not apply.
        """
        found = hashlib.sha256(stock).hexdigest()
        if found != self.stock_sha256:
            raise AircraftError(
                f"aircraft {self.name}: {self.stock_file} of the installed jsbsim: must have sha256 {self.stock_sha256[:12]}... "
                f"(got {found[:12]}...); install the jsbsim version that flightbed pins"
            )
        root = ET.fromstring(stock)
        root.set("name", f"{root.get('name', self.name)} (flightbed overlay)")
        for number, edit in enumerate(self.edits):
            try:
                EDITS[edit["do"]](root, edit, self.snippets)
            except (KeyError, ET.ParseError, EditError) as error:
                reason = f"needs {error}" if isinstance(error, KeyError) else str(error)
                raise AircraftError(f"aircraft {self.name}: edits.{number} ({edit.get('do')}): {reason}") from None
        return ET.tostring(root, encoding="unicode").encode()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Aircraft) and self.sha256 == other.sha256

    def __hash__(self) -> int:
        return hash(self.sha256)

    def references(self) -> list[tuple[str, str]]:
        """Return (file, property) pairs, one for each property reference in the snippets."""
        return [
            (file, word.removeprefix("-"))
            for file, snippet in self.snippets.items()
            for element in ET.fromstring(snippet).iter()
            for text in (element.text, element.get("value"))
            for word in (text or "").split()[:1]  # a test is a property, an operator and a value
            if "/" in word
        ]

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the definition of this aircraft, hexadecimal: stock model, edits and numbers."""
        text = repr(
            (
                self.name,
                self.stock_file,
                self.stock_sha256,
                self.actuator,
                self.limits,
                sorted(self.lateral.items()),
                sorted(self.properties.items()),
                [sorted(e.items()) for e in self.edits],
                sorted(self.snippets.items()),
            )
        )
        return hashlib.sha256(text.encode()).hexdigest()


def load_aircraft(name: str) -> Aircraft:
    """Read an overlay aircraft by shipped name or folder.

    Raises UnknownNameError, or AircraftError for an invalid overlay or a linear model (``models/linear_aircraft.py``).
    """
    folder = data.find("aircraft", name)
    path = folder / "aircraft.toml"
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
        if raw.get("kind") == "linear":
            raise AircraftError(
                f'{path}: kind: must be an overlay (got "linear"); fly a linear model with flightbed run, '
                "it cannot be trimmed or linearized"
            )
        _check(raw, path)
        numbers = {name: _in_rad(raw[name]) for name in SURFACES if name in raw}
        fill = {key: repr(value) for key, value in numbers["elevator"].items()}
        fill |= {f"{name}_{key}": repr(v) for name, found in numbers.items() for key, v in found.items()}
        actuators = {name: Actuator(*(found[k] for k in _ACTUATOR)) for name, found in numbers.items()}
        edits = tuple(substitute(edit, fill) for edit in raw["edits"])
        snippets = {
            edit["with"]: Template((folder / Path(edit["with"]).name).read_text(encoding="utf-8")).substitute(fill)
            for edit in edits
            if "with" in edit
        }
        alpha, throttle = raw["limits"]["alpha_deg"], raw["limits"]["throttle_norm"]
        return Aircraft(
            name=raw["name"],
            description=raw["description"],
            stock_file=raw["stock"]["file"],
            stock_sha256=raw["stock"]["sha256"],
            actuator=actuators["elevator"],
            limits=Limits((alpha[0] * DEG, alpha[1] * DEG), (throttle[0], throttle[1])),
            lateral={name: actuators[name] for name in LATERAL if name in actuators},
            properties=raw["properties"],
            edits=edits,
            snippets=snippets,
            equal_to=tuple(raw.get("equal_to", ())),
        )
    except KeyError as error:
        raise AircraftError(f"{path}: {error} is missing") from None
    except FileNotFoundError as error:
        raise AircraftError(
            f"{path}: refers to the file {Path(error.filename).name}; put it into the same folder"
        ) from None
    except (OSError, ValueError, TypeError, AttributeError, IndexError, RecursionError) as error:
        raise AircraftError(f"{path}: {printable(str(error))}") from None


_SHA256 = re.compile(r"[0-9a-f]{64}")
_ACTUATOR = ("lag_rad_s", "rate_limit_rad_s", "min_rad", "max_rad")


def _in_rad(table: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers of an actuator; those in degrees are added in radians."""
    numbers = {key: float(value) for key, value in table.items()}
    return numbers | {key.replace("_deg", "_rad"): value * DEG for key, value in numbers.items() if "_deg" in key}


_TABLES = tables_of(OVERLAY)


def _check(raw: Mapping[str, Any], path: Path) -> None:
    """Reject unknown and missing keys and numbers out of range. Raises AircraftError."""
    for table, schema in _TABLES.items():
        if table in LATERAL and table not in raw:
            continue
        found, known = raw.get(table, {}) if table else raw, keys_of(schema)
        dot = f"{table}." if table else ""
        for key in sorted(set(found) - set(known)):
            raise AircraftError(f"{path}: unknown key {dot}{key}{did_you_mean(key, known)}")
        for key in sorted(set(schema["required"]) - set(found)):
            raise AircraftError(f"{path}: {dot}{key} is missing")
    if raw["schema"] != 1 or isinstance(raw["schema"], bool):
        raise AircraftError(f"{path}: schema: must be 1 (got {raw['schema']!r})")
    if not isinstance(raw["edits"], list) or not all(isinstance(edit, Mapping) for edit in raw["edits"]):
        raise AircraftError(f"{path}: edits: must be tables, [[edits]]")
    earlier = raw.get("equal_to", [])
    if not isinstance(earlier, list):
        raise AircraftError(f"{path}: equal_to: must be a list of fingerprints (got {earlier!r})")
    for i, entry in enumerate(earlier):
        if not isinstance(entry, str) or not _SHA256.fullmatch(entry):
            raise AircraftError(
                f"{path}: equal_to.{i}: must be a fingerprint, 64 digits of 0-9 and a-f (got {entry!r}); "
                "copy aircraft.sha256 from a resolved scenario.toml"
            )
    for i, edit in enumerate(raw["edits"]):
        _check_edit(edit, f"{path}: edits.{i}")
    limits, surfaces = raw["limits"], [name for name in SURFACES if name in raw]
    given = [n in raw for n in LATERAL] + [n in raw["properties"] for n in sorted(LATERAL_PROPERTIES)]
    if any(given) and not all(given):
        raise AircraftError(
            f"{path}: [aileron], [rudder] and properties {', '.join(sorted(LATERAL_PROPERTIES))} go together: give all or none"
        )
    for name in surfaces:
        for key in ("lag_rad_s", "rate_limit_deg_s"):
            if not raw[name][key] > 0:
                raise AircraftError(f"{path}: {name}.{key}: must be above 0 (got {raw[name][key]})")
    for place, (low, high) in {
        **{f"{n}.min_deg, max_deg": (raw[n]["min_deg"], raw[n]["max_deg"]) for n in surfaces},
        "limits.alpha_deg": limits["alpha_deg"],
        "limits.throttle_norm": limits["throttle_norm"],
    }.items():
        if not low < high:
            raise AircraftError(f"{path}: {place}: must be in ascending order (got {low}, {high})")


def _check_edit(edit: Mapping[str, Any], place: str) -> None:
    """Reject an unknown kind of edit, and unknown and missing keys. Raises AircraftError."""
    do = edit.get("do")
    if not isinstance(do, str) or do not in edits():
        raise AircraftError(
            f"{place}.do: must be one of {', '.join(edits())} (got {do!r}){did_you_mean(str(do), edits())}"
        )
    required, known = edit_keys(do)
    for key in edit:
        if key not in known:
            raise AircraftError(
                f"{place}: unknown key {key}{did_you_mean(key, known)}; '{do}' has: {', '.join(known[1:])}"
            )
    for key in required:
        if key not in edit:
            raise AircraftError(f"{place} ({do}): {key} is missing")


def load_path(name: str) -> str:
    """Return a name that is valid from any directory: a shipped name unchanged, or the absolute path of a folder."""
    folder = data.find("aircraft", name)
    return name if folder.parent == data.shipped("aircraft") else str(folder.resolve())
