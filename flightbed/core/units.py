"""Conversion factors into SI, and the unit in a name's suffix; imports nothing.

Inside flightbed every quantity is in SI units and radians. A name in any other unit ends in that unit
(``altitude_ft``, ``alpha_deg``); multiplication by one of these factors converts its value to SI.
"""

DEG = 0.017453292519943295  # rad
FT = 0.3048  # m, exact by definition
INCH = 0.0254  # m, exact by definition
KT = 0.5144444444444445  # m/s: 1852 m per hour
LB = 0.45359237  # kg, exact by definition
LBF = 4.4482216152605  # N
G0 = 9.80665  # m/s^2, standard gravity

# Longest suffix first: "deg_s" must win over "s".
_SUFFIXES = (
    ("_m_s2", "m/s^2"),
    ("_rad_s2", "rad/s^2"),
    ("_deg_s2", "deg/s^2"),
    ("_rad_s", "rad/s"),
    ("_deg_s", "deg/s"),
    ("_norm", "1"),
    ("_cbar", "mean aerodynamic chord"),
    ("_deg", "deg"),
    ("_rad", "rad"),
    ("_fps", "ft/s"),
    ("_m_s", "m/s"),
    ("_ft", "ft"),
    ("_kt", "kt"),
    ("_hz", "Hz"),
    ("_lbs", "lb"),
    ("_ms", "ms"),
    ("_g", "g"),
    ("_n", "N"),
    ("_m", "m"),
    ("_s", "s"),
)


def unit_of(name: str) -> str:
    """Return the unit that ``name`` ends in, ``"1"`` when it carries none (``"mach"``, ``"x.effectiveness"``)."""
    for suffix, unit in _SUFFIXES:
        if name.endswith(suffix):
            return unit
    return "1"


# (from, to) -> factor.
_CONVERSIONS = {
    ("rad", "deg"): 1 / DEG,
    ("rad/s", "deg/s"): 1 / DEG,
    ("m", "ft"): 1 / FT,
    ("m/s", "ft/s"): 1 / FT,
}


def conversion(unit: str, to: str) -> float:
    """Return the factor from an SI unit to one in which the trace shows it. Raises KeyError for units that do not fit."""
    return 1.0 if unit == to else _CONVERSIONS[unit, to]
