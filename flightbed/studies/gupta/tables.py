"""Tables: summary of the examples, regularization of example 1, damping of example 3, effect of order and period."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from flightbed.document.document import Section, Table
from flightbed.estimation.reconstruction.input_model import invariant_zeros
from flightbed.statistics.intervals import Interval, share, spread
from flightbed.studies.base import Part, Trials, keyed_part
from flightbed.studies.gupta import plants, printed
from flightbed.studies.gupta.trials import (
    EXAMPLES,
    LAST,
    WITHIN,
    Case,
    RunMeasures,
    as_printed,
    forgetful,
    measure,
    models,
)

Results = Mapping[Any, list[RunMeasures]]

LARGE, SMALL = 1.0, 0.01  # scale of the initial states of example 3, m and m/s
_RULES: tuple[tuple[str, Mapping[str, Any]], ...] = (
    ("none", {"regularization": 0.0}),
    *((f"constant {eta:g}", {"regularization": eta}) for eta in (1e-4, 1e-3, 0.01, 0.1, 1.0)),
    *(
        (f"{rule} {eta:g}", {"regularization": eta, "regularized_by": rule})
        for rule in ("performance", "error")
        for eta in (1e-4, 0.01, 1.0)
    ),
    *((f"saturation +-{bound:g}", {"regularization": 0.0, "saturation": bound}) for bound in (0.7, 1.2)),
    ("constant 0.01, u(k-1) and u(k-2) optimized", {"retained": ((1, 2),)}),
)
ORDERS = (1, 2, 3, 5, 8, 10, 15, 20)
PERIODS = {"2 damped rigid body": (0.1, 0.2, 0.5, 1.0, 2.0), "5 missile": (0.05, 0.1, 0.2, 0.5, 1.0)}
DAMPING_PERIODS = (0.2, 0.1, 0.05, 0.02)


def share_converged(runs: Sequence[RunMeasures], key: str = "error") -> Interval:
    """Return the share of the runs with an error ``key`` below 2 %, with its 95 % interval."""
    return share(sum(getattr(run, key) < WITHIN for run in runs), len(runs))


def _errors(runs: Sequence[RunMeasures], key: str = "error") -> Any:
    values = [getattr(run, key) for run in runs]
    return spread([v if v is not None and np.isfinite(v) else None for v in values])


def glance(runs: int) -> Part:
    """Run every example with the printed settings and with forgetting."""
    inputs = {(name, one.forgetting): one for name, case in EXAMPLES.items() for one in (case, forgetful(case))}
    dampings = {
        (f"3 from about {scale:g} m", 1.0): replace(as_printed("3"), initial_scale=scale) for scale in (LARGE, SMALL)
    }

    def build(results: Results) -> Section:
        rows: list[list[Any]] = []
        for (name, forgetting), made in results.items():
            three = (name, forgetting) in dampings
            good, found = _dampings(made) if three else (share_converged(made), _errors(made))
            rows.append([name, forgetting, good, "" if three else found, found if three else ""])
        columns = ("example", "lambda", "share within 2 %", "error of input", "damping")
        table = Table(
            "glance", "The examples with the printed settings and with forgetting", columns, rows,
            {"lambda": "g", "share within 2 %": ".2f", "error of input": ".2g", "damping": ".4g"},
            note=f"{runs} runs each from random initial states and phases: median [5 %, 95 %] of the RMS over the last {LAST} samples in "
            "shares of the input's amplitude, or damping (true: 5); share with its 95 % interval. Never: run stopped after divergence.",
        )  # fmt: skip
        keys = ("equivalent_error", "state_error", "peak", "converged_at")
        more = [
            [name, lam, *(_errors(made, key) for key in keys)]
            for (name, lam), made in results.items()
            if (name, lam) in inputs
        ]
        headings = (
            "example", "lambda", "error against the equivalent input", "largest error of a state", "peak, amplitudes",
            "within 2 % from sample",
        )  # fmt: skip
        details = Table(
            "details", "The same runs: equivalent input, states, transients", headings, more,
            dict(zip(headings[1:], ("g", ".2g", ".2g", ".3g", ".0f"), strict=True)),
            note="States in shares of their RMS under the input alone; peak of |u^|; last column: sample from which the RMS error over "
            "100 samples, against the equivalent input, stays below 2 % of the amplitude to the end.",
        )  # fmt: skip
        return Section("At a glance", _GLANCE, [table, details])

    cases = {**inputs, **dampings}
    return keyed_part({key: Trials(measure, (case,), runs) for key, case in cases.items()}, build)


def _dampings(made: Sequence[RunMeasures]) -> tuple[Interval, Any]:
    good = sum(abs(m.damping - printed.DAMPING) < WITHIN * printed.DAMPING for m in made)
    return share(good, len(made)), _errors(made, "damping")


_GLANCE = (
    "The paper shows one run of each example as a figure and prints no error, initial state, duration or lambda. Here the initial states "
    "are random (standard deviations 1 m and 1 m/s; missile 1 g, 0.1 rad/s, 0.05 rad), and so is the phase of the input; the estimator "
    "starts at 0. Durations: 1000 samples, 300 in example 3, 3000 in example 4. 'As printed' has lambda = 1, 'with forgetting' lambda = "
    "0.99.",
    "Where the model has the wrong damping (example 4), only the equivalent input makes z vanish: the input that moves the output of the "
    "wrong model as u moves the output of the plant, G(plant)/G(model) times u at the input's frequency. The estimator reconstructs this "
    "input.",
)


def regularization(runs: int) -> Part:
    """Run example 1 with every regularization and saturation of the optimized input."""
    cases = {words: replace(as_printed("1"), **settings) for words, settings in _RULES}

    def build(results: Results) -> Section:
        rows = [
            [
                words,
                share_converged(made),
                _errors(made),
                _errors(made, "peak"),
                share(sum(not np.isfinite(m.error) for m in made), len(made)),
            ]
            for words, made in results.items()
        ]
        columns = ("eta", "share within 2 %", "error", "peak, amplitudes", "given up")
        table = Table(
            "regularization", "Example 1: regularization of the optimum", columns, rows,
            dict(zip(columns[1:], (".2f", ".2g", ".3g", ".2f"), strict=True)),
            note=f"{runs} runs each, as above. eta is added to (C B)^2 = 0.25. Given up: run stopped at |u^| beyond 1e9 amplitudes.",
        )  # fmt: skip
        return Section(
            "Example 1: the zero at -1",
            [
                "The sampled rigid body has its zero at -1, on the unit circle: an input of alternating sign does not appear in the "
                "position. The paper prints eta_0 = 0.01, but not the rule for eta.",
            ],
            [table],
        )

    return keyed_part({key: Trials(measure, (case,), runs) for key, case in cases.items()}, build)


def damping(runs: int) -> Part:
    """Run example 3 for several initial covariances, scales of the initial state, orders and periods."""
    base, cases = as_printed("3"), {}
    for covariance, scale in product((1.0, 1e-2, 1e-4), (LARGE, SMALL)):
        cases[f"P(0) = {covariance:g} I, from about {scale:g} m"] = replace(
            base, initial_covariance=covariance, initial_scale=scale
        )
    for order in (2, 5):
        cases[f"n_c = {order}, P(0) = I, from about 1 m"] = replace(base, order=order)
    for period in DAMPING_PERIODS:
        samples = round(base.samples * base.period_s / period)
        cases[f"T = {period:g} s, from about 0.01 m"] = replace(
            base, period_s=period, samples=samples, initial_scale=SMALL
        )

    def build(results: Results) -> Section:
        rows: list[list[Any]] = []
        for words, made in results.items():
            rows.append([words, *_dampings(made), plants.damping_limit(cases[words].period_s)])
        columns = ("example 3", "share within 2 % of 5", "damping, N s/m", "in the limit")
        table = Table(
            "damping", "Damping by (54), initial value 3", columns, rows,
            {columns[1]: ".2f", columns[2]: ".4f", columns[3]: ".4f"},
            note=f"{runs} runs each; median over the last {LAST} samples of 30 s. The limit is computed from the two models: held inputs "
            "in the estimator's model, continuous damping in the plant.",
        )  # fmt: skip
        return Section(
            "Example 3: damping",
            [
                "Multiplication of all signals by s and of P(0) by s^-2 changes the scale only, so 'P(0) = I' has no meaning without the "
                "scale of the initial state, which the paper does not print.",
            ],
            [table],
        )

    return keyed_part({key: Trials(measure, (case,), runs) for key, case in cases.items()}, build)


def sensitivity(runs: int) -> Part:
    """Run the examples for several orders and periods, with forgetting."""
    names = ("1 rigid body", "2 damped rigid body", "4 oscillator, c_0 = 4", "5 missile")
    orders = {
        (order, name): replace(forgetful(EXAMPLES[name]), order=order, samples=min(EXAMPLES[name].samples, 2000))
        for order, name in product(ORDERS, names)
    }
    periods = {
        (name, period): replace(forgetful(EXAMPLES[name]), period_s=period)
        for name, found in PERIODS.items()
        for period in found
    }

    def build(results: Results) -> Section:
        rows = [[order, *(_errors(results[order, name], "equivalent_error") for name in names)] for order in ORDERS]
        one = Table(
            "order", "Error against the equivalent input by order of the feedback", ("n_c", *names), rows, dict.fromkeys(names, ".2g"),
            note=f"{runs} runs each, lambda = 0.99, 1000 samples (example 4: 2000). A harmonic through a plant of order n needs n_c of "
            "about n + 2: two for the harmonic, n for a stable estimator.",
        )  # fmt: skip
        two_rows: list[list[Any]] = []
        for (name, period), case in periods.items():
            plant, _ = models(case)
            zero = float(np.max(np.abs(invariant_zeros(plant))))
            made = results[name, period]
            two_rows.append(
                [
                    name,
                    period,
                    float(plant.markov(1)[0, 0, 0]),
                    zero,
                    share_converged(made, "equivalent_error"),
                    _errors(made),
                ]
            )
        columns = ("example", "T, s", "C B", "largest |zero|", "share within 2 %", "error")
        two = Table(
            "period", "Sample period", columns, two_rows, {"T, s": "g", "C B": ".3g", "largest |zero|": ".3f", "share within 2 %": ".2f"},
            note="The input is 0.6 sin(0.2 k) per sample throughout. The missile's loop has zeros at -26.1 and +26.2 rad/s: the initial "
            "response of the acceleration at the c.g. of a tail-controlled missile has the wrong sign. The loop is minimum-phase, as the "
            "paper states, only with slow sampling.",
        )  # fmt: skip
        return Section("Order and sample period", (), [one, two])

    cases: dict[Any, Case] = {**orders, **periods}
    return keyed_part({key: Trials(measure, (case,), runs) for key, case in cases.items()}, build)
