"""flightbed: a testbed for flight control under loss of control effectiveness, on JSBSim's nonlinear F-16.

What is slow to import is imported when first used: ``import flightbed`` alone is cheap.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flightbed.aircraft.overlay import Aircraft, load_aircraft
    from flightbed.analysis.metrics import Metrics
    from flightbed.analysis.result import Result
    from flightbed.analysis.trace import Trace, read_trace
    from flightbed.avionics.short_period import ShortPeriod
    from flightbed.config.own_code import using
    from flightbed.core.errors import FlightbedError
    from flightbed.core.signals import Estimate, Measurement, Sample, Truth
    from flightbed.flight.pacing import WallClock
    from flightbed.flight.stepper import Stepper
    from flightbed.models.linearize import LinearModel, linearize
    from flightbed.models.reduce import short_period
    from flightbed.models.trim import TrimPoint, trim
    from flightbed.plant.airframe import JsbsimAirframe
    from flightbed.runs.run import fly, run
    from flightbed.scenario.reading import Scenario, load_scenario
    from flightbed.telemetry.live import Live

__all__ = [
    "Aircraft", "Estimate", "FlightbedError", "JsbsimAirframe", "LinearModel", "Live", "Measurement", "Metrics", "Result", "Sample",
    "Scenario", "ShortPeriod", "Stepper", "Trace", "TrimPoint", "Truth", "WallClock", "fly", "linearize", "load_aircraft",
    "load_scenario", "read_trace", "run", "short_period", "trim", "using",
]  # fmt: skip

# name -> module, imported on first use
_LATER = {
    "trim": "flightbed.models.trim",
    "TrimPoint": "flightbed.models.trim",
    "short_period": "flightbed.models.reduce",
    "ShortPeriod": "flightbed.avionics.short_period",
    "linearize": "flightbed.models.linearize",
    "LinearModel": "flightbed.models.linearize",
    "Aircraft": "flightbed.aircraft.overlay",
    "Estimate": "flightbed.core.signals",
    "FlightbedError": "flightbed.core.errors",
    "JsbsimAirframe": "flightbed.plant.airframe",
    "Live": "flightbed.telemetry.live",
    "Measurement": "flightbed.core.signals",
    "Metrics": "flightbed.analysis.metrics",
    "Result": "flightbed.analysis.result",
    "Sample": "flightbed.core.signals",
    "Scenario": "flightbed.scenario.reading",
    "Stepper": "flightbed.flight.stepper",
    "Trace": "flightbed.analysis.trace",
    "Truth": "flightbed.core.signals",
    "WallClock": "flightbed.flight.pacing",
    "fly": "flightbed.runs.run",
    "load_aircraft": "flightbed.aircraft.overlay",
    "load_scenario": "flightbed.scenario.reading",
    "read_trace": "flightbed.analysis.trace",
    "run": "flightbed.runs.run",
    "using": "flightbed.config.own_code",
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("flightbed")
    if name in _LATER:
        return getattr(import_module(_LATER[name]), name)
    raise AttributeError(f"module 'flightbed' has no attribute '{name}'")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
