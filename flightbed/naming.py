"""What estimates are called: ``NAME`` is the elevator's, ``NAME.aileron`` and ``NAME.rudder`` are those of the other surfaces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def estimate_name(estimator: str, surface: str) -> str:
    """Return what the estimate of a surface is called."""
    return estimator if surface == "elevator" else f"{estimator}.{surface}"


def surface_of(estimate: str) -> str:
    """Return the surface whose K an estimate is of."""
    return estimate.partition(".")[2] or "elevator"


def estimator_of(estimate: str) -> str:
    """Return the name of the estimator that an estimate comes from."""
    return estimate.partition(".")[0]


def of_surface(estimates: Iterable[str], surface: str) -> tuple[str, ...]:
    """Return those of some estimates that are of a surface."""
    return tuple(name for name in estimates if surface_of(name) == surface)


def numbered(estimates: Sequence[str]) -> dict[str, int]:
    """Return estimate -> index of the estimator that it comes from: all estimates of one have its colour."""
    estimators = list(dict.fromkeys(map(estimator_of, estimates)))
    return {name: estimators.index(estimator_of(name)) for name in estimates}
