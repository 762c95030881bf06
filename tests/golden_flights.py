"""The table of shipped flights in ``tests/golden/``: a SHA-256 and samples of every trace column.

    python -m tests.golden_flights                    # compare all shipped scenarios with the table
    python -m tests.golden_flights --write            # add missing entries; refuse if an entry would change
    python -m tests.golden_flights --write --changed "reason"   # change entries, and record the reason in the table

The SHA-256 of a column holds only where the same machine code computes it, so they are kept per environment: versions, libc, CPU features
and BLAS kernel. In an environment that the table does not know, columns are compared with samples, evenly spaced ticks, within 1e-9
of the column's range.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded, as in conftest.py: part of the environment

import argparse
import hashlib
import io
import json
import math
import sys
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from flightbed.core.environment import environment

Vector = npt.NDArray[np.float64]
Columns = Mapping[str, Vector]

GOLDEN = Path(__file__).resolve().parent / "golden"
SAMPLES = 41  # ticks a column
GOLDEN_PROPERTY = (
    "golden flight"  # of a test report: the fields of Compared, printed by conftest.py at the end of the session
)
# Of the column's range. The largest deviation measured is 1.9e-10, between BLAS kernels (docs/architecture.md, The guard).
TOLERANCE = 1e-9


def identifier(found: Mapping[str, str]) -> str:
    """Return the name of an environment in the table."""
    return hashlib.sha256(json.dumps(dict(found), sort_keys=True).encode()).hexdigest()[:12]


# ---- entries of the table ----


def sha256(column: Vector) -> str:
    """Return the SHA-256 of a column's bytes."""
    return hashlib.sha256(np.ascontiguousarray(column).tobytes()).hexdigest()


def sampled(column: Vector) -> Vector:
    """Return evenly spaced values of a column, the first and the last among them."""
    values: Vector = column[np.linspace(0, len(column) - 1, SAMPLES).round().astype(int)]
    return values


def scale(column: Vector) -> float:
    """Return the range of a column's finite values; of a constant its magnitude, of which 1e-9 may be lost like of a range."""
    finite = column[np.isfinite(column)]
    if not len(finite):
        return 0.0
    return float(np.ptp(finite)) or float(np.abs(finite[0]))


def deviation(column: Vector, stored: Vector, of: float) -> float:
    """Return the largest deviation from stored samples in units of ``of``; inf where only one of two is finite, or infinities differ."""
    taken = sampled(column)
    finite = np.isfinite(stored)
    if not np.array_equal(taken[~finite], stored[~finite], equal_nan=True) or not np.isfinite(taken[finite]).all():
        return math.inf
    largest = float(np.max(np.abs(taken[finite] - stored[finite]), initial=0.0))
    return largest / of if of else math.inf if largest else 0.0


@dataclass(frozen=True)
class Flight:
    """The entries of one scenario.

    Attributes:
        ticks: length of the trace.
        sha256: environment -> column -> SHA-256.
        samples: column -> SAMPLES values.
        scales: column -> the range that deviations are relative to.

    """

    ticks: int
    sha256: dict[str, dict[str, str]] = field(default_factory=dict)
    samples: dict[str, Vector] = field(default_factory=dict)
    scales: dict[str, float] = field(default_factory=dict)

    def compared(self, columns: Columns, key: str) -> Compared:
        """Compare a flight with the entries; ``key`` is the running environment."""
        known = self.sha256.get(key, {})
        problems, digests, largest = [], 0, 0.0
        for name in columns.keys() | self.samples.keys():
            if name not in self.samples:
                problems.append(f"{name}: a new column, not in the table")
            elif name not in columns:
                problems.append(f"{name}: in the table, not in the flight")
            elif len(columns[name]) != self.ticks:
                problems.append(f"{name}: {len(columns[name])} ticks, {self.ticks} in the table")
            elif name in known:
                digests += 1
                if sha256(columns[name]) != known[name]:
                    off = deviation(columns[name], self.samples[name], self.scales[name])
                    problems.append(f"{name}: another SHA-256; samples deviate by {off:.3g} of the range")
            else:
                off = deviation(columns[name], self.samples[name], self.scales[name])
                largest = max(largest, off)
                if not off <= TOLERANCE:
                    problems.append(f"{name}: samples deviate by {off:.3g} of the range, at most {TOLERANCE:g}")
        return Compared(sorted(problems), digests, len(columns) - digests, largest)


@dataclass(frozen=True)
class Compared:
    """A flight against the table: problems, how many columns by SHA-256 and how many by samples, the largest deviation of the latter."""

    problems: list[str]
    by_sha256: int
    by_samples: int
    largest: float


# ---- the table ----


@dataclass
class Table:
    """All entries.

    Attributes:
        environments: identifier -> environment.
        flights: scenario -> its entries.
        changes: reasons of the entries that were changed, each with the columns, oldest first.

    """

    environments: dict[str, dict[str, str]] = field(default_factory=dict)
    flights: dict[str, Flight] = field(default_factory=dict)
    changes: list[dict[str, Any]] = field(default_factory=list)

    @classmethod
    def read(cls, folder: Path = GOLDEN) -> Table:
        """Read it from a folder; an empty table if there is none."""
        file = folder / "flights.json"
        if not file.is_file():
            return cls()
        stored = json.loads(file.read_text())
        flights = {}
        with np.load(folder / "flights.npz") as arrays:
            for name, entry in stored["flights"].items():
                samples, scales = arrays[f"{name}/samples"], arrays[f"{name}/scales"]
                columns = samples.dtype.names
                flights[name] = Flight(
                    entry["ticks"],
                    entry["sha256"],
                    {column: samples[column].copy() for column in columns},
                    {column: float(scales[column]) for column in columns},
                )
        return cls(stored["environments"], flights, stored["changes"])

    def write(self, folder: Path = GOLDEN) -> None:
        """Write it: ``flights.json`` and ``flights.npz``, the same bytes for the same entries."""
        arrays: dict[str, npt.NDArray[Any]] = {}
        for name, flight in self.flights.items():
            layout = [(column, "<f8") for column in flight.samples]
            samples = np.zeros(SAMPLES, layout)
            scales = np.zeros((), layout)
            for column, values in flight.samples.items():
                samples[column] = values
                scales[column] = flight.scales[column]
            arrays |= {f"{name}/samples": samples, f"{name}/scales": scales}
        with zipfile.ZipFile(folder / "flights.npz", "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(arrays):
                data = io.BytesIO()
                np.lib.format.write_array(data, arrays[name])
                archive.writestr(zipfile.ZipInfo(f"{name}.npy"), data.getvalue(), zipfile.ZIP_DEFLATED)  # no date
        stored = {
            "environments": self.environments,
            "changes": self.changes,
            "flights": {n: {"ticks": f.ticks, "sha256": f.sha256} for n, f in self.flights.items()},
        }
        (folder / "flights.json").write_text(json.dumps(stored, indent=1, sort_keys=True) + "\n")

    def differing(self, flown: Mapping[str, Columns], key: str) -> dict[str, list[str]]:
        """Return scenario -> columns whose entries the flights contradict; columns and scenarios without entries do not count."""
        found = {name: sorted(flight.samples) for name, flight in self.flights.items() if name not in flown}
        for name, columns in flown.items():
            if name in self.flights:
                known = {c: v for c, v in columns.items() if c in self.flights[name].samples}
                problems = self.flights[name].compared(known, key).problems
                if problems:
                    found[name] = [problem.partition(": ")[0] for problem in problems]
        return found

    def add(self, flown: Mapping[str, Columns], found: Mapping[str, str], *, changed: str | None = None) -> int:
        """Add the entries that the table lacks; with a reason, also replace the entries that the flights contradict.

        A replaced entry loses its SHA-256 in all other environments: those compare it with its samples.

        Args:
            flown: scenario -> columns, all shipped scenarios.
            found: the environment that they were flown in.
            changed: reason why entries change.

        Returns: how many columns got an entry or a SHA-256.

        Raises ValueError when an entry would change without a reason.

        """
        key = identifier(found)
        differing = self.differing(flown, key)
        if differing and changed is None:
            listed = "; ".join(f"{name}: {', '.join(columns)}" for name, columns in differing.items())
            raise ValueError(f'entries would change ({listed}); find out why, then give the reason: --changed "..."')
        for name, contradicted in differing.items():
            self._drop(name, contradicted, flown.get(name, {}))
        if differing:
            self.changes.append({"why": changed, "columns": differing})
        added = 0
        for name, columns in flown.items():
            flight = self.flights.setdefault(name, Flight(len(columns["t_s"])))
            digests = flight.sha256.setdefault(key, {})
            for column, values in columns.items():
                if column not in flight.samples:
                    flight.samples[column], flight.scales[column] = sampled(values), scale(values)
                if column not in digests:
                    digests[column] = sha256(values)
                    added += 1
        self.environments[key] = dict(found)
        return added

    def _drop(self, name: str, columns: Sequence[str], flown: Columns) -> None:
        flight = self.flights[name]
        if not flown or len(flown["t_s"]) != flight.ticks:  # another length changes every column
            del self.flights[name]
            return
        for column in columns:
            del flight.samples[column], flight.scales[column]
            for digests in flight.sha256.values():
                digests.pop(column, None)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly all shipped scenarios and compare them with the table, or write it; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden_flights", description=__doc__.partition("\n")[0])
    parser.add_argument("--write", action="store_true", help="add missing entries")
    parser.add_argument("--changed", metavar="WHY", help="with --write: change entries, for this reason")
    given = parser.parse_args(arguments)
    if given.changed is not None and not (given.write and given.changed.strip()):
        parser.error("--changed needs --write and a reason that is not empty")
    from flightbed.core import data
    from tests.flights import fly_shipped

    found, table = environment(), Table.read()
    flights = {name: fly_shipped(name).trace.columns for name in data.names("scenario")}
    if given.write:
        try:
            print(f"{table.add(flights, found, changed=given.changed)} columns added or changed")
        except ValueError as error:
            print(error, file=sys.stderr)
            return 1
        table.write()
        return 0
    compared = {
        name: table.flights.get(name, Flight(0)).compared(columns, identifier(found))
        for name, columns in flights.items()
    }
    for name, one in compared.items():
        print(*(f"{name}: {problem}" for problem in one.problems), sep="\n", end="\n" if one.problems else "")
    print(summary(list(compared.values())))
    return 1 if any(one.problems for one in compared.values()) else 0


def summary(compared: Sequence[Compared]) -> str:
    """Return in one line how flights were compared."""
    digests, samples = sum(one.by_sha256 for one in compared), sum(one.by_samples for one in compared)
    text = f"{len(compared)} shipped scenarios: {digests} columns compared by SHA-256"
    if samples:
        text += (
            f", {samples} with samples (no SHA-256 for this environment, {identifier(environment())}): "
            f"within {max(one.largest for one in compared):.2g} of their range, at most {TOLERANCE:g} permitted"
        )
    return text


if __name__ == "__main__":
    sys.exit(main())
