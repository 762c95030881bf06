"""What a study is made of: parts, each the flights that it needs and the section that it makes of them."""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from importlib.metadata import version

from flightbed.document import Section
from flightbed.ensemble import Flown, Job, Progress, fly_jobs

Flights = list[list[Flown]]


@dataclass(frozen=True)
class Part:
    """A section and the flights behind it.

    Attributes:
        jobs: what has to be flown.
        build: the flights of each job, in order -> the section.

    """

    jobs: Sequence[Job]
    build: Callable[[Flights], Section]


def flights_of(parts: Sequence[Part]) -> int:
    """Return how many flights all parts need."""
    return sum(job.runs for part in parts for job in part.jobs)


def fly_parts(parts: Sequence[Part], *, executor: Executor | None, progress: Progress) -> list[Section]:
    """Fly what all parts need, together, and build their sections in order."""
    flights = fly_jobs([job for part in parts for job in part.jobs], executor=executor, progress=progress)
    sections, at = [], 0
    for part in parts:
        sections.append(part.build(flights[at : at + len(part.jobs)]))
        at += len(part.jobs)
    return sections


def versions() -> dict[str, str]:
    """Return the versions that the numbers of a study depend on."""
    return {
        "flightbed": version("flightbed"),
        "python": platform.python_version(),
        **{package: version(package) for package in ("jsbsim", "numpy", "scipy", "numba")},
    }
