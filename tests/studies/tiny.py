"""A study of two small flights, for tests of the code common to all studies."""

from __future__ import annotations

from collections.abc import Mapping

from flightbed.analysis.seeds import Flown, Job
from flightbed.document.document import Section, Table
from flightbed.statistics.intervals import spread
from flightbed.studies.base import Part, Study, keyed_part
from flightbed.studies.sillence.setup import EXPANDING, thesis


def tiny() -> Study:
    """Test study."""
    return Study("tiny", "A tiny study", 3, lambda runs: [_part(runs, "first"), _part(runs + 2, "second", ("t_s",))])


def _part(runs: int, key: str, columns: tuple[str, ...] = ()) -> Part:
    jobs = {left: Job(thesis(left=left, duration_s=6.0), runs, columns) for left in (0.5, 0.2)}

    def build(flown: Mapping[float, list[Flown]]) -> Section:
        rows = [
            [left, spread([f.metrics.estimators[EXPANDING].final for f in flights]), len(flights)]
            for left, flights in flown.items()
        ]
        return Section(key, [], [Table(key, key, ("K_1", "final", "flights"), rows)])

    return keyed_part(jobs, build)
