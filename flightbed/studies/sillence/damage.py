"""Beyond the thesis, (c) and (d): damage that rotates the control vector or shifts the c.g.; process noise, turbulence, gusts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from flightbed.analysis.seeds import Flown, Job
from flightbed.document.document import Cell, Section, Table
from flightbed.scenario.tables import Scenario
from flightbed.statistics.intervals import Spread, share, spread
from flightbed.studies.base import Part, keyed_part
from flightbed.studies.sillence import printed
from flightbed.studies.sillence.aircraft import SCHEDULED, f16
from flightbed.studies.sillence.setup import EXPANDING, WINDOW, estimator, thesis

MATCHED = "window-matched"
_AT = printed.FAILED_AT_S
_SHARES = ((0.5, 1.0), (0.5, 0.5), (0.5, 0.0), (0.2, 1.0), (0.2, 0.2), (0.2, 0.0))  # moment and force left
_SHIFTS = (0.02, 0.05)  # c.g. shift aft, mean chords
_STORMS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "calm": {},
        "light turbulence": {"atmosphere": {"turbulence": "light"}},
        "moderate turbulence": {"atmosphere": {"turbulence": "moderate"}},
        "severe turbulence": {"atmosphere": {"turbulence": "severe"}},
        "gust of 30 ft/s, rising in 0.25 s": {"gusts": [{"at_s": 8.0, "up_fps": 30.0, "rise_s": 0.25, "hold_s": 1.0}]},
    }
)
_PROCESS = (
    (0.0, 0.0),
    (0.5, 2.0),
    (2.0, 10.0),
    (5.0, 30.0),
)  # standard deviations of alpha rate, deg/s, and pitch acceleration, deg/s^2
_SIMPLE = ("median error of K-hat", "entry into 20 %, s", "mean NEES")


def structural(runs: int) -> Part:
    """Fly structural damage that K alone does not describe."""
    jobs: dict[tuple[str, str], Job] = {}
    for to, force in _SHARES:
        failure = [_structural(to, force)]
        jobs["linear", _share_words(to, force)] = Job(
            thesis(left=None, failures=failure, law="proportional-integral"), runs
        )
        jobs["F-16", _share_words(to, force)] = Job(f16(left=None, adapts=SCHEDULED, failures=failure), runs)
    for shift in _SHIFTS:
        for to in (1.0, 0.2):
            failure = [_structural(to, to), {"kind": "cg-shift", "at_s": _AT, "shift_cbar": shift}]
            words = f"{_share_words(to, to)}, c.g. {100.0 * shift:g} % aft"
            jobs["F-16", words] = Job(f16(left=None, adapts=SCHEDULED, failures=failure), runs)

    def build(flown: Mapping[tuple[str, str], list[Flown]]) -> Section:
        return Section(
            "(c) Structural damage",
            [
                "Structural damage, such as a bent surface or a lost tip, may reduce the two components of the control vector b = "
                "(Z_delta, M_delta) by different factors, and lost mass may shift the c.g. In the filters K scales both components; the "
                "reference for their error is the remaining share of the moment, the quantity by which the law is corrected.",
                "A rotation of b changes the estimate of the moment by thousandths: on the linear model and on the aircraft the "
                "elevator's force is a small part of the alpha dynamics. Sigma does not include this error: with a fifth of the moment "
                "and all of the force left, the mean NEES on the aircraft is far from 1. A c.g. shift is different: it changes "
                "C_m_alpha, which no K describes, and the trim moment, which the scheduled model takes for a change of K. A shift of 5 % "
                "of the chord together with the loss of the elevator exceeds the capability of the law.",
            ],
            [_filter_table("structural_linear", "Linear model, fixed law: the thesis's filters", flown, "linear", (WINDOW, EXPANDING)),
             _adaptive_table("structural_f16", "F-16, corrected by the scheduled filter", flown, "F-16")],
        )  # fmt: skip

    return keyed_part(jobs, build)


def _structural(to: float, force: float) -> dict[str, Any]:
    return {"kind": "structural", "at_s": _AT, "to": to, "force_to": force}


def _share_words(to: float, force: float) -> str:
    return "intact" if to == force == 1.0 else f"moment {to:.0%}, force {force:.0%}"


def disturbances(runs: int) -> Part:
    """Fly process noise on the linear model, turbulence and a gust on the aircraft."""
    jobs: dict[tuple[str, str], Job] = {}
    for alpha, q in _PROCESS:
        jobs["linear", f"{alpha:g} deg/s, {q:g} deg/s^2"] = Job(_process_noise(alpha, q), runs)
    for words, tables in _STORMS.items():
        jobs["F-16", words] = Job(f16(left=0.2, adapts=SCHEDULED, **tables), runs)

    def build(flown: Mapping[tuple[str, str], list[Flown]]) -> Section:
        return Section(
            "(d) Process noise, turbulence and gusts",
            [
                "The thesis's filters assume no process noise. They attribute every disturbance to K, and their sigma covers sensor "
                "noise only: the mean NEES, 1 for a consistent sigma, measures the inconsistency. 'Matched' is the same window with the "
                "correct variance of the process noise and the readings as its prior: hardly more accurate, but consistent. Where K "
                "stays constant after the failure, the expanding filter averages the noise over all data since the start; its K-hat is "
                "more accurate than any window's, though its sigma is far too small.",
                "On the aircraft no filter is given the strength of the disturbance. The scheduled filter raises its process noise to "
                "the level that its readings show, and holds its last estimate where a window contains little information.",
            ],
            [_filter_table("process_noise", "Linear model, K_1 = 0.2, fixed law", flown, "linear", (WINDOW, MATCHED, EXPANDING)),
             _adaptive_table("storms", "F-16, K_1 = 0.2, corrected by the scheduled filter", flown, "F-16")],
        )  # fmt: skip

    return keyed_part(jobs, build)


def _process_noise(alpha: float, q: float) -> Scenario:
    matched: dict[str, Any] = {
        "alpha_disturbance_deg_s": alpha,
        "q_disturbance_deg_s2": q,
        "input_at": "mean",
        "prior": {"state": "measurement"},
    }
    filters = [estimator(WINDOW), estimator(EXPANDING, "expanding"), estimator(MATCHED, **matched)]
    noise = {"alpha_std_deg_s": alpha, "q_std_deg_s2": q}
    return thesis(left=0.2, law="proportional-integral", estimators=filters, process_noise=noise)


def _error_cells(flights: Sequence[Flown], name: str) -> list[Spread]:
    metrics = [f.metrics.estimators[name] for f in flights]
    return [
        spread([getattr(m, key) for m in metrics])
        for key in ("median_abs_error_post", "first_within_20pct_s", "nees_mean_post")
    ]


def _filter_table(
    key: str, title: str, flown: Mapping[tuple[str, str], list[Flown]], plant: str, names: Sequence[str]
) -> Table:
    rows: list[list[Cell]] = [
        [words, name, *_error_cells(flights, name)]
        for (which, words), flights in flown.items()
        if which == plant
        for name in names
    ]
    columns = ("case", "filter", *_SIMPLE)
    return Table(key, title, columns, rows, dict(zip(_SIMPLE, (".4f", ".2f", ".3g"), strict=True)), _note(flown))


def _adaptive_table(key: str, title: str, flown: Mapping[tuple[str, str], list[Flown]], plant: str) -> Table:
    rows: list[list[Cell]] = []
    for (which, words), flights in flown.items():
        if which == plant:
            thesis_window = spread([f.metrics.estimators[WINDOW].median_abs_error_post for f in flights])
            rows.append([
                words, thesis_window, *_error_cells(flights, SCHEDULED), spread([f.metrics.tracking_rms_post_deg_s for f in flights]),
                share(sum(f.metrics.departed for f in flights), len(flights)),
            ])  # fmt: skip
    columns = ("case", "median error, thesis's window", *_SIMPLE, "RMS of q - q_ref, deg/s", "departed")
    formats = dict(zip(columns[1:], (".3f", ".4f", ".2f", ".3g", ".2f", ".2f"), strict=True))
    return Table(key, title, columns, rows, formats, _note(flown))


def _note(flown: Mapping[Any, Sequence[Flown]]) -> str:
    runs = len(next(iter(flown.values())))
    return f"{runs} flights each: median [5 %, 95 %], from 0.3 s after the failure; departed: share with its 95 % interval."
