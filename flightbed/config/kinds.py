"""Tables of the kinds: commands, failures, gusts, laws and estimators, each key with its range."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

from flightbed.config import families
from flightbed.config.family import Family
from flightbed.config.table import (
    Identifier,
    ModelWrapValidatorHandler,
    NonNegative,
    OwnSettings,
    Positive,
    PydanticCustomError,
    Settings,
    Share,
    between,
    example,
    model_validator,
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

    def idle(self, place: str, surroundings: Surroundings) -> dict[str, str]:  # noqa: ARG002
        """Return nothing: which keys the code reads is not known."""
        return {}

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
    at_s: Annotated[NonNegative, example(4.5)]
    """Start."""
    up_fps: Annotated[float, between(-500, 500), example(20.0)]
    """Vertical speed of the air at the peak, up positive."""

    def build(self, before: Any) -> Any:
        """Return the vertical speed of the air over time, m/s, with this gust added to the function ``before``."""
        raise NotImplementedError

    def in_words(self) -> str:
        """Return what happens at ``at_s``, as in "at 2 s a gust ..."."""
        return f"the gust '{self.shape}' begins"


class PlainGust(OwnSettings, GustSettings):
    """A gust of own code: a function (settings, before) -> vertical speed of the air over time."""

    def build(self, before: Any) -> Any:
        """Return the vertical speed of the air over time, m/s, with this gust added."""
        return families.factory("gusts", self.shape)(self, before)


GUSTS = Family("gusts", GustSettings, PlainGust, key="shape", default="1-cos")


class FailureSettings(Kind):
    """A failure from at_s on."""

    kind: str = "effectiveness"
    """Kind of failure."""
    at_s: Annotated[NonNegative, example(4.5)]
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
    """Surface that fails; aileron and rudder need lateral.enabled."""

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
    """Three poles of the closed loop, [re, im] in rad/s, in the left half plane, instead of those of docs/control.md."""

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


class EffectivenessPrior(Settings):
    """Prior of the effectiveness K."""

    effectiveness: Share = 1.0
    """Mean of K."""
    effectiveness_std: Positive = 0.63
    """Standard deviation of K."""


class EstimatorSettings(Kind):
    """One estimator; several may run side by side, at most one corrects the law.

    A subclass has ``kind: Literal["..."]``, or no further ``kind`` in code outside flightbed, its own keys, and ``build``.
    """

    on_short_period: ClassVar[Mapping[str, Any]] = MappingProxyType({})  # defaults with model = "short-period"
    reads_accelerometer: ClassVar[bool] = True

    name: Identifier
    """Name in ``adaptation.estimator``, the trace and the reports."""
    kind: str = "loop-gain"
    """Algorithm."""
    model: Literal["scheduled", "short-period"] = "scheduled"
    """Model on board: the schedule over Mach number and angle of attack, or the short period at the trim point."""
    smoothing: Annotated[float, between(0, 0.9999)] = 0.9
    """s of the smoothed K-hat, s times the last one plus 1 - s times K-hat; it starts at 1."""
    bounds: tuple[float, float] = (0.0, 1.0)
    """Least and greatest K-hat."""

    @model_validator(mode="wrap")
    @classmethod
    def _by_model(cls, raw: Any, read: ModelWrapValidatorHandler[Self]) -> Self:
        if not isinstance(raw, Mapping) or raw.get("model") != "short-period":
            return read(raw)
        more = {key: value for key, value in cls.on_short_period.items() if key not in raw}
        made = read({**raw, **more})
        made.model_fields_set.difference_update(more)  # these are defaults
        return made

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.bounds[0] >= self.bounds[1]:
            raise PydanticCustomError("bounds", "bounds must rise (got {b})", {"b": list(self.bounds)})
        return self

    @property
    def needs_schedule(self) -> bool:
        """Whether the model on board is the schedule, which a linear aircraft does not have."""
        return self.model == "scheduled"

    @property
    def detects_changes(self) -> bool:
        """Whether it has a test for a change of K."""
        return False

    @property
    def corrects(self) -> bool:
        """Whether it estimates the elevator's effectiveness, so that its estimate can correct the law."""
        return True

    @property
    def constant_over(self) -> int | None:
        """Ticks over which it takes K as constant, for the Cramer-Rao bound beside its errors; None: all since the start."""
        return 30

    def estimates(self, *, lateral: bool) -> tuple[str, ...]:  # noqa: ARG002
        """Return the surfaces whose effectiveness it estimates; ``lateral``: aileron and rudder are commanded."""
        return ("elevator",)

    def build(self, onboard: Any) -> Any:
        """Return the estimator, an ``estimation.base.Estimator`` or ``SurfacesEstimator``, for an ``avionics.onboard.OnBoard``."""
        raise NotImplementedError


class PlainEstimator(OwnSettings, EstimatorSettings):
    """An estimator of own code: a class or function (settings, onboard) -> object with ``update``."""

    prior: EffectivenessPrior = EffectivenessPrior()
    """Prior of K."""

    def build(self, onboard: Any) -> Any:
        """Return the estimator."""
        return families.factory("estimators", self.kind)(self, onboard)


ESTIMATORS = Family("estimators", EstimatorSettings, PlainEstimator, default="loop-gain")
