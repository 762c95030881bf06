"""Beyond the thesis, (f) and (g): the loop in real time; straight and level flight with and without dither."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

import numpy as np

from flightbed.analysis.punctuality import Punctuality
from flightbed.analysis.result import fly_scenario
from flightbed.analysis.seeds import Flown, Job
from flightbed.document import drawing
from flightbed.document.document import Cell, Picture, Section, Table
from flightbed.flight.pacing import WallClock
from flightbed.scenario.reading import load_scenario
from flightbed.statistics.intervals import share, spread
from flightbed.studies.base import Flights, Part, keyed_part
from flightbed.studies.sillence import plots
from flightbed.studies.sillence.plots import BASIC, TIME

SCHEDULED, SHORT = "scheduled", "short-period"
_DEVIATION = "estimators.1.input=deviation"
_CASES: Mapping[str, tuple[str, tuple[str, ...]]] = MappingProxyType(
    {
        "normal c.g., no dither": ("level-loss", (_DEVIATION,)),
        "normal c.g., dither 0.5 deg/s": (
            "level-loss",
            (_DEVIATION, "command.kind=dither", "command.amplitude_deg_s=0.5"),
        ),
        "no elevator at trim, no dither": ("dithered-level", ("command={kind='none'}",)),
        "no elevator at trim, dither 0.1 deg/s": ("dithered-level", ("command.amplitude_deg_s=0.1",)),
        "no elevator at trim, dither 0.5 deg/s": ("dithered-level", ()),
        "no elevator at trim, dither 1 deg/s": ("dithered-level", ("command.amplitude_deg_s=1.0",)),
    }
)
_QUIET, _DITHERED = "no elevator at trim, no dither", "no elevator at trim, dither 0.5 deg/s"
_COLUMNS = tuple(f"{n}.{c}" for n in (SCHEDULED, SHORT) for c in ("effectiveness", "effectiveness_smoothed"))


def level(runs: int) -> Part:
    """Fly straight and level with and without dither, at a trim with and a trim without elevator deflection."""
    jobs = {
        case: Job(load_scenario(name, overrides), runs, (*BASIC, "nz_g", *_COLUMNS))
        for case, (name, overrides) in _CASES.items()
    }

    def build(flown: Mapping[str, list[Flown]]) -> Section:
        return Section(
            "(g) Straight and level",
            [
                "In the thesis's model, written in deviations from trim, the elevator has no effect in level flight, so K is not "
                "observable: hence the thesis's call for dither. The trimmed aircraft gives more information. It is trimmed by a "
                "deflection, K scales the whole deflection, and a drop of K pitches the aircraft: with the absolute input K is found at "
                "once, without dither. The deviation form attributes none of that moment to K, and its error in level flight is as large "
                "as K itself, with dither or without.",
                "The thesis's argument holds only where the trim deflection is near zero, here by a c.g. 5.7 % of the chord further aft. "
                "There a dither of 0.5 deg/s suffices; the table gives the load factor that the pilot feels.",
            ],
            [_table(flown), _picture(flown)],
        )

    return keyed_part(jobs, build)


def _table(flown: Mapping[str, list[Flown]]) -> Table:
    rows: list[list[Cell]] = []
    for case, flights in flown.items():
        for name, word in ((SCHEDULED, "scheduled, absolute"), (SHORT, "short period, deviation")):
            m = [f.metrics.estimators[name] for f in flights]
            rows.append([
                case, word, spread([x.median_abs_error_post for x in m]), spread([x.first_within_20pct_smoothed_s for x in m]),
                spread([x.std_pre for x in m]), spread([_load_factor_rms(f) for f in flights]),
                share(sum(f.metrics.departed for f in flights), len(flights)),
            ])  # fmt: skip
    columns = (
        "case",
        "filter",
        "median error of K-hat",
        "smoothed in 20 %, s",
        "scatter before",
        "felt before, g RMS",
        "departed",
    )
    return Table(
        "level", "F-16 in level flight, K_1 = 0.2, corrected by the scheduled filter", columns, rows,
        dict(zip(columns[2:], (".3f", ".2f", ".3f", ".4f", ".2f"), strict=True)),
        note=f"{len(next(iter(flown.values())))} flights each: median [5 %, 95 %]; departed: share with its 95 % interval. Scatter: "
        "standard deviation of K-hat before the failure; felt: RMS of n_z - 1 from 0.3 s to the failure.",
    )  # fmt: skip


def _load_factor_rms(flown: Flown) -> float:
    t, nz = flown.columns[TIME], flown.columns["nz_g"]
    return float(np.sqrt(np.mean((nz[(t > 0.3) & (t < 4.5 - 1e-9)] - 1.0) ** 2)))


def _picture(flown: Mapping[str, list[Flown]]) -> Picture:
    facts = []
    with drawing.canvas(2, height=1.9) as (axes, svg):
        for axis, case in zip(axes, (_QUIET, _DITHERED), strict=True):
            flight, column = flown[case][0], f"{SCHEDULED}.effectiveness"
            lines = [(column, "scheduled", drawing.OTHER), (f"{column}_smoothed", "smoothed", drawing.ACTUAL)]
            plots.gain(axis, flight, lines, band=0.2)
            axis.set_title(case, fontsize=9, loc="left")
            facts.append(plots.error_words(flight, f"{column}_smoothed", case))
        drawn = drawing.distinct(svg(), "level")
    return Picture(
        "level",
        "F-16 trimmed at zero elevator: K without and with dither",
        drawn,
        "K_1 = 0.2, seed 0.",
        " ".join(facts),
    )


def real_time(scenario: str = "elevator-loss", overrides: tuple[str, ...] = ()) -> Part:
    """Fly one scenario in real time, after all other flights of the study.

    Args:
        scenario: name of a shipped scenario.
        overrides: settings that replace those of the scenario, each ``key=value``.

    """

    def build(_flights: Flights) -> Section:
        flown = fly_scenario(load_scenario(scenario, overrides), pace=WallClock())
        timing = flown.summary.realtime
        assert timing is not None  # the flight is paced
        return Section(
            "(f) Real time",
            [
                "The same loop on the same aircraft, with ticks released by the computer's monotonic clock at 100 Hz: `flightbed run "
                f"{scenario} --realtime`. A tick is late if its work, recording included, is unfinished when the next tick is due; late "
                "ticks are counted, and no tick is skipped. The figures are those of this computer at the time of this report.",
            ],
            [_timing_table(scenario, timing), _timing_picture(flown.trace["t_s"], flown.trace)],
        )

    return Part([], build)


def _timing_table(scenario: str, timing: Punctuality) -> Table:
    rows: list[list[Cell]] = [
        ["ticks", float(timing.ticks)], ["late ticks", float(timing.late_ticks)], ["worst overrun, ms", timing.worst_overrun_ms],
        *([f"{name} {percentile}, ms", value]
          for spread, name in ((timing.jitter_ms, "release delay,"), (timing.compute_ms, "computing time,"))
          for percentile, value in asdict(spread).items()),
        ["achieved, Hz", timing.achieved_hz],
    ]  # fmt: skip
    return Table("real_time", f"{scenario} in real time", ("quantity", "value"), rows, {"value": ".4g"})


def _timing_picture(t: Any, trace: Any) -> Picture:
    with drawing.canvas(1, height=2.0) as ((axis,), svg):
        axis.plot(t, trace["compute_ms"], color=drawing.ACTUAL, linewidth=0.6, label="computing time")
        axis.plot(t, trace["release_late_ms"], color=drawing.COMMAND, linewidth=0.6, label="release delay")
        axis.axhline(10.0, color=drawing.FAILURE, linestyle="--", label="period")
        axis.set_yscale("log")
        axis.set_ylim(1e-4, 30.0)
        axis.set_ylabel("ms")
        axis.set_xlabel("time, s")
        drawing.legend(axis)
        drawn = drawing.distinct(svg(), "real-time")
    busy = float(np.median(trace["compute_ms"]) / 10.0)
    return Picture(
        "real-time", "Delay and computing time of each tick", drawn, "", f"Median load {busy:.1%} of the period."
    )
