"""Flights of a campaign -> a table with one row per flight, and its columns as quantities: medians with intervals, ranges."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import product
from math import inf, isfinite, nan
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from flightbed.analysis.metrics import EstimatorMetrics, Metrics
from flightbed.analysis.pull_up import PULL_UP_METRICS
from flightbed.analysis.summary_text import FOLLOWED
from flightbed.campaigns.plan import Flight
from flightbed.campaigns.settings import Criterion
from flightbed.core.units import unit_of
from flightbed.scenario.estimates import detectors, estimates
from flightbed.scenario.tables import Scenario
from flightbed.statistics.bootstrap import mean_interval, percentile_interval
from flightbed.statistics.intervals import Interval, median_interval, quantile_interval, share

Value = int | float | bool | str | None
Row = Mapping[str, Value]

# None: columns of roll rate and sideslip without commanded aileron and rudder; columns of load factor and pull-up without a command in g.
TRACKING = (
    "tracking_rms_pre_deg_s", "tracking_rms_post_deg_s", "tracking_rms_pre_p_deg_s", "tracking_rms_post_p_deg_s",
    "tracking_rms_pre_beta_deg", "tracking_rms_post_beta_deg", "tracking_rms_pre_nz_g", "tracking_rms_post_nz_g",
)  # fmt: skip
_METRICS = (
    "departed", "ended", "departed_at_s", "flown_s", *TRACKING, *PULL_UP_METRICS, "estimators_since_s",
)  # fmt: skip
_KINDS = MappingProxyType(
    {
        "index": "int64", "point": "int64", "seed": "int64", "hash": "string", "error": "string", "passed": "bool_",
        "departed": "bool_", "ended": "string",
    }
)  # fmt: skip
_NO_QUANTITIES = (*_KINDS, "estimators_since_s")
_EVENTS = ("first_within_20pct_s", "first_within_20pct_smoothed_s", "detected_at_s")  # None: did not occur


class Followed(NamedTuple):
    """The tracking RMS that judges flights: its column, the error in words, its unit, and whether it covers the time after the failure."""

    column: str
    what: str
    unit: str
    after: bool


def followed(rows: Sequence[Row]) -> Followed:
    """Return the tracking RMS that judges flights: of pitch rate, or, without its command, of load factor; after the failure if any."""
    for (what, key, unit), when in product(FOLLOWED[:2], ("post", "pre")):
        column = f"tracking_rms_{when}_{key}"
        if any(row[column] is not None for row in rows):
            return Followed(column, what, unit, when == "post")
    what, key, unit = FOLLOWED[0]
    return Followed(f"tracking_rms_pre_{key}", what, unit, after=False)


@dataclass(frozen=True)
class Quantity:
    """A number of every flight.

    Attributes:
        column: its name in the table.
        values: one per flight; infinite for an event that did not occur, None where it is not defined.
        seed: of the campaign, for intervals by resampling.

    """

    column: str
    values: tuple[float | None, ...]
    seed: int = 0

    @property
    def known(self) -> list[float]:
        """Defined values, infinite ones included."""
        return [v for v in self.values if v is not None]

    @property
    def never(self) -> int:
        """Number of flights without the event."""
        return sum(not isfinite(v) for v in self.known)

    @property
    def median(self) -> Interval:
        """Median, with its exact distribution-free 95 % interval; an event that did not occur counts as infinite."""
        return median_interval(self.known)

    @property
    def _happened(self) -> list[float]:
        return [v for v in self.known if isfinite(v)]

    def percentile(self, percent: float) -> Interval:
        """Return a percentile of the finite values, with its exact distribution-free 95 % interval."""
        happened = self._happened
        return quantile_interval(happened, percent / 100.0) if happened else Interval(nan, -inf, inf, 0)

    @property
    def mean(self) -> Interval | None:
        """Mean, with its 95 % interval by resampling; None with an infinite value."""
        return None if self.never or not self.known else mean_interval(self.known, self.seed, self.column)

    def resampled_percentile(self, percent: float) -> Interval:
        """Return the same percentile with a 95 % interval by resampling; at least one value is finite."""
        return percentile_interval(self._happened, percent, self.seed, self.column)


def metric_columns(scenario: Scenario) -> list[str]:
    """Return the columns of the table that are metrics of a flight."""
    return _metric_columns(estimates(scenario))


def _metric_columns(estimators: Iterable[str]) -> list[str]:
    return [*_METRICS, *(f"{name}.{field.name}" for name in estimators for field in fields(EstimatorMetrics))]


def row(flight: Flight, known: str, metrics: Metrics, *, ticks: int, scenario: Scenario) -> Row:
    """Return the row of a flight: column -> value, None where it is not defined.

    Args:
        flight: index, point, values and seed.
        known: its hash.
        metrics: of the flight.
        ticks: its duration.
        scenario: of the flight.

    """
    return {
        **_identity(flight, known, None),
        "departed": metrics.departed,
        "ended": "departed" if metrics.departed else "time" if ticks == scenario.ticks else "ground",
        "departed_at_s": metrics.departed_at_s,
        "flown_s": ticks / scenario.rates.control_hz,
        **{key: getattr(metrics, key) for key in (*TRACKING, *PULL_UP_METRICS)},
        "estimators_since_s": metrics.estimators_since_s,
        **{
            f"{name}.{metric}": value
            for name, measured in metrics.estimators.items()
            for metric, value in asdict(measured).items()
        },
    }


def failed_row(flight: Flight, known: str | None, error: str, estimators: Sequence[str]) -> Row:
    """Return the row of a flight that raised: its error, and no metrics."""
    return {**_identity(flight, known, error), **dict.fromkeys(_metric_columns(estimators))}


def _identity(flight: Flight, known: str | None, error: str | None) -> Row:
    values = {key: json.dumps(v) if isinstance(v, list | tuple) else v for key, v in flight.values.items()}
    return {
        "index": flight.index, "point": flight.point, **values, "seed": flight.seed, "hash": known, "error": error, "passed": None,
    }  # fmt: skip


def passes(row: Row, criteria: Sequence[Criterion]) -> bool | None:
    """Return whether a flight meets all criteria; None without criteria. A flight that raised, or without a value, does not."""
    return all(_meets(row[c.metric], c) for c in criteria) if criteria else None


def _meets(value: Value, criterion: Criterion) -> bool:
    if value is None:
        return False
    if criterion.equals is not None:
        return value == criterion.equals
    low = -inf if criterion.min is None else criterion.min
    high = inf if criterion.max is None else criterion.max
    return not isinstance(value, str) and low <= value <= high


def departed(rows: Sequence[Row]) -> Interval | None:
    """Return the share of departed flights among those without error, with its exact interval; None where all raised."""
    known = [row["departed"] for row in rows if row["error"] is None]
    return share(known.count(True), len(known)) if known else None


def passed(rows: Sequence[Row]) -> Interval | None:
    """Return the share of the flights that meet the criteria, with its exact interval; None without criteria."""
    known = [row["passed"] for row in rows]
    return None if not known or None in known else share(known.count(True), len(known))


def quantity(table: Sequence[Row], column: str, *, tests: Collection[str], seed: int = 0) -> Quantity:
    """Return a column of numbers as a quantity; an event missing after a failure did not occur and counts as infinite.

    Alarms are defined for the estimators ``tests``, and for any other with an alarm.
    """
    name, _, metric = column.rpartition(".")
    happens = metric in _EVENTS and (
        metric != "detected_at_s" or name in tests or any(row[column] is not None for row in table)
    )
    values = []
    for row in table:
        value = row[column]
        never = inf if happens and row["estimators_since_s"] is not None else None
        values.append(never if value is None else float(value))
    return Quantity(column, tuple(values), seed)


def quantities(table: Sequence[Row], scenario: Scenario, seed: int) -> list[Quantity]:
    """Return every metric that is a number, and that some flight has."""
    tests = detectors(scenario)
    columns = [column for column in metric_columns(scenario) if column not in _NO_QUANTITIES]
    return [q for q in (quantity(table, column, tests=tests, seed=seed) for column in columns) if q.known]


def write_table(table: Sequence[Row], path: Path, keys: Sequence[str] = ()) -> None:
    """Write the table as Parquet; the unit of every column is also in its metadata. Raises OSError.

    Args:
        table: rows, each with the same columns; at least one.
        path: the file.
        keys: columns with values of axes, stored in the narrowest type that holds them all.

    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema(
        [
            pa.field(c, getattr(pa, _kind(table, c) if c in keys else _kind_of(c))(), metadata={"unit": unit_of(c)})
            for c in table[0]
        ]
    )
    columns = {c: [row[c] for row in table] for c in table[0]}
    for key in keys:
        if schema.field(key).type == pa.string():
            columns[key] = [v if isinstance(v, str) else json.dumps(v) for v in columns[key]]
    pq.write_table(pa.Table.from_pydict(columns, schema=schema), path)


def _kind_of(column: str) -> str:
    return _KINDS.get(column, "int64" if column.endswith(".false_alarms") else "float64")


def _kind(table: Sequence[Row], column: str) -> str:
    kinds = {type(row[column]) for row in table}
    for fitting, name in (({bool}, "bool_"), ({int}, "int64"), ({int, float}, "float64")):
        if kinds <= fitting:
            return name
    return "string"
