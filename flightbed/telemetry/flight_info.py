"""Information about a flight beside its trace, for the viewer; plain values that can be sent to another process."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

from flightbed.analysis.events import events, planned_events
from flightbed.analysis.result import Result
from flightbed.analysis.summary_text import plan_text, run_text
from flightbed.analysis.trace import Trace
from flightbed.core.actuator import Actuator
from flightbed.core.units import DEG
from flightbed.failures.base import failure_tick
from flightbed.flight.plan import Plan
from flightbed.scenario.estimates import detectors, estimates
from flightbed.telemetry.channels import Plot, plots


class Event(NamedTuple):
    """An event at a flight time; ``severe`` events are logged as errors."""

    t_s: float
    text: str
    severe: bool = False


@dataclass(frozen=True)
class FlightInfo:
    """Description of a flight for the viewer, available before the flight; ``with_result`` adds the outcome.

    Attributes:
        name: name of the recording.
        recording_id: identifier; recordings with equal identifiers merge in the viewer.
        summary_text: text summary, Markdown.
        planned: scheduled failures and gusts; after the flight all its events.
        failures_s: onsets of failures, s, marked in every plot.
        estimators: names of the estimates.
        detectors: estimates that are tested for a change of K.
        gusts: whether the scenario has gusts.
        moves_cg: whether a failure moves the c.g.
        actuators: commanded surface -> actuator: the elevator, or all three surfaces.
        faults_s: surface -> onset of its first actuator fault, s.
        control_hz: control rate, Hz.
        m_delta: pitch acceleration per deflection at the trim point, 1/s^2.
        readings: estimator -> number of readings in its NIS, where known.
        in_g: whether the pitch command is a load factor.
        departed: whether the flight ended in a departure.

    """

    name: str
    recording_id: str
    summary_text: str
    planned: tuple[Event, ...]
    failures_s: tuple[float, ...]
    estimators: tuple[str, ...]
    detectors: tuple[str, ...]
    gusts: bool
    moves_cg: bool
    actuators: Mapping[str, Actuator]
    faults_s: Mapping[str, float]
    control_hz: int
    m_delta: float
    readings: Mapping[str, float]
    in_g: bool = False
    departed: bool = False

    @classmethod
    def of(cls, plan: Plan, *, readings: Mapping[str, float]) -> FlightInfo:
        """Return the description of a planned flight; ``readings``: estimator -> number of readings in its NIS."""
        scenario = plan.scenario
        hz = scenario.rates.control_hz
        return cls(
            name=f"{scenario.name} seed {scenario.seed}",
            recording_id=hashlib.sha256(scenario.to_toml().encode()).hexdigest()[:16],
            summary_text=plan_text(scenario),
            planned=tuple(Event(*event) for event in planned_events(scenario)),
            failures_s=tuple(sorted({failure_tick(failure, hz) / hz for failure in scenario.failures})),
            estimators=estimates(scenario),
            detectors=detectors(scenario),
            gusts=bool(scenario.gusts),
            moves_cg=any(failure.moves_cg for failure in scenario.failures),
            actuators=dict(plan.actuators),
            faults_s={
                surface: min(failure_tick(failure, hz) / hz for failure in faults)
                for surface in plan.actuators
                if (faults := [f for f in scenario.failures if f.actuator == surface])
            },
            control_hz=hz,
            m_delta=float(plan.design.b[1]),
            readings=dict(readings),
            in_g=scenario.in_g,
        )

    def with_result(
        self,
        summary_text: str,
        events: Sequence[tuple[float, str, bool]],
        *,
        departed: bool,
        alarmed: Collection[str],
    ) -> FlightInfo:
        """Return the description with the outcome of the flight.

        Args:
            summary_text: text summary with the results, Markdown.
            events: (time in s, text, whether severe) of all events.
            departed: whether the flight ended in a departure.
            alarmed: estimates that raised alarms.

        """
        return dataclasses.replace(
            self,
            summary_text=summary_text,
            planned=tuple(Event(*event) for event in events),
            departed=departed,
            detectors=tuple(name for name in self.estimators if name in self.detectors or name in alarmed),
        )

    @property
    def lateral(self) -> bool:
        """Whether aileron and rudder are commanded, so that samples and trace include roll and yaw."""
        return "aileron" in self.actuators

    @property
    def stops_deg(self) -> Mapping[str, tuple[float, ...]]:
        """Stops of each commanded surface, deg; empty for a surface without stops."""
        return {
            surface: tuple(s / DEG for s in (actuator.min_rad, actuator.max_rad) if isfinite(s))
            for surface, actuator in self.actuators.items()
        }

    def plots(self, trace: Trace, *, certain: Collection[str] = ()) -> tuple[Plot, ...]:
        """Return the plots for a trace, or for its first ticks; ``certain`` columns are plotted even without values so far."""
        return plots(
            trace,
            stops_deg=self.stops_deg,
            gusts=self.gusts,
            moves_cg=self.moves_cg,
            readings=self.readings,
            certain=certain,
        )

    def to_json(self) -> str:
        """Return the description as JSON."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> FlightInfo:
        """Return the description from the text of ``to_json``."""
        raw: dict[str, Any] = json.loads(text)
        raw["planned"] = tuple(Event(*event) for event in raw["planned"])
        raw["actuators"] = {surface: Actuator(**numbers) for surface, numbers in raw["actuators"].items()}
        plain: Any = {key: tuple(value) if isinstance(value, list) else value for key, value in raw.items()}
        return cls(**plain)


def result_info(result: Result) -> FlightInfo:
    """Return the information on a finished flight that the viewer shows."""
    scenario, summary = result.plan.scenario, result.summary
    happened = events(scenario, result.trace, summary, result.plan.actuators)
    measured = result.metrics.estimators
    readings = {name: m.nis_expected for name, m in measured.items() if m.nis_expected is not None}
    return FlightInfo.of(result.plan, readings=readings).with_result(
        run_text(scenario, summary),
        happened,
        departed=result.metrics.departed,
        alarmed=[name for name in measured if result.trace[f"{name}.alarms"].max() > 0.0],
    )
