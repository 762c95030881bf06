"""Flights of one scenario -> a table, a row a flight, and its columns as quantities: medians with intervals, ranges."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import inf, isfinite
from pathlib import Path

from flightbed.ensemble import Flown
from flightbed.errors import OutputError
from flightbed.settings import Scenario
from flightbed.statistics import Interval, Spread, median_interval, spread
from flightbed.units import unit_of

Value = int | float | bool | str | None
Row = Mapping[str, Value]

NO_QUANTITIES = ("seed", "departed", "ended", "estimators_since_s")
_EVENTS = ("first_within_20pct_s", "first_within_20pct_smoothed_s", "detected_at_s")  # None: it never happened


@dataclass(frozen=True)
class Quantity:
    """A number that every flight has, or may have.

    Attributes:
        column: its name in the table.
        values: one a flight; infinite where it never happened, None where it cannot be said.

    """

    column: str
    values: tuple[float | None, ...]

    @property
    def known(self) -> list[float]:
        """Values that can be said, those that never happened (infinite) among them."""
        return [v for v in self.values if v is not None]

    @property
    def never(self) -> int:
        """Flights in which it never happened."""
        return sum(not isfinite(v) for v in self.known)

    @property
    def median(self) -> Interval:
        """Median, with its exact distribution-free 95 % interval; what never happened counts as infinite."""
        return median_interval(self.known)

    @property
    def spread(self) -> Spread:
        """Median and 5-95 % range over the flights in which it happened."""
        return spread(self.known)

    def to_dict(self) -> dict[str, float | int | None]:
        """Return plain values, ready for JSON: null for what is infinite."""
        middle, around = self.median, self.spread
        names = ("median", "low", "high", "p5", "p95")
        numbers = (middle.estimate, middle.low, middle.high, around.low, around.high)
        plain = {name: value if isfinite(value) else None for name, value in zip(names, numbers, strict=True)}
        return {**plain, "flights": middle.runs, "never": self.never}


def flown_s(flown: Flown, scenario: Scenario) -> float:
    """Return how long a flight lasted, s."""
    return len(flown.columns["q_deg_s"]) / scenario.rates.control_hz


def ended(flown: Flown, scenario: Scenario) -> str:
    """Return how a flight ended: ``"departed"``, ``"ground"`` or ``"time"``, as in metrics.json."""
    whole = len(flown.columns["q_deg_s"]) == scenario.ticks
    return "departed" if flown.metrics.departed else "time" if whole else "ground"


def rows(flights: Sequence[Flown], scenario: Scenario) -> list[Row]:
    """Return the table: column -> value of every flight; None where there is none."""
    return [
        {
            "seed": flown.seed,
            "departed": flown.metrics.departed,
            "ended": ended(flown, scenario),
            "departed_at_s": flown.metrics.departed_at_s,
            "flown_s": flown_s(flown, scenario),
            "tracking_rms_pre_deg_s": flown.metrics.tracking_rms_pre_deg_s,
            "tracking_rms_post_deg_s": flown.metrics.tracking_rms_post_deg_s,
            "estimators_since_s": flown.metrics.estimators_since_s,
            **{
                f"{name}.{metric}": value
                for name, measured in flown.metrics.estimators.items()
                for metric, value in asdict(measured).items()
            },
        }
        for flown in flights
    ]


def quantity(table: Sequence[Row], column: str, *, tests: Collection[str]) -> Quantity:
    """Return a column of numbers as a quantity; what did not happen to an estimator after a failure never happened.

    An alarm can happen to the estimators ``tests`` alone, and to those that raise one anyhow.
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
    return Quantity(column, tuple(values))


def write_table(table: Sequence[Row], path: Path) -> None:
    """Write the table as Parquet; the unit of every column is also in its metadata. Raises OutputError."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    types = {"seed": pa.int64(), "departed": pa.bool_(), "ended": pa.string()}

    def kind(column: str) -> pa.DataType:
        return types.get(column, pa.int64() if column.endswith(".false_alarms") else pa.float64())

    schema = pa.schema([pa.field(column, kind(column), metadata={"unit": unit_of(column)}) for column in table[0]])
    try:
        pq.write_table(pa.Table.from_pylist([dict(row) for row in table], schema=schema), path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error}") from None
