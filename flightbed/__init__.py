"""flightbed: a testbed for flight control under loss of control effectiveness, on JSBSim's nonlinear F-16.

Names are imported when first used: ``import flightbed`` alone is cheap.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flightbed.aircraft import Aircraft as Aircraft
    from flightbed.aircraft import load_aircraft as load_aircraft
    from flightbed.errors import FlightbedError as FlightbedError
    from flightbed.linearize import LinearModel as LinearModel
    from flightbed.linearize import linearize as linearize
    from flightbed.metrics import Metrics as Metrics
    from flightbed.mission import Result as Result
    from flightbed.mission import fly as fly
    from flightbed.mission import run as run
    from flightbed.plant.jsbsim import JsbsimAirframe as JsbsimAirframe
    from flightbed.scenario import Scenario as Scenario
    from flightbed.scenario import load_scenario as load_scenario
    from flightbed.short_period import ShortPeriod as ShortPeriod
    from flightbed.short_period import short_period as short_period
    from flightbed.signals import Estimate as Estimate
    from flightbed.signals import Measurement as Measurement
    from flightbed.signals import Sample as Sample
    from flightbed.signals import Truth as Truth
    from flightbed.trace import Trace as Trace
    from flightbed.trace import read_trace as read_trace
    from flightbed.trim import TrimPoint as TrimPoint
    from flightbed.trim import trim as trim

_HOMES = {
    "Aircraft": "aircraft",
    "load_aircraft": "aircraft",
    "FlightbedError": "errors",
    "LinearModel": "linearize",
    "linearize": "linearize",
    "Metrics": "metrics",
    "Result": "mission",
    "fly": "mission",
    "run": "mission",
    "JsbsimAirframe": "plant.jsbsim",
    "Scenario": "scenario",
    "load_scenario": "scenario",
    "ShortPeriod": "short_period",
    "short_period": "short_period",
    "Estimate": "signals",
    "Measurement": "signals",
    "Sample": "signals",
    "Truth": "signals",
    "Trace": "trace",
    "read_trace": "trace",
    "TrimPoint": "trim",
    "trim": "trim",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> object:
    if name in _HOMES:
        return getattr(import_module(f"flightbed.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'flightbed' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__
