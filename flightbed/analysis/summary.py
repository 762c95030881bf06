"""RunSummary: the numbers of one flight, as ``metrics.json`` stores them.

Reports, text summary, events, terminal, viewer and comparison read its attributes; only ``to_dict`` and ``from_dict`` name the file's keys.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from math import isfinite
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from flightbed.analysis.metrics import EstimatorMetrics, Metrics
from flightbed.analysis.punctuality import Punctuality, Spread
from flightbed.control.base import Gains

T = TypeVar("T")
Ending = Literal["departed", "ground", "time"]


@dataclass(frozen=True)
class TrimSummary:
    """Trim point of a flight.

    Attributes:
        alpha_deg: angle of attack, deg.
        elevator_deg: elevator deflection, deg, trailing edge down positive.
        throttle_norm: throttle, 0 to 1.
        residual: largest acceleration that remains, g and rad/s^2.

    """

    alpha_deg: float
    elevator_deg: float
    throttle_norm: float
    residual: float


@dataclass(frozen=True)
class ShortPeriodSummary:
    """Short-period model x' = A x + b u at the trim point, x = (alpha, q), u the elevator; rad and s.

    Attributes:
        A: (2, 2), rows.
        b: (2,).
        poles_rad_s: eigenvalues of A, rad/s.

    """

    A: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    poles_rad_s: tuple[complex, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return nested plain values; each pole is a list of real and imaginary part."""
        return {
            "A": [list(row) for row in self.A],
            "b": list(self.b),
            "poles_rad_s": [[pole.real, pole.imag] for pole in self.poles_rad_s],
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> ShortPeriodSummary:
        """Return the model that ``to_dict`` stored. Raises KeyError."""
        poles = tuple(complex(real, imaginary) for real, imaginary in values["poles_rad_s"])
        return cls(tuple(map(tuple, values["A"])), tuple(values["b"]), poles)


@dataclass(frozen=True)
class MarginSummary:
    """Stability margins of the loops before the flight.

    Attributes:
        elevator: smallest and largest true K of the elevator with a stable pitch loop; None for a law without known gains.
        aileron_and_rudder: largest error of K-hat of aileron and rudder, as a share of K-hat, with stable roll and yaw; None where they
            are not commanded.

    """

    elevator: tuple[float, float] | None = None
    aileron_and_rudder: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values; a margin that is not defined has no key."""
        elevator = {} if self.elevator is None else {"elevator": list(self.elevator)}
        turning = {} if self.aileron_and_rudder is None else {"aileron_and_rudder": self.aileron_and_rudder}
        return {**elevator, **turning}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> MarginSummary:
        """Return the margins that ``to_dict`` stored."""
        elevator = values.get("elevator")
        return cls(None if elevator is None else (elevator[0], elevator[1]), values.get("aileron_and_rudder"))


@dataclass(frozen=True)
class ExtensionSummary:
    """Code from outside flightbed that flew.

    Attributes:
        name: ``module:Attribute``, ``file.py:Attribute``, or the name given to ``flightbed.using``.
        sha256: of its source; None where the source is not known.
        imports: path -> sha256 of the files that it imports from its own folder or package.

    """

    name: str
    sha256: str | None
    imports: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class RunSummary:
    """Numbers of one flight, in the order of ``metrics.json``.

    Attributes:
        scenario: name of the scenario.
        seed: of the scenario.
        metrics: tracking and estimation; its keys stand at the top level of the file.
        snr_db: signal to noise ratio before the failure, Sillence eq (82), dB; None without a signal.
        ended: end of the flight: departure, ground, or the duration of the scenario.
        failed_at_s: time of the first failure of any kind that the flight reached, s; None without one.
        flown_s: duration of the flight, s.
        elevator_at_stop_share: share of the ticks with the command cut at a stop; None in files written before it was stored.
        bank_max_deg: largest bank, deg; None in files written before it was stored.
        trim: trim point.
        short_period: design model.
        gains: of the pitch law; None for a law without known gains.
        extensions: code from outside flightbed.
        aircraft_sha256: fingerprint of the aircraft.
        wall_time_s: time that the flight took, s.
        real_time_factor: flown_s over wall_time_s.
        realtime: real-time performance; None for a flight that was not paced.
        versions: package -> version.
        source_sha256: of all Python sources of flightbed; None in files written before it was stored.
        environment: all else that decides the last digits: CPU features, libc, BLAS kernels; empty in older files.
        plug_ins: kinds of installed packages that flew -> SHA-256 of their sources.
        margins: stability margins before the flight.
        others: keys of a file that this version does not know, with their values.

    """

    scenario: str
    seed: int
    metrics: Metrics
    snr_db: float | None
    ended: Ending
    failed_at_s: float | None
    flown_s: float
    elevator_at_stop_share: float | None = None
    bank_max_deg: float | None = None
    trim: TrimSummary
    short_period: ShortPeriodSummary
    gains: Gains | None = None
    extensions: tuple[ExtensionSummary, ...] = ()
    aircraft_sha256: str
    wall_time_s: float
    real_time_factor: float
    realtime: Punctuality | None = None
    versions: Mapping[str, str]
    source_sha256: str | None = None
    environment: Mapping[str, str] = field(default_factory=dict)
    plug_ins: Mapping[str, str | None] = field(default_factory=dict)
    margins: MarginSummary = field(default_factory=MarginSummary)
    others: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ended_s(self) -> float:
        """Flight time of the end, s: of the departure if there is one."""
        return self.flown_s if self.metrics.departed_at_s is None else self.metrics.departed_at_s

    @property
    def own_code(self) -> tuple[str, ...]:
        """Names of the code from outside flightbed that flew."""
        return tuple(extension.name for extension in self.extensions)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of metrics.json: nested plain values."""
        return {
            "scenario": self.scenario,
            "seed": self.seed,
            **self.metrics.to_dict(),
            "snr_db": self.snr_db,
            "ended": self.ended,
            "failed_at_s": self.failed_at_s,
            "flown_s": self.flown_s,
            "elevator_at_stop_share": self.elevator_at_stop_share,
            "bank_max_deg": self.bank_max_deg,
            "trim": asdict(self.trim),
            "short_period": self.short_period.to_dict(),
            "gains": {} if self.gains is None else asdict(self.gains),
            "extensions": [asdict(extension) for extension in self.extensions],
            "aircraft_sha256": self.aircraft_sha256,
            "wall_time_s": self.wall_time_s,
            "real_time_factor": self.real_time_factor,
            "realtime": None if self.realtime is None else asdict(self.realtime),
            "versions": dict(self.versions),
            "source_sha256": self.source_sha256,
            "environment": dict(self.environment),
            "plug_ins": dict(self.plug_ins),
            "margins": self.margins.to_dict(),
            **self.others,
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> RunSummary:
        """Return the summary that a metrics.json holds, of this or an earlier version of flightbed.

        Args:
            values: the content of the file. Keys added after version 0.1 may be missing: their fields have the default.

        Raises:
            ValueError: a key that every version stores is missing, or has another form.

        """
        try:
            summary = cls._from_dict(values)
        except (KeyError, TypeError, AttributeError, IndexError) as error:
            raise ValueError(f"not the metrics of a flight ({type(error).__name__}: {error})") from error
        if problem := _mistyped(summary, cls, ""):
            raise ValueError(f"not the metrics of a flight ({problem})")
        return summary

    @classmethod
    def _from_dict(cls, values: Mapping[str, Any]) -> RunSummary:
        estimators = {name: _known(EstimatorMetrics, measured) for name, measured in values["estimators"].items()}
        realtime = values.get("realtime")
        names = {one.name for one in (*fields(cls), *fields(Metrics))} - {"metrics", "others"}
        return cls(
            scenario=values["scenario"],
            seed=values["seed"],
            metrics=_known(Metrics, {"estimators_since_s": None, **values, "estimators": estimators}),
            snr_db=values["snr_db"],
            ended=values["ended"],
            failed_at_s=values["failed_at_s"],
            flown_s=values["flown_s"],
            elevator_at_stop_share=values.get("elevator_at_stop_share"),
            bank_max_deg=values.get("bank_max_deg"),
            trim=_known(TrimSummary, values["trim"]),
            short_period=ShortPeriodSummary.from_dict(values["short_period"]),
            gains=_known(Gains, values["gains"]) if values["gains"] else None,
            extensions=tuple(_known(ExtensionSummary, own) for own in values.get("extensions", ())),
            aircraft_sha256=values["aircraft_sha256"],
            wall_time_s=values["wall_time_s"],
            real_time_factor=values["real_time_factor"],
            realtime=None if realtime is None else _punctuality(realtime),
            versions=dict(values["versions"]),
            source_sha256=values.get("source_sha256"),
            environment=dict(values.get("environment", {})),
            plug_ins=dict(values.get("plug_ins", {})),
            margins=MarginSummary.from_dict(values.get("margins", {})),
            others={key: value for key, value in values.items() if key not in names},
        )

    @classmethod
    def read(cls, path: Path) -> RunSummary:
        """Return the summary in a metrics.json. Raises OSError; ValueError as ``from_dict``, and for a file that is not JSON."""
        return cls.from_dict(json.loads(path.read_text(encoding="utf-8")))


def _mistyped(value: Any, kind: Any, place: str) -> str | None:
    """Return the first value that has not the declared type, or is not finite; None if there is none."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is UnionType:
        return None if any(_mistyped(value, one, place) is None for one in inner) else f"{place} = {value!r}"
    if kind is Any:
        return None
    if isinstance(kind, type) and is_dataclass(kind) and isinstance(value, kind):
        hints = get_type_hints(kind)
        found = (_mistyped(getattr(value, one.name), hints[one.name], one.name) for one in fields(kind))
    elif origin in (dict, Mapping) and isinstance(value, dict):
        found = (_mistyped(one, inner[1], f"{place}.{key}") for key, one in value.items())
    elif origin is tuple and isinstance(value, tuple):
        kinds = inner[:1] * len(value) if inner[1:] == (...,) else inner
        if len(kinds) != len(value):
            return f"{place} = {value!r}"
        found = (_mistyped(one, part, place) for one, part in zip(value, kinds, strict=True))
    else:
        if origin is Literal:
            valid = any(value == one for one in inner)
        elif origin is not None:  # a mapping or a tuple was expected
            valid = False
        elif kind in (float, complex):
            valid = isinstance(value, int | float | complex) and not isinstance(value, bool) and isfinite(abs(value))
        else:
            valid = isinstance(value, kind) and (kind is not int or not isinstance(value, bool))
        return None if valid else f"{place} = {value!r}"
    return next((problem for problem in found if problem is not None), None)


def _punctuality(values: Mapping[str, Any]) -> Punctuality:
    spreads = {key: _known(Spread, values[key]) for key in ("jitter_ms", "compute_ms")}
    return _known(Punctuality, {**values, **spreads})


def _known(kind: type[T], values: Mapping[str, Any]) -> T:
    """Return a dataclass from its own fields' values; other keys are ignored. Raises TypeError where a field without default is missing."""
    names = {one.name for one in fields(kind)}  # type: ignore[arg-type]
    return kind(**{name: value for name, value in values.items() if name in names})
