"""The study of all estimators over one short flight, for tests of its command and its folder."""

from __future__ import annotations

from flightbed.studies.base import Study
from flightbed.studies.estimators.comparison import Comparison
from flightbed.studies.estimators.entrants import ENTRANTS
from flightbed.studies.estimators.flights import FLIGHTS, Course
from flightbed.studies.estimators.study import study

SHORT = Comparison(ENTRANTS[:2], FLIGHTS[:1], Course(("duration_s=6.5",)), rounds=1)


def estimators() -> Study:
    """Two built-in estimators, one flight that ends two seconds after its failure."""
    return study(SHORT)
