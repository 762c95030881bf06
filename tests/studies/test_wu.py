"""Wu, Zhang and Zhou (2000): examples, claims with intervals, distribution of the test statistic, margins, figures, the folder."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from flightbed.config import families
from flightbed.control.lq import spectral_radius
from flightbed.document.document import Claim, Picture, Section, Table
from flightbed.estimation.two_stage.change_test import (
    calibrated_threshold,
    chi_square_threshold,
    correlated_threshold,
    effective_degrees,
)
from flightbed.estimation.two_stage.filter import VariableForgetting
from flightbed.studies.base import Part, distinct_jobs, reproduce, run_trials
from flightbed.studies.wu import choices, detection, figures, measures, printed, tables
from flightbed.studies.wu.claims import claims
from flightbed.studies.wu.simulate import (
    CONSTANT,
    FLOOR,
    FORGETTING,
    LEFT,
    NONE,
    PERIOD_S,
    VARIABLE,
    Law,
    aircraft,
    effectiveness,
    model,
    simulate,
    unstable,
)

FEW, MANY = (12, 40), (50, 100)  # noise draws of each case and without failure, seeds from 0 on
CONTRARY = {
    "small_until_failure", "chi_square_fixed", "zero_mean_fixed", "recovered_alpha_redesigned", "recovered_alpha_offset",
    "more_indicative_redesigned", "more_indicative_ever_redesigned", "more_indicative_ever_offset",
    "more_accurate_redesigned", "more_accurate_offset",
}  # fmt: skip
OPEN = {
    "chi_square_open",
    "zero_mean_open",
    "raised_after_failure",
}  # too close to their limits for a verdict with these draws
OPEN_IF_FEW = {"small_until_failure", "recovered_alpha_redesigned"}


def _built(part: Part) -> Section:
    jobs: list[Any] = distinct_jobs([part])
    found = run_trials(jobs, executor=None, progress=lambda _: None)
    by_job = dict(zip(((j.simulate, j.arguments, j.first_seed) for j in jobs), found, strict=True))
    each: list[Any] = list(part.jobs)
    return part.build([by_job[j.simulate, j.arguments, j.first_seed][: j.runs] for j in each])


@pytest.fixture(scope="module", params=[FEW, pytest.param(MANY, marks=pytest.mark.long)], ids=["few", "many"])
def draws(request: pytest.FixtureRequest) -> tuple[int, int]:
    found: tuple[int, int] = request.param
    return found


@pytest.fixture(scope="module")
def judged(draws: tuple[int, int]) -> dict[str, Claim]:
    return {c.key: c for c in _built(claims(*draws)).items if isinstance(c, Claim)}


@pytest.mark.parametrize("scenario", printed.SCENARIOS)
def test_variable_factors_beat_the_constant_one_and_that_beats_none(
    judged: dict[str, Claim], draws: tuple[int, int], scenario: int
) -> None:
    for order in ("constant_better_than_none", "variable_better_than_constant", "variable_better_than_none"):
        claim = judged[f"{order}_{scenario}"]
        assert claim.holds is True
        assert claim.interval.high < 0.0
        assert claim.interval.runs == draws[0]


def test_the_ramp_is_followed(judged: dict[str, Claim]) -> None:
    claim = judged["ramp_followed"]
    assert claim.holds is True
    assert claim.interval.high < 0.05  # the ramp falls by 0.4


def test_without_redesign_example_2_departs_and_with_it_settles(judged: dict[str, Claim]) -> None:
    assert judged["unstable_without"].interval.low > 1000.0
    assert judged["settled_with_redesigned"].interval.high < 2.0
    assert judged["settled_with_offset"].interval.high < 1.3


def test_adaptation_raises_d_with_offset_weights_and_lowers_it_without(judged: dict[str, Claim]) -> None:
    assert judged["more_indicative_offset"].interval.low > 0.0
    assert judged["more_indicative_redesigned"].interval.high < 0.0


def test_verdicts_agree_with_the_document(judged: dict[str, Claim], draws: tuple[int, int]) -> None:
    assert len(judged) == 35
    settled = CONTRARY if draws == MANY else CONTRARY - OPEN_IF_FEW
    assert {key for key, claim in judged.items() if claim.holds is False} >= settled
    assert {key for key, claim in judged.items() if claim.holds is not True} <= CONTRARY | OPEN


def test_the_scenarios_are_those_of_table_1() -> None:
    """Per cent of each input at the times of the table's columns."""
    wanted = {
        1: [(100, 100), (25, 100), (25, 100), (25, 100)],
        2: [(100, 100), (50, 100), (0, 100), (0, 100)],
        3: [(100, 100), (50, 100), (50, 100), (50, 50)],
        4: [(100, 100), (50, 100), (10, 100), (10, 50)],
        5: [(100, 100), (50, 100), (10, 100), (10, 50)],
    }
    for scenario, rows in wanted.items():
        K = effectiveness(aircraft(scenario))
        assert len(K) == round(printed.DURATION_S / PERIOD_S)
        for at_s, row in zip((0.0, 5.1, 10.1, 12.6), rows, strict=True):
            np.testing.assert_allclose(100.0 * K[round(at_s / PERIOD_S)], row, atol=1e-9)
        np.testing.assert_array_equal(K[50], 1.0)  # the last sample before the first change
    ramp = effectiveness(aircraft(5))[51:102, 0]
    np.testing.assert_allclose(ramp, np.linspace(0.5, 0.1, 51), rtol=1e-12)


def test_the_matrices_are_of_differential_equations() -> None:
    for example, (most, count) in {1: (-0.04, 0), 2: (1.8, 1)}.items():
        poles = np.linalg.eigvals(np.array(printed.EXAMPLES[example].A))
        assert np.max(poles.real) < most
        assert np.sum(poles.real > 0.0) == count
        np.testing.assert_allclose(
            np.sort_complex(np.linalg.eigvals(model(example).A)), np.sort_complex(np.exp(poles * PERIOD_S)), rtol=1e-9
        )


def test_a_run_satisfies_the_equation_of_the_plant(rng: np.random.Generator) -> None:
    """The recorded states, inputs and K satisfy the plant's equation up to the process noise."""
    case = aircraft(4, law=Law.OFFSET)
    run, again = simulate(3, case), simulate(3, case)
    np.testing.assert_array_equal(run.estimate, again.estimate)
    A, B, *_ = model(1)
    states = np.vstack([printed.AIRCRAFT.x0, run.state])
    noise = states[1:] - states[:-1] @ A.T - (run.effectiveness * run.inputs) @ B.T
    assert np.std(noise) == pytest.approx(printed.PROCESS_STD, rel=0.1)
    assert run.redesigns > 0
    np.testing.assert_allclose(
        run.statistic[5], np.mean(((run.estimate - 1.0) / run.deviation)[3:6] ** 2, axis=0), rtol=1e-12
    )


def test_the_noise_is_the_same_in_all_cases() -> None:
    one, other = simulate(0, aircraft(1, NONE)), simulate(0, aircraft(1, VARIABLE, Law.OPEN))
    A, B, *_ = model(1)
    noises = []
    for run in (one, other):
        states = np.vstack([printed.AIRCRAFT.x0, run.state])
        noises.append(states[1:] - states[:-1] @ A.T - (run.effectiveness * run.inputs) @ B.T)
    np.testing.assert_allclose(noises[0], noises[1], atol=1e-9)


def test_measures_by_hand() -> None:
    case = unstable(LEFT)
    run = simulate(1, case)
    found = measures.run_measures(run, case)
    after = run.t_s > printed.FAILED_AT_S + 1e-9
    error = run.estimate - run.effectiveness
    assert found.error == pytest.approx(np.sqrt(np.mean(error[after] ** 2)), rel=1e-12)
    assert found.late == pytest.approx(np.sqrt(np.mean(run.state[-50:, [0, 2]] ** 2)), rel=1e-12)
    first = run.t_s[np.argmax(after & (run.statistic[:, 0] > 5.0))] - printed.FAILED_AT_S
    assert measures.delay_s(found, 5.0, PERIOD_S) == pytest.approx(first, abs=1e-9)
    near = run.t_s[np.argmax(after & (np.max(np.abs(error), axis=1) < 0.2))] - printed.FAILED_AT_S
    assert measures.time_to_within_s(found, 0.2, PERIOD_S) == pytest.approx(near, abs=1e-9)
    assert measures.delay_s(found, 1e9, PERIOD_S) == np.inf
    whole = measures.run_measures(simulate(1, unstable(None)), unstable(None))
    assert np.isnan(whole.error)
    assert whole.failed == len(run.t_s)


def test_in_open_loop_d_has_one_degree_of_freedom_not_three() -> None:
    """300 runs without forgetting: the effective degrees give the nominal rate, the three degrees of the print do not."""
    runs = [measures.quiet_run(seed, aircraft(None, NONE, Law.OPEN)) for seed in range(300)]
    degrees = effective_degrees(measures.autocorrelation(runs), printed.WINDOW)
    assert 1.0 <= degrees < 1.1
    last = np.array([run.statistic[-1] for run in runs])
    assert 5 <= np.sum(last > correlated_threshold(degrees, 0.05)) <= 29  # binomial (300, 0.05), 0.1 % to 99.9 %
    assert (
        np.sum(last > chi_square_threshold(printed.WINDOW, 0.05)) > 21
    )  # under the print's distribution the 99 % point is 24, the median 15
    assert abs(np.mean([run.last for run in runs])) < 3.3 / np.sqrt(300)


def test_feedback_of_the_estimates_causes_the_mean_of_gamma() -> None:
    """The mean vanishes in open loop."""
    closed, opened = (
        np.array([measures.quiet_run(seed, aircraft(None, VARIABLE, law)).last for seed in range(40)])
        for law in (Law.FIXED, Law.OPEN)
    )
    assert np.mean(closed) > 1.0
    assert abs(np.mean(opened)) < 3.3 * np.std(opened) / np.sqrt(40)


def test_a_calibrated_threshold_holds_on_fresh_runs() -> None:
    case = aircraft(None, CONSTANT)
    first, fresh = (np.array([measures.quiet_run(s, case).largest for s in range(k, k + 100)]) for k in (0, 100))
    found = calibrated_threshold(first, 0.1)
    assert found.low < found.threshold < found.high
    assert 2 <= np.sum(fresh > found.threshold) <= 25  # nominally 10 of 100, with a threshold estimated from 100 runs


def test_the_margins_of_example_2_are_where_its_loop_loses_stability() -> None:
    A, B, *_ = model(2)
    F = tables.gain(2, np.ones(2), Law.FIXED)
    part = tables.margins(2)
    table = next(item for item in _built(part).items if isinstance(item, Table) and item.key == "margins")
    row = next(r for r in table.rows if r[0] == 2 and r[2] == "healthy")
    alone = row[-1]
    assert isinstance(alone, float)
    for factor, stable in ((0.999, True), (1.001, False)):
        K = np.array([1.0 - factor * alone, 1.0])
        assert (spectral_radius(A - B @ (K[:, None] * F)) < 1.0) is stable
    assert tables.closed_loop_radius(LEFT, Law.OFFSET) == pytest.approx(
        tables.closed_loop_radius(1.0, Law.FIXED), rel=1e-9
    )
    assert LEFT < 1.0 - alone < 0.3
    assert FLOOR < LEFT


def test_the_parts_with_few_draws() -> None:
    """Tables have all their rows with two draws."""
    law = _built(detection.law(2, 2))
    by_key = {item.key: item for item in law.items if isinstance(item, Table)}
    assert [len(by_key[k].rows) for k in ("law_of_test", "thresholds")] == [12, 9]
    example_2 = next(item for item in _built(tables.example_2(2)).items if isinstance(item, Table))
    assert len(example_2.rows) == len(tables.LEFT_VALUES) * len(tables.LAWS) + 1
    accuracy = [item for item in _built(tables.accuracy(2)).items if isinstance(item, Table)]
    assert [len(table.rows) for table in accuracy] == [5, 15]


def test_choices_change_one_thing_each() -> None:
    variants = choices.variants()
    ours, filters = variants.pop("ours")
    assert filters == FORGETTING
    for name, (case, others) in variants.items():
        changed = [f for f in vars(ours) if getattr(case, f) != getattr(ours, f)]
        swapped = [f for f in filters if others[f] != filters[f]]
        assert len(changed) + len(swapped) == 1 or "per second" in name, name
    scaled = variants["period 0.02 s, forgetting per second"][1]
    assert scaled["constant"].factor ** (PERIOD_S / 0.02) == pytest.approx(CONSTANT.factor)  # type: ignore[union-attr]
    assert isinstance(scaled["variable"], VariableForgetting)
    assert scaled["variable"].variance_min == pytest.approx(0.2 * VARIABLE.variance_min)


def test_the_choices_table_counts_orders() -> None:
    part = choices.choices(1)
    jobs: list[Any] = list(part.jobs)
    error = {"none": 3.0, "constant": 2.0, "variable": 1.0}
    names = {repr(f): which for which, f in FORGETTING.items()}

    def fake(which: str) -> Any:
        empty = np.zeros(2)
        return measures.RunMeasures(0.0, error[which], empty, empty, np.nan, 0.0, 0.0, 0.0, empty, empty, 0, 0.0)

    results = [[fake(names.get(repr(j.arguments[0].forgetting), "constant"))] * 12 for j in jobs]
    table = next(item for item in part.build(results).items if isinstance(item, Table))
    ours = next(row for row in table.rows if row[0] == "ours")
    assert list(ours) == ["ours", 3.0, 2.0, 1.0, "5, opposite 0", "5, opposite 0", "5, opposite 0"]


def test_figures_2_to_8_are_drawn_from_their_runs() -> None:
    pictures = [item for item in _built(figures.figures()).items if isinstance(item, Picture)]
    assert [picture.key for picture in pictures] == [f"figure-{n}" for n in range(2, 9)]
    for picture in pictures:
        assert picture.svg.startswith("<svg")
        assert "nan" not in picture.facts
    run = simulate(0, unstable(LEFT))
    late = np.sqrt(np.mean(run.state[run.t_s > 15.0][:, [0, 2]] ** 2))
    assert f"fixed {late:.3g}" in pictures[3].facts


def test_the_study_is_registered_and_its_numbers_do_not_depend_on_the_executor() -> None:
    study = families.factory("studies", "wu")()
    assert study.name == "wu"
    small = type(study)(study.name, study.title, 1, lambda runs: [tables.accuracy(runs)])
    with ThreadPoolExecutor(2) as threads:
        pooled = reproduce(small, 2, executor=threads).to_dict()
    assert pooled["tables"] == reproduce(small, 2).to_dict()["tables"]
    assert pooled["again"] == "flightbed reproduce wu --runs 2"
