"""The colours of all pictures, on the page and in the viewer: the same thing has the same one everywhere.

Each stands out from white and from a viewer's near-black by a contrast of 3 and more (WCAG 2, graphics), and all are told apart by the
colour-blind; a test computes both. The hues are those of Okabe and Ito's palette (2008), their lightness moved to the middle.
"""

from __future__ import annotations

REFERENCE, ACTUAL, COMMAND, TRUTH, FAILURE, OTHER = "#00a078", "#2a7fd4", "#cc8400", "#a8429b", "#c03a12", "#8c9199"

# Estimators, and runs beside each other, in order; a further one begins again.
ESTIMATES = (ACTUAL, COMMAND, REFERENCE, OTHER)
RUNS = (ACTUAL, COMMAND, OTHER, "#a0714f", "#1f9aa8")  # beside them q reference, K true and failures are drawn
DEPARTED = "#7a1f06"  # of a mode, whose name is written on it


def estimate(index: int) -> str:
    """Return the colour of the estimator with this index in the scenario."""
    return ESTIMATES[index % len(ESTIMATES)]


def run(index: int) -> str:
    """Return the colour of one of several runs beside each other."""
    return RUNS[index % len(RUNS)]


def rgb(color: str) -> tuple[int, int, int]:
    """Return red, green and blue of ``#rrggbb``, 0 to 255."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def between(start: str, end: str, share: float) -> tuple[int, int, int]:
    """Return the colour at a share, 0 to 1, of the way from one to another."""
    share = min(1.0, max(0.0, share))
    a, b = rgb(start), rgb(end)
    mixed = [round(x + share * (y - x)) for x, y in zip(a, b, strict=True)]
    return mixed[0], mixed[1], mixed[2]
