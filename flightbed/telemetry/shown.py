"""What the viewer has to be told of a flight besides its columns; plain values, so that they can be sent to another process."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

from flightbed.aircraft import Actuator
from flightbed.card import plan_card
from flightbed.consistency import ACTUATOR_FAILURES, detectors, estimates
from flightbed.event_log import planned_events
from flightbed.factories import failure_tick
from flightbed.plan import Plan
from flightbed.telemetry.channels import Plot, plots
from flightbed.trace import Trace
from flightbed.units import DEG


class Event(NamedTuple):
    """Something that happened at a time."""

    t_s: float
    text: str
    severe: bool = False


@dataclass(frozen=True)
class Shown:
    """A flight as the viewer is told of it before take-off.

    Attributes:
        name: of the recording.
        recording_id: recordings with the same one merge in a viewer.
        card: the run card, Markdown.
        planned: failures and gusts to come.
        failures_s: when failures begin, marked in every plot.
        estimators: names of the estimates.
        detectors: those of them that are tested for a change of K.
        gusts: whether there are any.
        moves_cg: whether a failure moves the c.g.
        actuators: of the surfaces that are commanded, by name: the elevator, or all three; stops and rate limits.
        faults_s: of surfaces from when on something is wrong with their actuator.
        control_hz: ticks per second.
        m_delta: pitch acceleration per deflection at the trim point, 1/s^2.
        readings: of estimators how many readings their NIS is of, where that is known.
        in_g: whether it is commanded in g.
        departed: whether it ended in a departure.

    """

    name: str
    recording_id: str
    card: str
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
    def of(cls, plan: Plan, *, readings: Mapping[str, float]) -> Shown:
        """Return what there is to tell of a plan; ``readings`` as above."""
        scenario = plan.scenario
        hz = scenario.rates.control_hz
        return cls(
            name=f"{scenario.name} seed {scenario.seed}",
            recording_id=hashlib.sha256(scenario.to_toml().encode()).hexdigest()[:16],
            card=plan_card(scenario),
            planned=tuple(Event(*event) for event in planned_events(scenario)),
            failures_s=tuple(sorted({failure_tick(failure, hz) / hz for failure in scenario.failures})),
            estimators=estimates(scenario),
            detectors=detectors(scenario),
            gusts=bool(scenario.gusts),
            moves_cg=any(failure.kind == "cg-shift" for failure in scenario.failures),
            actuators=dict(plan.actuators),
            faults_s={
                surface: min(failure_tick(failure, hz) / hz for failure in faults)
                for surface in plan.actuators
                if (faults := [f for f in scenario.failures if f.surface == surface and f.kind in ACTUATOR_FAILURES])
            },
            control_hz=hz,
            m_delta=float(plan.design.b[1]),
            readings=dict(readings),
            in_g=scenario.in_g,
        )

    def flown(
        self,
        card: str,
        events: Sequence[tuple[float, str, bool]],
        *,
        departed: bool,
        alarmed: Collection[str],
    ) -> Shown:
        """Return it with what is known when the flight is over: card, events, whether it departed, who raised alarms."""
        return dataclasses.replace(
            self,
            card=card,
            planned=tuple(Event(*event) for event in events),
            departed=departed,
            detectors=tuple(name for name in self.estimators if name in self.detectors or name in alarmed),
        )

    @property
    def lateral(self) -> bool:
        """Whether aileron and rudder are commanded, so that samples and columns of roll and yaw come with the others."""
        return "aileron" in self.actuators

    @property
    def stops_deg(self) -> Mapping[str, tuple[float, ...]]:
        """The stops of each surface, if it has any."""
        return {
            surface: tuple(s / DEG for s in (actuator.min_rad, actuator.max_rad) if isfinite(s))
            for surface, actuator in self.actuators.items()
        }

    def plots(self, trace: Trace, *, certain: Collection[str] = ()) -> tuple[Plot, ...]:
        """Return what is plotted of it, from its trace or its first ticks; ``certain`` columns have values later at least."""
        return plots(
            trace,
            stops_deg=self.stops_deg,
            gusts=self.gusts,
            moves_cg=self.moves_cg,
            readings=self.readings,
            certain=certain,
        )

    def to_json(self) -> str:
        """Return it as text."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Shown:
        """Return what ``to_json`` was told."""
        raw: dict[str, Any] = json.loads(text)
        raw["planned"] = tuple(Event(*event) for event in raw["planned"])
        raw["actuators"] = {surface: Actuator(**numbers) for surface, numbers in raw["actuators"].items()}
        plain: Any = {key: tuple(value) if isinstance(value, list) else value for key, value in raw.items()}
        return cls(**plain)
