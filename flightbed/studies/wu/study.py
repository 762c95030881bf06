"""The study of Wu, Zhang and Zhou (2000): both examples recomputed, their claims judged, the test's law and the choices examined."""

from __future__ import annotations

from collections.abc import Sequence

from flightbed.studies.base import Part, Study
from flightbed.studies.wu import choices, detection, tables
from flightbed.studies.wu.claims import claims
from flightbed.studies.wu.figures import figures

RUNS = 100
QUIET = 2  # times as many runs without failure as of other cases: 200 by default, and as many again to check
FEWER = 5  # cases with other choices get this fraction


def wu() -> Study:
    """Loss of control effectiveness by two-stage filtering (Wu, Zhang and Zhou 2000): examples, figures, claims, the test's law."""
    return Study("wu", "Wu, Zhang and Zhou (2000), recomputed", RUNS, parts)


def parts(runs: int) -> Sequence[Part]:
    """Return all parts, in the order of the report.

    Args:
        runs: noise draws of each case; runs without failure are two times two times as many, those with other choices a fifth.

    """
    few = max(1, runs // FEWER)
    return [
        tables.accuracy(runs),
        claims(runs, QUIET * runs),
        tables.second(runs),
        tables.margins(runs),
        detection.law(QUIET * runs, runs),
        choices.choices(few),
        figures(),
    ]
