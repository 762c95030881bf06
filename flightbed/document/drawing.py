"""Figures for pages: matplotlib without a display, as reproducible SVG."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flightbed.document.palette import ACTUAL as ACTUAL
from flightbed.document.palette import COMMAND as COMMAND
from flightbed.document.palette import FAILURE as FAILURE
from flightbed.document.palette import OTHER as OTHER
from flightbed.document.palette import REFERENCE as REFERENCE
from flightbed.document.palette import TRUTH as TRUTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Vector = npt.NDArray[np.float64]

_WIDTH = 8.0  # width of figures, inches
BUCKETS = 500  # about one per point of figure width

_RC: Any = {  # Any: matplotlib types the keys as a literal of all its names
    "svg.hashsalt": "flightbed", "svg.fonttype": "none", "font.family": "sans-serif", "font.size": 9.0, "axes.grid": True,
    "grid.color": "#e3e6ec", "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False, "lines.linewidth": 1.1,
    "path.simplify": True, "path.simplify_threshold": 0.15, "figure.constrained_layout.use": True,
}  # fmt: skip

_PATH, _DIGITS = re.compile(r'\bd="[^"]*"'), re.compile(r"(\.\d\d)\d+")  # coordinates to 0.01 points


@contextmanager
def canvas(
    rows: int = 1, columns: int = 1, *, height: float = 2.6, share_x: bool = True, margin: float | None = None
) -> Iterator[tuple[list[Axes], Callable[[], str]]]:
    """Yield the axes of a figure, row by row, and a function that returns the figure as SVG.

    Args:
        rows: number of rows of axes.
        columns: number of columns; the axes of a row share the y axis.
        height: height of a row, inches; the figure is 8 inches wide.
        share_x: whether the rows share the x axis.
        margin: left margin for labels, inches; a fixed margin aligns the axes of several figures and draws faster; None fits
            the margin to the labels.

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
    """Lay out the axes with fixed margins, inches; constrained layout would draw the figure twice to find the margins."""
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
    """Return an SVG with the key as prefix of all ids, so that one page can hold several figures."""
    svg = re.sub(r'\bid="', f'id="{key}-', svg)
    return re.sub(r'(url\(#|href="#)', rf"\g<1>{key}-", svg)


def thin(t: Vector, values: Vector, buckets: int = BUCKETS) -> tuple[Vector, Vector]:
    """Reduce a long history to the least and largest value in each of ``buckets`` equal time intervals.

    Args:
        t, values: (n,); non-finite values become nan, which is not drawn.
        buckets: number of intervals; a history of at most twice as many values is returned unchanged.

    Returns:
        Times and values (m,), m <= max(2 buckets, n).

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
    """Reduce a long band to its outer edges over ``buckets`` equal time intervals.

    Args:
        t, low, high: (n,); non-finite values become nan, which is not drawn.
        buckets: number of intervals; a band of at most as many values is returned unchanged.

    """
    low, high = (np.where(np.isfinite(edge), edge, np.nan) for edge in (low, high))
    if len(t) <= buckets:
        return t, low, high
    starts = np.arange(buckets) * len(t) // buckets
    return t[starts], np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)


def line(axes: Axes, t: Vector, values: Vector, *, buckets: int = BUCKETS, **style: Any) -> None:
    """Plot a history, reduced to the resolution of the figure."""
    axes.plot(*thin(t, values, buckets), **style)


def band(axes: Axes, t: Vector, low: Vector, high: Vector, *, buckets: int = BUCKETS // 2, **style: Any) -> None:
    """Fill the area between two histories, reduced to the resolution of the figure."""
    axes.fill_between(*envelope(t, low, high, buckets), linewidth=0.0, **style)


def legend(axes: Axes) -> None:
    """Draw the legend above the axes, clear of the lines."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=8, borderaxespad=0.0)


def mark(axes: Axes, at_s: float | None, **style: Any) -> None:
    """Mark the onset of a failure by a vertical line; nothing for None."""
    if at_s is not None:
        axes.axvline(at_s, color=FAILURE, linestyle=":", linewidth=1.0, **style)
