"""Parquet file of the histories of a campaign: one row per point and tick."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightbed.core.units import unit_of
from flightbed.statistics.histories import PERCENTILES, Ensemble


def write_histories(ensembles: Mapping[int, Ensemble], control_hz: Mapping[int, int], path: Path) -> None:
    """Write histories as Parquet, one row group per point, with the unit of each column in its metadata. Raises OSError.

    Columns are ``point``, ``t_s``, ``flying`` (flights that have not ended before the tick), ``sampled`` (flights of the point that the
    percentiles use, the same at all ticks), and for each history ``NAME.mean``, ``NAME.std``, ``NAME.p5`` ... ``NAME.p95``, in single
    precision.

    Args:
        ensembles: point -> histories, with the same columns at all points; at least one point.
        control_hz: point -> control rate, Hz.
        path: the file.

    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = list(next(iter(ensembles.values())).percentiles)
    parts = ("mean", "std", *(f"p{percent}" for percent in PERCENTILES))
    kinds = {"point": pa.int32(), "t_s": pa.float64(), "flying": pa.int32(), "sampled": pa.int32()}
    fields = [pa.field(name, kind, metadata={"unit": unit_of(name)}) for name, kind in kinds.items()]
    fields += [pa.field(f"{n}.{part}", pa.float32(), metadata={"unit": unit_of(n)}) for n in names for part in parts]
    packed = {
        "compression": "zstd",
        "use_dictionary": False,
        "use_byte_stream_split": True,
    }  # halves the file
    with pq.ParquetWriter(path, pa.schema(fields), **packed) as file:
        for point in sorted(ensembles):
            ensemble = ensembles[point]
            ticks = len(ensemble.moments.flying)
            columns: dict[str, Any] = {
                "point": np.full(ticks, point),
                "t_s": np.arange(ticks) / control_hz[point],
                "flying": ensemble.moments.flying,
                "sampled": np.full(ticks, ensemble.sampled),
            }
            for name in names:
                found = (ensemble.moments.mean[name], ensemble.moments.std(name), *ensemble.percentiles[name])
                columns |= {f"{name}.{part}": v for part, v in zip(parts, found, strict=True)}
            arrays = [pa.array(columns[field.name], type=field.type, safe=False) for field in fields]
            file.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)))
