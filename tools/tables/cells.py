"""Cells that the tables share."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np


def likely(values: Iterable[float | None], spec: str) -> str:
    """Return "median (5 % - 95 %)" of the values that are not None, or "-"."""
    known = [v for v in values if v is not None]
    if not known:
        return "-"
    low, middle, high = np.percentile(known, [5, 50, 95])
    return f"{middle:{spec}} ({low:{spec}} - {high:{spec}})"
