"""The study of Sillence (1999): his tables and figures recomputed, his claims judged, his future work done."""

from __future__ import annotations

from collections.abc import Sequence

from flightbed.studies.base import Part, Study
from flightbed.studies.sillence import aircraft, damage, examples, inputs, level, setup, tables, variants
from flightbed.studies.sillence.claims import claims
from flightbed.studies.sillence.figures import figures

RUNS = 100
HISTORY = 5  # times as many flights as in other cases: 500 by default
FEWER = 5  # the slower cases of the aircraft get this fraction of the flights


def sillence() -> Study:
    """Loop-gain estimation (Sillence 1999, with Pachter): tables, figures, claims, and its future work, on line and on the aircraft."""
    return Study("sillence", "Sillence (1999), recomputed and carried on to the aircraft", RUNS, parts)


def parts(runs: int) -> Sequence[Part]:
    """Return all parts, in the order of the report.

    Args:
        runs: flights of each case; the histories take five times as many, most cases beyond the thesis a fifth.

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
