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
from flightbed.core.signals import (
    Estimate,
    LoadFactorSample,
    Measurement,
    Sample,
    Truth,
)
from flightbed.core.units import DEG, FT, unit_of
from flightbed.flight.record import FLOWN_FIELDS, LATERAL_FIELDS, LEADING, row_packer

if TYPE_CHECKING:
    import pandas as pd

Vector = npt.NDArray[np.float64]

_FLOWN = {
    "q_cmd_deg_s": ("q_cmd_rad_s", 1 / DEG),
    "q_ref_deg_s": ("q_ref_rad_s", 1 / DEG),
    "elevator_cmd_deg": ("elevator_cmd_rad", 1 / DEG),
}
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
    "elevator_force_true": ("elevator_force", 1.0),
    "cg_shift_cbar": ("cg_shift_cbar", 1.0),
    "gust_up_fps": ("gust_up_m_s", 1 / FT),
    "elevator_offset_deg": ("elevator_offset_rad", 1 / DEG),
    "lift_n": ("lift_n", 1.0),
    "drag_n": ("drag_n", 1.0),
    "thrust_n": ("thrust_n", 1.0),
}
_MEASURED = {
    "q_meas_deg_s": ("q_rad_s", 1 / DEG),
    "alpha_meas_deg": ("alpha_rad", 1 / DEG),
    "elevator_meas_deg": ("elevator_rad", 1 / DEG),
    "elevator_mean_meas_deg": ("elevator_mean_rad", 1 / DEG),
    "mach_meas": ("mach", 1.0),
    "altitude_meas_ft": ("altitude_m", 1 / FT),
    "theta_meas_deg": ("theta_rad", 1 / DEG),
    "phi_meas_deg": ("phi_rad", 1 / DEG),
    "nz_meas_g": ("nz_g", 1.0),
}
_ESTIMATED = {
    "effectiveness": ("effectiveness", 1.0),
    "effectiveness_std": ("effectiveness_std", 1.0),
    "effectiveness_smoothed": ("effectiveness_smoothed", 1.0),
    "effectiveness_raw": ("effectiveness_raw", 1.0),
    "alpha_deg": ("alpha_rad", 1 / DEG),
    "q_deg_s": ("q_rad_s", 1 / DEG),
    "nis": ("nis", 1.0),
    "alarms": ("alarms", 1.0),
    "innovation_alpha_deg": ("innovation_alpha_rad", 1 / DEG),
    "innovation_q_deg_s": ("innovation_q_rad_s", 1 / DEG),
    "innovation_alpha_std_deg": ("innovation_alpha_std_rad", 1 / DEG),
    "innovation_q_std_deg_s": ("innovation_q_std_rad_s", 1 / DEG),
}
# Columns of estimators that reconstruct an input; the others do not have them.
_RECONSTRUCTED = {
    "reconstructed_deg": ("reconstructed_rad", 1 / DEG),
    "reconstructed_std_deg": ("reconstructed_std_rad", 1 / DEG),
    "offset_deg": ("offset_rad", 1 / DEG),
    "offset_std_deg": ("offset_std_rad", 1 / DEG),
    "verdict": ("verdict", 1.0),
}
ACTING, GUST_ALPHA = (
    "elevator_acting_deg",
    "gust_alpha_deg",
)  # true values of the reconstructed inputs, in flights with such an estimator
_LATERAL = {
    "p_cmd_deg_s": ("p_cmd_rad_s", 1 / DEG),
    "p_ref_deg_s": ("p_ref_rad_s", 1 / DEG),
    "beta_cmd_deg": ("beta_cmd_rad", 1 / DEG),
    "beta_ref_deg": ("beta_ref_rad", 1 / DEG),
    "aileron_cmd_deg": ("aileron_cmd_rad", 1 / DEG),
    "rudder_cmd_deg": ("rudder_cmd_rad", 1 / DEG),
    "beta_deg": ("beta_rad", 1 / DEG),
    "p_deg_s": ("p_rad_s", 1 / DEG),
    "r_deg_s": ("r_rad_s", 1 / DEG),
    "aileron_deg": ("aileron_rad", 1 / DEG),
    "rudder_deg": ("rudder_rad", 1 / DEG),
    "effectiveness_aileron_true": ("aileron_effectiveness", 1.0),
    "effectiveness_rudder_true": ("rudder_effectiveness", 1.0),
    "aileron_offset_deg": ("aileron_offset_rad", 1 / DEG),
    "rudder_offset_deg": ("rudder_offset_rad", 1 / DEG),
    "beta_meas_deg": ("beta_rad/measured", 1 / DEG),
    "p_meas_deg_s": ("p_rad_s/measured", 1 / DEG),
    "r_meas_deg_s": ("r_rad_s/measured", 1 / DEG),
    "aileron_meas_deg": ("aileron_rad/measured", 1 / DEG),
    "rudder_meas_deg": ("rudder_rad/measured", 1 / DEG),
    "aileron_mean_meas_deg": ("aileron_mean_rad/measured", 1 / DEG),
    "rudder_mean_meas_deg": ("rudder_mean_rad/measured", 1 / DEG),
}
# Fields of a flight commanded in g, after all others.
_LOAD_FACTOR = {
    "nz_cmd_g": ("nz_cmd_g", 1.0),
    "nz_ref_g": ("nz_ref_g", 1.0),
    "throttle_cmd_norm": ("throttle_norm", 1.0),
    "model_a_0": ("model_a_0", 1.0),
    "model_a_1": ("model_a_1", 1.0),
    "model_b_0": ("model_b_0", 1.0),
    "model_b_1": ("model_b_1", 1.0),
}
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
    groups = [("", _FLOWN, FLOWN_FIELDS), ("", _TRUTH, Truth._fields), ("", _MEASURED, Measurement._fields)]
    groups += [(f"{name}.", _ESTIMATED, Estimate._fields) for name in estimators]
    groups += [("", _LATERAL, LATERAL_FIELDS)] if lateral else []
    groups += [("", _LOAD_FACTOR, LoadFactorSample._fields)] if load_factor else []
    rows = rows.reshape(-1, sum(len(fields) for _, _, fields in groups))
    columns: dict[str, Vector] = {"t_s": rows[:, 0] / control_hz}
    offset, reconstructs = 0, False
    for prefix, wanted, fields in groups:
        if wanted is _ESTIMATED and np.isfinite(rows[:, offset + fields.index("reconstructed_rad")]).any():
            wanted, reconstructs = {**wanted, **_RECONSTRUCTED}, True
        for column, (field, factor) in wanted.items():
            columns[prefix + column] = rows[:, offset + fields.index(field)] * factor
        offset += len(fields)
    if reconstructs:
        mean = rows[:, LEADING + Truth._fields.index("elevator_mean_rad")] / DEG
        columns[ACTING] = columns["effectiveness_true"] * mean + columns["elevator_offset_deg"]
        columns[GUST_ALPHA] = columns["gust_up_fps"] * FT / columns["airspeed_m_s"] / DEG
    return Trace(columns, tuple(estimators))
