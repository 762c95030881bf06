"""Figures for pages: matplotlib without a display, as SVG that does not change from one run to the next."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flightbed.palette import ACTUAL as ACTUAL
from flightbed.palette import COMMAND as COMMAND
from flightbed.palette import FAILURE as FAILURE
from flightbed.palette import OTHER as OTHER
from flightbed.palette import REFERENCE as REFERENCE
from flightbed.palette import TRUTH as TRUTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Vector = npt.NDArray[np.float64]

_WIDTH = 8.0  # of figures, inches
BUCKETS = 500  # about one a point of the width of a figure

_RC: Any = {  # typed by matplotlib with a literal of all its names
    "svg.hashsalt": "flightbed", "svg.fonttype": "none", "font.family": "sans-serif", "font.size": 9.0, "axes.grid": True,
    "grid.color": "#e3e6ec", "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False, "lines.linewidth": 1.1,
    "path.simplify": True, "path.simplify_threshold": 0.15, "figure.constrained_layout.use": True,
}  # fmt: skip

_PATH, _DIGITS = re.compile(r'\bd="[^"]*"'), re.compile(r"(\.\d\d)\d+")  # a hundredth of a point is enough


@contextmanager
def canvas(
    rows: int = 1, columns: int = 1, *, height: float = 2.6, share_x: bool = True, margin: float | None = None
) -> Iterator[tuple[list[Axes], Callable[[], str]]]:
    """Give the axes of a figure, row by row, and a function that returns it as SVG.

    Args:
        rows: how many axes below each other.
        columns: how many beside each other; they share the y axis.
        height: of each, inches; the figure is 8 inches wide.
        share_x: whether they share the x axis.
        margin: what is left free for labels on the left, inches: the axes of several figures then lie below each other, and are
            drawn faster; None fits it to the labels.

    """
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with mpl.rc_context({**_RC, "figure.constrained_layout.use": margin is None}):
        figure = Figure(figsize=(_WIDTH, height * rows))
        FigureCanvasSVG(figure)
        axes = figure.subplots(rows, columns, sharex=share_x, sharey=columns > 1, squeeze=False).ravel().tolist()
        if margin is not None:
            _fix(figure, rows, margin)

        def svg() -> str:
            buffer = io.StringIO()
            figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
            text = buffer.getvalue()
            return _PATH.sub(lambda path: _DIGITS.sub(r"\1", path[0]), text[text.index("<svg") :])

        yield axes, svg


def _fix(figure: Figure, rows: int, margin: float) -> None:
    """Lay out axes with fixed margins, inches; constrained layout draws everything twice to find them."""
    above, below, between, height = 0.27, 0.43, 0.27, float(figure.get_figheight())
    each = (height - above - below - between * (rows - 1)) / rows
    figure.subplots_adjust(
        left=margin / _WIDTH,
        right=0.99,
        bottom=below / height,
        top=1.0 - above / height,
        hspace=between / each,
        wspace=0.06,
    )


def distinct(svg: str, key: str) -> str:
    """Return an SVG whose ids start with a key, so that several can stand on one page."""
    svg = re.sub(r'\bid="', f'id="{key}-', svg)
    return re.sub(r'(url\(#|href="#)', rf"\g<1>{key}-", svg)


def thin(t: Vector, values: Vector, buckets: int = BUCKETS) -> tuple[Vector, Vector]:
    """Leave of a long history what can be seen: the least and the largest value of each of so many equal stretches of time.

    Args:
        t, values: (n,), as they come; values that are not finite become nan, which is not drawn.
        buckets: stretches; a history of no more than twice as many values is returned whole.

    """
    values = np.where(np.isfinite(values), values, np.nan)
    if len(t) <= 2 * buckets:
        return t, values
    starts = np.arange(buckets) * len(t) // buckets
    filled = np.where(np.isnan(values), 0.0, values)
    ends = [*starts[1:].tolist(), len(t)]
    kept = [
        i
        for start, end in zip(starts.tolist(), ends, strict=True)
        for i in sorted({start + int(filled[start:end].argmin()), start + int(filled[start:end].argmax())})
    ]
    return t[kept], values[kept]


def envelope(t: Vector, low: Vector, high: Vector, buckets: int = BUCKETS) -> tuple[Vector, Vector, Vector]:
    """Leave of a long band its outer edges over so many equal stretches of time.

    Args:
        t, low, high: (n,); values that are not finite become nan, which is not drawn.
        buckets: stretches; a band of no more values is returned whole.

    """
    low, high = (np.where(np.isfinite(edge), edge, np.nan) for edge in (low, high))
    if len(t) <= buckets:
        return t, low, high
    starts = np.arange(buckets) * len(t) // buckets
    return t[starts], np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)


def line(axes: Axes, t: Vector, values: Vector, *, buckets: int = BUCKETS, **style: Any) -> None:
    """Draw a history, as much of it as can be seen."""
    axes.plot(*thin(t, values, buckets), **style)


def band(axes: Axes, t: Vector, low: Vector, high: Vector, *, buckets: int = BUCKETS // 2, **style: Any) -> None:
    """Fill between two histories, as much as can be seen."""
    axes.fill_between(*envelope(t, low, high, buckets), linewidth=0.0, **style)


def legend(axes: Axes) -> None:
    """Name the lines, above the axes, where nothing is drawn."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=8, borderaxespad=0.0)


def mark(axes: Axes, at_s: float | None, **style: Any) -> None:
    """Draw the time of a failure."""
    if at_s is not None:
        axes.axvline(at_s, color=FAILURE, linestyle=":", linewidth=1.0, **style)
