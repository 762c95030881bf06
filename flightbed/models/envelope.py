"""Aircraft -> pitch motion and load factor over dynamic pressure, for scheduled control laws."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np

from flightbed.aircraft.overlay import Aircraft
from flightbed.avionics.pitch_points import PitchPoint
from flightbed.core.atmosphere import standard_air
from flightbed.core.errors import NoTrimError
from flightbed.core.units import FT, LBF
from flightbed.models.linearize import LinearModel, linearize
from flightbed.models.trim import trim
from flightbed.plant.airframe import JsbsimAirframe

PSF = LBF / FT**2  # Pa
DYNAMIC_PRESSURES_PSF = (
    25.0,
    77.5,
    130.0,
    182.5,
    235.0,
    287.5,
    340.0,
    392.5,
    445.0,
    497.5,
    550.0,
)  # Kemp S 6.1: 11 points
_LOADS = (None, 0.75, 0.5, 0.25)  # level flight; else a push-over at the first of these load factors with a trim


def pitch_points(aircraft: Aircraft, *, cg_shift_cbar: float) -> tuple[PitchPoint, ...]:
    """Trim and linearize at sea level at Kemp's 11 dynamic pressures, 25 to 550 lb/ft^2.

    The F-16 has no level trim at 25 lb/ft^2: this point is a push-over at a load factor below 1, with ``level`` False; the thesis does
    not describe its treatment of this point.

    Raises:
        NoTrimError: a dynamic pressure has no equilibrium, not even at a load factor of 0.25.

    """
    return tuple(_point(aircraft, pressure * PSF, cg_shift_cbar) for pressure in DYNAMIC_PRESSURES_PSF)


def _point(aircraft: Aircraft, dynamic_pressure_pa: float, cg_shift_cbar: float) -> PitchPoint:
    air = standard_air(0.0)
    mach = sqrt(dynamic_pressure_pa / (0.7 * air.pressure_pa))
    airframe = JsbsimAirframe(aircraft, mach=mach, altitude_m=0.0, cg_shift_cbar=cg_shift_cbar)
    for load in _LOADS:
        try:
            point = trim(airframe, load_factor=load)
            break
        except NoTrimError:
            if load == _LOADS[-1]:
                raise
    found = pitch_point(linearize(airframe, point), mach=mach, altitude_m=0.0)
    return found if load is None else replace(found, level=False)


def pitch_point(model: LinearModel, *, mach: float, altitude_m: float) -> PitchPoint:
    """Extract short period and load factor from a linear model at a Mach number and altitude."""
    A, B = model.part(("alpha", "q"), ("elevator",))
    states, inputs = [name for name, _ in model.states], [name for name, _ in model.inputs]
    row = [name for name, _ in model.outputs].index("nz")
    c = model.C[row, [states.index("alpha"), states.index("q")]]
    pressure = 0.7 * standard_air(altitude_m).pressure_pa * mach**2
    return PitchPoint(pressure, A, B[:, 0], np.asarray(c), float(model.D[row, inputs.index("elevator")]))
