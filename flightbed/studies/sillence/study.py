"""The study of Sillence (1999): tables and figures recomputed, claims judged, the thesis's future work carried out."""

from __future__ import annotations

from collections.abc import Sequence

from flightbed.studies.base import Part, Study
from flightbed.studies.sillence import aircraft, damage, examples, inputs, level, setup, tables, variants
from flightbed.studies.sillence.claims import claims
from flightbed.studies.sillence.figures import figures

RUNS = 100
HISTORY = 5  # flights of the histories, as a multiple of the other cases: 500 by default
FEWER = 5  # the slower cases get 1/FEWER of the flights


def sillence() -> Study:
    """Loop-gain estimation (Sillence 1999, with Pachter): tables, figures, claims and future work, on the linear model and the F-16."""
    return Study("sillence", "Sillence (1999), recomputed and carried on to the aircraft", RUNS, parts)


def parts(runs: int) -> Sequence[Part]:
    """Return all parts, in the order of the report.

    Args:
        runs: flights per case; the histories have ``HISTORY`` times as many, most cases beyond the thesis 1/``FEWER``.

    """
    few = max(1, runs // FEWER)
    return [
        tables.glance(runs),
        claims(runs),
        setup.search(),
        tables.estimation(runs),
        variants.grid(few),
        figures(),
        examples.examples(runs),
        aircraft.experiment(few),
        inputs.excitation(few),
        damage.structural(few),
        damage.disturbances(few),
        aircraft.ensembles(HISTORY * runs),
        level.real_time(),
        level.level(few),
    ]
