"""The thesis's experiment as scenarios, and the search for what the thesis does not say about it."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from flightbed import data
from flightbed.document import Section, Table
from flightbed.ensemble import Flown, Job
from flightbed.scenario import Scenario, load_scenario
from flightbed.statistics import Interval, Vector
from flightbed.studies.base import Part, keyed
from flightbed.studies.sillence import printed

UNBOUNDED = (-1000.0, 1000.0)
SEARCH_RUNS = 25
FINAL_TOLERANCE, ENTRY_TOLERANCE_S = 0.01, 0.08  # of the medians, against the print: one unit of distance each


@dataclass(frozen=True)
class Setup:
    """What the thesis leaves open.

    Attributes:
        input_at: which elevator deflection is u_k: its mean over the sample, or that at the sample's start or end.
        start_s: when the first doublet starts.
        first_reading: whether the reading at the sample to which the prior belongs corrects it ("used") or not ("left-out").
        fed_back: what the law is fed: the readings, or the state of a filter, by its name.

    """

    input_at: str = "end"
    start_s: float = 0.0
    first_reading: str = "left-out"
    fed_back: str = "readings"


DEFAULT = Setup()  # what ``search`` finds closest to the print


@cache
def _raw() -> Mapping[str, Any]:
    return tomllib.loads(data.find("scenario", "thesis-loss").read_text(encoding="utf-8"))


def estimator(name: str, memory: str = "window", setup: Setup = DEFAULT, **changes: Any) -> dict[str, Any]:
    """Return the settings of one of the thesis's filters, unbounded."""
    base: dict[str, Any] = next(e for e in _raw()["estimators"] if e["memory"] == memory)
    prior = {**base["prior"], "first_reading": setup.first_reading}
    return {**base, "name": name, "input_at": setup.input_at, "bounds": UNBOUNDED, "prior": prior, **changes}


WINDOW, EXPANDING = "window", "expanding"
FAST = "window-smoothed-07"  # the window, smoothed by 0.7 instead of 0.9


def thesis(
    *,
    left: float | None = 0.2,
    at_s: float = printed.FAILED_AT_S,
    law: str = "proportional",
    adapts: str = "",
    noise: tuple[float, float] = (0.03, 0.1108),
    estimators: Sequence[Mapping[str, Any]] = (),
    setup: Setup = DEFAULT,
    **tables: Mapping[str, Any] | Sequence[Any],
) -> Scenario:
    """Return a scenario of the thesis.

    Args:
        left: K after the failure; None for no failure but those of a table.
        at_s: time of the failure.
        law: name of the law.
        adapts: name of the estimator that the law is corrected by; empty for the fixed law.
        noise: standard deviations of alpha, deg, and pitch rate, deg/s.
        estimators: settings; without, the thesis's two filters, unbounded.
        setup: what the thesis leaves open.
        tables: further tables of the scenario; keys replace those of the shipped one, lists the whole list.

    """
    given = list(estimators) or [estimator(WINDOW, "window", setup), estimator(EXPANDING, "expanding", setup)]
    raw = dict(_raw())
    settings: dict[str, Mapping[str, Any] | Sequence[Any]] = {
        "failures": [] if left is None else [{"kind": "effectiveness", "at_s": at_s, "to": left}],
        "command": {"start_s": setup.start_s},
        "sensors": {"alpha_std_deg": noise[0], "q_std_deg_s": noise[1]},
        "control": {"law": law, "state_from": "" if setup.fed_back == "readings" else setup.fed_back},
        "adaptation": {"enabled": bool(adapts), "estimator": adapts},
    }
    for table, keys in (*settings.items(), *tables.items()):
        raw[table] = {**raw.get(table, {}), **keys} if isinstance(keys, Mapping) else keys
    return load_scenario({**raw, "estimators": given})


# How his adaptive law may be read: where the actuator's position is fed back (Fig. 1: into the sum that 1/K multiplies), and whether
# alpha and q are the readings or, as S 5.6 says of the adaptive flights, the window's estimates. The first is this study's.
LAWS_READ = tuple(product(("effective", "position"), (WINDOW, "readings")))


def adaptive(
    *, left: float = 0.2, snr: str = "37.227", bounded: bool = True, feedback: str = "effective", fed: str = WINDOW,
    law: str = "proportional-integral", smoothing: float = 0.9,
) -> Scenario:  # fmt: skip
    """Return a flight whose law is corrected by the window's smoothed K-hat, in one reading of that law.

    Args:
        left: K after the failure.
        snr: row of Table 1.
        bounded: whether K-hat is kept within 0 and 1.
        feedback: ``"position"``: 1/K multiplies the position feedback too; ``"effective"``: K-hat times the position is fed back.
        fed: ``"window"``: the law gets that filter's alpha and q; ``"readings"``.
        law: name of the law.
        smoothing: of K-hat.

    """
    q_std, alpha_std = next((q, alpha) for q, alpha, text in printed.TABLE_1 if text == snr)
    bounds = (0.0, 1.0) if bounded else UNBOUNDED
    return thesis(
        left=left, law=law, adapts=WINDOW, noise=(alpha_std, q_std), setup=replace(DEFAULT, fed_back=fed),
        estimators=[estimator(WINDOW, bounds=bounds, smoothing=smoothing), estimator(EXPANDING, "expanding")],
        adaptation={"feedback": feedback},
    )  # fmt: skip


class Trial(NamedTuple):
    """A set-up and how far its medians are from the print.

    Attributes:
        values: (15, runs) finals, raw and smoothed entries, by K_1 in the order of the tables; inf for what never happened.
        distance: root mean square of the 15 differences of Tables 4 and 5, in units of the tolerances.
        largest: the largest of them.

    """

    setup: Setup
    values: Vector
    distance: float
    largest: float


_STARTS_S = (0.0, 0.01, 0.02, 0.05)
_INPUTS = ("mean", "start", "end")
_READINGS = ("left-out", "used")
_RESAMPLES, _SEED = 400, 4  # of the noise draws, for intervals of differences of distance


def search() -> Part:
    """Fly the set-ups that the thesis leaves open, and rank them."""
    jobs: dict[tuple[float, str, str, float], Job] = {}
    variants = list(product(_INPUTS, _READINGS))
    for left in printed.GAINS_LEFT:
        for start_s in _STARTS_S:  # fed the readings, all filters run along on the same flight
            filters = [estimator(f"{WINDOW}-{i}-{r}", WINDOW, Setup(i, start_s, r)) for i, r in variants]
            # Of the expanding filter the prior's own reading is one in a thousand.
            filters += [estimator(f"{EXPANDING}-{i}", EXPANDING, Setup(i)) for i in _INPUTS]
            jobs[start_s, "", "readings", left] = Job(
                thesis(left=left, estimators=filters, setup=Setup(start_s=start_s)), SEARCH_RUNS
            )
        for input_at, fed in product(_INPUTS, (WINDOW, EXPANDING)):
            jobs[0.0, input_at, fed, left] = Job(thesis(left=left, setup=Setup(input_at, fed_back=fed)), SEARCH_RUNS)

    def build(flown: Mapping[tuple[float, str, str, float], list[Flown]]) -> Section:
        return _section(sorted(_trials(flown), key=lambda trial: trial.distance))

    return keyed(jobs, build)


def _trials(flown: Mapping[tuple[float, str, str, float], list[Flown]]) -> Iterator[Trial]:
    for start_s, input_at, reading in product(_STARTS_S, _INPUTS, _READINGS):
        groups = [flown[start_s, "", "readings", left] for left in printed.GAINS_LEFT]
        yield _trial(
            Setup(input_at, start_s, reading), groups, f"{WINDOW}-{input_at}-{reading}", f"{EXPANDING}-{input_at}"
        )
    for input_at, fed in product(_INPUTS, (WINDOW, EXPANDING)):
        groups = [flown[0.0, input_at, fed, left] for left in printed.GAINS_LEFT]
        yield _trial(Setup(input_at, fed_back=fed), groups, WINDOW, EXPANDING)


def _trial(setup: Setup, groups: Sequence[list[Flown]], window: str, expanding: str) -> Trial:
    kinds = ((expanding, "final"), (window, "first_within_20pct_s"), (window, "first_within_20pct_smoothed_s"))
    values = np.array([[_value(f, name, metric) for f in group] for name, metric in kinds for group in groups])
    off = distances(np.median(values, axis=1))
    return Trial(setup, values, float(np.sqrt(np.mean(off**2))), float(np.max(np.abs(off))))


def _value(flown: Flown, name: str, metric: str) -> float:
    value = getattr(flown.metrics.estimators[name], metric)
    return np.inf if value is None else float(value)


def distances(medians: Vector) -> Vector:
    """Return the differences from Tables 4 and 5 in units of the tolerances.

    Args:
        medians: (15, ...) finals, raw and smoothed entries, each by K_1 in the order of the tables.

    """
    wanted = [printed.TABLE_4[k][0] for k in printed.GAINS_LEFT]
    wanted += [printed.TABLE_5[k][i] for i in (0, 1) for k in printed.GAINS_LEFT]
    unit = np.repeat([FINAL_TOLERANCE, ENTRY_TOLERANCE_S], [5, 10])
    shape = (-1, *(1,) * (medians.ndim - 1))
    off: Vector = (medians - np.reshape(wanted, shape)) / np.reshape(unit, shape)
    return off


def further(trial: Trial, nearest: Trial) -> Interval:
    """Return by how much a trial's distance is larger than another's, with its bootstrap interval over the noise draws that both share."""
    draws = np.random.default_rng(_SEED).integers(trial.values.shape[1], size=(_RESAMPLES, trial.values.shape[1]))
    one, other = (
        np.sqrt(np.mean(distances(np.median(t.values[:, draws], axis=2)) ** 2, axis=0)) for t in (trial, nearest)
    )
    low, high = np.percentile(one - other, [2.5, 97.5]).tolist()
    return Interval(trial.distance - nearest.distance, low, high, trial.values.shape[1])


def _section(trials: Sequence[Trial]) -> Section:
    def text(values: Sequence[float] | Vector, spec: str) -> str:
        return "  ".join(format(value, spec) for value in values)

    columns = (
        "u_k", "doublets start, s", "prior's own reading", "law is fed", "distance", "further than the nearest", "largest", "final K-hat",
        "entry, s", "smoothed, s",
    )  # fmt: skip
    rows: list[list[Any]] = [
        ["print", None, None, None, 0.0, None, 0.0, text([printed.TABLE_4[k][0] for k in printed.GAINS_LEFT], ".4f"),
         *(text([printed.TABLE_5[k][i] for k in printed.GAINS_LEFT], ".2f") for i in (0, 1))]
    ]  # fmt: skip
    apart = [further(t, trials[0]) for t in trials]
    for t, interval in zip(trials, apart, strict=True):
        s, medians = t.setup, np.median(t.values, axis=1)
        rows.append(
            [s.input_at, s.start_s, s.first_reading, s.fed_back, t.distance, interval, t.largest, text(medians[:5], ".4f"),
             text(medians[5:10], ".2f"), text(medians[10:], ".2f")]
        )  # fmt: skip
    table = Table(
        "setups", "Set-ups of the linear experiment, nearest to the print first (K_1 = 0.8, 0.6, 0.4, 0.2, 0.1)", columns, rows,
        {"distance": ".3f", "largest": ".3f", "doublets start, s": ".2f", "further than the nearest": ".3f"},
        note=f"Medians over {SEARCH_RUNS} noise draws. Distance: root mean square of the 15 differences of Tables 4 and 5 from the print, "
        f"in units of {FINAL_TOLERANCE} of K and {ENTRY_TOLERANCE_S} s; largest: the largest of them.",
    )  # fmt: skip
    tied = [t.setup for t, interval in zip(trials, apart, strict=True) if interval.low <= 0.0]
    kept = "it is among them" if DEFAULT in tied else "it is not"
    return Section(
        "What the thesis leaves open",
        [
            "The text does not say which deflection is u_k within a sample, when exactly the first doublet starts, whether the reading at "
            "the sample of the prior is used, and what the law is fed in the experiments with a fixed controller. Each choice below "
            "was flown. How the smoother starts cannot matter: at the failure its start has a weight of 0.9^450, 3e-21.",
            f"Nearest to the print, or not to be told from the nearest by these draws: {'; '.join(map(_words, tied))}. This study's set-up "
            f"is: {_words(DEFAULT)}; {kept}.",
        ],
        [table],
    )


def _words(setup: Setup) -> str:
    fed = "the readings" if setup.fed_back == "readings" else f"the state of the {setup.fed_back} filter"
    return (
        f"u_k at the {setup.input_at} of the sample, doublets from {setup.start_s:g} s, the prior's own reading {setup.first_reading}, the "
        f"law fed {fed}"
    ).replace("at the mean of the sample", "the mean over the sample")
