"""Fly one scenario of each form, so that numba's cache holds the compiled kernels before several test processes start.

``make test`` runs it beside mypy. Without it each process of the tests compiles the same kernels at the same time.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario

NAMES = (
    "elevator-loss", "thesis-loss", "elevator-and-aileron", "elevator-redesign", "elevator-stuck", "harmonic-gust", "pull-up-loss",
)  # fmt: skip


def main() -> None:
    for name in NAMES:
        run(load_scenario(name), rerun=False, report=False)


if __name__ == "__main__":
    main()
