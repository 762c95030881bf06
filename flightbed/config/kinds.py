"""Tables of the kinds: commands, failures, gusts, laws and estimators, each key with its range."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

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
from flightbed.core.units import DEG, unit_of


class Surroundings(NamedTuple):
    """Settings of a scenario on which checks of its kinds depend."""

    control_hz: int
    lateral: bool  # aileron and rudder are commanded
    in_g: bool  # the command is a load factor
    law: str  # of pitch


class Kind(Settings):
    """Base class of the settings of a kind; the keys of a subclass are those of one kind."""

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:  # noqa: ARG002
        """Return conflicts between keys, one line each, as "place.key: problem (got value)"; ``place`` is that of the table."""
        return []

    def idle(self, place: str, surroundings: Surroundings) -> dict[str, str]:  # noqa: ARG002
        """Return key without effect -> the setting outside this table that disables it. ``only_with`` states those inside it."""
        return {}


class Identification(Settings):
    """Online identification of the law nz-adaptive: PLID's prior and noise variances (g^2), and filters of gains and command (rad/s).

    Kemp's thesis uses prior = "thesis", prior_var = 1 and neither filter.
    """

    prior: Literal["linearization", "thesis"] = "linearization"
    prior_var: Positive = 1e-3
    process_var: Positive = 0.01
    output_var: NonNegative = 1e-8
    block_fade: Annotated[float, between(1, 2)] = 1.001
    form: Literal["factored", "plain"] = "factored"
    precision: Literal["double", "single"] = "double"
    patience: Annotated[int, between(0, 100000)] = 0
    gain_filter_rad_s: NonNegative = 5.0
    command_filter_rad_s: NonNegative = 0.0


class Autothrottle(Settings):
    """Bang-bang autothrottle of flights commanded in g; it holds the initial true airspeed.

    With then_fps > 0 it holds then_fps (ft/s) from then_at_s on. Throttle settings are normalized, 0 to 1.
    """

    enabled: bool = False
    low_norm: Share = 0.1
    high_norm: Share = 1.0
    then_fps: NonNegative = 0.0
    then_at_s: NonNegative = 0.0


LOAD_FACTOR_LAWS = ("nz-adaptive", "nz-scheduled")  # commanded in g


AMPLITUDES = ("amplitude_deg_s", "amplitude_g", "amplitude_deg")  # of a rate, of a load factor, of an angle


class CommandSettings(Kind):
    """A command over time, and its prefilter w/(s + w)."""

    kind: str = "doublet"
    """Shape over time."""
    filter_rad_s: NonNegative = 3.0
    """Bandwidth w of the prefilter; 0 passes the command unfiltered."""

    def build(self, amplitude_rad_s: float) -> Any:
        """Return the command over time with this amplitude: a function from times, s, to values in the unit of the amplitude, arrays."""
        raise NotImplementedError

    def rate(self) -> Any:
        """Return the commanded rate over time, rad/s."""
        return self.build(0.0)

    def load_factor(self) -> Any:
        """Return the commanded increment of the load factor over time, g."""
        return self.build(0.0)

    def angle(self) -> Any:
        """Return the commanded angle over time, rad."""
        return self.build(0.0)

    def in_words(self, amplitude: str) -> str:
        """Return kind, keys and prefilter in words; ``amplitude`` is the key of AMPLITUDES that acts."""
        used = self._used(amplitude)
        suffixes = {"deg/s": "_deg_s", "deg": "_deg", "s": "_s", "Hz": "_hz", "g": "_g"}
        words = [self.kind]
        for key, value in sorted(used.items(), key=lambda item: not item[0].startswith("amplitude")):
            unit = unit_of(key) if unit_of(key) in suffixes else ""
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            words.append(f"{key.removesuffix(suffixes.get(unit, '')).replace('_', ' ')} {shown} {unit}".strip())
        return f"{', '.join(words)}; prefilter {self.filter_rad_s:g} rad/s"

    def _used(self, amplitude: str) -> dict[str, Any]:
        """Return the keys that ``in_words`` lists."""
        left_out = {"kind", "filter_rad_s", *AMPLITUDES} - {amplitude}
        return self.model_dump(exclude=left_out)


class ShapedCommand(CommandSettings):
    """A command with an amplitude; each place has one of the amplitudes, the pitch command two of them."""

    amplitude_deg_s: float = 5.0
    """Peak of a commanded rate."""
    amplitude_g: float = 1.0
    """Peak of a commanded load factor: increment over level flight, up positive."""
    amplitude_deg: float = 2.0
    """Peak of a commanded angle."""

    def rate(self) -> Any:
        """Return the commanded rate over time, rad/s."""
        return self._made(self.amplitude_deg_s)

    def load_factor(self) -> Any:
        """Return the commanded increment of the load factor over time, g."""
        return self._made(self.amplitude_g / DEG)

    def angle(self) -> Any:
        """Return the commanded angle over time, rad."""
        return self._made(self.amplitude_deg)

    def _made(self, amplitude_deg_s: float) -> Any:
        return self.build(amplitude_deg_s * DEG)

    def idle(self, place: str, surroundings: Surroundings) -> dict[str, str]:
        """Return the amplitude of the pitch command that does not act: the law is commanded either in deg/s or in g."""
        if place != "command":
            return {}
        key = "amplitude_deg_s" if surroundings.in_g else "amplitude_g"
        return {f"{place}.{key}": f"control.law = '{surroundings.law}'"}


class PlainCommand(OwnSettings, ShapedCommand):
    """A command of own code: a function (settings) -> command over time; ``settings.amplitude_deg_s`` is its amplitude in every place."""

    start_s: NonNegative = 0.0
    """Start."""
    period_s: Positive = 4.5
    """Period."""
    count: Annotated[int, between(0, 10000)] = 3
    """Number of periods."""

    def build(self, amplitude_rad_s: float) -> Any:
        """Return the command over time."""
        return self._made(amplitude_rad_s / DEG)

    def _made(self, amplitude_deg_s: float) -> Any:
        given = self.model_copy(update={"amplitude_deg_s": amplitude_deg_s})
        return families.factory("commands", self.kind)(given)

    def _used(self, amplitude: str) -> dict[str, Any]:  # noqa: ARG002
        """Return the keys that are set, and the options: which keys the code reads is not known."""
        written = self.model_dump(include=self.model_fields_set - {"kind", "filter_rad_s", "options"})
        return {**written, **self.options}


COMMANDS = Family("commands", CommandSettings, PlainCommand, default="doublet", without=("amplitude_deg",))
ROLL_COMMANDS = Family(
    "commands", CommandSettings, PlainCommand, default="none", without=("amplitude_g", "amplitude_deg")
)
SIDESLIP_COMMANDS = Family(
    "commands", CommandSettings, PlainCommand, default="none", without=("amplitude_g", "amplitude_deg_s")
)


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


class FailureSettings(Kind):
    """A failure from at_s on."""

    kind: str = "effectiveness"
    """Kind of failure."""
    at_s: NonNegative
    """Onset; the failure acts from the first tick at or after it."""

    @property
    def actuator(self) -> str | None:
        """Surface whose actuator is faulty; None for other failures."""
        return None

    @property
    def actuator_property(self) -> str | None:
        """Property of the overlay through which the fault of the actuator acts, such as "elevator_stuck"; None for other failures."""
        return None

    @property
    def moves_cg(self) -> bool:
        """Whether the c.g. moves in flight."""
        return False

    def build(self, before: Any, control_hz: int) -> Any:
        """Return the health as a function of the tick, with this failure added to the function ``before``."""
        raise NotImplementedError

    def in_words(self) -> str:
        """Return what happens at ``at_s``, as in "at 3 s the elevator ..."."""
        return f"the failure '{self.kind}' begins"


class SurfaceFailure(FailureSettings):
    """A failure of a control surface."""

    surface: Literal["elevator", "aileron", "rudder"] = "elevator"
    """Surface that fails."""

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:
        """Return the problem of a surface that the flight computer does not command."""
        if self.surface == "elevator" or surroundings.lateral:
            return []
        return [
            f"{place}.surface: the stock laws control aileron and rudder (got '{self.surface}'); set lateral.enabled to true"
        ]


class PlainFailure(OwnSettings, SurfaceFailure):
    """A failure of own code: a function (settings, before, control_hz) -> health as a function of the tick."""

    to: Share = 1.0
    """Remaining share."""

    def build(self, before: Any, control_hz: int) -> Any:
        """Return the health as a function of the tick, with this failure added."""
        return families.factory("failures", self.kind)(self, before, control_hz)


FAILURES = Family("failures", FailureSettings, PlainFailure, default="effectiveness")


class GainSettings(Settings):
    """Given gains of the pitch law, with the signs of ``control.base.Gains``."""

    alpha: float
    q_s: float
    elevator: float
    reference_s: float
    integral: float = 0.0


class PitchWeights(Settings):
    """Weights of the law lq by Bryson's rule: these deviations of alpha, q and elevator cost the same."""

    alpha_deg: Positive = 3.0
    q_deg_s: Positive = 3.0
    elevator_deg: Positive = 3.0


class Control(OwnSettings):
    """The control law; without poles and gains it is designed near the poles of Sillence's Table 3 (see docs/control.md).

    The law reads the sensors, or alpha and q of the estimator named by ``state_from``.
    """

    law: Annotated[str, registered("laws")] = "proportional"
    poles: tuple[tuple[float, float], ...] | None = None
    integral_pole_rad_s: Annotated[float, between(-100.0, -1e-6)] = -0.5
    gains: GainSettings | None = None
    weights: PitchWeights = PitchWeights()
    identification: Identification = Identification()
    autothrottle: Autothrottle = Autothrottle()
    state_from: str = ""

    @model_validator(mode="after")
    def _stable(self) -> Control:
        if self.poles is not None and any(real >= 0.0 for real, _ in self.poles):
            raise PydanticCustomError(
                "poles", "poles must lie in the left half plane (got {p})", {"p": [list(pole) for pole in self.poles]}
            )
        return self


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
