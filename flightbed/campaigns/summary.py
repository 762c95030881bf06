"""CampaignSummary: the statistics of a campaign and of its points, computed once from the rows of its table.

``summary.json``, the report, its headline and the terminal show this value; only ``to_dict`` names the keys of the file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from flightbed.analysis.metrics import PHASES, Metrics
from flightbed.analysis.summary import RunSummary
from flightbed.analysis.summary_text import FOLLOWED
from flightbed.campaigns.plan import Programme, Values
from flightbed.campaigns.settings import Criterion
from flightbed.campaigns.table import Followed, Quantity, Row, departed, followed, passed, quantities, quantity
from flightbed.config.own_code import use_options
from flightbed.core.versions import versions
from flightbed.scenario.estimates import detectors, estimates
from flightbed.statistics.bootstrap import RESAMPLES
from flightbed.statistics.histories import PERCENTILES, SAMPLE
from flightbed.statistics.intervals import Interval

_RESAMPLED = (5, 50, 95)  # percentiles in summary.json


@dataclass(frozen=True)
class ShareSummary:
    """A share of the flights.

    Attributes:
        count: number of flights.
        share: count over all flights, with its exact binomial 95 % interval.

    """

    count: int
    share: Interval

    def to_dict(self) -> dict[str, float | int]:
        """Return plain values."""
        return {"count": self.count, "share": self.share.estimate, "low": self.share.low, "high": self.share.high}


@dataclass(frozen=True)
class QuantitySummary:
    """Statistics of one number over the flights that did not raise.

    Attributes:
        column: its name in the table.
        flights: number of flights with a value; an event that did not occur counts as one.
        never: number of flights without the event.
        median: with its exact distribution-free 95 % interval; an event that did not occur counts as infinite.
        mean: with its 95 % interval by resampling; None where the event did not occur in some flight.
        p5, p95: percentiles over the flights with the event, with exact distribution-free 95 % intervals.

    """

    column: str
    flights: int
    never: int
    median: Interval
    mean: Interval | None
    p5: Interval
    p95: Interval

    @classmethod
    def of(cls, values: Quantity) -> QuantitySummary:
        """Return the statistics of a quantity; at least one flight has a value."""
        ends = values.percentile(5), values.percentile(95)
        return cls(values.column, len(values.known), values.never, values.median, values.mean, *ends)

    def to_dict(self) -> dict[str, float | int | None]:
        """Return plain values; null for infinite values, and for a mean that is not defined."""
        ends = {"": self.median, "p5": self.p5, "p95": self.p95, "mean": self.mean}
        found: dict[str, float | int | None] = {}
        for name, interval in ends.items():
            values = (None, None, None) if interval is None else (interval.estimate, interval.low, interval.high)
            keys = (name or "median", f"{name}_low" if name else "low", f"{name}_high" if name else "high")
            found |= {k: None if v is None or not isfinite(v) else v for k, v in zip(keys, values, strict=True)}
        return {**found, "flights": self.flights, "never": self.never}


@dataclass(frozen=True)
class FlightsSummary:
    """Statistics of a group of flights: of a campaign, or of one of its points.

    Attributes:
        flights: number of flights.
        errors: number of flights that raised an error; of the other numbers only ``passed`` includes them.
        departed: flights that departed; None where every flight raised.
        hit_ground: number of flights that hit the ground.
        passed: flights that meet the criteria; a flight that raised does not. None without criteria.
        quantities: column -> statistics, of every metric that is a number and that some flight has.
        estimators: names of the estimates.

    """

    flights: int
    errors: int
    departed: ShareSummary | None
    hit_ground: int
    passed: ShareSummary | None
    quantities: Mapping[str, QuantitySummary]
    estimators: tuple[str, ...]

    @classmethod
    def of(cls, rows: Sequence[Row], programme: Programme) -> FlightsSummary:
        """Return the statistics of some rows of a programme's table."""
        flown = [row for row in rows if row["error"] is None]
        ends = [row["ended"] for row in flown]
        gone, kept = departed(rows), passed(rows)
        return cls(
            flights=len(rows),
            errors=len(rows) - len(flown),
            departed=None if gone is None else ShareSummary(ends.count("departed"), gone),
            hit_ground=ends.count("ground"),
            passed=None if kept is None else ShareSummary(sum(row["passed"] is True for row in rows), kept),
            quantities={q.column: QuantitySummary.of(q) for q in quantities(flown, programme.scenario, programme.seed)},
            estimators=estimates(programme.scenario),
        )

    def of_owner(self, owner: str) -> dict[str, QuantitySummary]:
        """Return metric -> statistics of an estimate, or of the flights for ``""``."""
        split = [(column.rpartition("."), values) for column, values in self.quantities.items()]
        return {metric: values for (name, _, metric), values in split if name == owner}

    def to_dict(self) -> dict[str, Any]:
        """Return nested plain values; the number of flights stands above them in summary.json."""

        def plain(owner: str) -> dict[str, Any]:
            return {metric: values.to_dict() for metric, values in self.of_owner(owner).items()}

        return {
            "errors": self.errors,
            "departed": None if self.departed is None else self.departed.to_dict(),
            "hit_ground": self.hit_ground,
            "passed": None if self.passed is None else self.passed.to_dict(),
            **plain(""),
            "estimators": {name: plain(name) for name in self.estimators},
        }


@dataclass(frozen=True)
class PointSummary:
    """Statistics of a point.

    Attributes:
        point: its number.
        values: key of an axis -> value.
        flights: statistics of its flights.

    """

    point: int
    values: Values
    flights: FlightsSummary

    def to_dict(self) -> dict[str, Any]:
        """Return nested plain values."""
        numbers = self.flights.to_dict()
        return {"point": self.point, "values": dict(self.values), "flights": self.flights.flights, **numbers}


@dataclass(frozen=True)
class Resampled:
    """Intervals of a quantity by resampling.

    Attributes:
        mean: BCa; None where the event did not occur in some flight.
        percentiles: percent -> percentile method, of ``histories.PERCENTILES``.

    """

    mean: Interval | None
    percentiles: Mapping[int, Interval]

    @classmethod
    def of(cls, values: Quantity) -> Resampled:
        """Return the intervals of a quantity that some flight has."""
        return cls(values.mean, {percent: values.resampled_percentile(percent) for percent in PERCENTILES})

    def to_dict(self) -> dict[str, list[float | None]]:
        """Return plain values: low and high end, null for too few flights."""
        chosen = {f"p{percent}": self.percentiles[percent] for percent in _RESAMPLED}
        return {
            name: [end if isfinite(end) else None for end in (interval.low, interval.high)]
            for name, interval in {"mean": self.mean, **chosen}.items()
            if interval is not None
        }


@dataclass(frozen=True)
class TrackingSummary:
    """Statistics of the tracking RMS that judges a campaign.

    Attributes:
        followed: column, quantity and unit, see ``table.followed``.
        percentiles: percent -> percentile with its exact distribution-free 95 % interval, of ``histories.PERCENTILES``; empty where no
            flight has the quantity.

    """

    followed: Followed
    percentiles: Mapping[int, Interval]


@dataclass(frozen=True)
class ErrorSummary:
    """An error that flights raised: its message, and the indices of these flights."""

    message: str
    indices: tuple[int, ...]


@dataclass(frozen=True)
class WorstSummary:
    """The worst flight of a campaign.

    Attributes:
        index: its number.
        point: number of its point.
        values: key of an axis -> value.
        seed: of its scenario.
        reason: why it is the worst, in words.
        options: of ``flightbed run`` that fly it with the campaign's scenario.toml.
        run: its own summary.

    """

    index: int
    point: int
    values: Values
    seed: int
    reason: str
    options: str
    run: RunSummary

    @property
    def metrics(self) -> Metrics:
        """Tracking and estimation of the flight."""
        return self.run.metrics

    @property
    def rerun_command(self) -> str:
        """Command that flies it; FOLDER is the campaign's."""
        return f"flightbed run FOLDER/scenario.toml{self.options}"

    def to_dict(self) -> dict[str, Any]:
        """Return nested plain values."""
        return {
            "index": self.index,
            "point": self.point,
            "values": dict(self.values),
            "seed": self.seed,
            "reason": self.reason,
            "command": self.rerun_command,
            "metrics": self.metrics.to_dict(),
        }


@dataclass(frozen=True, kw_only=True)
class CampaignSummary:
    """Statistics of a campaign.

    Attributes:
        scenario: name of the base scenario.
        name: of the campaign.
        fingerprint: SHA-256 of everything that determines the table.
        runs: flights at each point.
        seed: of the campaign file, or of the first flight of a scenario with successive seeds.
        from_file: whether a campaign file defines the flights; ``seed`` is then its seed.
        criteria: of a flight that passes.
        flights: statistics of all flights.
        tracking: the tracking RMS that judges the campaign.
        resampled: column -> intervals by resampling, of the tracking RMS of pitch rate and load factor that some flight has.
        histories: numbers of the points with histories.
        points: statistics of each point; empty for a single point.
        errors: errors that flights raised, in the order of their first flights.
        worst: the worst flight; None where every flight raised.
        wall_time_s: duration of the campaign, s, after the last ``--resume``.
        aircraft_sha256: fingerprint of the (first) aircraft.
        versions: package -> version.
        sources: hashes of the sources that flew (``Programme.sources``).

    """

    scenario: str
    name: str
    fingerprint: str
    runs: int
    seed: int
    from_file: bool
    criteria: tuple[Criterion, ...]
    flights: FlightsSummary
    tracking: TrackingSummary
    resampled: Mapping[str, Resampled]
    histories: tuple[int, ...]
    points: tuple[PointSummary, ...]
    errors: tuple[ErrorSummary, ...]
    worst: WorstSummary | None
    wall_time_s: float
    aircraft_sha256: str
    versions: Mapping[str, str]
    sources: Mapping[str, Any]

    def quantity(self, column: str) -> QuantitySummary | None:
        """Return the statistics of a column over all flights; None where no flight has it."""
        return self.flights.quantities.get(column)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of summary.json: nested plain values, null for infinite and undefined ones."""
        return {
            "scenario": self.scenario,
            "name": self.name,
            "campaign": self.fingerprint,
            "flights": self.flights.flights,
            "runs": self.runs,
            "seed" if self.from_file else "first_seed": self.seed,
            **self.flights.to_dict(),
            "bootstrap": {"resamples": RESAMPLES, **{name: found.to_dict() for name, found in self.resampled.items()}},
            "histories": {"points": list(self.histories), "percentiles_of_flights": SAMPLE},
            "points": [point.to_dict() for point in self.points],
            "worst": None if self.worst is None else self.worst.to_dict(),
            "wall_time_s": self.wall_time_s,
            "aircraft_sha256": self.aircraft_sha256,
            "versions": dict(self.versions),
            **self.sources,
        }


def summarize_campaign(
    programme: Programme,
    rows: Sequence[Row],
    *,
    histories: Sequence[int],
    worst: RunSummary | None,
    worst_index: int,
    reason: str,
    wall_time_s: float,
) -> CampaignSummary:
    """Return the summary of a campaign.

    Args:
        programme: the flights.
        rows: one per flight, in order of their indices, with ``passed`` filled in.
        histories: numbers of the points with histories.
        worst: summary of the worst flight; None where every flight raised.
        worst_index: its index.
        reason: why it is the worst, in words.
        wall_time_s: duration of the campaign, s.

    """
    settings, runs = programme.settings, programme.runs
    flown = [row for row in rows if row["error"] is None]
    tests = detectors(programme.scenario)
    chosen = followed(flown)

    def values(column: str) -> Quantity:
        return quantity(flown, column, tests=tests, seed=programme.seed)

    columns = [f"tracking_rms_{phase}_{key}" for _, key, _ in FOLLOWED[:2] for phase in PHASES]
    judged = values(chosen.column)
    exact = {percent: judged.percentile(percent) for percent in PERCENTILES} if judged.known else {}
    points = programme.points if len(programme.points) > 1 else ()
    return CampaignSummary(
        scenario=programme.scenario.name,
        name=programme.name,
        fingerprint=programme.fingerprint,
        runs=runs,
        seed=programme.seed,
        from_file=settings is not None,
        criteria=() if settings is None else tuple(settings.criteria),
        flights=FlightsSummary.of(rows, programme),
        tracking=TrackingSummary(chosen, exact),
        resampled={q.column: Resampled.of(q) for q in map(values, columns) if q.known},
        histories=tuple(sorted(histories)),
        points=tuple(
            PointSummary(number, point, FlightsSummary.of(rows[number * runs : (number + 1) * runs], programme))
            for number, point in enumerate(points)
        ),
        errors=_errors(rows),
        worst=None if worst is None else _worst(programme, worst, worst_index, reason),
        wall_time_s=wall_time_s,
        aircraft_sha256=programme.aircraft[0],
        versions=versions(),
        sources=programme.sources,
    )


def _worst(programme: Programme, run: RunSummary, index: int, reason: str) -> WorstSummary:
    flight = programme.flight(index)
    options = f"{programme.overrides(flight)}{use_options(run.own_code)}"
    return WorstSummary(index, flight.point, flight.values, run.seed, reason, options, run)


def _errors(rows: Sequence[Row]) -> tuple[ErrorSummary, ...]:
    found: dict[str, list[int]] = {}
    for row in rows:
        if row["error"] is not None:
            found.setdefault(str(row["error"]), []).append(int(row["index"] or 0))
    return tuple(ErrorSummary(message, tuple(indices)) for message, indices in found.items())
