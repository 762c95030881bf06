"""One scenario flown with many seeds: the flights, their numbers, the worst of them, and the folder that they leave."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from flightbed.campaign_table import NO_QUANTITIES, Quantity, Row, ended, flown_s, quantity, rows
from flightbed.consistency import detectors
from flightbed.ensemble import Flown, Job, fly_jobs, processes
from flightbed.errors import InputError
from flightbed.extension import permits
from flightbed.folder import CAMPAIGN_FILES, check_target, write_campaign
from flightbed.mission import Result, plan
from flightbed.mission import run as fly_one
from flightbed.settings import Scenario
from flightbed.statistics import Interval, share

Progress = Callable[[int, int], None]

HISTORIES = (
    "q_deg_s",
    "q_ref_deg_s",
    "alpha_deg",
    "elevator_deg",
    "effectiveness_true",
)  # and of estimators the smoothed K
_BATCH = 10  # flights of a job: so many are done before the progress tells of them, and two workers share twenty
_LAST_SEED = 2**63 - 1


@dataclass(frozen=True)
class Campaign:
    """Flights of one scenario with successive seeds.

    Attributes:
        scenario: as flown, complete; its seed is the first flight's.
        flights: one a seed, in their order, with the columns ``HISTORIES`` and ``<name>.effectiveness_smoothed``.
        worst: the worst flight, flown again, whole.
        reason: why it is the worst, in words.
        wall_time_s: how long it took.

    """

    scenario: Scenario
    flights: Sequence[Flown]
    worst: Result
    reason: str
    wall_time_s: float

    @property
    def estimators(self) -> tuple[str, ...]:
        """Names of the estimators, as the scenario orders them."""
        return tuple(e.name for e in self.scenario.estimators)

    @property
    def departed(self) -> Interval:
        """Share of the flights that departed, with its exact binomial interval."""
        return share(sum(f.metrics.departed for f in self.flights), len(self.flights))

    @property
    def override(self) -> str:
        """Options of ``flightbed run`` that fly the worst flight again, of the campaign's scenario.toml."""
        return f" --set seed={self.worst.plan.scenario.seed}{permits(self.worst.summary)}"

    @property
    def again(self) -> str:
        """Command that flies the worst flight again; FOLDER is the campaign's."""
        return f"flightbed run FOLDER/scenario.toml{self.override}"

    @cached_property
    def rows(self) -> list[Row]:
        """Table of the flights: column -> value of each; None where there is none."""
        return rows(self.flights, self.scenario)

    def quantity(self, column: str) -> Quantity:
        """Return a column of the table as a quantity of the flights."""
        return quantity(self.rows, column, tests=detectors(self.scenario))

    def quantities(self) -> list[Quantity]:
        """Return every number of the table that some flight has, but for seeds."""
        columns = [column for column in self.rows[0] if column not in NO_QUANTITIES]
        return [q for q in map(self.quantity, columns) if q.known]


def run(
    scenario: Scenario,
    out: str | Path,
    *,
    runs: int,
    workers: int | None = None,
    replace: bool = True,
    progress: Progress | None = None,
) -> tuple[Campaign, Path]:
    """Fly a campaign on local processes and leave a folder with scenario, table, summary and report, whole or not at all.

    Args:
        scenario: what to fly.
        out: folder to write.
        runs: how often.
        workers: processes, all cores if None.
        replace: an ``out`` that holds an earlier campaign is replaced, and any other folder that is not empty is refused; if false,
            the first free one of OUT, OUT-2, OUT-3, ... is taken instead.
        progress: called with the numbers of flights that are done, and of all, whenever some are done.

    Returns:
        The campaign, and where it was written.

    Raises:
        As ``fly``; OutputError when the folder cannot be written.

    """
    if workers is not None and workers < 1:
        raise InputError(f"--workers: must be at least 1 (got {workers})")
    target = check_target(Path(out), replace=replace, files=CAMPAIGN_FILES)
    with processes(workers) as executor:
        flown = fly(scenario, runs, executor=executor, progress=progress)
    return flown, write_campaign(flown, target, replace=replace)


def fly(
    scenario: Scenario, runs: int, *, executor: Executor | None = None, progress: Progress | None = None
) -> Campaign:
    """Fly a scenario with ``runs`` successive seeds, its own first.

    Args:
        scenario: what to fly.
        runs: how often.
        executor: where, see ``ensemble.processes``; None flies here and now. The flights do not depend on it.
        progress: called with the numbers of flights that are done, and of all, whenever some are done.

    Raises:
        InputError, NotComputableError, as ``mission.run`` does; InputError for runs < 1, and for seeds beyond the largest.

    """
    if runs < 1:
        raise InputError(f"--runs: must be at least 1 (got {runs})")
    if scenario.seed > _LAST_SEED - runs + 1:
        raise InputError(f"seed: must be at most {_LAST_SEED - runs + 1} with {runs} flights (got {scenario.seed})")
    began, done = time.perf_counter(), 0

    def tell(flights: int) -> None:
        nonlocal done
        done += flights
        if progress is not None:
            progress(done, runs)

    scenario = plan(scenario).scenario  # complete; and what cannot be flown is told before workers start
    columns = (*HISTORIES, *(f"{e.name}.effectiveness_smoothed" for e in scenario.estimators))
    starts = range(0, runs, _BATCH)
    jobs = [Job(scenario, min(_BATCH, runs - start), columns, scenario.seed + start) for start in starts]
    flights = [flown for part in fly_jobs(jobs, executor=executor, progress=tell) for flown in part]
    worst, reason = _worst(flights, scenario)
    return Campaign(scenario, flights, fly_one(scenario.with_seed(worst.seed)), reason, time.perf_counter() - began)


def _worst(flights: Sequence[Flown], scenario: Scenario) -> tuple[Flown, str]:
    """Return the worst flight, the first of several, and why: it departed first, hit the ground first, or tracked worst."""
    for how, words in (("departed", "departed first"), ("ground", "hit the ground first")):
        gone = [flown for flown in flights if ended(flown, scenario) == how]
        if gone:
            worst = min(gone, key=lambda flown: flown_s(flown, scenario))
            return worst, f"{words}, at {worst.metrics.departed_at_s or flown_s(worst, scenario):.2f} s"
    worst = max(flights, key=_tracking)
    return worst, f"largest RMS of q - q_ref {tracking_words(worst)}, {_tracking(worst):.3g} deg/s"


def _tracking(flown: Flown) -> float:
    after = flown.metrics.tracking_rms_post_deg_s
    return (after if after is not None else flown.metrics.tracking_rms_pre_deg_s) or 0.0


def tracking_words(flown: Flown) -> str:
    """Return what the tracking of a flight is taken over."""
    return "over the whole flight" if flown.metrics.tracking_rms_post_deg_s is None else "from 0.3 s after the failure"


def summary(campaign: Campaign) -> dict[str, Any]:
    """Return what summary.json holds: nested plain values, null for what is infinite or cannot be said."""
    departed, worst = campaign.departed, campaign.worst.summary
    ends = [row["ended"] for row in campaign.rows]
    numbers = {q.column: q.to_dict() for q in campaign.quantities()}
    return {
        "scenario": campaign.scenario.name,
        "flights": len(campaign.flights),
        "first_seed": campaign.scenario.seed,
        "departed": {"count": ends.count("departed"), "share": departed.estimate, "low": departed.low, "high": departed.high},
        "hit_ground": ends.count("ground"),
        **{column: values for column, values in numbers.items() if "." not in column},
        "estimators": {
            name: {c.removeprefix(f"{name}."): v for c, v in numbers.items() if c.startswith(f"{name}.")}
            for name in campaign.estimators
        },
        "worst": {
            "seed": worst["seed"],
            "reason": campaign.reason,
            "command": campaign.again,
            "metrics": campaign.worst.metrics.to_dict(),
        },
        "wall_time_s": campaign.wall_time_s,
        "aircraft_sha256": worst["aircraft_sha256"],
        "versions": worst["versions"],
    }  # fmt: skip
