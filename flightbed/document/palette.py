"""The colours of all figures and of the viewer: a quantity has the same colour everywhere.

Each colour has a contrast of at least 3 against white and against the viewer's near-black background (WCAG 2, graphics), and all are
distinguishable with colour blindness; a test computes both. The hues are those of Okabe and Ito's palette (2008), with medium lightness.
"""

from __future__ import annotations

REFERENCE, ACTUAL, COMMAND, TRUTH, FAILURE, OTHER = "#00a078", "#2a7fd4", "#cc8400", "#a8429b", "#c03a12", "#8c9199"

# Colours of estimators and of compared runs, in order; further ones repeat the sequence.
ESTIMATES = (ACTUAL, COMMAND, REFERENCE, OTHER)
RUNS = (ACTUAL, COMMAND, OTHER, "#a0714f", "#1f9aa8")  # without those of q reference, true K and failures
DEPARTED = "#7a1f06"  # of a state in a lane, which is also labelled by its name


def estimate(index: int) -> str:
    """Return the colour of an estimator by its index in the scenario."""
    return ESTIMATES[index % len(ESTIMATES)]


def run(index: int) -> str:
    """Return the colour of a run by its index in a comparison."""
    return RUNS[index % len(RUNS)]


def rgb(color: str) -> tuple[int, int, int]:
    """Return red, green and blue of ``#rrggbb``, 0 to 255."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def blend(start: str, end: str, share: float) -> tuple[int, int, int]:
    """Return the mixture of two colours, red, green and blue, 0 to 255; ``share`` of ``end`` is clipped to 0 to 1."""
    share = min(1.0, max(0.0, share))
    a, b = rgb(start), rgb(end)
    mixed = [round(x + share * (y - x)) for x, y in zip(a, b, strict=True)]
    return mixed[0], mixed[1], mixed[2]
