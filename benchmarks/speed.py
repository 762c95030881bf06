"""Speed and memory of flightbed: every figure of docs/benchmarks.md.

    python benchmarks/speed.py                              # everything
    python benchmarks/speed.py --only loop estimators       # some sections
    python benchmarks/speed.py --json speed.json            # the value of every round, too

Compared cases are measured in turn within one run; a figure is the median over the rounds with the lowest and the highest, and a ratio is
taken round by round. The machine must be idle otherwise: its load average before the first section is printed.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from importlib import import_module
from pathlib import Path
from types import MappingProxyType

from measuring import THREADS, Effort, Table, machine

# Modules, imported when measured: worker processes import this file again, and are not to pay for all of them.
SECTIONS = {
    "loop": "sections.loop",
    "estimators": "sections.estimators",
    "flights": "sections.flights",
    "start-up": "sections.startup",
    "recording": "sections.recording",
    "memory": "sections.memory",
}
ROUNDS = 9


def full(rounds: int) -> Effort:
    """Return the effort of the published figures."""
    return Effort(rounds)


def quick(rounds: int) -> Effort:
    """Return the effort of a test: few and short flights, nothing compiled or drawn in a fresh shell."""
    return Effort(
        rounds,
        overrides=("duration_s=1", "failures.0.at_s=0.5"),
        chunks=1,
        chunk=1,
        parallel=("linear aircraft",),
        flights=10,
        held=2,
        environment=MappingProxyType({"FLIGHTBED_PLAIN": "1"}),
        report="off",
    )


def main(arguments: list[str]) -> int:
    """Measure the requested sections, print each when it is finished, and write them if a file is named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--only", nargs="+", choices=SECTIONS, default=list(SECTIONS), metavar="NAME", help=", ".join(SECTIONS)
    )
    parser.add_argument("--rounds", type=_positive, help=f"of each measurement; {ROUNDS}, and 1 with --quick")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there as well")
    parser.add_argument("--quick", action="store_true", help="a smoke run: its figures mean nothing")
    given = parser.parse_args(arguments)
    effort = quick(given.rounds or 1) if given.quick else full(given.rounds or ROUNDS)
    for (
        name
    ) in THREADS:  # as workers have it: threads that wait for matrices by spinning take the second core from others
        os.environ.setdefault(name, "1")
    before = machine()
    print(
        f"{before['cores']} cores, load average before: {before['load_average']:.2f}; median (range) of {effort.rounds} rounds"
    )
    found: dict[str, list[Table]] = {}
    for name in dict.fromkeys(given.only):
        print(f"\n## {name}", flush=True)
        found[name] = import_module(SECTIONS[name]).measure(effort)
        for table in found[name]:
            print(f"\n{table.text()}", flush=True)
    if given.json is not None:
        sections = {name: [table.to_dict() for table in tables] for name, tables in found.items()}
        values = {"machine": before, "rounds": effort.rounds, "quick": given.quick, "sections": sections}
        given.json.write_text(json.dumps(values, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return 0


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
