"""Read recordings back."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader


def series(path: Path, entity: str, component: str) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values, one row per time: (n,) for one instance, (n, m) for several, objects for text."""
    times, values = [], []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity and not chunk.is_static:
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                times.append(batch.column("time").to_numpy(zero_copy_only=False).astype("int64") * 1e-9)
                rows = batch.column(component).to_pylist()
                ragged = len({len(row) for row in rows}) > 1
                values.append(np.array(rows, dtype=object) if ragged else np.array(rows))
    joined = np.concatenate(values)
    return np.concatenate(times), joined[:, 0] if joined.shape[1:] == (1,) else joined


def static_text(path: Path, entity: str, component: str) -> list[str]:
    found: list[str] = []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity and chunk.is_static:
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                found += [text for row in batch.column(component).to_pylist() for text in row]
    return found


def rerun(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "rerun", *arguments], capture_output=True, text=True, check=False)
