"""Trace: one row per control tick, columns with unit suffixes; Parquet in and out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flightbed.errors import OutputError
from flightbed.signals import Estimate, Measurement, Sample, Truth
from flightbed.units import DEG, FT, unit_of

if TYPE_CHECKING:
    import pandas as pd

Vector = npt.NDArray[np.float64]

# column -> (field, factor from SI)
_TRUTH = {
    "q_deg_s": ("q_rad_s", 1 / DEG),
    "alpha_deg": ("alpha_rad", 1 / DEG),
    "theta_deg": ("theta_rad", 1 / DEG),
    "phi_deg": ("phi_rad", 1 / DEG),
    "psi_deg": ("psi_rad", 1 / DEG),
    "elevator_deg": ("elevator_rad", 1 / DEG),
    "mach": ("mach", 1.0),
    "airspeed_m_s": ("airspeed_m_s", 1.0),
    "altitude_ft": ("altitude_m", 1 / FT),
    "north_m": ("north_m", 1.0),
    "east_m": ("east_m", 1.0),
    "nz_g": ("nz_g", 1.0),
    "effectiveness_true": ("effectiveness", 1.0),
}
_MEASURED = {
    "q_meas_deg_s": ("q_rad_s", 1 / DEG),
    "alpha_meas_deg": ("alpha_rad", 1 / DEG),
    "elevator_meas_deg": ("elevator_rad", 1 / DEG),
    "elevator_mean_meas_deg": ("elevator_mean_rad", 1 / DEG),
}
_ESTIMATED = {
    "effectiveness": ("effectiveness", 1.0),
    "effectiveness_std": ("effectiveness_std", 1.0),
    "effectiveness_smoothed": ("effectiveness_smoothed", 1.0),
    "effectiveness_raw": ("effectiveness_raw", 1.0),
    "alpha_deg": ("alpha_rad", 1 / DEG),
    "q_deg_s": ("q_rad_s", 1 / DEG),
    "nis": ("nis", 1.0),
}


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
    except (OSError, pa.ArrowInvalid) as error:
        raise OutputError(f"{path}: not a trace: {error}") from None
    names = (table.schema.metadata or {}).get(b"estimators", b"").decode()
    return Trace(
        {name: table.column(name).to_numpy() for name in table.column_names}, tuple(n for n in names.split(",") if n)
    )


def collect(samples: Iterable[Sample], *, estimators: Sequence[str], control_hz: int) -> Trace:
    """Gather the samples of a flight into a trace."""
    rows = list(samples)
    tick = np.array([row.tick for row in rows], dtype=np.float64)
    columns: dict[str, Vector] = {
        "t_s": tick / control_hz,
        "q_cmd_deg_s": np.array([row.q_cmd_rad_s for row in rows]) / DEG,
        "q_ref_deg_s": np.array([row.q_ref_rad_s for row in rows]) / DEG,
        "elevator_cmd_deg": np.array([row.elevator_cmd_rad for row in rows]) / DEG,
    }
    columns |= _columns([row.truth for row in rows], Truth._fields, _TRUTH)
    columns |= _columns([row.measurement for row in rows], Measurement._fields, _MEASURED)
    for i, name in enumerate(estimators):
        columns |= _columns([row.estimates[i] for row in rows], Estimate._fields, _ESTIMATED, prefix=f"{name}.")
    return Trace(columns, tuple(estimators))


def _columns(
    rows: Sequence[tuple[float, ...]],
    fields: tuple[str, ...],
    wanted: Mapping[str, tuple[str, float]],
    prefix: str = "",
) -> dict[str, Vector]:
    values = np.array(rows, dtype=np.float64).reshape(len(rows), len(fields))
    return {prefix + column: values[:, fields.index(field)] * factor for column, (field, factor) in wanted.items()}
