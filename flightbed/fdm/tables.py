"""Breakpoints of the tables and switches of a JSBSim model."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET


def breakpoints(model: bytes, path: str) -> tuple[float, ...]:
    """Return the values of a property at table breakpoints and switch thresholds, sorted, in the property's unit.

    Args:
        model: content of the model file.
        path: property, for example ``velocities/mach``.

    """
    root = ET.fromstring(model)
    found: set[float] = set()
    for table in root.iter("table"):
        axes = {(v.get("lookup") or "row"): (v.text or "").strip() for v in table.findall("independentVar")}
        for data in table.findall("tableData"):
            lines = [line.split() for line in (data.text or "").splitlines() if line.strip()]
            if axes.get("row") == path:
                rows = lines[1:] if "column" in axes else lines
                found |= {float(line[0]) for line in rows}
            if axes.get("column") == path and lines:
                found |= {float(value) for value in lines[0]}
    number = r"(-?\d*\.?\d+)"
    for test in root.iter("test"):
        for condition in (test.text or "").splitlines():
            match = re.match(
                rf"{re.escape(path)}\s*(?:lt|le|gt|ge|<=?|>=?)\s*{number}", condition.strip(), flags=re.IGNORECASE
            )
            if match:
                found.add(float(match[1]))
    return tuple(sorted(found))
