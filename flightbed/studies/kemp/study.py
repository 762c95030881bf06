"""The study of Kemp (1987): pseudo-linear identification, and adaptive control based on it, on the plants of the thesis."""

from __future__ import annotations

from collections.abc import Sequence

from flightbed.studies.base import Part, Study
from flightbed.studies.kemp.adaptive import adaptive
from flightbed.studies.kemp.figures import figures
from flightbed.studies.kemp.identification import identification
from flightbed.studies.kemp.tracking import tracking

RUNS = 200


def kemp() -> Study:
    """Pseudo-linear identification (Kemp 1987): plants A to F, bias and speed, tracking, adaptive pole placement, U-D factors."""
    return Study("kemp", "Kemp (1987), recomputed: pseudo-linear identification and adaptive control", RUNS, parts)


def parts(runs: int) -> Sequence[Part]:
    """Return all parts, in the order of the report.

    Args:
        runs: draws of input and noises per case.

    """
    return [identification(runs), tracking(runs), adaptive(runs), figures()]
