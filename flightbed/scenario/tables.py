"""Tables and keys of a scenario: frozen, each key with its type and range."""

from __future__ import annotations

from typing import Annotated, Literal

import tomli_w

from flightbed.config.kinds import (
    COMMANDS,
    FAILURES,
    GUSTS,
    LOAD_FACTOR_LAWS,
    ROLL_COMMANDS,
    SIDESLIP_COMMANDS,
    CommandSettings,
    Control,
    EstimatorSettings,
    FailureSettings,
    GustSettings,
)
from flightbed.config.table import (
    Field,
    Identifier,
    NonNegative,
    Positive,
    PydanticCustomError,
    Settings,
    between,
    model_validator,
)


class AircraftSettings(Settings):
    """Aircraft model; optional SHA-256 fingerprint, which excludes every other aircraft; c.g. shift in mean chords, aft positive."""

    model: str = "f16"
    sha256: str = ""
    cg_shift_cbar: Annotated[float, between(-0.5, 0.5)] = 0.0


class Condition(Settings):
    """Trimmed initial condition; gamma is the flight-path angle, up positive."""

    mach: Positive = 0.8
    altitude_ft: Annotated[float, between(0, 60000)] = 20000.0
    gamma_deg: Annotated[float, between(-60, 60)] = 0.0


class Rates(Settings):
    """Control and plant rates, Hz, and the command delay of delay_ticks control ticks; plant_hz is an integer multiple of control_hz."""

    control_hz: Annotated[int, between(10, 1000)] = 100
    plant_hz: Annotated[int, between(10, 2000)] = 200
    delay_ticks: Annotated[int, between(0, 100)] = 0

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
    """Roll and yaw control that replaces the stock laws: commands and weights of the LQ regulator.

    The weights follow Bryson's rule: the cost of a state or surface is the square of its ratio to the value given here.
    """

    enabled: bool = False
    roll: Annotated[CommandSettings, ROLL_COMMANDS] = Field(default_factory=ROLL_COMMANDS.make)
    sideslip: Annotated[CommandSettings, SIDESLIP_COMMANDS] = Field(default_factory=SIDESLIP_COMMANDS.make)
    beta_deg: Positive = 2.0
    p_deg_s: Positive = 20.0
    r_deg_s: Positive = 10.0
    aileron_deg: Positive = 10.0
    rudder_deg: Positive = 10.0


class Sensors(Settings):
    """Standard deviations of the white noise per tick, and constant sensor errors unknown on board (Mach number: relative error)."""

    alpha_std_deg: Positive = 0.03
    q_std_deg_s: Positive = 0.1108
    elevator_std_deg: NonNegative = 0.0
    mach_std: NonNegative = 0.0005
    altitude_std_ft: NonNegative = 10.0
    theta_std_deg: NonNegative = 0.05
    phi_std_deg: NonNegative = 0.05
    nz_std_g: NonNegative = 0.0
    beta_std_deg: Positive = 0.03
    p_std_deg_s: Positive = 0.1108
    r_std_deg_s: Positive = 0.1108
    aileron_std_deg: NonNegative = 0.0
    rudder_std_deg: NonNegative = 0.0
    alpha_bias_deg: float = 0.0
    q_bias_deg_s: float = 0.0
    mach_error: Annotated[float, between(-0.5, 0.5)] = 0.0


class Atmosphere(Settings):
    """MIL-F-8785C turbulence."""

    turbulence: Literal["none", "light", "moderate", "severe"] = "none"


class ModelError(Settings):
    """Errors of the on-board model, unknown to the flight computer.

    Factors on the estimators' C_m_alpha (change from trim), C_m_q and C_m_delta; c.g. (mean chords) and fuel (lb) of the aircraft in
    flight minus those of the aircraft that was trimmed and modelled.
    """

    cm_alpha: Annotated[float, between(0, 10)] = 1.0
    cm_q: Annotated[float, between(0, 10)] = 1.0
    cm_delta: Annotated[float, between(0, 10)] = 1.0
    cg_shift_cbar: Annotated[float, between(-0.5, 0.5)] = 0.0
    fuel_lbs: float = 0.0


class ProcessNoise(Settings):
    """Process noise of a linear aircraft: standard deviations of white alpha rate and pitch acceleration, held for one control tick."""

    alpha_std_deg_s: NonNegative = 0.0
    q_std_deg_s2: NonNegative = 0.0


class Adaptation(Settings):
    """Correction of the law by 1/K-hat of one estimator; ``oracle`` uses the true K, for studies.

    method = "redesign" instead redesigns the laws, which must be lq, for K-hat once the estimator has confirmed a change.
    """

    enabled: bool = False
    method: Literal["divide", "redesign"] = "divide"
    estimator: str = ""
    floor: Annotated[float, between(0, 1, open_low=True)] = 0.08
    feedback: Literal["effective", "position"] = "effective"
    caution: Annotated[float, between(0, 10)] = 0.0
    limit_command: bool = False
    oracle: bool = False


class Scenario(Settings):
    """Complete specification of one flight."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Identifier
    description: str = ""
    duration_s: Annotated[float, between(0, 36000, open_low=True)]
    seed: Annotated[int, between(0, 2**63 - 1)] = 0
    aircraft: AircraftSettings = AircraftSettings()
    condition: Condition = Condition()
    rates: Rates = Rates()
    command: Annotated[CommandSettings, COMMANDS] = Field(default_factory=COMMANDS.make)
    lateral: Lateral = Field(default_factory=Lateral)
    sensors: Sensors = Sensors()
    atmosphere: Atmosphere = Atmosphere()
    gusts: tuple[Annotated[GustSettings, GUSTS], ...] = ()
    model_error: ModelError = ModelError()
    process_noise: ProcessNoise = ProcessNoise()
    failures: tuple[Annotated[FailureSettings, FAILURES], ...] = ()
    control: Control = Control()
    adaptation: Adaptation = Adaptation()
    estimators: tuple[EstimatorSettings, ...] = ()

    @property
    def ticks(self) -> int:
        """Number of control ticks."""
        return round(self.duration_s * self.rates.control_hz)

    @property
    def in_g(self) -> bool:
        """Whether the command is a load factor in g instead of a pitch rate."""
        return self.control.law in LOAD_FACTOR_LAWS

    def with_aircraft(self, model: str, sha256: str) -> Scenario:
        """Return the scenario bound to the aircraft with this path and SHA-256 fingerprint."""
        return self.model_copy(update={"aircraft": self.aircraft.model_copy(update={"model": model, "sha256": sha256})})

    def with_seed(self, seed: int) -> Scenario:
        """Return the scenario with another seed."""
        return self.model_copy(update={"seed": seed})

    def to_toml(self) -> str:
        """Return the scenario as TOML text, with every key written out."""
        return tomli_w.dumps(self.model_dump(mode="json", by_alias=True, exclude_none=True))
