"""Tables of the kinds: commands, failures, gusts, laws and estimators, each key with its range."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

from flightbed.config import families
from flightbed.config.family import Family
from flightbed.config.options import Options
from flightbed.config.table import (
    Identifier,
    NonNegative,
    OwnOptions,
    OwnSettings,
    Positive,
    PydanticCustomError,
    Settings,
    Share,
    between,
    model_validator,
    registered,
)
from flightbed.core.units import DEG


class Surroundings(NamedTuple):
    """Settings of a scenario on which checks of its kinds depend."""

    control_hz: int
    lateral: bool  # aileron and rudder are commanded
    in_g: bool  # the command is a load factor


class Kind(Settings):
    """Base class of the settings of a kind; the keys of a subclass are those of one kind."""

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:  # noqa: ARG002
        """Return conflicts between keys, one line each, as "place.key: problem (got value)"; ``place`` is that of the table."""
        return []

    def idle(self, place: str, surroundings: Surroundings) -> dict[str, str]:  # noqa: ARG002
        """Return key without effect -> the setting outside this table that disables it. ``only_with`` states those inside it."""
        return {}


class _Shape(OwnSettings):
    kind: Annotated[str, registered("commands")] = "doublet"
    period_s: Positive = 4.5
    count: Annotated[int, between(0, 10000)] = 3
    start_s: NonNegative = 0.0
    low_hz: NonNegative = 0.2
    high_hz: Positive = 2.0
    switch_s: Positive = 0.3
    register_bits: Annotated[int, between(2, 12)] = 4
    seed: Annotated[int, between(0, 2**63 - 1)] = 0
    filter_rad_s: NonNegative = 3.0


class _RateCommand(_Shape):
    amplitude_deg_s: float = 5.0

    @model_validator(mode="before")
    @classmethod
    def _small_dither(cls, raw: Any) -> Any:
        return {"amplitude_deg_s": 0.5, **raw} if isinstance(raw, Mapping) and raw.get("kind") == "dither" else raw


class Command(_RateCommand):
    """Pitch-rate or load-factor command and its prefilter w/(s+w); each kind ignores the keys that it does not need."""

    amplitude_g: float = 1.0

    def in_g(self) -> Command:
        """Return a command whose pitch rate in rad/s equals this command's increment in g."""
        return self.model_copy(update={"amplitude_deg_s": self.amplitude_g / DEG})


class RollCommand(_RateCommand):
    """Roll-rate command and its prefilter, with the keys of Command; the default kind is "none"."""

    kind: Annotated[str, registered("commands")] = "none"

    def as_command(self) -> Command:
        """Return the equivalent Command."""
        return Command(**{key: getattr(self, key) for key in _RateCommand.model_fields})


class SideslipCommand(_Shape):
    """Sideslip command in degrees and its prefilter, with the shapes of Command; the default kind is "none"."""

    kind: Annotated[str, registered("commands")] = "none"
    amplitude_deg: float = 2.0

    def as_command(self) -> Command:
        """Return a Command whose pitch rate in deg/s equals this sideslip in deg."""
        shape = {key: getattr(self, key) for key in _Shape.model_fields}
        return Command(**shape, amplitude_deg_s=self.amplitude_deg)


class GustSettings(Kind):
    """A vertical gust."""

    shape: str = "1-cos"
    """Shape over time."""
    at_s: NonNegative
    """Start."""
    up_fps: Annotated[float, between(-500, 500)]
    """Vertical speed of the air at the peak, up positive."""

    def build(self, before: Any) -> Any:
        """Return the vertical speed of the air over time, m/s, with this gust added to the function ``before``."""
        raise NotImplementedError

    def in_words(self) -> str:
        """Return what happens at ``at_s``, as in "at 2 s a gust ..."."""
        return f"the gust '{self.shape}' begins"


class PlainGust(GustSettings):
    """A gust of own code: a function (settings, before) -> vertical speed of the air over time."""

    options: OwnOptions = Options()
    """Its own settings."""

    def build(self, before: Any) -> Any:
        """Return the vertical speed of the air over time, m/s, with this gust added."""
        return families.factory("gusts", self.shape)(self, before)


GUSTS = Family("gusts", GustSettings, PlainGust, key="shape", default="1-cos")


class Failure(OwnSettings):
    """A failure from at_s on; ``scenario/checks.py`` lists the keys that each kind needs or ignores."""

    kind: Annotated[str, registered("failures")] = "effectiveness"
    surface: Literal["elevator", "aileron", "rudder"] = "elevator"
    at_s: NonNegative
    to: Share = 1.0
    force_to: Share = 1.0
    over_s: Positive = 2.0
    side: Literal["low", "high"] = "high"
    bias_deg: Annotated[float, between(-60, 60)] = 0.0
    shift_cbar: Annotated[float, between(-0.5, 0.5)] = 0.0


class LawSettings(Kind):
    """A control law. It reads the sensors, or alpha and q of an estimator."""

    in_g: ClassVar[bool] = False  # the command is a load factor in g; otherwise a pitch rate
    can_redesign: ClassVar[bool] = False  # the gains can be computed again for another K, see ``gains_at``
    identifies: ClassVar[bool] = False  # the law identifies its own model, so no estimator corrects it
    reads_accelerometer: ClassVar[bool] = True

    law: str = "proportional"
    """Name of the law."""
    state_from: str = ""
    """Name of the estimator that supplies alpha and q of the law; empty: the readings."""

    @property
    def times(self) -> Mapping[str, float]:
        """Key -> its time in s, of the keys that act at a time of the flight."""
        return {}

    def build(self, design: Any, control_hz: int) -> Any:
        """Return a new law: a ``control.base.Law`` for a short period, or with ``in_g`` a ``LoadFactorLaw`` for a LoadFactorDesign.

        Raises:
            DesignError: the law cannot be designed.

        """
        raise NotImplementedError

    def gains_at(self, design: Any, control_hz: int, effectiveness: float) -> Any:
        """Return the ``control.base.Gains`` of a law with ``can_redesign`` at a given K. Raises DesignError."""
        raise NotImplementedError

    def throttle(self, *, airspeed_m_s: float, control_hz: int) -> Any:  # noqa: ARG002
        """Return the autothrottle of a law with ``in_g``; None if the throttle stays at trim."""
        return None


class PoleSettings(LawSettings):
    """A law that is designed by pole placement."""

    poles: tuple[tuple[float, float], ...] | None = None
    """Poles of the closed loop, [re, im]; without them those of docs/control.md."""

    @model_validator(mode="after")
    def _stable(self) -> Self:
        if self.poles is not None and any(real >= 0.0 for real, _ in self.poles):
            raise PydanticCustomError(
                "poles", "poles must lie in the left half plane (got {p})", {"p": [list(pole) for pole in self.poles]}
            )
        return self

    def wanted_poles(self) -> list[complex] | None:
        """Return the poles, rad/s; None for the default poles."""
        return None if self.poles is None else [complex(re, im) for re, im in self.poles]


class GainSettings(Settings):
    """Given gains of the pitch law, with the signs of ``control.base.Gains``."""

    alpha: float
    """Gain of the angle of attack."""
    q_s: float
    """Gain of the pitch rate."""
    elevator: float
    """Gain of the elevator's position."""
    reference_s: float
    """Gain of the reference."""


class IntegralGainSettings(GainSettings):
    """Given gains of the pitch law with an integral."""

    integral: float = 0.0
    """Gain of the integral of reference minus pitch rate."""


class GainOrPoleSettings(PoleSettings):
    """A law with given gains, or designed by pole placement."""

    gains: GainSettings | None = None
    """Gains, which replace the design."""

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:  # noqa: ARG002
        """Return the problem of gains together with poles."""
        if self.gains is None or self.poles is None:
            return []
        return [f"{place}.poles: cannot be combined with {place}.gains, which replace the design; give one of them"]


class PlainLaw(GainOrPoleSettings, OwnSettings):
    """A law of own code: a class or function (settings, design, control_hz) -> Law."""

    gains: IntegralGainSettings | None = None

    def build(self, design: Any, control_hz: int) -> Any:
        """Return a new law."""
        return families.factory("laws", self.law)(self, design, control_hz)


LAWS = Family("laws", LawSettings, PlainLaw, key="law", default="proportional")


class Prior(Settings):
    """Prior of a filter; state = "measurement" initializes alpha and q from the readings.

    A fixed state is the prior at the first sample of the filter; ``first_reading`` decides whether the reading of that sample corrects it.
    """

    state: Literal["measurement", "fixed"] = "measurement"
    first_reading: Literal["left-out", "used"] = "left-out"
    alpha_deg: float = 0.0
    q_deg_s: float = 0.0
    alpha_std_deg: Positive = 1.0
    q_std_deg_s: Positive = 1.0
    effectiveness: Share = 1.0
    effectiveness_std: Positive = 0.63


# Defaults of a loop-gain estimator that depend on its model. On the short period they are those of Sillence's thesis.
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


# Defaults that depend on the kind: the two-stage filter has no window, and its test averages few samples; the test of a reconstruction
# averages more.
_BY_KIND = MappingProxyType(
    {
        "two-stage": MappingProxyType({"memory": "variable", "window": 3}),
        "retrospective-cost": MappingProxyType({"window": 45}),
        "input-kalman": MappingProxyType({"window": 45}),
    }
)


class EstimatorSettings(OwnSettings):
    """One estimator; several may run side by side, at most one corrects the law. Some defaults depend on the kind and the model."""

    name: Identifier
    kind: Annotated[str, registered("estimators")] = "loop-gain"
    model: Literal["scheduled", "short-period"] = "scheduled"
    input: Literal["absolute", "deviation"] = "absolute"
    input_at: Literal["mean", "start", "end"] = "mean"
    memory: Literal["window", "expanding", "fading", "variable"] = "window"
    window: Annotated[int, between(2, 10000)] = 30
    forgetting: Annotated[float, between(0.5, 1)] = 0.98
    smoothing: Annotated[float, between(0, 0.9999)] = 0.9
    bounds: tuple[float, float] = (0.0, 1.0)
    alarm_threshold: NonNegative = 30.0
    follow_disturbances: bool = True
    hold_std: NonNegative = 0.3
    alpha_disturbance_deg_s: NonNegative = 0.05
    q_disturbance_deg_s2: NonNegative = 0.3
    beta_disturbance_deg_s: NonNegative = 0.05
    p_disturbance_deg_s2: NonNegative = 1.0
    r_disturbance_deg_s2: NonNegative = 0.3
    variance_min: Positive = 2e-5
    variance_max: Positive = 1.0
    walk_std: NonNegative = 1e-4
    false_alarm: Annotated[float, between(0, 0.5, open_low=True)] = 1e-6
    block_fade: Annotated[float, between(1, 2)] = 1.01
    form: Literal["factored", "plain"] = "factored"
    precision: Literal["double", "single"] = "double"
    unknown: Literal["elevator", "gust"] = "elevator"
    order: Annotated[int, between(1, 20)] = 4
    horizon: Annotated[int, between(1, 20)] = 6
    regularization: NonNegative = 1.0
    initial_covariance: Positive = 0.01
    input_forgetting: Annotated[float, between(0.5, 1)] = 1.0
    saturation_deg: Positive = 30.0
    input_step_deg: Positive = 0.1
    offset_deg: Positive = 0.3
    prior: Prior = Prior()

    @model_validator(mode="before")
    @classmethod
    def _by_model(cls, raw: Any) -> Any:
        if not isinstance(raw, Mapping):
            return raw
        return {**_BY_MODEL.get(str(raw.get("model")), {}), **_BY_KIND.get(str(raw.get("kind")), {}), **raw}

    @model_validator(mode="after")
    def _ordered(self) -> EstimatorSettings:
        if self.bounds[0] >= self.bounds[1]:
            raise PydanticCustomError("bounds", "bounds must rise (got {b})", {"b": list(self.bounds)})
        return self
