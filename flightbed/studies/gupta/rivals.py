"""Comparison on the same signals: Kalman filters with an input state, an unknown-input observer, and the retrospective cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import sin, sqrt
from typing import Any

import numpy as np

from flightbed.document.document import Section, Table
from flightbed.estimation.reconstruction.input_kalman import (
    InputDynamics,
    InputKalmanFilter,
    UnknownInputObserver,
    harmonic,
    no_observer,
    random_walk,
)
from flightbed.estimation.reconstruction.input_model import InputModel
from flightbed.statistics.intervals import spread
from flightbed.studies.base import Part, Trials, keyed_part
from flightbed.studies.gupta import printed
from flightbed.studies.gupta.trials import (
    EXAMPLES,
    LAST,
    WITHIN,
    Array,
    Case,
    Signals,
    forgetful,
    initial_std,
    measure,
    models,
    signals,
)

NOISES = (0.0, 0.01, 0.1)  # standard deviations, as shares of the output's RMS
WRONG_FREQUENCY = 1.1  # frequency of the mistuned filter relative to the true one
_FLOOR = 1e-6  # smallest noise in the filters' settings, as a share of the output's RMS
RETROSPECTIVE, FORGETTING, WALK, HARMONIC, OFF, OBSERVER = (
    "retrospective", "retrospective, forgetting", "random walk", "harmonic", "harmonic, 10 % off", "observer, u(k-1)",
)  # fmt: skip


def rivals(seed: int, case: Case) -> dict[str, float | None]:
    """Return the RMS error of each estimator over the last 100 samples, as a share of the amplitude; None if no observer exists."""
    given, (_, model) = signals(seed, case), models(case)
    unit = printed.AMPLITUDE
    step = 2.0 * sin(printed.RAD_PER_SAMPLE / 2.0) * unit / sqrt(2.0)  # RMS of u(k+1) - u(k)
    # Amplitude and phase of the harmonic may change by a thousandth of the amplitude per sample.
    dynamics: dict[str, InputDynamics] = {
        WALK: random_walk(1, step_std=step, initial_std=unit),
        HARMONIC: harmonic(1, printed.RAD_PER_SAMPLE, step_std=1e-3 * unit, initial_std=unit),
        OFF: harmonic(1, WRONG_FREQUENCY * printed.RAD_PER_SAMPLE, step_std=1e-3 * unit, initial_std=unit),
    }
    settings = _settings(given, model, case)
    found: dict[str, float | None] = {
        name: _error(_estimates(InputKalmanFilter(one, model, **settings), given), given.input)
        for name, one in dynamics.items()
    }
    found[OBSERVER] = None
    if no_observer(model) is None:
        late = _estimates(UnknownInputObserver(model, **settings), given)
        found[OBSERVER] = _error(late[1:], given.input[:-1])
    found[RETROSPECTIVE] = measure(seed, case).error
    found[FORGETTING] = measure(seed, forgetful(case)).error
    return found


def _settings(given: Signals, model: InputModel, case: Case) -> dict[str, Array]:
    usual = float(np.sqrt(np.mean(given.outputs[-LAST:] ** 2)))
    noise = max(given.noise_std, _FLOOR * usual)
    return {
        "process": np.zeros((model.states, model.states)),
        "noise": np.array([[noise**2]]),
        "state_covariance": np.diag(initial_std(case) ** 2),
    }


def _estimates(estimator: InputKalmanFilter | UnknownInputObserver, given: Signals) -> Array:
    return np.array([estimator.update(y).input[0] for y in given.outputs])


def _error(found: Array, truth: Array) -> float:
    return float(np.sqrt(np.mean((found - truth)[-LAST:] ** 2))) / printed.AMPLITUDE


def comparison(runs: int) -> Part:
    """Compare all estimators on all examples except the third, without noise and with noise."""
    jobs: dict[tuple[str, float], Trials] = {
        (name, noise): Trials(rivals, (replace(case, noise_share=noise),), runs)
        for name, case in EXAMPLES.items()
        for noise in NOISES
    }

    def build(results: Mapping[tuple[str, float], list[dict[str, float | None]]]) -> Section:
        names = (RETROSPECTIVE, FORGETTING, WALK, HARMONIC, OFF, OBSERVER)
        rows: list[list[Any]] = []
        for (example, noise), runs_of in results.items():
            cells: list[Any] = []
            for name in names:
                values = [run[name] for run in runs_of]
                cells.append("none exists" if all(v is None for v in values) else spread(values))
            rows.append([example, f"{noise:.0%}", *cells])
        columns = ("example", "noise", *names)
        table = Table(
            "rivals", "Error of the input, in shares of its amplitude", columns, rows, dict.fromkeys(names, ".2g"),
            note=f"{runs} runs each, median [5 %, 95 %], RMS over the last {LAST} samples, against u itself; below {WITHIN:g} the input "
            "counts as reconstructed. Noise: as a share of the output's RMS under the input alone. The observer estimates the input one "
            "sample late and is compared with that sample. The RMS change of u per sample is 0.14. The Kalman filters have the variance "
            "of the noise, the random walk also the RMS of the input's steps.",
        )  # fmt: skip
        return Section(
            "Rivals",
            [
                "A Kalman filter with the input's frequency; a Kalman filter with a frequency 10 % too high; a Kalman filter with a "
                "random walk as its model of the input; and the unbiased minimum-variance observer of Gillijns and De Moor (2007), which "
                "assumes nothing about the input and exists if no zero is on or outside the unit circle. All use the same model of the "
                "plant as the retrospective cost.",
            ],
            [table],
        )

    return keyed_part(jobs, build)
