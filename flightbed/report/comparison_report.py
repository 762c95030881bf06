"""Compared runs -> the document of their page."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from importlib.metadata import version

from flightbed.analysis.comparison import Run, different_sources, differing, metrics_table, same_line
from flightbed.analysis.trace import Vector
from flightbed.document import drawing, palette
from flightbed.document.document import Document, Picture, Section

_ROWS = (
    ("Pitch rate, deg/s", "q_deg_s", "q_ref_deg_s", palette.REFERENCE, "reference"),
    ("K, share", "effectiveness", "effectiveness_true", palette.TRUTH, "true"),
    ("Elevator, deg", "elevator_deg", "", "", ""),
    ("Angle of attack, deg", "alpha_deg", "", "", ""),
    ("Load factor nz, g", "nz_g", "nz_ref_g", palette.REFERENCE, "reference"),
)
_LATERAL_ROWS = (
    ("Roll rate, deg/s", "p_deg_s", "p_ref_deg_s", palette.REFERENCE, "reference"),
    ("Sideslip, deg", "beta_deg", "beta_ref_deg", palette.REFERENCE, "reference"),
    ("Aileron K, share", "effectiveness.aileron", "effectiveness_aileron_true", palette.TRUTH, "true"),
    ("Rudder K, share", "effectiveness.rudder", "effectiveness_rudder_true", palette.TRUTH, "true"),
    ("Aileron, deg", "aileron_deg", "", "", ""),
    ("Rudder, deg", "rudder_deg", "", "", ""),
)  # for flights with commanded aileron and rudder


def comparison_report(runs: Sequence[Run]) -> Document:
    """Return the report of runs side by side: outcomes, figures on one time axis, metrics, settings that differ."""
    names = ", ".join(run.label for run in runs)
    outcomes = tuple(f"{run.label}: {run.outcome}." for run in runs)
    figure = Picture(
        "overlay",
        "All runs on one time axis",
        drawing.distinct(_draw(runs), "overlay"),
        "Smoothed K of the estimator that corrects the law, otherwise of the first; the dotted line is the onset of a failure.",
    )
    settings, sources = differing(runs), different_sources(runs)
    same = () if settings.rows else ("All settings are the same.",)
    return Document(
        f"Compared: {names}",
        (
            Section("Outcomes", outcomes, (metrics_table(runs),)),
            Section("Flights", (), (figure,)),
            Section("Settings", (*same, *((sources,) if sources else ())), (settings,) if settings.rows else ()),
        ),
        {
            "runs": ", ".join(str(run.folder) for run in runs),
            "versions": {"flightbed": version("flightbed")},
            "again": shlex.join(["flightbed", "compare", *(str(run.folder) for run in runs)]),
        },
    )


def _draw(runs: Sequence[Run]) -> str:
    rows = (*_ROWS, *(_LATERAL_ROWS if any(run.lateral for run in runs) else ()))
    with drawing.canvas(len(rows), height=1.9) as (axes, svg):
        for row, (title, column, shared, color, name) in zip(axes, rows, strict=True):
            references: list[tuple[Vector, Vector]] = []
            for run in runs:
                t, reference = run.trace["t_s"], run.trace.columns.get(shared)
                if reference is not None and not any(same_line(t, reference, *other) for other in references):
                    references.append((t, reference))
                    row.plot(t, reference, color=color, label="_" if len(references) > 1 else name)
            for run in runs:
                values = _values(run, column)
                if values is not None:
                    row.plot(run.trace["t_s"], values, color=run.color, label=_plain(run.label))
            for i, t_s in enumerate(sorted({t_s for run in runs for t_s in run.failures_s})):
                drawing.mark(row, t_s, label="_" if i else "failure")
            row.set_ylabel(title)
        drawing.legend(axes[0])
        drawing.legend(axes[1])
        axes[-1].set_xlabel("t, s")
        text: Callable[[], str] = svg
        return text()


def _values(run: Run, column: str) -> Vector | None:
    quantity, _, surface = column.partition(".")
    return run.smoothed(surface or "elevator") if quantity == "effectiveness" else run.trace.columns.get(column)


def _plain(label: str) -> str:
    """Return a label that matplotlib draws literally: no mathematics, and visible even with a leading underscore."""
    return "\u200b" + label.replace("$", r"\$")
