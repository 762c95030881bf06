"""JSON Schema of a file, from its settings classes."""

from __future__ import annotations

from typing import Any

from flightbed.config.family import json_schema
from flightbed.config.table import Settings
from flightbed.core.units import unit_of

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema_of(model: type[Settings], title: str, description: str) -> dict[str, Any]:
    """Return the JSON Schema of a file: one schema per kind, ranges, descriptions with units, and conditions between keys of a table.

    Args:
        model: class of the whole file.
        title: of the schema.
        description: what the file is, and which relations the schema does not state.

    """
    schema = _with_units(json_schema(model))
    return {"$schema": DIALECT, "title": title, **schema, "description": description}


def _with_units(node: Any) -> Any:
    """Return a schema whose numbers have their unit at the end of the description."""
    if isinstance(node, list):
        return [_with_units(inner) for inner in node]
    if not isinstance(node, dict):
        return node
    node = {key: _with_units(value) for key, value in node.items()}
    for name, inner in node.get("properties", {}).items():
        if isinstance(inner, dict) and inner.get("type") in ("number", "integer") and (unit := unit_of(name)) != "1":
            inner["description"] = f"{inner.get('description', '')} Unit: {unit}.".strip()
    return node
