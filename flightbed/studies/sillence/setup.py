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
from flightbed.statistics import spread
from flightbed.studies.base import Flights, Part
from flightbed.studies.sillence import printed

UNBOUNDED = (-1000.0, 1000.0)
SEARCH_RUNS = 8
FINAL_TOLERANCE, ENTRY_TOLERANCE_S = 0.01, 0.08  # of the medians, against the print: one unit of distance each


@dataclass(frozen=True)
class Setup:
    """What the thesis leaves open.

    Attributes:
        input_at: which elevator deflection is u_k: its mean over the sample, or that at the sample's start or end.
        start_s: when the first doublet starts.
        first_reading: whether the reading at the sample to which the prior belongs corrects it ("used") or not ("left-out").
        fed_back: what the law is fed: the readings, or the filter's state (his Fig. 1).

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
        "control": {"law": law, "state_from": adapts if setup.fed_back == "estimate" else ""},
        "adaptation": {"enabled": bool(adapts), "estimator": adapts},
    }
    for table, keys in (*settings.items(), *tables.items()):
        raw[table] = {**raw.get(table, {}), **keys} if isinstance(keys, Mapping) else keys
    return load_scenario({**raw, "estimators": given})


class Trial(NamedTuple):
    """A set-up and how far its medians are from the print.

    Attributes:
        distance: root mean square of the 15 differences of Tables 4 and 5, in units of the tolerances.
        largest: the largest of them.
        final, entry_s, smoothed_s: medians, by K_1 in the order of the tables.

    """

    setup: Setup
    distance: float
    largest: float
    final: list[float]
    entry_s: list[float]
    smoothed_s: list[float]


_STARTS_S = (0.0, 0.01, 0.02, 0.05)
_INPUTS = ("mean", "start", "end")
_READINGS = ("left-out", "used")


def search() -> Part:
    """Fly the set-ups that the thesis leaves open, and rank them."""
    jobs, keys = [], []
    for start_s, left in product(_STARTS_S, printed.GAINS_LEFT):
        variants = [Setup(i, start_s, r) for i, r in product(_INPUTS, _READINGS)]
        filters = [estimator(f"{WINDOW}-{n}", WINDOW, s) for n, s in enumerate(variants)]
        # Of the expanding filter the prior's own reading is one in a thousand.
        filters += [estimator(f"{EXPANDING}-{i}", EXPANDING, Setup(i)) for i in _INPUTS]
        jobs.append(Job(thesis(left=left, estimators=filters, setup=variants[0]), SEARCH_RUNS))
        keys.append((start_s, left, ""))
    for left, fed in product(printed.GAINS_LEFT, (WINDOW, EXPANDING)):
        jobs.append(Job(thesis(left=left, control={"state_from": fed}), SEARCH_RUNS))
        keys.append((0.0, left, fed))

    def build(flights: Flights) -> Section:
        flown = dict(zip(keys, flights, strict=True))
        return _section(sorted(_trials(flown), key=lambda trial: trial.distance))

    return Part(jobs, build)


def _trials(flown: Mapping[tuple[float, float, str], list[Flown]]) -> Iterator[Trial]:
    for start_s in _STARTS_S:
        for n, (input_at, reading) in enumerate(product(_INPUTS, _READINGS)):
            groups = [flown[start_s, left, ""] for left in printed.GAINS_LEFT]
            yield _trial(Setup(input_at, start_s, reading), groups, groups, f"{WINDOW}-{n}", f"{EXPANDING}-{input_at}")
    windows, expandings = ([flown[0.0, left, fed] for left in printed.GAINS_LEFT] for fed in (WINDOW, EXPANDING))
    yield _trial(replace(DEFAULT, fed_back="estimate"), windows, expandings, WINDOW, EXPANDING)


def _trial(
    setup: Setup, windows: Sequence[list[Flown]], expandings: Sequence[list[Flown]], window: str, expanding: str
) -> Trial:
    final = [spread([f.metrics.estimators[expanding].final for f in group]).median for group in expandings]
    entry = [spread([f.metrics.estimators[window].first_within_20pct_s for f in group]).median for group in windows]
    smoothed = [
        spread([f.metrics.estimators[window].first_within_20pct_smoothed_s for f in group]).median for group in windows
    ]
    off = distances(final, entry, smoothed)
    return Trial(setup, float(np.sqrt(np.mean(off**2))), float(np.max(np.abs(off))), final, entry, smoothed)


def distances(
    final: Sequence[float], entry_s: Sequence[float], smoothed_s: Sequence[float]
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the 15 differences from Tables 4 and 5 in units of the tolerances, by K_1 in the order of the tables."""
    wanted = [printed.TABLE_4[k][0] for k in printed.GAINS_LEFT]
    raw, low_passed = ([printed.TABLE_5[k][i] for k in printed.GAINS_LEFT] for i in (0, 1))
    return np.concatenate(
        [
            (np.asarray(final) - wanted) / FINAL_TOLERANCE,
            (np.asarray(entry_s) - raw) / ENTRY_TOLERANCE_S,
            (np.asarray(smoothed_s) - low_passed) / ENTRY_TOLERANCE_S,
        ]
    )


def _section(trials: Sequence[Trial]) -> Section:
    def text(values: Sequence[float], spec: str) -> str:
        return "  ".join(format(value, spec) for value in values)

    columns = (
        "u_k",
        "doublets start, s",
        "prior's own reading",
        "law is fed",
        "distance",
        "largest",
        "final K-hat",
        "entry, s",
        "smoothed, s",
    )
    rows: list[list[Any]] = [
        ["print", None, None, None, 0.0, 0.0, text([printed.TABLE_4[k][0] for k in printed.GAINS_LEFT], ".4f"),
         *(text([printed.TABLE_5[k][i] for k in printed.GAINS_LEFT], ".2f") for i in (0, 1))]
    ]  # fmt: skip
    for t in trials:
        s = t.setup
        rows.append(
            [s.input_at, s.start_s, s.first_reading, s.fed_back, t.distance, t.largest, text(t.final, ".4f"),
             text(t.entry_s, ".2f"), text(t.smoothed_s, ".2f")]
        )  # fmt: skip
    table = Table(
        "setups", "Set-ups of the linear experiment, nearest to the print first (K_1 = 0.8, 0.6, 0.4, 0.2, 0.1)", columns, rows,
        {"distance": ".3f", "largest": ".3f", "doublets start, s": ".2f"},
        note=f"Medians over {SEARCH_RUNS} noise draws. Distance: root mean square of the 15 differences of Tables 4 and 5 from the print, "
        f"in units of {FINAL_TOLERANCE} of K and {ENTRY_TOLERANCE_S} s; largest: the largest of them.",
    )  # fmt: skip
    best = trials[0].setup
    return Section(
        "What the thesis leaves open",
        [
            "The text does not say which deflection is u_k within a sample, when exactly the first doublet starts, whether the reading at "
            "the sample of the prior is used, and what the law is fed in the experiments with a fixed controller. Each choice below "
            "was flown. How the smoother starts cannot matter: at the failure its start has a weight of 0.9^450, 3e-21.",
            f"Nearest to the print: u_k = {best.input_at} of the sample, doublets from {best.start_s:g} s, the prior's own reading "
            f"{best.first_reading}, the law fed with {'the readings' if best.fed_back == 'readings' else 'the estimate'}"
            + ("; it is this study's set-up." if best == DEFAULT else f"; this study keeps {DEFAULT}."),
        ],
        [table],
    )
