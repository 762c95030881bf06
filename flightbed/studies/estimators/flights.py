"""The flights that all estimators share, one row each: shipped scenarios with other estimators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flightbed.core.errors import FlightbedError
from flightbed.flight.assembly import assemble
from flightbed.flight.plan import plan
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.tables import Scenario
from flightbed.studies.estimators.entrants import FIXED, TRUE_K, Entrant, inline


@dataclass(frozen=True)
class Flight:
    """A flight of the set.

    Attributes:
        name: its name in the tables.
        scenario: name of a shipped scenario.
        what: its events, for the tables.
        without: name of the same flight without its failure; flights that are equal without it share the name.
        overrides: of the scenario, KEY=VALUE.

    """

    name: str
    scenario: str
    what: str
    without: str
    overrides: tuple[str, ...] = ()


_DOUBLETS = "doublets, Mach 0.8"

FLIGHTS: tuple[Flight, ...] = (
    Flight("elevator loss", "elevator-loss", "K falls to 0.2 at once", _DOUBLETS),
    Flight("ramp", "ramp-loss", "K falls to 0.3 within 4 s", _DOUBLETS),
    Flight("level", "level-loss", "K falls to 0.2 in level flight: no command, no dither", "level, Mach 0.8"),
    Flight("transonic", "transonic-loss", "K falls to 0.4 at Mach 0.9", "doublets, Mach 0.9"),
    Flight("turbulence", "turbulent-loss", "K falls to 0.3 in moderate turbulence", "doublets, moderate turbulence"),
    Flight(
        "marginal",
        "marginal-authority",
        "K falls to 0.1 in level flight, doublets follow; the law cuts commands to what is left",
        "late doublets, Mach 0.8",
    ),
    Flight("loss and c.g.", "elevator-and-cg", "K falls to 0.2 and the c.g. moves 3 % of the chord aft", _DOUBLETS),
    Flight(
        "stuck",
        "elevator-stuck",
        "the elevator stays where a doublet has it at 5.2 s; its effectiveness is all there, K = 1",
        "doublets, c.g. 6 % forward",
    ),
    Flight(
        "bias",
        "elevator-bias",
        "a bias of 1 deg acts in addition to the commanded and measured deflection; K = 1",
        _DOUBLETS,
    ),
    Flight(
        "c.g. shift",
        "nominal",
        "the c.g. moves 3 % of the chord aft at 4.5 s; K = 1 throughout",
        _DOUBLETS,
        ('failures=[{kind="cg-shift", at_s=4.5, shift_cbar=0.03}]',),
    ),
)


@dataclass(frozen=True)
class Course:
    """Scenarios made of the flights.

    Attributes:
        more: overrides of every scenario, KEY=VALUE.

    """

    more: tuple[str, ...] = ()

    def _scenario(self, flight: Flight, entrants: Sequence[Entrant], *own: str) -> Scenario:
        estimators = f"estimators={inline([entrant.table() for entrant in entrants])}"
        return load_scenario(flight.scenario, [*flight.overrides, estimators, *own, *self.more])

    def together(self, flight: Flight, entrants: Sequence[Entrant]) -> Scenario:
        """Return the flight with all estimators in parallel; the law is corrected by the true K, by none of them."""
        return self._scenario(flight, entrants, "adaptation.oracle=true")

    def healthy(self, flight: Flight, entrants: Sequence[Entrant]) -> Scenario:
        """Return the same flight without its failure."""
        return self._scenario(flight, entrants, "adaptation.oracle=true", "failures=[]")

    def corrected(self, flight: Flight, by: Entrant | str) -> Scenario:
        """Return the flight with the law corrected by one estimator, by the true K (``TRUE_K``), or not at all (``FIXED``)."""
        if isinstance(by, Entrant):
            return self._scenario(flight, [by], f"adaptation.estimator={inline(by.name)}")
        return self._scenario(flight, [], {TRUE_K: "adaptation.oracle=true", FIXED: "adaptation.enabled=false"}[by])

    def failed_at_s(self, flight: Flight) -> float:
        """Return the time of the first failure of a flight, s."""
        return min(failure.at_s for failure in self.corrected(flight, TRUE_K).failures)

    def why_not(self, flight: Flight, entrant: Entrant) -> str | None:
        """Return the error that refuses an estimator in a flight; None if it can fly."""
        try:
            assemble(plan(self.corrected(flight, entrant)))
        except FlightbedError as refused:
            return str(refused)
        return None
