"""Names of estimates: ``NAME`` for the elevator, ``NAME.aileron`` and ``NAME.rudder`` for the other surfaces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def estimate_name(estimator: str, surface: str) -> str:
    """Return the name of an estimator's estimate for a surface."""
    return estimator if surface == "elevator" else f"{estimator}.{surface}"


def surface_of(estimate: str) -> str:
    """Return the surface of an estimate."""
    return estimate.partition(".")[2] or "elevator"


def estimator_of(estimate: str) -> str:
    """Return the name of the estimator of an estimate."""
    return estimate.partition(".")[0]


def of_surface(estimates: Iterable[str], surface: str) -> tuple[str, ...]:
    """Return the estimates of one surface."""
    return tuple(name for name in estimates if surface_of(name) == surface)


def estimator_indices(estimates: Sequence[str]) -> dict[str, int]:
    """Return estimate -> index of its estimator; all estimates of one estimator share its colour."""
    estimators = list(dict.fromkeys(map(estimator_of, estimates)))
    return {name: estimators.index(estimator_of(name)) for name in estimates}
