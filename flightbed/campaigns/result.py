"""Campaign: the result of a programme: table rows, histories, the worst flight, and the summary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from flightbed.analysis.result import Result
from flightbed.campaigns.plan import Programme
from flightbed.campaigns.summary import CampaignSummary, summarize_campaign
from flightbed.campaigns.table import Quantity, Row, followed, quantity
from flightbed.scenario.estimates import detectors, estimates
from flightbed.scenario.tables import Scenario
from flightbed.statistics.histories import Ensemble


@dataclass(frozen=True)
class Campaign:
    """Flights of a programme.

    Attributes:
        programme: the flights.
        rows: one per flight, in order of their indices: column -> value, None where the flight has none.
        histories: point -> histories of the columns ``worker.HISTORIES`` and ``<name>.effectiveness_smoothed``; of the points
            that keep them, and in which some flight did not raise.
        worst: the worst flight, flown again with its complete trace; None where every flight raised.
        worst_index: its index.
        reason: why it is the worst, in words.
        wall_time_s: duration, s, after the last ``--resume``.

    """

    programme: Programme
    rows: Sequence[Row]
    histories: Mapping[int, Ensemble]
    worst: Result | None
    worst_index: int
    reason: str
    wall_time_s: float

    @property
    def scenario(self) -> Scenario:
        """The base scenario, complete."""
        return self.programme.scenario

    @property
    def estimators(self) -> tuple[str, ...]:
        """Names of the estimates, in the order of the scenario's estimators."""
        return estimates(self.scenario)

    @cached_property
    def flown(self) -> list[Row]:
        """Rows of the flights that did not raise."""
        return [row for row in self.rows if row["error"] is None]

    @cached_property
    def failed(self) -> list[Row]:
        """Rows of the flights that raised."""
        return [row for row in self.rows if row["error"] is not None]

    @cached_property
    def summary(self) -> CampaignSummary:
        """Statistics of the campaign and of its points."""
        return summarize_campaign(
            self.programme,
            self.rows,
            histories=sorted(self.histories),
            worst=None if self.worst is None else self.worst.summary,
            worst_index=self.worst_index,
            reason=self.reason,
            wall_time_s=self.wall_time_s,
        )

    def quantity(self, column: str) -> Quantity:
        """Return the values of a column of the table, of the flights that did not raise."""
        return quantity(self.flown, column, tests=detectors(self.scenario), seed=self.programme.seed)


def worst_of(rows: Sequence[Row]) -> tuple[int, str]:
    """Return index of the worst flight and the reason: the first to depart, else to hit the ground, else the largest tracking RMS.

    Of equal flights the first one; -1 where every flight raised.
    """
    flown = [row for row in rows if row["error"] is None]
    if not flown:
        return -1, "every flight failed"
    for how, words in (("departed", "departed first"), ("ground", "hit the ground first")):
        gone = [row for row in flown if row["ended"] == how]
        if gone:
            worst = min(gone, key=lambda row: float(row["flown_s"] or 0.0))
            return int(worst["index"] or 0), f"{words}, at {worst['departed_at_s'] or worst['flown_s']:.2f} s"
    worst = max(flown, key=_tracking)
    column, what, unit, after = followed([worst])
    if worst[column] is None:
        return int(worst["index"] or 0), "the first flight: all flew to the end, and there is no command to follow"
    when = "from 0.3 s after the failure" if after else "over the whole flight"
    return int(worst["index"] or 0), f"largest RMS of {what} {when}, {_tracking(worst):.3g} {unit}"


def _tracking(row: Row) -> float:
    return float(row[followed([row]).column] or 0.0)
