"""Tables and keys of a scenario: frozen, each key with its type and range."""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Annotated, Any, Literal

import tomli_w

from flightbed.config.kinds import (
    COMMANDS,
    ESTIMATORS,
    FAILURES,
    GUSTS,
    LAWS,
    ROLL_COMMANDS,
    SIDESLIP_COMMANDS,
    CommandSettings,
    EstimatorSettings,
    FailureSettings,
    GustSettings,
    Kind,
    LawSettings,
    Surroundings,
)
from flightbed.config.table import (
    Field,
    FormatVersion,
    Identifier,
    NonNegative,
    Positive,
    PydanticCustomError,
    Settings,
    between,
    idle_keys,
    model_validator,
    only_with,
)


class AircraftSettings(Settings):
    """The aircraft."""

    model: str = "f16"
    """Name of an aircraft (`flightbed list aircraft`), or path of its folder."""
    sha256: str = ""
    """Fingerprint of the aircraft: another aircraft is an error, unless it lists this one as equal; empty: any."""
    cg_shift_cbar: Annotated[float, between(-0.5, 0.5)] = 0.0
    """Shift of the c.g., known on board; aft positive."""


class Condition(Settings):
    """Initial condition, trimmed."""

    mach: Positive = 0.8
    """Mach number."""
    altitude_ft: Annotated[float, between(0, 60000)] = 20000.0
    """Altitude above sea level."""
    gamma_deg: Annotated[float, between(-60, 60)] = 0.0
    """Flight-path angle, up positive."""


class Rates(Settings):
    """Rates of the flight computer and of the simulated aircraft."""

    control_hz: Annotated[int, between(10, 1000)] = 100
    """Control rate."""
    plant_hz: Annotated[int, between(10, 2000)] = 200
    """Rate of the simulated aircraft, an integer multiple of control_hz."""
    delay_ticks: Annotated[int, between(0, 100)] = 0
    """Control ticks between a command and the actuator."""

    @model_validator(mode="after")
    def _divide(self) -> Rates:
        if self.plant_hz % self.control_hz:
            raise PydanticCustomError(
                "rates",
                "plant_hz must be an integer multiple of control_hz (got {p} and {c})",
                {"p": self.plant_hz, "c": self.control_hz},
            )
        return self


class Lateral(Settings):
    """Roll and yaw control that replaces the stock laws: commands, and weights of an LQ regulator.

    The weights follow Bryson's rule: the cost of a state or surface is the square of its ratio to the value given here.
    """

    enabled: bool = False
    """An LQ regulator commands aileron and rudder instead of the stock laws."""
    roll: Annotated[CommandSettings, ROLL_COMMANDS, only_with(enabled=True)] = Field(default_factory=ROLL_COMMANDS.make)
    """Roll-rate command, right wing down positive."""
    sideslip: Annotated[CommandSettings, SIDESLIP_COMMANDS, only_with(enabled=True)] = Field(
        default_factory=SIDESLIP_COMMANDS.make
    )
    """Sideslip command, positive with the air from the right."""
    beta_deg: Annotated[Positive, only_with(enabled=True)] = 2.0
    """Weight of sideslip by Bryson's rule: this deviation costs as much as the others."""
    p_deg_s: Annotated[Positive, only_with(enabled=True)] = 20.0
    """Weight of roll rate by Bryson's rule: this deviation costs as much as the others."""
    r_deg_s: Annotated[Positive, only_with(enabled=True)] = 10.0
    """Weight of yaw rate by Bryson's rule: this deviation costs as much as the others."""
    aileron_deg: Annotated[Positive, only_with(enabled=True)] = 10.0
    """Weight of the aileron by Bryson's rule: this deviation costs as much as the others."""
    rudder_deg: Annotated[Positive, only_with(enabled=True)] = 10.0
    """Weight of the rudder by Bryson's rule: this deviation costs as much as the others."""


class Sensors(Settings):
    """Sensors: standard deviations of their white noise per tick, and constant errors unknown on board."""

    alpha_std_deg: Positive = 0.03
    """Noise of the angle of attack."""
    q_std_deg_s: Positive = 0.1108
    """Noise of pitch rate."""
    elevator_std_deg: NonNegative = 0.0
    """Noise of the elevator position."""
    mach_std: NonNegative = 0.0005
    """Noise of the Mach number, a reading of the scheduled model."""
    altitude_std_ft: NonNegative = 10.0
    """Noise of altitude."""
    theta_std_deg: NonNegative = 0.05
    """Noise of pitch attitude."""
    phi_std_deg: NonNegative = 0.05
    """Noise of bank angle."""
    nz_std_g: NonNegative = 0.0
    """Noise of the load factor; read by laws commanded in g, and by own code."""
    beta_std_deg: Positive = 0.03
    """Noise of sideslip; read with lateral.enabled."""
    p_std_deg_s: Positive = 0.1108
    """Noise of roll rate; read with lateral.enabled."""
    r_std_deg_s: Positive = 0.1108
    """Noise of yaw rate; read with lateral.enabled."""
    aileron_std_deg: NonNegative = 0.0
    """Noise of the aileron position; read with lateral.enabled."""
    rudder_std_deg: NonNegative = 0.0
    """Noise of the rudder position; read with lateral.enabled."""
    alpha_bias_deg: float = 0.0
    """Constant error of the angle of attack."""
    q_bias_deg_s: float = 0.0
    """Constant error of pitch rate."""
    mach_error: Annotated[float, between(-0.5, 0.5)] = 0.0
    """Relative error of the Mach number."""


class Atmosphere(Settings):
    """The air."""

    turbulence: Literal["none", "light", "moderate", "severe"] = "none"
    """Turbulence of MIL-F-8785C; light, moderate and severe are JSBSim's severity 3, 4 and 6."""


class ModelError(Settings):
    """Errors of the on-board model, unknown to the flight computer.

    c.g. and fuel are those of the aircraft in flight minus those of the aircraft that was trimmed and modelled.
    """

    cm_alpha: Annotated[float, between(0, 10)] = 1.0
    """Factor on the change of C_m from trim with alpha, in the estimators' model; aircraft and law are unchanged."""
    cm_q: Annotated[float, between(0, 10)] = 1.0
    """Factor on C_mq of the estimators' model."""
    cm_delta: Annotated[float, between(0, 10)] = 1.0
    """Factor on C_m_delta of the estimators' model."""
    cg_shift_cbar: Annotated[float, between(-0.5, 0.5)] = 0.0
    """Shift of the c.g. in flight, aft positive."""
    fuel_lbs: float = 0.0
    """Additional fuel in flight."""


class ProcessNoise(Settings):
    """Process noise of a linear aircraft: white, held for one control tick."""

    alpha_std_deg_s: NonNegative = 0.0
    """Standard deviation of the alpha rate."""
    q_std_deg_s2: NonNegative = 0.0
    """Standard deviation of pitch acceleration."""


class Adaptation(Settings):
    """Correction of the law by the estimate of one estimator."""

    enabled: bool = False
    """Whether the law is corrected."""
    method: Annotated[Literal["divide", "redesign"], only_with(enabled=True)] = "divide"
    """divide: by K-hat. redesign: the laws are designed again for K-hat once the estimator has confirmed a change."""
    estimator: Annotated[str, only_with(enabled=True, oracle=False)] = ""
    """Name of the estimator."""
    floor: Annotated[float, between(0, 1, open_low=True), only_with(enabled=True)] = 0.08
    """Lower bound of K-hat in the correction."""
    feedback: Annotated[Literal["effective", "position"], only_with(enabled=True, method="divide")] = "effective"
    """Feedback of the elevator: effective: K-hat times the measured position; position: the measured position."""
    caution: Annotated[float, between(0, 10), only_with(enabled=True, method="divide", oracle=False)] = 0.0
    """c of the divisor K-hat + (c sigma)^2 / K-hat, which corrects less with an uncertain K-hat."""
    limit_command: Annotated[bool, only_with(enabled=True, method="divide")] = False
    """Whether the reference is limited to what the elevator can follow with K-hat."""
    oracle: Annotated[bool, only_with(enabled=True)] = False
    """Whether the true K corrects the law, for studies."""


class Scenario(Settings):
    """Complete specification of one flight."""

    schema_version: FormatVersion = Field(alias="schema")
    """Version of the file's format."""
    name: Identifier
    """Name of the scenario, and of the default folder of its runs: letters, digits, - and _."""
    description: str = ""
    """One sentence about the flight; --set appends its overrides."""
    duration_s: Annotated[float, between(0, 36000, open_low=True)]
    """Duration, a whole number of control ticks."""
    seed: Annotated[int, between(0, 2**63 - 1)] = 0
    """Seed of all random numbers of the flight."""
    aircraft: AircraftSettings = AircraftSettings()
    """The aircraft."""
    condition: Condition = Condition()
    """Initial condition."""
    rates: Rates = Rates()
    """Rates."""
    command: Annotated[CommandSettings, COMMANDS] = Field(default_factory=COMMANDS.make)
    """Command of the pitch axis."""
    lateral: Lateral = Field(default_factory=Lateral)
    """Control of roll and yaw."""
    sensors: Sensors = Sensors()
    """Sensors."""
    atmosphere: Atmosphere = Atmosphere()
    """The air."""
    gusts: tuple[Annotated[GustSettings, GUSTS], ...] = ()
    """Gusts."""
    model_error: ModelError = ModelError()
    """Errors of the on-board model."""
    process_noise: ProcessNoise = ProcessNoise()
    """Process noise of a linear aircraft."""
    failures: tuple[Annotated[FailureSettings, FAILURES], ...] = ()
    """Failures in flight."""
    control: Annotated[LawSettings, LAWS] = Field(default_factory=LAWS.make)
    """Control law of the pitch axis."""
    adaptation: Adaptation = Adaptation()
    """Correction of the law."""
    estimators: tuple[Annotated[EstimatorSettings, ESTIMATORS], ...] = ()
    """Estimators, side by side; at most one corrects the law."""

    @property
    def ticks(self) -> int:
        """Number of control ticks."""
        return round(self.duration_s * self.rates.control_hz)

    @property
    def in_g(self) -> bool:
        """Whether the command is a load factor in g instead of a pitch rate."""
        return self.control.in_g

    def with_aircraft(self, model: str, sha256: str) -> Scenario:
        """Return the scenario bound to the aircraft with this path and SHA-256 fingerprint."""
        return self.model_copy(update={"aircraft": self.aircraft.model_copy(update={"model": model, "sha256": sha256})})

    def with_seed(self, seed: int) -> Scenario:
        """Return the scenario with another seed."""
        return self.model_copy(update={"seed": seed})

    @property
    def surroundings(self) -> Surroundings:
        """Settings on which the checks of its kinds depend."""
        return Surroundings(self.rates.control_hz, lateral=self.lateral.enabled, in_g=self.in_g, law=self.control.law)

    def kinds(self) -> Iterator[tuple[str, Kind]]:
        """Yield the place and the settings of each kind."""
        yield "command", self.command
        if self.lateral.enabled:
            yield "lateral.roll", self.lateral.roll
            yield "lateral.sideslip", self.lateral.sideslip
        yield "control", self.control
        yield from ((f"failures.{i}", failure) for i, failure in enumerate(self.failures))
        yield from ((f"gusts.{i}", gust) for i, gust in enumerate(self.gusts))
        yield from ((f"estimators.{i}", estimator) for i, estimator in enumerate(self.estimators))

    def idle_keys(self) -> dict[str, str]:
        """Return key without effect -> setting that disables it."""
        keys = idle_keys(self)
        for place, kind in self.kinds():
            keys |= kind.idle(place, self.surroundings)
        law = self.control
        idle = ["adaptation.feedback"] if law.in_g else []
        if not law.reads_accelerometer and not any(estimator.reads_accelerometer for estimator in self.estimators):
            idle.append("sensors.nz_std_g")
        keys |= {key: f"control.law = '{law.law}'" for key in idle if key not in keys}
        if not self.lateral.enabled:
            keys |= {f"sensors.{key}": "lateral.enabled = false" for key in _LATERAL_SENSORS}
        return keys

    def settings(self) -> dict[str, Any]:
        """Return the scenario as plain nested values, without the keys that another key leaves without effect."""
        whole: dict[str, Any] = self.model_dump(mode="json", by_alias=True, exclude_none=True)
        idle = self.idle_keys()
        return {
            key: inner for key, value in whole.items() if key not in idle and (inner := _acting(value, idle, key)) != {}
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the scenario as plain nested values, with every key that has an effect.

        Lists without entries, and errors of the model and process noise of zero, are left out.
        """
        off = {name for name in ("model_error", "process_noise") if getattr(self, name) == type(getattr(self, name))()}
        return {key: value for key, value in self.settings().items() if value != [] and key not in off}

    def to_toml(self) -> str:
        """Return the scenario as TOML text, with every key that has an effect."""
        return tomli_w.dumps(self.to_dict())


_LATERAL_SENSORS = ("beta_std_deg", "p_std_deg_s", "r_std_deg_s", "aileron_std_deg", "rudder_std_deg")


def _acting(value: Any, idle: Container[str], place: str) -> Any:
    """Return nested plain values without the keys that have no effect, and without tables that are then empty."""
    if isinstance(value, list):
        return [_acting(inner, idle, f"{place}.{i}") for i, inner in enumerate(value)]
    if not isinstance(value, dict):
        return value
    return {
        key: inner
        for key, old in value.items()
        if f"{place}.{key}" not in idle and (inner := _acting(old, idle, f"{place}.{key}")) != {}
    }
