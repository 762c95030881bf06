"""The study of Wu, Zhang and Zhou (2000): both examples recomputed, claims judged, distribution of the test statistic, choices varied."""

from __future__ import annotations

from collections.abc import Sequence

from flightbed.studies.base import Part, Study
from flightbed.studies.wu import choices, detection, tables
from flightbed.studies.wu.claims import claims
from flightbed.studies.wu.figures import figures

RUNS = 100
QUIET = 2  # runs without failure, as a multiple of the other cases: 200 by default, and as many again for the check
FEWER = 5  # the variants of our choices get 1/FEWER of the runs


def wu() -> Study:
    """Loss of control effectiveness by two-stage filtering (Wu, Zhang and Zhou 2000): examples, figures, claims, test statistic."""
    return Study("wu", "Wu, Zhang and Zhou (2000), recomputed", RUNS, parts)


def parts(runs: int) -> Sequence[Part]:
    """Return all parts, in the order of the report.

    Args:
        runs: noise draws per case; cases without failure have ``QUIET`` times as many, twice, the variants 1/``FEWER``.

    """
    few = max(1, runs // FEWER)
    return [
        tables.accuracy(runs),
        claims(runs, QUIET * runs),
        tables.example_2(runs),
        tables.margins(runs),
        detection.law(QUIET * runs, runs),
        choices.choices(few),
        figures(),
    ]
