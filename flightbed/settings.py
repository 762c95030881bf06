"""The tables and keys of a scenario, frozen, each with what it may be. The only module that imports pydantic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any, Literal, get_args

import tomli_w
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetPydanticSchema,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)  # fmt: skip
from pydantic import ValidationError as ValidationError
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from flightbed import registry
from flightbed.consistency import contradictions
from flightbed.errors import did_you_mean
from flightbed.options import Options, is_option


def _between(low: float, high: float, *, open_low: bool = False) -> AfterValidator:
    text = f"must be above {low} and at most {high}" if open_low else f"must be between {low} and {high}"

    def check(value: float) -> float:
        if not (low < value if open_low else low <= value) or value > high:
            raise PydanticCustomError("range", "{text}", {"text": text})
        return value

    return AfterValidator(check)


def _registered(family: str) -> AfterValidator:
    def check(value: str) -> str:
        known = registry.names(family)
        if value not in known:
            if problem := registry.outside(value):
                raise PydanticCustomError("outside", "{problem}", {"problem": problem})
            what, near = family.removesuffix("s"), did_you_mean(value, known)
            raise PydanticCustomError(
                "registered",
                "unknown {what}{near}; known: {known}",
                {"what": what, "near": near, "known": ", ".join(known)},
            )
        return value

    return AfterValidator(check)


def _option(value: Any) -> Any:
    if not is_option(value):
        text = "must be text, a finite number, true or false, or a list of these"
        raise PydanticCustomError("option", "{text}", {"text": text})
    return value


def _options(_kind: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
    table = handler.generate_schema(dict[str, Annotated[Any, AfterValidator(_option)]])
    plain = core_schema.no_info_before_validator_function(lambda v: dict(v) if isinstance(v, Options) else v, table)
    written = core_schema.plain_serializer_function_ser_schema(dict)
    return core_schema.no_info_after_validator_function(Options, plain, serialization=written)


Positive = Annotated[float, _between(0, 1000000, open_low=True)]
NonNegative = Annotated[float, _between(0, 1000000)]
Share = Annotated[float, _between(0, 1)]
OwnOptions = Annotated[Options, GetPydanticSchema(_options)]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, populate_by_name=True)


class _OwnTable(_Table):
    """A table that names code, which may be the user's own and then has options of its own."""

    options: OwnOptions = Options()

    @model_serializer(mode="wrap")
    def _without_empty_options(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = write(self)
        return {key: value for key, value in written.items() if key != "options" or value}


class AircraftSettings(_Table):
    """Which aircraft; its fingerprint, if it must be that very one; c.g. shift in mean chords, aft positive."""

    model: str = "f16"
    sha256: str = ""
    cg_shift_cbar: Annotated[float, _between(-0.5, 0.5)] = 0.0


class Condition(_Table):
    """Where the flight starts, trimmed; gamma is the flight-path angle, up positive."""

    mach: Positive = 0.8
    altitude_ft: Annotated[float, _between(0, 60000)] = 20000.0
    gamma_deg: Annotated[float, _between(-60, 60)] = 0.0


class Rates(_Table):
    """The plant rate is an integer multiple of the control rate; a command reaches the actuator delay_ticks control ticks late."""

    control_hz: Annotated[int, _between(10, 1000)] = 100
    plant_hz: Annotated[int, _between(10, 2000)] = 200
    delay_ticks: Annotated[int, _between(0, 100)] = 0

    @model_validator(mode="after")
    def _divide(self) -> Rates:
        if self.plant_hz % self.control_hz:
            raise PydanticCustomError(
                "rates",
                "plant_hz must be an integer multiple of control_hz (got {p} and {c})",
                {"p": self.plant_hz, "c": self.control_hz},
            )
        return self


class Command(_OwnTable):
    """Pitch-rate command and its prefilter w/(s+w); keys that a kind has no use for stay unused."""

    kind: Annotated[str, _registered("commands")] = "doublet"
    amplitude_deg_s: float = 5.0
    period_s: Positive = 4.5
    count: Annotated[int, _between(0, 10000)] = 3
    start_s: NonNegative = 0.0
    low_hz: NonNegative = 0.2
    high_hz: Positive = 2.0
    switch_s: Positive = 0.3
    register_bits: Annotated[int, _between(2, 12)] = 4
    seed: Annotated[int, _between(0, 2**63 - 1)] = 0
    filter_rad_s: NonNegative = 3.0

    @model_validator(mode="before")
    @classmethod
    def _small_dither(cls, raw: Any) -> Any:
        return {"amplitude_deg_s": 0.5, **raw} if isinstance(raw, Mapping) and raw.get("kind") == "dither" else raw


class Sensors(_Table):
    """Standard deviations of white noise, per tick; constant errors that nothing on board knows of (of Mach, a share)."""

    alpha_std_deg: Positive = 0.03
    q_std_deg_s: Positive = 0.1108
    elevator_std_deg: NonNegative = 0.0
    mach_std: NonNegative = 0.0005
    altitude_std_ft: NonNegative = 10.0
    theta_std_deg: NonNegative = 0.05
    phi_std_deg: NonNegative = 0.05
    alpha_bias_deg: float = 0.0
    q_bias_deg_s: float = 0.0
    mach_error: Annotated[float, _between(-0.5, 0.5)] = 0.0


class Atmosphere(_Table):
    """MIL-F-8785C turbulence."""

    turbulence: Literal["none", "light", "moderate", "severe"] = "none"


class ModelError(_Table):
    """What nobody on board knows of.

    Factors on the estimators' C_m_alpha (its change from trim), C_m_q and C_m_delta; c.g. and fuel of the aircraft that flies, less those
    of the aircraft that was trimmed and modelled.
    """

    cm_alpha: Annotated[float, _between(0, 10)] = 1.0
    cm_q: Annotated[float, _between(0, 10)] = 1.0
    cm_delta: Annotated[float, _between(0, 10)] = 1.0
    cg_shift_cbar: Annotated[float, _between(-0.5, 0.5)] = 0.0
    fuel_lbs: float = 0.0


class ProcessNoise(_Table):
    """Of a linear aircraft: standard deviations of an alpha rate and a pitch acceleration, white, each held for one control tick."""

    alpha_std_deg_s: NonNegative = 0.0
    q_std_deg_s2: NonNegative = 0.0


class GustSettings(_Table):
    """Vertical air, up positive, that rises to its peak as 1-cos from at_s on, holds, and falls as it rose."""

    at_s: NonNegative
    up_fps: Annotated[float, _between(-500, 500)]
    rise_s: Positive
    hold_s: NonNegative = 0.0


class Failure(_OwnTable):
    """What fails from at_s on; which other keys a kind needs, and has no use for, says consistency.py."""

    kind: Annotated[str, _registered("failures")] = "effectiveness"
    surface: Literal["elevator"] = "elevator"
    at_s: NonNegative
    to: Share = 1.0
    force_to: Share = 1.0
    over_s: Positive = 2.0
    shift_cbar: Annotated[float, _between(-0.5, 0.5)] = 0.0


class GainSettings(_Table):
    """Gains as they are, summed with the signs of ``control.base.Gains``."""

    alpha: float
    q_s: float
    elevator: float
    reference_s: float
    integral: float = 0.0


class Control(_OwnTable):
    """The law; without poles and gains, near the poles of Sillence's Table 3 (see docs/control.md).

    The law is fed the readings, or alpha and q of the estimator that ``state_from`` names.
    """

    law: Annotated[str, _registered("laws")] = "proportional"
    poles: tuple[tuple[float, float], ...] | None = None
    integral_pole_rad_s: Annotated[float, _between(-100.0, -1e-6)] = -0.5
    gains: GainSettings | None = None
    state_from: str = ""

    @model_validator(mode="after")
    def _stable(self) -> Control:
        if self.poles is not None and any(real >= 0.0 for real, _ in self.poles):
            raise PydanticCustomError(
                "poles", "poles must lie in the left half plane (got {p})", {"p": [list(pole) for pole in self.poles]}
            )
        return self


class Adaptation(_Table):
    """Correction by 1/K-hat, from one of the estimators; the oracle is told the true K, for studies."""

    enabled: bool = False
    estimator: str = ""
    floor: Annotated[float, _between(0, 1, open_low=True)] = 0.08
    feedback: Literal["effective", "position"] = "effective"
    caution: Annotated[float, _between(0, 10)] = 0.0
    limit_command: bool = False
    oracle: bool = False


class Prior(_Table):
    """What a filter starts from; state = "measurement" starts alpha and q from the readings.

    A fixed state holds at the sample at which a filter starts; the reading of that sample corrects it, or is left out.
    """

    state: Literal["measurement", "fixed"] = "measurement"
    first_reading: Literal["left-out", "used"] = "left-out"
    alpha_deg: float = 0.0
    q_deg_s: float = 0.0
    alpha_std_deg: Positive = 1.0
    q_std_deg_s: Positive = 1.0
    effectiveness: Share = 1.0
    effectiveness_std: Positive = 0.63


# What a loop-gain estimator is without a word about it: by the model that it works on. On the short period it is the thesis's.
_BY_MODEL = MappingProxyType(
    {
        "short-period": MappingProxyType(
            {
                "alarm_threshold": 0.0,
                "follow_disturbances": False,
                "hold_std": 0.0,
                "alpha_disturbance_deg_s": 0.6,
                "q_disturbance_deg_s2": 6.0,
            }
        )
    }
)


class EstimatorSettings(_OwnTable):
    """One estimator; several may run side by side, at most one adapts. The defaults of some keys depend on the model."""

    name: Identifier
    kind: Annotated[str, _registered("estimators")] = "loop-gain"
    model: Literal["scheduled", "short-period"] = "scheduled"
    input: Literal["absolute", "deviation"] = "absolute"
    input_at: Literal["mean", "start", "end"] = "mean"
    memory: Literal["window", "expanding", "fading"] = "window"
    window: Annotated[int, _between(2, 10000)] = 30
    forgetting: Annotated[float, _between(0.5, 1)] = 0.98
    smoothing: Annotated[float, _between(0, 0.9999)] = 0.9
    bounds: tuple[float, float] = (0.0, 1.0)
    alarm_threshold: NonNegative = 30.0
    follow_disturbances: bool = True
    hold_std: NonNegative = 0.3
    alpha_disturbance_deg_s: NonNegative = 0.05
    q_disturbance_deg_s2: NonNegative = 0.3
    prior: Prior = Prior()

    @model_validator(mode="before")
    @classmethod
    def _by_model(cls, raw: Any) -> Any:
        return {**_BY_MODEL.get(str(raw.get("model")), {}), **raw} if isinstance(raw, Mapping) else raw

    @model_validator(mode="after")
    def _ordered(self) -> EstimatorSettings:
        if self.bounds[0] >= self.bounds[1]:
            raise PydanticCustomError("bounds", "bounds must rise (got {b})", {"b": list(self.bounds)})
        return self


class Scenario(_Table):
    """One flight, completely."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Identifier
    description: str = ""
    duration_s: Annotated[float, _between(0, 36000, open_low=True)]
    seed: Annotated[int, _between(0, 2**63 - 1)] = 0
    aircraft: AircraftSettings = AircraftSettings()
    condition: Condition = Condition()
    rates: Rates = Rates()
    command: Command = Command()
    sensors: Sensors = Sensors()
    atmosphere: Atmosphere = Atmosphere()
    gusts: tuple[GustSettings, ...] = ()
    model_error: ModelError = ModelError()
    process_noise: ProcessNoise = ProcessNoise()
    failures: tuple[Failure, ...] = ()
    control: Control = Control()
    adaptation: Adaptation = Adaptation()
    estimators: tuple[EstimatorSettings, ...] = ()

    @property
    def ticks(self) -> int:
        """Number of control ticks."""
        return round(self.duration_s * self.rates.control_hz)

    @model_validator(mode="after")
    def _consistent(self) -> Scenario:
        if problems := contradictions(self):
            raise PydanticCustomError("consistency", "{problems}", {"problems": "\n".join(problems)})
        return self

    def with_aircraft(self, model: str, sha256: str) -> Scenario:
        """Return the scenario bound to one very aircraft."""
        return self.model_copy(update={"aircraft": self.aircraft.model_copy(update={"model": model, "sha256": sha256})})

    def with_seed(self, seed: int) -> Scenario:
        """Return the scenario with another seed."""
        return self.model_copy(update={"seed": seed})

    def to_toml(self) -> str:
        """Return the scenario with every key written out."""
        return tomli_w.dumps(self.model_dump(mode="json", by_alias=True, exclude_none=True))


def known_keys(loc: Sequence[int | str]) -> list[str]:
    """Return the keys of the table at a place in the scenario."""
    model: Any = Scenario
    for part in loc:
        if isinstance(part, int):
            continue
        field = next(f for n, f in model.model_fields.items() if part in (n, f.alias))
        inner = [
            a
            for a in (field.annotation, *get_args(field.annotation))
            if isinstance(a, type) and issubclass(a, BaseModel)
        ]
        model = inner[0]
    return [f.alias or n for n, f in model.model_fields.items()]
