"""The study of Gupta, D'Amato, Ali and Bernstein (2012): examples recomputed, claims judged, rival estimators on the same signals."""

from __future__ import annotations

from collections.abc import Sequence

from flightbed.studies.base import Part, Study
from flightbed.studies.gupta import tables
from flightbed.studies.gupta.claims import claims
from flightbed.studies.gupta.figures import figures
from flightbed.studies.gupta.rivals import comparison

RUNS = 40


def gupta() -> Study:
    """Retrospective-cost reconstruction of an unknown harmonic input (Gupta et al. 2012): examples, figures, claims, rivals."""
    return Study("gupta", "Gupta, D'Amato, Ali and Bernstein (2012), recomputed, with rivals", RUNS, parts)


def parts(runs: int) -> Sequence[Part]:
    """Return all parts, in the order of the report.

    Args:
        runs: initial states and phases per case.

    """
    return [
        tables.glance(runs),
        claims(runs),
        tables.regularization(runs),
        tables.damping(runs),
        tables.sensitivity(runs),
        comparison(runs),
        figures(),
    ]
