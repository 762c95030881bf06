"""JSON Schema of ``aircraft.toml``: overlays and linear aircraft. The readers take the names of the keys from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

SURFACES = ("elevator", "aileron", "rudder")
LATERAL = ("aileron", "rudder")

_DESCRIPTION = (
    "An aircraft of flightbed: an overlay of a stock JSBSim model, or a linear model of the short period. This schema does not state: "
    "limits rise; the stock model has the elements that the edits refer to, and the files that they insert exist; the properties exist "
    "in the patched model; name and description of a linear aircraft are one line; whole numbers have no decimal point. "
    "`flightbed trim` and `flightbed run` check all of it."
)


def _text(description: str, **more: Any) -> dict[str, Any]:
    return {"type": "string", "description": description, **more}


def _number(description: str, unit: str = "", **more: Any) -> dict[str, Any]:
    return {"type": "number", "description": f"{description}{f' Unit: {unit}.' if unit else ''}", **more}


def _whole(description: str) -> dict[str, Any]:
    return {"type": "integer", "minimum": 1, "description": description}


def _texts(description: str) -> dict[str, Any]:
    return {"type": "array", "items": {"type": "string"}, "minItems": 1, "description": description}


def _pair(description: str, unit: str = "") -> dict[str, Any]:
    number = {"type": "number"}
    text = f"{description}{f' Unit: {unit}.' if unit else ''}"
    return {"type": "array", "prefixItems": [number, number], "minItems": 2, "maxItems": 2, "description": text}


def _table(description: str, properties: Mapping[str, Any], optional: Sequence[str] = ()) -> dict[str, Any]:
    required = [key for key in properties if key not in optional]
    return {
        "type": "object",
        "description": description,
        "properties": dict(properties),
        "required": required,
        "additionalProperties": False,
    }


def _actuator(surface: str) -> dict[str, Any]:
    return _table(
        f"Actuator of the {surface}: a lag, a rate limit and stops. Texts of the edits and snippets refer to its numbers by name.",
        {
            "lag_rad_s": _number("Bandwidth of the first-order lag.", "rad/s", exclusiveMinimum=0),
            "rate_limit_deg_s": _number("Largest rate.", "deg/s", exclusiveMinimum=0),
            "min_deg": _number("Lower stop.", "deg"),
            "max_deg": _number("Upper stop, above min_deg.", "deg"),
        },
    )


_HEAD = {
    "schema": {"const": 1, "description": "Version of the file's format."},
    "name": _text("Name of the aircraft."),
    "description": _text("One line about the aircraft."),
}
LATERAL_PROPERTIES = {
    "lateral_direct": _text(
        "Property that selects the positions of aileron and rudder: 0 stock laws, 1 as given, 2 through the actuators."
    ),
    **{
        f"{surface}_{what}": _text(f"Property of the {surface}'s {words}.")
        for surface in LATERAL
        for what, words in (
            ("cmd_rad", "command in radians"),
            ("rad", "position in radians"),
            ("effectiveness", "effectiveness K"),
        )
    },
}
_FAULT_PROPERTIES = {
    f"{surface}_{what}": _text(f"Property of the {surface}'s {words}.")
    for surface in SURFACES
    for what, words in (
        ("offset_rad", "deflection in addition to K times the position, in radians"),
        ("rate_limit_rad_s", "rate limit, in rad/s"),
        ("stuck", "malfunction: 1 keeps the actuator's position"),
    )
}
_EDITS: Mapping[str, dict[str, Any]] = {
    "declare": _table(
        "Declare a property in the flight control section.",
        {
            "property": _text("Path of the property."),
            "value": {
                "type": ["number", "string"],
                "description": "Initial value, or the name of an actuator's number, such as $rate_limit_rad_s.",
            },
        },
    ),
    "replace-channel": _table(
        "Replace a channel of the flight control section by a snippet, at the same place.",
        {"channel": _text("Name of the channel."), "with": _text("File of the snippet, in the folder of aircraft.toml.")},
    ),
    "insert-channel": _table(
        "Insert a channel, a snippet, before another one.",
        {"before": _text("Name of the channel after it."), "with": _text("File of the snippet, in the folder of aircraft.toml.")},
    ),
    "rewire-channel": _table(
        "Let a channel read another property.",
        {
            "channel": _text("Name of the channel."),
            "from": _text("Property that it reads in the stock model."),
            "to": _text("Property that it reads instead."),
            "count": _whole("Number of places at which the channel reads it."),
        },
    ),
    "rewire": _table(
        "Let aerodynamic functions read other properties.",
        {
            "from": _text("Property that they read in the stock model."),
            "to": {
                "type": "object",
                "additionalProperties": {"type": "array", "items": {"type": "string"}},
                "description": "New property -> the functions that read it; all functions that read `from` are listed.",
            },
        },
    ),
    "remove-functions": _table("Remove aerodynamic functions.", {"functions": _texts("Names of the functions.")}),
    "remove-systems": _table("Remove systems.", {"systems": _texts("Files of the systems.")}),
    "remove": {
        **_table(
            "Remove elements at a path of tags: those with the given names, or all.",
            {
                "elements": _text(
                    "Tags from the root, such as flight_control/channel; the last one may be * for any tag.",
                    pattern=r"^[A-Za-z_][\w.-]*(/[A-Za-z_][\w.-]*)*(/\*)?$",
                ),
                "names": _texts("Names of the elements, one element each."),
                "count": _whole("Number of the elements, which are all removed."),
            },
            optional=("names", "count"),
        ),
        "oneOf": [{"required": ["names"]}, {"required": ["count"]}],
    },
}  # fmt: skip


def _edit(do: str) -> dict[str, Any]:
    table = _EDITS[do]
    properties = {"do": {"const": do, "description": "Kind of edit."}, **table["properties"]}
    return {**table, "title": do, "properties": properties, "required": ["do", *table["required"]]}


def _together() -> dict[str, Any]:
    """Return the rule that actuators and properties of aileron and rudder are given together."""
    names = list(LATERAL_PROPERTIES)
    among = {"type": "object", "anyOf": [{"required": [name]} for name in names]}
    some = [*({"required": [s]} for s in LATERAL), {"properties": {"properties": among}, "required": ["properties"]}]
    return {
        "if": {"anyOf": some},
        "then": {"required": list(LATERAL), "properties": {"properties": {"required": names}}},
    }


OVERLAY: Mapping[str, Any] = MappingProxyType(
    {
        "title": "overlay",
        **_table(
            "An overlay: edits of a stock JSBSim model, actuators, limits and property names.",
            {
                **_HEAD,
                "equal_to": {
                    "type": "array",
                    "items": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
                    "description": "Fingerprints of earlier versions that fly the same traces bit for bit.",
                },
                "stock": _table(
                    "The stock model, which the jsbsim package contains.",
                    {
                        "file": _text("Its path inside the package."),
                        "sha256": _text("Its SHA-256, hexadecimal; another one is an error."),
                    },
                ),
                **{surface: _actuator(surface) for surface in SURFACES},
                "limits": _table(
                    "Bounds of the trim search.",
                    {
                        "alpha_deg": _pair("Least and greatest angle of attack.", "deg"),
                        "throttle_norm": _pair("Least and greatest throttle."),
                    },
                ),
                "properties": _table(
                    "JSBSim properties of the patched model.",
                    {
                        "elevator_cmd_rad": _text("Property of the elevator's command in radians."),
                        "elevator_rad": _text("Property of the elevator's position in radians."),
                        "effectiveness": _text("Property of K: share of the elevator's pitching moment that remains."),
                        "elevator_force": _text("Property of the share of the elevator's lift and drag that remains."),
                        "throttle_norm": _text("Property of the throttle command."),
                        **LATERAL_PROPERTIES,
                        **_FAULT_PROPERTIES,
                    },
                    optional=(*LATERAL_PROPERTIES, *_FAULT_PROPERTIES),
                ),
                "edits": {
                    "type": "array",
                    "items": {"type": "object", "oneOf": [_edit(do) for do in _EDITS]},
                    "description": "Edits of the stock model, in order of application.",
                },
            },
            optional=("equal_to", *LATERAL),
        ),
        **_together(),
    }
)
LINEAR: Mapping[str, Any] = MappingProxyType(
    {
        "title": "linear",
        **_table(
            "A linear aircraft: its short period, in deviations from trim, and an actuator without limits.",
            {
                **_HEAD,
                "kind": {"const": "linear", "description": "A linear model; overlays have no such key."},
                "condition": _table(
                    "Flight condition of the model; speed is held.",
                    {
                        "mach": _number("Mach number.", exclusiveMinimum=0),
                        "altitude_ft": _number("Altitude above sea level.", "ft"),
                    },
                ),
                "short_period": _table(
                    "Derivatives of the short period: alpha' = Z_alpha alpha + Z_q q + Z_delta delta, and q' the same with M.",
                    {
                        "z_alpha_1_s": _number("Z_alpha.", "1/s"),
                        "z_q": _number("Z_q."),
                        "z_delta_1_s": _number("Z_delta.", "1/s"),
                        "m_alpha_1_s2": _number("M_alpha.", "1/s^2"),
                        "m_q_1_s": _number("M_q.", "1/s"),
                        "m_delta_1_s2": _number("M_delta.", "1/s^2"),
                    },
                ),
                "elevator": _table(
                    "Actuator of the elevator.",
                    {"lag_rad_s": _number("Bandwidth of the first-order lag.", "rad/s", exclusiveMinimum=0)},
                ),
            },
        ),
    }
)


def aircraft_schema() -> dict[str, Any]:
    """Return the JSON Schema of ``aircraft.toml``."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "flightbed aircraft",
        "description": _DESCRIPTION,
        "type": "object",
        "oneOf": [dict(OVERLAY), dict(LINEAR)],
    }


def keys_of(schema: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the keys of a table, in the order of its schema."""
    return tuple(schema["properties"])


def tables_of(schema: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the schema of a file's outermost table, by the name "", and those of the tables in it."""
    inner = {key: value for key, value in schema["properties"].items() if value.get("type") == "object"}
    return {"": schema, **inner}


def edits() -> tuple[str, ...]:
    """Return the kinds of edits."""
    return tuple(_EDITS)


def edit_keys(do: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the required keys and all keys of a kind of edit, its ``do`` first."""
    table = _edit(do)
    return tuple(table["required"]), keys_of(table)
