"""The same signals given to a Kalman filter with an input state, to an unknown-input observer, and to the retrospective cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import sin, sqrt
from typing import Any

import numpy as np

from flightbed.document import Section, Table
from flightbed.estimation.input_model import InputModel
from flightbed.estimation.input_observer import (
    InputDynamics,
    InputKalmanFilter,
    UnknownInputObserver,
    harmonic,
    no_observer,
    random_walk,
)
from flightbed.statistics import spread
from flightbed.studies.base import Part, Trials, keyed
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
    measured,
    models,
    signals,
)

NOISES = (0.0, 0.01, 0.1)  # of the output's RMS
WRONG_FREQUENCY = 1.1  # times the true one
_FLOOR = 1e-6  # of the outputs' RMS: noise that filters are told of where there is none
RETROSPECTIVE, FORGETTING, WALK, HARMONIC, OFF, OBSERVER = (
    "retrospective", "retrospective, forgetting", "random walk", "harmonic", "harmonic, 10 % off", "observer, u(k-1)",
)  # fmt: skip


def rivals(seed: int, case: Case) -> dict[str, float | None]:
    """Return the errors of all, RMS over the last 100 samples in shares of the amplitude; None where no observer exists."""
    given, (_, model) = signals(seed, case), models(case)
    unit = printed.AMPLITUDE
    step = 2.0 * sin(printed.RAD_PER_SAMPLE / 2.0) * unit / sqrt(2.0)  # RMS of u(k+1) - u(k)
    # The harmonic keeps amplitude and phase but for what a thousandth of the amplitude a sample may change.
    believed: dict[str, InputDynamics] = {
        WALK: random_walk(1, step_std=step, initial_std=unit),
        HARMONIC: harmonic(1, printed.RAD_PER_SAMPLE, step_std=1e-3 * unit, initial_std=unit),
        OFF: harmonic(1, WRONG_FREQUENCY * printed.RAD_PER_SAMPLE, step_std=1e-3 * unit, initial_std=unit),
    }
    told = _told(given, model, case)
    found: dict[str, float | None] = {
        name: _error(_filtered(InputKalmanFilter(dynamics, model, **told), given), given.input)
        for name, dynamics in believed.items()
    }
    found[OBSERVER] = None
    if no_observer(model) is None:
        late = _filtered(UnknownInputObserver(model, **told), given)
        found[OBSERVER] = _error(late[1:], given.input[:-1])
    found[RETROSPECTIVE] = measured(seed, case).error
    found[FORGETTING] = measured(seed, forgetful(case)).error
    return found


def _told(given: Signals, model: InputModel, case: Case) -> dict[str, Array]:
    usual = float(np.sqrt(np.mean(given.outputs[-LAST:] ** 2)))
    noise = max(given.noise_std, _FLOOR * usual)
    return {
        "process": np.zeros((model.states, model.states)),
        "noise": np.array([[noise**2]]),
        "state_covariance": np.diag(initial_std(case) ** 2),
    }


def _filtered(estimator: InputKalmanFilter | UnknownInputObserver, given: Signals) -> Array:
    return np.array([estimator.update(y).input[0] for y in given.outputs])


def _error(found: Array, truth: Array) -> float:
    return float(np.sqrt(np.mean((found - truth)[-LAST:] ** 2))) / printed.AMPLITUDE


def comparison(runs: int) -> Part:
    """Compare all on all examples but the third, without noise and with it."""
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
            note=f"{runs} runs each, median [5 %, 95 %], RMS over the last {LAST} samples, against u itself; {WITHIN:g} is the mark. "
            "Noise: of the output's RMS that the input gives. The observer tells the input one sample late and is compared with that one. "
            "0.14 is what u changes in a sample. The Kalman filters know the noise, the walk the RMS of the input's steps.",
        )  # fmt: skip
        return Section(
            "Rivals",
            [
                "A Kalman filter that knows the input's frequency; one that is told a frequency 10 % too high; one that takes the input "
                "for a random walk; and the unbiased minimum-variance observer of Gillijns and De Moor (2007), which asks nothing of the "
                "input and exists if no zero is on or outside the unit circle. All have the model that the retrospective cost has.",
            ],
            [table],
        )

    return keyed(jobs, build)
