"""Figures for pages: matplotlib without a display, as SVG that does not change from one run to the next."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# From the palette of Okabe and Ito (2008), readable by the colour-blind and in print; the same thing has the same colour everywhere.
REFERENCE, ACTUAL, COMMAND, TRUTH, FAILURE, OTHER = "#009e73", "#0072b2", "#e69f00", "#cc79a7", "#d55e00", "#777777"

_RC: Any = {  # typed by matplotlib with a literal of all its names
    "svg.hashsalt": "flightbed", "svg.fonttype": "none", "font.family": "sans-serif", "font.size": 9.0, "axes.grid": True,
    "grid.color": "#e3e6ec", "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False, "lines.linewidth": 1.1,
    "path.simplify": True, "path.simplify_threshold": 0.5, "figure.constrained_layout.use": True,
}  # fmt: skip


@contextmanager
def canvas(
    rows: int = 1, *, height: float = 2.6, share_x: bool = True
) -> Iterator[tuple[list[Axes], Callable[[], str]]]:
    """Give the axes of a figure, one below the other, and a function that returns it as SVG.

    Args:
        rows: how many axes.
        height: of each, inches; the figure is 8 inches wide.
        share_x: whether they share the x axis.

    """
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with mpl.rc_context(_RC):
        figure = Figure(figsize=(8.0, height * rows))
        FigureCanvasSVG(figure)
        axes = figure.subplots(rows, 1, sharex=share_x, squeeze=False)[:, 0].tolist()

        def svg() -> str:
            buffer = io.StringIO()
            figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
            text = buffer.getvalue()
            return text[text.index("<svg") :]

        yield axes, svg


def distinct(svg: str, key: str) -> str:
    """Return an SVG whose ids start with a key, so that several can stand on one page."""
    svg = re.sub(r'\bid="', f'id="{key}-', svg)
    return re.sub(r'(url\(#|href="#)', rf"\g<1>{key}-", svg)


def legend(axes: Axes) -> None:
    """Name the lines, above the axes, where nothing is drawn."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=8, borderaxespad=0.0)


def mark(axes: Axes, at_s: float | None, **style: Any) -> None:
    """Draw the time of a failure."""
    if at_s is not None:
        axes.axvline(at_s, color=FAILURE, linestyle=":", linewidth=1.0, **style)
