"""Beyond the thesis, (a) and (e): the same experiment on the nonlinear F-16; mean and one-sigma histories."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from flightbed.analysis.seeds import Flown, Job, histories
from flightbed.core import data
from flightbed.document import drawing
from flightbed.document.document import Cell, Picture, Section, Table
from flightbed.scenario.reading import Scenario, load_scenario
from flightbed.statistics.intervals import outcome, spread
from flightbed.studies.base import Part, keyed_part
from flightbed.studies.sillence import plots, printed
from flightbed.studies.sillence.plots import BASIC, TIME
from flightbed.studies.sillence.setup import EXPANDING, WINDOW, changed, estimator, thesis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SCHEDULED = "scheduled"
# The thesis's flight condition, and a condition that the F-16 can fly with either law: Mach number, amplitude, deg/s, and law.
CONDITIONS = {
    "Mach 0.9, +-10 deg/s, P": (0.9, 10.0, "proportional"),
    "Mach 0.8, +-5 deg/s, P": (0.8, 5.0, "proportional"),
    "Mach 0.8, +-5 deg/s, PI": (0.8, 5.0, "proportional-integral"),
}
ORACLE = "true K"  # correction by the true K of the scenario, for comparison
ADAPTED = {"fixed": "", "thesis's window": WINDOW, "scheduled": SCHEDULED, ORACLE: ORACLE}
GAINS = (1.0, *printed.GAINS_LEFT)  # 1: nothing fails
FEW = 25  # flights of the smaller ensemble of histories

_ESTIMATES = tuple(f"{name}.{c}" for name in (WINDOW, SCHEDULED) for c in ("effectiveness", "effectiveness_smoothed"))


def f16(
    *,
    left: float | None = 0.2,
    adapts: str = "",
    base: str = "elevator-loss",
    **tables: Mapping[str, Any] | Sequence[Any],
) -> Scenario:
    """Return a scenario of the nonlinear F-16 with the thesis's filters and the scheduled filter.

    Args:
        left: K after the failure at 4.5 s; None keeps the failures of ``base`` or of ``tables``.
        adapts: name of the estimator that corrects the law, or ``ORACLE``; empty for the fixed law.
        base: shipped scenario that supplies all other settings.
        tables: further tables of the scenario; their keys replace those of ``base``, a table with a kind replaces the whole.

    """
    raw = tomllib.loads(data.find("scenario", base).read_text(encoding="utf-8"))
    scheduled = next(e for e in raw["estimators"] if e["name"] == SCHEDULED)
    bounds: dict[str, Any] = {"bounds": (0.0, 1.0)} if adapts == WINDOW else {}
    given: dict[str, Any] = {
        "adaptation": {"enabled": True, "estimator": adapts} if adapts else {"enabled": False},
        "estimators": [estimator(WINDOW, **bounds), estimator(EXPANDING, "expanding"), scheduled],
    }
    if adapts == ORACLE:  # no estimator is named, and no caution is taken with its sigma
        raw["adaptation"] = {k: v for k, v in raw["adaptation"].items() if k not in ("estimator", "caution")}
        given["adaptation"] = {"enabled": True, "oracle": True}
    if left is not None:
        given["failures"] = [{"kind": "effectiveness", "at_s": printed.FAILED_AT_S, "to": left}]
    for table, keys in (*given.items(), *tables.items()):
        raw[table] = changed(raw.get(table, {}), keys) if isinstance(keys, Mapping) else keys
    return load_scenario(raw)


def _at(condition: str, left: float, adapts: str) -> Scenario:
    mach, amplitude, law = CONDITIONS[condition]
    return f16(
        left=left, adapts=adapts, condition={"mach": mach}, command={"amplitude_deg_s": amplitude}, control={"law": law}
    )


def experiment(runs: int) -> Part:
    """Fly the thesis's experiment on the nonlinear F-16."""
    keys = list(product(CONDITIONS, GAINS, ADAPTED))
    jobs = {key: Job(_at(key[0], key[1], ADAPTED[key[2]]), runs, (*BASIC, *_ESTIMATES)) for key in keys}

    def build(flown: Mapping[tuple[str, float, str], list[Flown]]) -> Section:
        return Section(
            "(a) The full nonlinear aircraft",
            [
                "The thesis's filters, prior and noise are applied to JSBSim's F-16: six degrees of freedom, aerodynamics that depend on "
                "Mach number and alpha, an actuator with rate and position limits. The model of these filters is the short period "
                "linearized at the trim point, and the law is designed on the same model. The scheduled filter of this project flies "
                "beside them: its model is a grid of local linear models scheduled by Mach number and alpha, its input is the absolute "
                "deflection, and the readings are the prior of its window.",
                "The linear study cannot show one effect: away from the trim point the error of the short-period model exceeds the "
                "moment of the elevator. The thesis's filters attribute this error to K, with a failure or without: the error of K-hat "
                "is as large as K itself. With the scheduled model the error of K-hat is a few hundredths in both conditions.",
                "An accurate K alone does not prevent departure. In the thesis's flight condition the intact aircraft (K_1 = 1) departs "
                "under commands of 10 deg/s with the fixed linear law, and a correction by the true K only restores the intact aircraft. "
                "In that condition the wrong K-hat of the thesis's window prevents departure down to K_1 = 0.4: a K-hat near 0 makes the "
                "loop up to 1/0.08 times as stiff; at smaller K_1 the aircraft departs sooner than with the true K. At Mach 0.8 and K_1 "
                "= 0.1 the elevator is at its position limit, the P law with the true K loses the aircraft, and the stiffer loop with "
                "the wrong K-hat again keeps it.",
            ],
            [_tracking(flown), _estimates(flown), _picture(flown["Mach 0.8, +-5 deg/s, P", 0.2, "scheduled"][0])],
        )

    return keyed_part(jobs, build)


def _tracking(flown: Mapping[tuple[str, float, str], list[Flown]]) -> Table:
    rows: list[list[Cell]] = []
    for condition, left in product(CONDITIONS, GAINS):
        metrics = [[f.metrics for f in flown[condition, left, law]] for law in ADAPTED]
        cells = [
            outcome([m.tracking_rms_post_deg_s for m in each], [m.departed_at_s for m in each]) for each in metrics
        ]
        rows.append([condition, left, *cells])
    columns = ("condition, law", "K_1", *(f"{'' if law == 'fixed' else 'corrected by '}{law}" for law in ADAPTED))
    return Table(
        "aircraft_tracking", "F-16: tracking, RMS of q - q_ref, deg/s, or departure", columns, rows,
        {"K_1": "g"} | dict.fromkeys(columns[2:], ".2f"),
        note=f"{_runs(flown)} flights each. RMS from 0.3 s after the failure to the end, over the flights without departure, median [5 %, "
        "95 %]; gone: departure, alpha more than 25 deg from trim. No departure in 20 flights: fewer than 17 % with 95 % confidence.",
    )  # fmt: skip


def _estimates(flown: Mapping[tuple[str, float, str], list[Flown]]) -> Table:
    rows: list[list[Cell]] = []
    for condition, left in product(CONDITIONS, GAINS):
        metrics = [f.metrics.estimators for f in flown[condition, left, "scheduled"]]
        rows.append([
            condition, left, spread([m[EXPANDING].final for m in metrics]),
            *(spread([getattr(m[name], metric) for m in metrics]) for metric in ("median_abs_error_post", "first_within_20pct_s")
              for name in (WINDOW, SCHEDULED)),
        ])  # fmt: skip
    columns = (
        "condition", "K_1", "final K-hat, thesis's expanding", "median error, thesis's window", "median error, scheduled",
        "entry into 20 %, thesis's window, s", "entry, scheduled, s",
    )  # fmt: skip
    formats = dict.fromkeys(columns[2:5], ".3f") | dict.fromkeys(columns[5:], ".2f") | {"K_1": "g"}
    return Table(
        "aircraft_estimates", "F-16: estimates of K in the flights corrected by the scheduled filter", columns, rows, formats,
        note=f"{_runs(flown)} flights each, median [5 %, 95 %]. Error: |K-hat - K| from 0.3 s after the failure. The time of first entry "
        "into the band is no measure of accuracy for an estimate that oscillates through the band.",
    )  # fmt: skip


def _runs(flown: Mapping[Any, Sequence[Flown]]) -> int:
    return len(next(iter(flown.values())))


def _picture(flown: Flown) -> Picture:
    with drawing.canvas(2, height=1.9) as (axes, svg):
        plots.response(axes[:1], flown)
        lines = [
            (f"{WINDOW}.effectiveness", "thesis's window", drawing.OTHER),
            (f"{SCHEDULED}.effectiveness", "scheduled", drawing.ACTUAL),
        ]
        plots.gain(axes[1], flown, lines)
        drawn = drawing.distinct(svg(), "aircraft")
    return Picture(
        "aircraft", "F-16: a flight corrected by the scheduled filter, and the thesis's window on the same flight", drawn,
        "Mach 0.8, 20,000 ft, doublets of +-5 deg/s, K_1 = 0.2, seed 0.",
        plots.error_words(flown, lines[0][0], lines[0][1]) + " " + plots.error_words(flown, lines[1][0], lines[1][1]),
    )  # fmt: skip


def ensembles(runs: int) -> Part:
    """Fly ensembles of the adaptive loop, linear and nonlinear; the smaller ensemble is the first ``FEW`` flights of the larger."""
    linear = thesis(
        left=0.2, adapts=WINDOW, estimators=[estimator(WINDOW, bounds=(0.0, 1.0)), estimator(EXPANDING, "expanding")]
    )
    jobs = {
        ("linear", WINDOW): Job(linear, runs, (*BASIC, f"{WINDOW}.effectiveness_smoothed")),
        ("F-16", SCHEDULED): Job(
            f16(left=0.2, adapts=SCHEDULED), runs, (*BASIC, f"{SCHEDULED}.effectiveness_smoothed")
        ),
    }

    def build(flown: Mapping[tuple[str, str], list[Flown]]) -> Section:
        pictures = [
            _history(plant, name, flights[:count])
            for (plant, name), flights in flown.items()
            for count in dict.fromkeys((min(FEW, runs), runs))
        ]
        return Section(
            f"(e) Mean and one-sigma histories of {min(FEW, runs)} and {runs} flights",
            [
                "Adaptive loop: mean over the flights, and mean plus and minus one standard deviation over the noise draws, of the "
                "smoothed K-hat and of the tracking error. The remaining mean error is systematic: bias of the filters, lag of the law, "
                "and the error of windows that contain the failure.",
            ],
            pictures,
        )

    return keyed_part(jobs, build)


def _history(plant: str, name: str, flights: Sequence[Flown]) -> Picture:
    key = f"history-{plant.lower()}-{len(flights)}"
    errors = [Flown(f.seed, f.metrics, {"error": f.columns["q_deg_s"] - f.columns["q_ref_deg_s"]}) for f in flights]
    words = []
    with drawing.canvas(2, height=1.9) as (axes, svg):
        curves = (
            (axes[0], flights, f"{name}.effectiveness_smoothed", "K, smoothed"),
            (axes[1], errors, "error", "q - reference, deg/s"),
        )
        for axis, group, column, label in curves:
            mean, std, _ = histories(group, column)
            _band(axis, mean, std, label)
            late = slice(480, None)
            words.append(f"{label}: one sigma {np.median(std[late]):.4f} (median), at most {np.max(std[late]):.3f}")
        axes[0].plot(
            flights[0].columns[TIME], flights[0].columns["effectiveness_true"], color=drawing.TRUTH, label="true"
        )
        drawing.legend(axes[0])
        axes[1].set_xlabel("time, s")
        drawn = drawing.distinct(svg(), key)
    aircraft = "linear short period, Mach 0.9" if plant == "linear" else "nonlinear F-16, Mach 0.8"
    return Picture(
        key, f"{len(flights)} flights of the {aircraft}", drawn,
        f"K_1 = 0.2, corrected by the smoothed estimate of '{name}'; {_departures(flights)}.", "From 4.8 s on, " + "; ".join(words) + ".",
    )  # fmt: skip


def _departures(flights: Sequence[Flown]) -> str:
    gone = sum(f.metrics.departed for f in flights)
    return f"{gone or 'none'} of {len(flights)} departed"


def _band(axis: Axes, mean: Any, std: Any, label: str) -> None:
    t = np.arange(len(mean)) / 100.0
    axis.fill_between(t, mean - std, mean + std, color=drawing.ACTUAL, alpha=0.25, linewidth=0, label="one sigma")
    axis.plot(t, mean, color=drawing.ACTUAL, label="mean")
    axis.set_ylabel(label)
    drawing.mark(axis, printed.FAILED_AT_S)
