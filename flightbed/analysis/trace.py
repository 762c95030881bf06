"""Trace: one row per control tick, columns with unit suffixes; Parquet in and out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flightbed.core.errors import OutputError, printable
from flightbed.core.estimate_names import surface_of
from flightbed.core.signals import Sample
from flightbed.core.units import DEG, FT, unit_of
from flightbed.flight.record import ESTIMATED, FLOWN, TRUE, WITH_RECONSTRUCTION, parts_of, row_packer

if TYPE_CHECKING:
    import pandas as pd

Vector = npt.NDArray[np.float64]

# True values of the reconstructed inputs, in flights with an estimator that reconstructs one.
ACTING, GUST_ALPHA = "elevator_acting_deg", "gust_alpha_deg"
_TRUE_SHARES = {
    "elevator": "effectiveness_true",
    "aileron": "effectiveness_aileron_true",
    "rudder": "effectiveness_rudder_true",
}


def true_share(estimate: str) -> str:
    """Return the column of the true K of an estimate: ``NAME`` estimates the elevator, ``NAME.aileron`` the aileron."""
    return _TRUE_SHARES[surface_of(estimate)]


@dataclass(frozen=True)
class Trace:
    """One flight as columns.

    Attributes:
        columns: name -> values, one per control tick; units are in the names (``unit_of``).
        estimators: names of the estimators, whose columns are ``<name>.effectiveness`` and so on.

    """

    columns: Mapping[str, Vector]
    estimators: tuple[str, ...]

    def __getitem__(self, column: str) -> Vector:
        return self.columns[column]

    def __len__(self) -> int:
        return len(self.columns["t_s"])

    def with_column(self, name: str, values: Vector) -> Trace:
        """Return the trace with one more column."""
        return Trace({**self.columns, name: values}, self.estimators)

    def since(self, tick: int) -> Trace:
        """Return the part of the trace from a tick on."""
        return Trace({name: values[tick:] for name, values in self.columns.items()}, self.estimators)

    def to_pandas(self) -> pd.DataFrame:
        """Return a DataFrame with one row per tick."""
        import pandas as pd

        return pd.DataFrame(dict(self.columns))

    def write(self, path: Path) -> None:
        """Write Parquet; the unit of every column is also in its metadata. Raises OutputError."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        schema = pa.schema(
            [pa.field(name, pa.float64(), nullable=False, metadata={"unit": unit_of(name)}) for name in self.columns],
            metadata={"estimators": ",".join(self.estimators)},
        )
        try:
            pq.write_table(pa.table([pa.array(v) for v in self.columns.values()], schema=schema), path)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {error}") from None


def read_trace(path: str | Path) -> Trace:
    """Read a trace that Trace.write wrote. Raises OutputError."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
        names = (table.schema.metadata or {}).get(b"estimators", b"").decode()
    except (OSError, ValueError, pa.ArrowException) as error:
        raise OutputError(f"{path}: not a trace: {printable(str(error))}") from None
    if problem := _problem(table):
        raise OutputError(f"{path}: not a trace: {problem}; fly the scenario again")
    return Trace(
        {name: table.column(name).to_numpy() for name in table.column_names}, tuple(n for n in names.split(",") if n)
    )


def _problem(table: Any) -> str | None:
    """Return why an Arrow table is not a trace; None for a trace."""
    names = table.column_names
    if len(set(names)) < len(names):
        return f"column {next(name for name in names if names.count(name) > 1)} exists twice"
    if "t_s" not in names or not len(table):
        return "it has no column t_s" if "t_s" not in names else "it has no rows"
    for name, column in zip(names, table.columns, strict=True):
        if str(column.type) != "double" or column.null_count:
            return f"column {name} has values that are not numbers"
    return None


def collect(samples: Iterable[Sample], *, estimators: Sequence[str], control_hz: int) -> Trace:
    """Return the trace of a flight's samples; each sample is packed as it arrives and not kept."""
    flown = iter(samples)
    first = next(flown)
    lateral, load_factor = first.lateral is not None, first.load_factor is not None
    pack = row_packer(len(estimators), lateral=lateral, load_factor=load_factor)
    rows = np.frombuffer(b"".join(map(pack, chain([first], flown))))
    return from_rows(rows, estimators=estimators, control_hz=control_hz, lateral=lateral, load_factor=load_factor)


def from_rows(
    rows: Vector, *, estimators: Sequence[str], control_hz: int, lateral: bool = False, load_factor: bool = False
) -> Trace:
    """Return the trace of consecutive packed rows."""
    parts = parts_of(len(estimators), lateral=lateral, load_factor=load_factor)
    prefixes = iter([f"{name}." for name in estimators])
    rows = rows.reshape(-1, sum(len(part.fields) for part in parts))
    columns: dict[str, Vector] = {"t_s": rows[:, 0] / control_hz}
    offset, reconstructs = 0, False
    for part in parts:
        prefix = next(prefixes) if part is ESTIMATED else ""
        if part is ESTIMATED and np.isfinite(rows[:, offset + part.fields.index("reconstructed_rad")]).any():
            part, reconstructs = WITH_RECONSTRUCTION, True
        for column, (at, factor) in part.columns.items():
            columns[prefix + column] = rows[:, offset + at] * factor
        offset += len(part.fields)
    if reconstructs:
        mean = rows[:, len(FLOWN.fields) + TRUE.fields.index("elevator_mean_rad")] / DEG
        columns[ACTING] = columns["effectiveness_true"] * mean + columns["elevator_offset_deg"]
        columns[GUST_ALPHA] = columns["gust_up_fps"] * FT / columns["airspeed_m_s"] / DEG
    return Trace(columns, tuple(estimators))
