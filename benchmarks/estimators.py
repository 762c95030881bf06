"""All estimators side by side: what they assume, what they cost, and how they do on one set of flights; the tables of docs/estimators.md.

    python benchmarks/estimators.py [--runs 80] [--workers N]      # fly, and print the tables
    python benchmarks/estimators.py --write                         # write them into docs/estimators.md and README.md, too
    python benchmarks/estimators.py --quick --runs 1                # short flights: does it work? Their figures mean nothing

An estimator more is a row in ``side_by_side/entrants.py``, a flight more one in ``side_by_side/flights.py``.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from side_by_side.cost import costs_us
from side_by_side.entrants import ENTRANTS
from side_by_side.flights import FLIGHTS, Course
from side_by_side.measures import fly_set
from side_by_side.page import pieces, write

from flightbed.ensemble import processes

ROOT = Path(__file__).resolve().parents[1]
QUICK = Course(("duration_s=6.5",))  # two seconds beyond the failures
ROUNDS = 9


def main(arguments: Sequence[str]) -> int:
    """Fly what is asked for, print the tables, and write them if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=80, help="seeds of each flight")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--write", action="store_true", help="into the documents")
    parser.add_argument("--quick", action="store_true", help="a smoke run: its figures mean nothing")
    asked = parser.parse_args(arguments)
    if asked.runs < 1:
        parser.error("--runs: must be at least 1")
    if asked.quick and asked.write:
        parser.error("--write: the figures of --quick mean nothing")
    began = time.perf_counter()
    course = QUICK if asked.quick else Course()
    costs = costs_us(course.together(FLIGHTS[0], ENTRANTS), 1 if asked.quick else ROUNDS)
    with processes(asked.workers) as executor:
        results = fly_set(
            FLIGHTS,
            ENTRANTS,
            costs,
            runs=asked.runs,
            course=course,
            executor=executor,
            say=lambda text: print(text, flush=True),
        )
    told = pieces(results)
    for name, text in told.items():
        print(f"\n## {name}\n\n{text}")
    if asked.write:
        write(told, page=ROOT / "docs" / "estimators.md", readme=ROOT / "README.md")
    print(f"\n{time.perf_counter() - began:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
