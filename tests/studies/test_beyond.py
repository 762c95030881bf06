"""The thesis's future work: the cases of each part, and the facts stated in its text."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.integrate import quad

from flightbed.analysis.seeds import fly_jobs
from flightbed.document.document import Section, Table
from flightbed.studies.base import Part
from flightbed.studies.sillence import aircraft, damage, examples, inputs, level, variants
from flightbed.studies.sillence.study import parts


def _built(part: Part) -> Section:
    return part.build(fly_jobs(part.jobs))


def _tables(section: Section) -> dict[str, Table]:
    return {item.key: item for item in section.items if isinstance(item, Table)}


def test_the_study_has_every_letter_of_the_future_work_and_every_key_once() -> None:
    letters = [
        aircraft.experiment,
        inputs.excitation,
        damage.structural,
        damage.disturbances,
        aircraft.ensembles,
        level.real_time,
        level.level,
    ]
    assert len(parts(1)) == 7 + len(letters)
    assert max(job.runs for job in parts(100)[11].jobs) == 500


def test_sine_tests_identify_known_parameters() -> None:
    tested = examples.sine_tests()
    assert len(tested) == 6
    for name, known, found in tested:
        assert found == pytest.approx(known, rel=1e-9), name


def test_weighting_by_the_noise_reduces_bias_and_scatter() -> None:
    plain, weighted = examples.regressions(200, seed=4)
    truth = np.array([0.9, 0.5])
    sigma_of_mean = weighted.std(axis=0) / np.sqrt(200)
    assert np.all(np.abs(weighted.mean(axis=0) - truth) < 6.0 * sigma_of_mean + 2e-3)
    assert np.all(np.abs(plain.mean(axis=0) - truth) > 10.0 * np.abs(weighted.mean(axis=0) - truth))
    assert np.all(weighted.std(axis=0) < 0.7 * plain.std(axis=0))


def test_recursion_and_regression_agree_on_a_flight() -> None:
    table = _tables(_built(examples.examples(3)))["batch"]
    for _, recursive, batch, difference, sigma in table.rows:
        assert difference == abs(recursive - batch) < 1e-12
        assert abs(recursive - 0.4) < 4.0 * sigma


@pytest.mark.parametrize(("plant", "name"), list(product(inputs.PLANTS, inputs.INPUTS)))
def test_inputs_have_the_same_energy(plant: str, name: str) -> None:
    if name == "none":
        assert inputs.amplitude(plant, name) == 0.0
        return
    scenario = inputs.flight(plant, name, inputs.WINDOW)
    command = scenario.command.rate()
    found, _ = quad(lambda t: float(np.degrees(command(np.array([t]))[0])) ** 2, 0.0, 16.5, limit=2000, epsabs=1.0)
    assert found == pytest.approx(
        13.5 * inputs.PLANTS[plant] ** 2, rel=0.01
    )  # sampled at 100 Hz here, continuous there


def test_inputs_table_against_its_flights() -> None:
    """On the linear model the filter is consistent and efficient: sigma equals the bound; broadband inputs are better in a window."""
    part = inputs.excitation(2)
    linear = Part([job for job in part.jobs if job.scenario.aircraft.model == "sillence"], part.build)
    assert len(linear.jobs) == 14
    flights = fly_jobs(linear.jobs)
    table = _tables(part.build([*flights, *flights]))["inputs_linear"]
    rows = {row[0]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    for name, row in rows.items():
        if name != "none":  # without a command the prior matters
            assert row["sigma, all data"] == pytest.approx(row["bound, all data"], rel=0.02)
    assert rows["multisine"]["sigma, window"].median < 0.6 * rows["doublet"]["sigma, window"].median
    assert rows["step"]["bound, all data"] < rows["multisine"]["bound, all data"]


def _median(table: Table, case: str, column: str) -> float:
    (row,) = [r for r in table.rows if r[0] == case]
    return float(row[table.columns.index(column)].median)


def test_damage_section() -> None:
    section = _built(damage.structural(1))
    table = _tables(section)["structural_f16"]
    error = "median error of K-hat"
    for force in (100, 20, 0):  # a rotation of b hardly changes the estimate of the moment
        assert _median(table, f"moment 20%, force {force}%", error) < 0.01
    assert _median(table, "intact, c.g. 5 % aft", error) > 0.1  # an effect that no K describes
    assert len(_tables(section)["structural_linear"].rows) == 12


def test_disturbances_section() -> None:
    tables = _tables(_built(damage.disturbances(2)))
    rows = {(r[0], r[1]): r for r in tables["process_noise"].rows}
    strong = "5 deg/s, 30 deg/s^2"
    assert rows[strong, "window"][4].median > 50.0  # NEES of a filter without process noise
    assert 0.5 < rows[strong, damage.MATCHED][4].median < 2.0
    assert len(tables["storms"].rows) == 5


def test_aircraft_section() -> None:
    tables = _tables(_built(aircraft.experiment(1)))
    tracking, estimates = tables["aircraft_tracking"], tables["aircraft_estimates"]
    assert len(tracking.rows) == len(estimates.rows) == 18
    scheduled, window = (estimates.columns.index(f"median error, {n}") for n in ("scheduled", "thesis's window"))
    for row in estimates.rows:
        assert row[scheduled].median < 0.03 < row[window].median, row[:2]
    stays = {
        (row[0], row[1], law): cell.gone_s.missing == 1
        for row in tracking.rows
        for law, cell in zip(aircraft.ADAPTED, row[2:], strict=True)
    }
    his, flyable = "Mach 0.9, +-10 deg/s, P", "Mach 0.8, +-5 deg/s, P"
    assert not any(stays[his, k, law] for k in aircraft.GAINS for law in ("fixed", "scheduled", aircraft.ORACLE))
    assert [stays[his, k, "thesis's window"] for k in aircraft.GAINS] == [True] * 4 + [False] * 2
    assert [stays[flyable, k, "fixed"] for k in aircraft.GAINS] == [True] * 4 + [False] * 2
    assert [stays[flyable, k, "scheduled"] for k in aircraft.GAINS] == [True] * 5 + [False]
    assert not stays[flyable, 0.1, aircraft.ORACLE]
    assert stays[flyable, 0.1, "thesis's window"]
    assert stays[flyable.replace("P", "PI"), 0.1, "scheduled"]


def test_variants_section() -> None:
    table = _tables(_built(variants.grid(1)))["variants"]
    assert len(table.rows) == 2 * 5 * 4
    rows = {tuple(row[:4]): row[4:] for row in table.rows}
    for (law, snr, bounds, smoothing), values in rows.items():
        fixed, adapted, error, _, entry = (value.median for value in values)
        assert adapted < 0.2 * fixed
        assert fixed == pytest.approx(rows["P", snr, bounds, smoothing][0].median, rel=1e-3)  # P or PI
        if smoothing == 0.7:
            slower = rows[law, snr, bounds, 0.9]
            assert entry < slower[4].median - 0.1
            assert adapted < slower[1].median
            assert (error > slower[2].median) == (float(snr) < 50.0)


def test_histories_section() -> None:
    section = _built(aircraft.ensembles(3))
    assert [item.key for item in section.items] == ["history-linear-3", "history-f-16-3"]
    assert "none of 3 departed" in section.items[0].parameters


def test_level_section() -> None:
    table = _tables(_built(level.level(1)))["level"]
    error = table.columns.index("median error of K-hat")
    found = {(row[0], row[1]): row[error].median for row in table.rows}
    scheduled = "scheduled, absolute"
    assert found["normal c.g., no dither", scheduled] < 0.01  # the lost trim moment shows K
    assert found["no elevator at trim, no dither", scheduled] > 0.1
    assert found["no elevator at trim, dither 0.5 deg/s", scheduled] < 0.05


def test_real_time_section() -> None:
    table = _tables(level.real_time("nominal", ("duration_s=0.5",)).build([]))["real_time"]
    values = {row[0]: row[1] for row in table.rows}
    assert values["ticks"] == 50.0
    assert values["achieved, Hz"] == pytest.approx(100.0, rel=0.2)  # a busy machine may be late, not fast
