"""Band of frequencies of a command: checks common to chirp and multisine."""

from __future__ import annotations


def band_conflicts(place: str, *, low_hz: float, high_hz: float, control_hz: int) -> list[str]:
    """Return the problems of a band from low_hz to high_hz, one line each; ``place`` is that of the command's table."""
    problems = []
    if high_hz >= 0.5 * control_hz:
        problems.append(
            f"{place}.high_hz: must be below {0.5 * control_hz:g}, half of rates.control_hz (got {high_hz:g})"
        )
    if low_hz > high_hz:
        problems.append(f"{place}.low_hz: must be no higher than high_hz = {high_hz:g} (got {low_hz:g})")
    return problems
