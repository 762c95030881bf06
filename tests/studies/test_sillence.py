"""Sillence (1999): Tables 1 to 5 against the print, the search over set-ups, the claims with their intervals, every figure."""

from __future__ import annotations

import re
import tomllib
from math import log10
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from flightbed.analysis.result import fly_plan
from flightbed.analysis.seeds import fly_jobs
from flightbed.document.document import Claim, Picture, Table
from flightbed.flight.plan import plan
from flightbed.studies.sillence import printed, setup, tables
from flightbed.studies.sillence.claims import NEAR, REMOVED, SIGNIFICANT, claims
from flightbed.studies.sillence.setup import EXPANDING, WINDOW
from tests.studies.conftest import MANY, Flights

GOLDEN = tomllib.loads((Path(__file__).parents[1] / "golden" / "sillence.toml").read_text())
CONTRARY = {
    "adaptive_near_unfailed_position_window", "adaptive_near_unfailed_position_readings", "bounded_significant_0.2", "bounded_significant_0.1",
    "hump_removed_0.2", "hump_removed_0.1", "two_sigma",
}  # fmt: skip
# Too close to the limit for a verdict with 60 draws; the tests check the distance from the limit.
SLIGHT = {"better_after_0.8", "bounded_0.1_post"} | {
    f"adaptation_costs_excitation_{feedback}_{fed}" for feedback, fed in setup.LAWS_READ
}


def test_printed_numbers_agree_with_the_golden_file() -> None:
    assert [[q, alpha, float(snr)] for q, alpha, snr in printed.TABLE_1] == GOLDEN["table_1"]["rows"]
    assert [[k, *row] for k, row in printed.TABLE_4.items()] == GOLDEN["table_4"]["rows"]
    assert [[k, *row] for k, row in printed.TABLE_5.items()] == GOLDEN["table_5"]["rows"]


def test_tables_1_to_3_come_out_with_all_digits() -> None:
    found = [tables.table_1(), *tables.eigenvalue_tables()]
    assert [len(table.rows) for table in found] == [5, 11, 9]
    assert all(row[-1] == "yes" for table in found for row in table.rows)


def test_table_1_by_hand() -> None:
    """Eq (82) written out: half the ratio of |x|^2 with w^2 on pitch rate, w^2 = 1 / |p1 p2| of the printed poles."""
    w2 = 1.0 / (0.6737 * 0.30691)
    for q_std, alpha_std, wanted in printed.TABLE_1:
        ratio = (6.0**2 + w2 * 11.144**2) / (2.0 * (alpha_std**2 + w2 * q_std**2))
        assert format(10.0 * log10(ratio), f".{len(wanted.partition('.')[2])}f") == wanted


@pytest.mark.parametrize(
    ("value", "text", "same"), [(0.12345, "0.1235", True), (0.12344, "0.1235", False), (-2.5, "-2", True), (1.0, "1.000", True), (1.0006, "1.000", False)]
)  # fmt: skip
def test_same_digits(value: float, text: str, same: bool) -> None:
    assert tables.same_digits(value, text) == same


@pytest.mark.parametrize("left", printed.GAINS_LEFT)
def test_table_4_finals(flown: Flights, left: float) -> None:
    finals = [f.metrics.estimators[EXPANDING].final for f in flown.by_gain[left]]
    assert len(finals) == flown.runs
    assert abs(np.median(np.array(finals, dtype=float)) - printed.TABLE_4[left][0]) <= 0.01


@pytest.mark.parametrize("column", [0, 1])
def test_table_5_entries(flown: Flights, column: int) -> None:
    metric = ("first_within_20pct_s", "first_within_20pct_smoothed_s")[column]
    medians = [
        float(np.median([getattr(f.metrics.estimators[WINDOW], metric) for f in flown.by_gain[left]]))
        for left in printed.GAINS_LEFT
    ]
    for left, median in zip(printed.GAINS_LEFT, medians, strict=True):
        assert abs(median - printed.TABLE_5[left][column]) <= 0.08, left
    assert np.all(np.diff(medians) > 0.0), medians  # the larger the failure, the later


def test_the_glance_says_the_same(flown: Flights) -> None:
    (table,) = flown.glance.items
    assert isinstance(table, Table)
    assert len(table.rows) == 3 + 15
    assert all(row[-1] == "yes" for row in table.rows)


def test_the_default_set_up_is_indistinguishable_from_the_nearest(flown: Flights) -> None:
    (table,) = flown.search.items
    assert isinstance(table, Table)
    default, found = setup.DEFAULT, table.rows[1:]
    assert table.rows[0][0] == "print"
    distances = [row[4] for row in found]
    assert distances == sorted(distances)
    assert len(found) == len({tuple(row[:4]) for row in found}) == 4 * 3 * 2 + 3 * 2
    (own,) = [
        row
        for row in found
        if list(row[:4]) == [default.input_at, default.start_s, default.first_reading, default.fed_back]
    ]
    assert own[5].low <= 0.0
    readings = [row for row in found if row[3] == "readings"]
    assert own is readings[0]  # nearest of the set-ups with the readings fed back, as in the text of the thesis
    far = {row[0]: row for row in readings if row[1] == 0.0 and row[2] == default.first_reading and row is not own}
    assert all(row[5].low > 0.0 for row in far.values())  # the data identify the deflection u_k


def test_distance_is_one_at_the_tolerance() -> None:
    final = [printed.TABLE_4[k][0] + 0.01 for k in printed.GAINS_LEFT]
    entries = [printed.TABLE_5[k][i] - 0.08 for i in (0, 1) for k in printed.GAINS_LEFT]
    off = setup.distances(np.array(final + entries))
    assert off == pytest.approx([1.0] * 5 + [-1.0] * 10)
    assert setup.distances(np.array([final + entries] * 2).T) == pytest.approx(np.array([off, off]).T)


def test_the_initial_value_of_the_smoother_has_no_effect() -> None:
    """Eq (85) by scipy's filter, from 1 as here and from 0: the difference has vanished at the failure."""
    trace, _ = fly_plan(plan(setup.thesis(left=0.2)))
    raw, smoothed = trace[f"{WINDOW}.effectiveness"], trace[f"{WINDOW}.effectiveness_smoothed"]
    started = [lfilter([0.1], [1.0, -0.9], raw, zi=[0.9 * start])[0] for start in (1.0, 0.0)]
    assert started[0] == pytest.approx(smoothed, abs=1e-12)
    failed = trace["t_s"] >= printed.FAILED_AT_S
    assert np.max(np.abs(started[0] - started[1])[failed]) < 1e-15
    assert np.max(np.abs(started[0] - started[1])) > 0.5


def _claims(flown: Flights) -> dict[str, Claim]:
    return {item.key: item for item in flown.claims.items if isinstance(item, Claim)}


def _bounds(flown: Flights, key: str) -> tuple[float, float]:
    """Return the interval of a claim; with few draws, whose interval is wide, the estimate twice."""
    interval = _claims(flown)[key].interval
    return (interval.low, interval.high) if flown.runs == MANY[0] else (interval.estimate, interval.estimate)


def test_which_claims_hold(flown: Flights) -> None:
    """All claims of the thesis hold except those that docs/sillence.md lists."""
    judged = _claims(flown)
    assert {key for key, claim in judged.items() if claim.holds is not True} - SLIGHT == CONTRARY
    assert all(judged[key].holds is False for key in CONTRARY)
    assert all(claim.interval.low <= claim.interval.estimate <= claim.interval.high for claim in judged.values())
    assert SLIGHT | CONTRARY < judged.keys()


@pytest.mark.parametrize("left", printed.GAINS_LEFT)
@pytest.mark.parametrize("kind", ["raw", "smoothed"])
def test_the_window_is_quicker_than_the_expanding_horizon(flown: Flights, left: float, kind: str) -> None:
    assert _claims(flown)[f"window_quicker_{left:g}_{kind}"].interval.high < -0.5


@pytest.mark.parametrize("left", printed.GAINS_LEFT[1:])
def test_a_larger_failure_is_estimated_better_after_than_before(flown: Flights, left: float) -> None:
    claims = _claims(flown)
    assert claims[f"better_after_{left:g}"].interval.high < 0.0
    assert claims[f"larger_better_{left:g}"].interval.high < 0.0


def test_a_small_failure_is_estimated_equally_before_and_after(flown: Flights) -> None:
    low, high = _bounds(flown, "better_after_0.8")
    assert -0.02 < low <= high < 0.01


@pytest.mark.parametrize(("feedback", "fed"), setup.LAWS_READ)
def test_adaptation_hardly_costs_excitation(flown: Flights, feedback: str, fed: str) -> None:
    """The thesis reports a significant reduction of estimation performance; the RMS error of 0.02 changes by a tenth."""
    low, high = _bounds(flown, f"adaptation_costs_excitation_{feedback}_{fed}")
    assert -0.005 < low <= high < 0.005


def test_bounds_help_tracking_at_23_db_but_hardly(flown: Flights) -> None:
    claims = _claims(flown)
    for key in ("bounded_0.2_pre", "bounded_0.2_post"):
        assert -0.02 < claims[key].interval.low < claims[key].interval.high < 0.0
    assert -0.005 < claims["bounded_0.1_post"].interval.estimate < 0.0
    for left in ("0.2", "0.1"):
        assert claims[f"bounded_significant_{left}"].interval.high < 0.2 * SIGNIFICANT
        assert claims[f"hump_removed_{left}"].interval.high < 0.02 * REMOVED


@pytest.mark.parametrize("fed", [WINDOW, "readings"])
def test_adaptive_tracking_is_near_the_unfailed_one_in_one_reading_of_the_law(flown: Flights, fed: str) -> None:
    claims = _claims(flown)
    assert claims[f"adaptive_near_unfailed_effective_{fed}"].interval.low > 0.97
    assert 0.6 < claims[f"adaptive_near_unfailed_position_{fed}"].interval.high < 0.75 < NEAR


def test_two_sigma_are_consistent_with_the_mean_deflection_only(flown: Flights) -> None:
    (table,) = [item for item in flown.claims.items if isinstance(item, Table) and item.key == "coverage"]
    his, readings = (
        {at.removeprefix("u_k: "): cell for at, cell in zip(table.columns[1:], row[1:], strict=True)}
        for row in table.rows
    )
    for row in (his, readings):
        # Windows of 30 samples overlap; about 50 of a flight do not: its share scatters by 0.03, the median of 60 flights by 0.005.
        assert row["mean"].estimate == pytest.approx(0.9545, abs=0.015)
        assert row["start"].high < 0.9
        assert row["end"].high < 0.9
    assert abs(his["end"].estimate - readings["end"].estimate) < 0.05  # the prior has little effect
    assert _claims(flown)["two_sigma"].interval == his["end"]


def test_too_few_draws_settle_nothing() -> None:
    part = claims(2)
    section = part.build(fly_jobs(part.jobs))
    assert {item.holds for item in section.items if isinstance(item, Claim)} == {None}


def test_every_figure_is_there_and_shows_something(flown: Flights) -> None:
    pictures = [item for item in flown.figures.items if isinstance(item, Picture)]
    numbers = [int(picture.key.partition("-")[2]) for picture in pictures]
    assert numbers == [*range(3, 13), *range(14, 48)]
    for picture in pictures:
        assert picture.title.startswith(f"Figure {picture.key.partition('-')[2]}: ")
        assert picture.parameters
        assert re.search(r"\d", picture.facts), picture.key
        assert "nan" not in picture.facts
        assert picture.svg.count("<path") > 5


def test_a_held_step_is_late_by_half_a_period(flown: Flights) -> None:
    (figure,) = [item for item in flown.figures.items if isinstance(item, Picture) and item.key == "figure-11"]
    assert float(re.search(r"is ([\d.]+) ms;", figure.facts)[1]) == pytest.approx(
        50.0, abs=2.5
    )  # T/2; the next term of exp(-3 t) is 3 T^2 / 12


def test_alpha_feedback_improves_tracking(flown: Flights) -> None:
    """Figures 3 to 6: without alpha feedback the pitch rate tracks worse, with both laws."""
    words = {item.key: item.facts for item in flown.figures.items if isinstance(item, Picture)}
    rms = {n: float(re.search(r"([\d.]+) deg/s", words[f"figure-{n}"])[1]) for n in (3, 4, 5, 6)}
    assert rms[3] > 1.5 * rms[4]
    assert rms[5] > 1.5 * rms[6]
