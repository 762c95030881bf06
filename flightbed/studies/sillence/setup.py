"""Scenarios of the thesis's experiment, and the search over the choices that the thesis leaves open."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from flightbed.analysis.seeds import Flown, Job
from flightbed.control.base import Gains
from flightbed.core import data
from flightbed.document.document import Section, Table
from flightbed.scenario.reading import Scenario, load_scenario
from flightbed.statistics.intervals import Interval, Vector
from flightbed.studies.base import Part, keyed_part
from flightbed.studies.sillence import printed

UNBOUNDED = (-1000.0, 1000.0)
_INTEGRAL = -0.0001  # gain of the integral in the proportional-integral law
SEARCH_RUNS = 25
FINAL_TOLERANCE, ENTRY_TOLERANCE_S = 0.01, 0.08  # one unit of distance: medians against printed values


@dataclass(frozen=True)
class Setup:
    """Choices that the thesis leaves open.

    Attributes:
        input_at: deflection that serves as u_k: ``"mean"`` over the sample, or at the ``"start"`` or ``"end"`` of the sample.
        start_s: start of the first doublet, s.
        first_reading: ``"used"`` if the reading at the sample of the prior corrects the prior, else ``"left-out"``.
        fed_back: input of the law: ``"readings"``, or the name of a filter whose state is fed back.

    """

    input_at: str = "end"
    start_s: float = 0.0
    first_reading: str = "left-out"
    fed_back: str = "readings"


DEFAULT = Setup()  # among the set-ups that ``search`` finds nearest to the print


@cache
def _raw() -> Mapping[str, Any]:
    return tomllib.loads(data.find("scenario", "thesis-loss").read_text(encoding="utf-8"))


def estimator(name: str, memory: str = "window", setup: Setup = DEFAULT, **changes: Any) -> dict[str, Any]:
    """Return the settings of one of the thesis's filters, unbounded."""
    base: dict[str, Any] = next(e for e in _raw()["estimators"] if e["memory"] == memory)
    prior = {**base["prior"], "first_reading": setup.first_reading}
    return {**base, "name": name, "input_at": setup.input_at, "bounds": UNBOUNDED, "prior": prior, **changes}


def gains(law: str) -> dict[str, float]:
    """Return the thesis's gains of a law, with the keys of ``control.gains``."""
    given: dict[str, float] = _raw()["control"]["gains"]
    return {**given, "integral": _INTEGRAL} if law == "proportional-integral" else dict(given)


def law_gains(law: str) -> Gains:
    """Return the thesis's gains of a law."""
    given = gains(law)
    return Gains(given["alpha"], given["q_s"], given["elevator"], given["reference_s"], given.get("integral", 0.0))


WINDOW, EXPANDING = "window", "expanding"
FAST = "window-smoothed-07"  # the window, smoothed by 0.7 instead of 0.9


def changed(table: Mapping[str, Any], keys: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a table with other keys; those of a kind, or of a table that is off, replace the whole table: others have no effect there."""
    return keys if "kind" in keys or keys.get("enabled") is False else {**table, **keys}


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
    """Return a scenario of the thesis's experiment: the shipped scenario ``thesis-loss`` with changes.

    Args:
        left: K after the failure; None for no failure, or for those that ``tables`` gives.
        at_s: time of the failure, s.
        law: name of the law.
        adapts: name of the estimator that corrects the law; empty for the fixed law.
        noise: standard deviations of the readings of alpha, deg, and pitch rate, deg/s.
        estimators: settings of the estimators; if empty, the thesis's two filters, unbounded.
        setup: choices that the thesis leaves open.
        tables: further tables of the scenario; keys of a table replace those of ``thesis-loss``, a list or a table with a kind replaces
            the whole.

    """
    given = list(estimators) or [estimator(WINDOW, "window", setup), estimator(EXPANDING, "expanding", setup)]
    raw = dict(_raw())
    settings: dict[str, Mapping[str, Any] | Sequence[Any]] = {
        "failures": [] if left is None else [{"kind": "effectiveness", "at_s": at_s, "to": left}],
        "command": {"start_s": setup.start_s},
        "sensors": {"alpha_std_deg": noise[0], "q_std_deg_s": noise[1]},
        "control": {
            "law": law,
            "state_from": "" if setup.fed_back == "readings" else setup.fed_back,
            "gains": gains(law),
        },
        "adaptation": {"enabled": True, "estimator": adapts} if adapts else {"enabled": False},
    }
    for table, keys in (*settings.items(), *tables.items()):
        raw[table] = changed(raw.get(table, {}), keys) if isinstance(keys, Mapping) else keys
    return load_scenario({**raw, "estimators": given})


# Readings of the thesis's adaptive law: where the actuator's position is fed back (Fig. 1: into the sum that 1/K multiplies), and
# whether alpha and q are the readings or the window's estimates (S 5.6, adaptive flights). This study uses the first.
LAWS_READ = tuple(product(("effective", "position"), (WINDOW, "readings")))


def adaptive(
    *, left: float = 0.2, snr: str = "37.227", bounded: bool = True, feedback: str = "effective", fed: str = WINDOW,
    law: str = "proportional-integral", smoothing: float = 0.9,
) -> Scenario:  # fmt: skip
    """Return a scenario whose law is corrected by the window's smoothed K-hat, in one reading of the thesis's adaptive law.

    Args:
        left: K after the failure.
        snr: SNR, dB, of a row of Table 1, as printed.
        bounded: whether K-hat is bounded to 0 .. 1.
        feedback: ``"position"``: 1/K multiplies the position feedback too; ``"effective"``: K-hat times the position is fed back.
        fed: alpha and q of the law: ``"window"`` for that filter's estimates, or ``"readings"``.
        law: name of the law.
        smoothing: smoothing factor of K-hat.

    """
    q_std, alpha_std = next((q, alpha) for q, alpha, text in printed.TABLE_1 if text == snr)
    bounds = (0.0, 1.0) if bounded else UNBOUNDED
    return thesis(
        left=left, law=law, adapts=WINDOW, noise=(alpha_std, q_std), setup=replace(DEFAULT, fed_back=fed),
        estimators=[estimator(WINDOW, bounds=bounds, smoothing=smoothing), estimator(EXPANDING, "expanding")],
        adaptation={"feedback": feedback},
    )  # fmt: skip


class Candidate(NamedTuple):
    """A set-up and the distance of its medians from the print.

    Attributes:
        setup: choices that the thesis leaves open.
        values: (15, runs) final K-hat, raw and smoothed times of entry, s, by K_1 in the order of the tables; inf: no entry.
        distance: root mean square of the 15 differences from Tables 4 and 5, in units of the tolerances.
        largest: largest magnitude of these differences.

    """

    setup: Setup
    values: Vector
    distance: float
    largest: float


_STARTS_S = (0.0, 0.01, 0.02, 0.05)
_INPUTS = ("mean", "start", "end")
_READINGS = ("left-out", "used")
_RESAMPLES, _SEED = 400, 4  # bootstrap over the noise draws, for intervals of differences of distance


def search(runs: int = SEARCH_RUNS) -> Part:
    """Fly the set-ups that the thesis leaves open and rank them by their distance from the print."""
    jobs: dict[tuple[float, str, str, float], Job] = {}
    variants = list(product(_INPUTS, _READINGS))
    for left in printed.GAINS_LEFT:
        for start_s in _STARTS_S:  # with the readings fed back, all filters share one flight
            filters = [estimator(f"{WINDOW}-{i}-{r}", WINDOW, Setup(i, start_s, r)) for i, r in variants]
            # The expanding filter uses a thousand readings: the reading at the prior's sample is negligible.
            filters += [estimator(f"{EXPANDING}-{i}", EXPANDING, Setup(i)) for i in _INPUTS]
            jobs[start_s, "", "readings", left] = Job(
                thesis(left=left, estimators=filters, setup=Setup(start_s=start_s)), runs
            )
        for input_at, fed in product(_INPUTS, (WINDOW, EXPANDING)):
            jobs[0.0, input_at, fed, left] = Job(thesis(left=left, setup=Setup(input_at, fed_back=fed)), runs)

    def build(flown: Mapping[tuple[float, str, str, float], list[Flown]]) -> Section:
        return _section(sorted(_candidates(flown), key=lambda candidate: candidate.distance))

    return keyed_part(jobs, build)


def _candidates(flown: Mapping[tuple[float, str, str, float], list[Flown]]) -> Iterator[Candidate]:
    for start_s, input_at, reading in product(_STARTS_S, _INPUTS, _READINGS):
        groups = [flown[start_s, "", "readings", left] for left in printed.GAINS_LEFT]
        yield _candidate(
            Setup(input_at, start_s, reading), groups, f"{WINDOW}-{input_at}-{reading}", f"{EXPANDING}-{input_at}"
        )
    for input_at, fed in product(_INPUTS, (WINDOW, EXPANDING)):
        groups = [flown[0.0, input_at, fed, left] for left in printed.GAINS_LEFT]
        yield _candidate(Setup(input_at, fed_back=fed), groups, WINDOW, EXPANDING)


def _candidate(setup: Setup, groups: Sequence[list[Flown]], window: str, expanding: str) -> Candidate:
    kinds = ((expanding, "final"), (window, "first_within_20pct_s"), (window, "first_within_20pct_smoothed_s"))
    values = np.array([[_value(f, name, metric) for f in group] for name, metric in kinds for group in groups])
    off = distances(np.median(values, axis=1))
    return Candidate(setup, values, float(np.sqrt(np.mean(off**2))), float(np.max(np.abs(off))))


def _value(flown: Flown, name: str, metric: str) -> float:
    value = getattr(flown.metrics.estimators[name], metric)
    return np.inf if value is None else float(value)


def distances(medians: Vector) -> Vector:
    """Return the differences from Tables 4 and 5 in units of the tolerances.

    Args:
        medians: (15, ...) final K-hat, raw and smoothed times of entry, s, each by K_1 in the order of the tables.

    """
    wanted = [printed.TABLE_4[k][0] for k in printed.GAINS_LEFT]
    wanted += [printed.TABLE_5[k][i] for i in (0, 1) for k in printed.GAINS_LEFT]
    unit = np.repeat([FINAL_TOLERANCE, ENTRY_TOLERANCE_S], [5, 10])
    shape = (-1, *(1,) * (medians.ndim - 1))
    off: Vector = (medians - np.reshape(wanted, shape)) / np.reshape(unit, shape)
    return off


def distance_excess(candidate: Candidate, nearest: Candidate) -> Interval:
    """Return the excess of a candidate's distance over the nearest's, with a 95 % bootstrap interval over the shared noise draws."""
    draws = np.random.default_rng(_SEED).integers(
        candidate.values.shape[1], size=(_RESAMPLES, candidate.values.shape[1])
    )
    one, other = (
        np.sqrt(np.mean(distances(np.median(t.values[:, draws], axis=2)) ** 2, axis=0)) for t in (candidate, nearest)
    )
    low, high = np.percentile(one - other, [2.5, 97.5]).tolist()
    return Interval(candidate.distance - nearest.distance, low, high, candidate.values.shape[1])


def _section(candidates: Sequence[Candidate]) -> Section:
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
    apart = [distance_excess(t, candidates[0]) for t in candidates]
    for t, interval in zip(candidates, apart, strict=True):
        s, medians = t.setup, np.median(t.values, axis=1)
        rows.append(
            [s.input_at, s.start_s, s.first_reading, s.fed_back, t.distance, interval, t.largest, text(medians[:5], ".4f"),
             text(medians[5:10], ".2f"), text(medians[10:], ".2f")]
        )  # fmt: skip
    table = Table(
        "setups", "Set-ups of the linear experiment, nearest to the print first (K_1 = 0.8, 0.6, 0.4, 0.2, 0.1)", columns, rows,
        {"distance": ".3f", "largest": ".3f", "doublets start, s": ".2f", "further than the nearest": ".3f"},
        note=f"Medians over {candidates[0].values.shape[1]} noise draws. Distance: root mean square of the 15 differences of Tables 4 and "
        f"5 from the print, in units of {FINAL_TOLERANCE} of K and {ENTRY_TOLERANCE_S} s; largest: the largest of them.",
    )  # fmt: skip
    nearest = [t.setup for t, interval in zip(candidates, apart, strict=True) if interval.low <= 0.0]
    kept = "it is among them" if DEFAULT in nearest else "it is not"
    return Section(
        "What the thesis leaves open",
        [
            "The thesis does not specify the deflection within a sample that serves as u_k, the start of the first doublet, the use of "
            "the reading at the sample of the prior, and the input of the law in the experiments with a fixed controller. Each choice "
            "below was flown. The initial value of the smoother has no effect: its weight at the failure is 0.9^450 = 3e-21.",
            f"Nearest to the print, or indistinguishable from the nearest with these draws: {'; '.join(map(_words, nearest))}. Set-up of "
            f"this study: {_words(DEFAULT)}; {kept}.",
        ],
        [table],
    )


def _words(setup: Setup) -> str:
    fed = "the readings" if setup.fed_back == "readings" else f"the state of the {setup.fed_back} filter"
    return (
        f"u_k at the {setup.input_at} of the sample, doublets from {setup.start_s:g} s, the prior's own reading {setup.first_reading}, the "
        f"law fed {fed}"
    ).replace("at the mean of the sample", "the mean over the sample")
