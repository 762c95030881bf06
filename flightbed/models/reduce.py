"""Linear model -> design models of fewer states."""

from __future__ import annotations

from flightbed.avionics.lateral import INPUTS, STATES, LateralDirectional
from flightbed.avionics.short_period import ShortPeriod
from flightbed.models.linearize import LinearModel
from flightbed.models.tabulate_lateral import tabulate
from flightbed.plant.base import Airframe


def short_period(model: LinearModel, *, actuator_rad_s: float) -> ShortPeriod:
    """Extract the short-period model from a linear model; speed, attitude and lateral motion are frozen."""
    A, B = model.part(("alpha", "q"), ("elevator",))
    return ShortPeriod(A, B[:, 0], actuator_rad_s, model.trim.alpha_rad, model.trim.controls.elevator)


def lateral_directional(
    model: LinearModel, airframe: Airframe, *, actuators_rad_s: tuple[float, float]
) -> LateralDirectional:
    """Return the design model, with its tables, of an overlay aircraft whose aileron and rudder are inputs in rad."""
    A, B = model.part(STATES, INPUTS)
    banked, _ = model.part(("beta", "phi"), ())
    tables = tabulate(airframe, throttle=model.trim.throttle_norm)
    return LateralDirectional(A, B, float(banked[0, 1]), model.trim.alpha_rad, actuators_rad_s, tables)
