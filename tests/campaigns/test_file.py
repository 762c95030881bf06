"""Campaign files: flights follow the file; all problems at once; seeds and draws depend only on campaign seed, index and key."""

from __future__ import annotations

import shlex
import tomllib
from pathlib import Path

import numpy as np
import pytest

from flightbed.aircraft.overlay import Aircraft
from flightbed.campaigns.file import load_programme, plain
from flightbed.campaigns.plan import Programme, draw, flight_hash, scenario_of, values_of
from flightbed.campaigns.settings import AxisSettings, CampaignSettings
from flightbed.core import data
from flightbed.core.errors import AircraftError, InputError, ScenarioError, UnknownNameError
from flightbed.scenario.reading import load_scenario
from flightbed.statistics.intervals import share
from tests.lateral_flight import rolling

HEAD = 'schema = 1\nname = "mine"\nbase = "elevator-loss"\nruns = 3\nseed = 11\n'
MACH = '[[axes]]\nkey = "condition.mach"\nvalues = [0.7, 0.8]\n'
K = '[[axes]]\nkey = "failures.0.to"\nfrom = 0.2\nto = 0.6\ncount = 3\n'
DRAWN = '[[axes]]\nkey = "model_error.cm_q"\ndistribution = "normal"\nmean = 1.0\nstd = 0.1\nlow = 0.9\nhigh = 1.3\n'


def _load(tmp_path: Path, text: str, overrides: list[str] | None = None, runs: int | None = None) -> Programme:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return load_programme(path, overrides or [], runs)


@pytest.mark.parametrize("name", list(data.names("campaign")))
def test_shipped_campaigns_load(name: str) -> None:
    programme = load_programme(name)
    assert programme.name == name
    assert programme.description
    assert 100 <= len(programme) <= 500
    assert len({programme.flight(i).seed for i in range(len(programme))}) == len(programme)


def test_which_campaigns_are_shipped() -> None:
    assert set(data.names("campaign")) == {"effectiveness-grid", "noise", "turbulence", "model-error", "false-alarms"}
    assert not set(data.names("campaign")) & set(data.names("scenario"))


def test_crossed_axes_give_every_combination_the_last_fastest(tmp_path: Path) -> None:
    programme = _load(tmp_path, HEAD + MACH + K)
    points = [tuple(p.values()) for p in programme.points]
    assert points == [(0.7, 0.2), (0.7, 0.4), (0.7, 0.6), (0.8, 0.2), (0.8, 0.4), (0.8, 0.6)]
    assert len(programme) == 18
    flight = programme.flight(13)
    assert (flight.index, flight.point) == (13, 4)
    scenario = scenario_of(programme.raw, flight)
    assert (scenario.condition.mach, scenario.failures[0].to, scenario.seed) == (0.8, 0.4, flight.seed)


@pytest.mark.parametrize("kind", ["campaign", "scenario"])
def test_a_base_bound_to_an_equal_aircraft_is_bound_to_the_one_that_flies(
    tmp_path: Path, kind: str, f16: Aircraft
) -> None:
    earlier = f16.equal_to[0]

    def load(sha256: str) -> Programme:
        sets = [f"aircraft.sha256='{sha256}'"]
        return _load(tmp_path, HEAD + MACH, sets) if kind == "campaign" else plain(load_scenario("nominal", sets), 3)

    programme = load(earlier)
    assert programme.raw["aircraft"]["sha256"] == programme.scenario.aircraft.sha256 == f16.sha256
    assert [note.partition(":")[0] for note in programme.notes] == ["aircraft.sha256"]
    bound = load(f16.sha256)
    assert bound.notes == ()
    assert (bound.raw["aircraft"], bound.aircraft) == (programme.raw["aircraft"], programme.aircraft)
    with pytest.raises(AircraftError, match="is not the aircraft of this scenario"):
        load("0" * 64)


def test_paired_axes_go_together(tmp_path: Path) -> None:
    programme = _load(tmp_path, HEAD + 'combine = "paired"\n' + MACH + K.replace("count = 3", "count = 2"))
    assert [tuple(p.values()) for p in programme.points] == [(0.7, 0.2), (0.8, 0.6)]


def test_ranges() -> None:
    axis = {"key": "x", "from": 0, "to": 1, "count": 11}
    assert values_of(AxisSettings.model_validate(axis)) == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    whole = values_of(AxisSettings.model_validate({**axis, "to": 20}))
    assert whole == list(range(0, 21, 2))
    assert {type(v) for v in whole} == {int}


def test_a_seed_comes_from_the_campaigns_and_the_index_alone(tmp_path: Path) -> None:
    few, many = _load(tmp_path, HEAD + MACH), _load(tmp_path, HEAD + MACH + DRAWN, runs=50)
    assert [few.flight(i).seed for i in range(6)] == [many.flight(i).seed for i in range(6)]
    state = np.random.SeedSequence(11, spawn_key=(4,)).generate_state(1, np.uint64)
    assert few.flight(4).seed == int(state[0]) // 2**11 < 2**53
    assert _load(tmp_path, HEAD.replace("11", "12") + MACH).flight(4).seed != few.flight(4).seed


def test_a_drawn_value_depends_on_its_key_and_not_on_other_axes(tmp_path: Path) -> None:
    uniform = '[[axes]]\nkey = "model_error.cm_alpha"\ndistribution = "uniform"\nlow = 0.5\nhigh = 0.6\n'
    alone, beside = _load(tmp_path, HEAD + DRAWN), _load(tmp_path, HEAD + uniform + DRAWN)
    assert len(alone.points) == len(beside.points) == 1
    for i in range(3):
        assert alone.flight(i).values["model_error.cm_q"] == beside.flight(i).values["model_error.cm_q"]
        assert list(beside.flight(i).values) == ["model_error.cm_alpha", "model_error.cm_q"]


def test_draws_have_their_distribution() -> None:
    """For 2000 draws the share below a quantile lies within the exact interval around its probability (true for these seeds)."""
    normal = AxisSettings.model_validate({"key": "x", "distribution": "normal", "mean": 1.0, "std": 0.5, "low": 1.0})
    uniform = AxisSettings.model_validate({"key": "x", "distribution": "uniform", "low": -2, "high": 2})
    for axis, quantile in ((normal, 1.0 + 0.5 * 0.6744897501960817), (uniform, 0.0)):
        values = np.array([draw(axis, 3, i) for i in range(2000)])
        assert values.min() >= float(axis.low or 0.0)
        below = share(int(np.sum(values < quantile)), len(values))
        assert below.low < 0.5 < below.high, axis
    bounded = AxisSettings.model_validate(
        {"key": "x", "distribution": "normal", "mean": 0, "std": 9, "low": -1, "high": 1}
    )
    assert max(abs(draw(bounded, 3, i)) for i in range(200)) <= 1.0


def test_every_problem_is_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError) as caught:
        _load(
            tmp_path,
            HEAD.replace("runs", "rnus") + '[[axes]]\nkey = "condition.mach"\nvalue = [1]\n[traces]\nkeep = "all"\n',
        )
    lines = [line.removeprefix(f"{tmp_path}/mine.toml: ") for line in caught.value.problems]
    assert lines == [
        "runs: is missing",
        "unknown key axes.0.value; did you mean values?",
        "traces.keep: must be 'none', 'worst' or 'chosen' (got 'all')",
        "unknown key rnus; did you mean runs?",
    ]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('[[axes]]\nkey = "condition.mach"\n', "axes.0: needs values, or from, to and count, or distribution"),
        (K.replace("count = 3", ""), "axes.0: 'from' needs count too"),
        (MACH + "low = 1.0\n", "axes.0: low: cannot be combined with 'values'"),
        (DRAWN.replace("high = 1.3", "high = 0.8"), "axes.0: low must be below high (got 0.9 and 0.8)"),
        (DRAWN.replace("mean = 1.0", "mean = 2.0"), "axes.0: mean must lie between low and high (got 2)"),
        (MACH + MACH, "axes: condition.mach is varied twice"),
        (MACH + '[histories]\nkeep = "chosen"\n', "histories: points and keep = 'chosen' need each other; give both or neither"),
        (MACH + '[histories]\npoints = [0]\n', "histories: points and keep = 'chosen' need each other; give both or neither"),
        (MACH + '[histories]\nkeep = "chosen"\npoints = [0, 9]\n', "histories.points: must be below 2, the number of points (got 9)"),
        (MACH.replace("0.8", "-1.0"), "axes.0: condition.mach: must be above 0 and at most 1000000 (got -1.0)"),
        (MACH.replace("condition.mach", "condition.mch"), "axes.0: unknown key condition.mch; did you mean mach?"),
        (MACH.replace("condition.mach", "failures.3.to"), "axes.0: failures.3.to: '3' must be an index from 0 to 1 (1 adds one)"),
        (MACH.replace("condition.mach", "seed"), "axes.0.key: 'seed' cannot be varied; name the key of a single number or text"),
        (MACH.replace("condition.mach", "failures.0.over_s"), "axes.0.key: failures.0.over_s has no effect with kind = 'effectiveness'"),
        ('[[criteria]]\nmetric = "departd"\nequals = false\n', "criteria.0.metric: there is no metric 'departd'; did you mean departed?"),
        ('[[criteria]]\nmetric = "departed"\n', "criteria.0: needs equals, min or max"),
        ('[traces]\nkeep = "chosen"\nindices = [7]\n', "traces.indices: must be below 3, the number of flights (got 7)"),
        ('combine = "paired"\n' + MACH + K, "axes: combine = 'paired' needs the same number of values for every key (got condition.mach 2, failures.0.to 3)"),
    ],
)  # fmt: skip
def test_problems_name_place_value_and_cure(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        _load(tmp_path, HEAD + text)
    assert len(caught.value.problems) == 1
    assert caught.value.problems[0].startswith(f"{tmp_path}/mine.toml: {problem}")


def test_what_is_set_reaches_the_base_but_not_what_is_varied(tmp_path: Path) -> None:
    programme = _load(tmp_path, HEAD + MACH, ["failures.0.to=0.35"])
    assert programme.scenario.failures[0].to == 0.35
    with pytest.raises(
        ScenarioError, match=r"--set condition.mach: is varied by the campaign, see axes.0 in .*mine.toml"
    ):
        _load(tmp_path, HEAD + MACH, ["condition.mach=0.6"])
    with pytest.raises(InputError, match=r"--runs: must be at least 1 \(got 0\)"):
        _load(tmp_path, HEAD + MACH, runs=0)


def test_the_base_may_lie_beside_the_file(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text(load_scenario("nominal", ["duration_s=2"]).to_toml())
    assert _load(tmp_path, HEAD.replace("elevator-loss", "base.toml") + MACH).scenario.duration_s == 2.0
    with pytest.raises(UnknownNameError, match="unknown scenario 'elevator-los'"):
        _load(tmp_path, HEAD.replace("elevator-loss", "elevator-los"))


def test_a_plain_scenario_is_one_point_with_successive_seeds() -> None:
    programme = load_programme("nominal", ["seed=5"])
    assert (len(programme), len(programme.points)) == (100, 1)
    assert [programme.flight(i).seed for i in (0, 1, 99)] == [5, 6, 104]


def test_the_options_that_fly_a_flight_again_give_its_very_scenario(tmp_path: Path) -> None:
    words = (
        '[[axes]]\nkey = "command.kind"\nvalues = ["none", "3-2-1-1"]\n[[axes]]\nkey = "command.count"\nvalues = [2]\n'
    )
    bounds = '[[axes]]\nkey = "estimators.0.bounds"\nvalues = [[0.0, 1.5]]\n'
    programme = _load(tmp_path, HEAD + words + bounds + DRAWN)
    for index, idle in ((1, True), (5, False)):
        flight = programme.flight(index)
        options = shlex.split(programme.overrides(flight))
        assert any("command.count" in option for option in options) is not idle  # it has no effect without a command
        again = load_scenario(programme.raw, options[1::2])
        expected = scenario_of(programme.raw, flight)
        if idle:
            again = again.model_copy(update={"command": expected.command})
        assert again.model_copy(update={"description": expected.description}) == expected


def test_the_hash_is_of_what_decides_a_flight() -> None:
    scenario = plain(load_scenario("nominal"), 1).scenario
    known = flight_hash(scenario, ())
    assert known == flight_hash(scenario.model_copy(update={"name": "x", "description": "y"}), ())
    others = [
        scenario.with_seed(1),
        scenario.with_aircraft("f16", "0" * 64),
        scenario.model_copy(update={"duration_s": 2.0}),
    ]
    assert len({known, *(flight_hash(other, ()) for other in others)}) == 4


def test_two_campaigns_have_one_fingerprint_only_if_they_are_the_same(tmp_path: Path) -> None:
    same = [_load(tmp_path, HEAD + MACH).fingerprint for _ in range(2)]
    assert len({*same, _load(tmp_path, HEAD + MACH, runs=4).fingerprint}) == 2
    assert _load(tmp_path, HEAD + MACH, ["failures.0.to=0.35"]).fingerprint not in same
    assert _load(tmp_path, HEAD + K).fingerprint not in same


def test_a_campaign_is_written_as_it_is_read(tmp_path: Path) -> None:
    settings = _load(tmp_path, HEAD + MACH + K + DRAWN + '[traces]\nkeep = "chosen"\nindices = [1]\n').settings
    assert settings is not None
    path = tmp_path / "again.toml"
    path.write_text(settings.to_toml())
    assert load_programme(path).settings == settings
    assert tomllib.loads(settings.to_toml())["axes"][1] == {"key": "failures.0.to", "from": 0.2, "to": 0.6, "count": 3}
    assert isinstance(settings, CampaignSettings)


def test_flights_of_a_campaign_have_the_same_estimates(tmp_path: Path) -> None:
    """Estimates are columns of the table: roll and yaw in only some flights would change the columns."""
    (tmp_path / "base.toml").write_text(rolling(["failures=[]"]).to_toml())
    text = HEAD.replace("elevator-loss", str(tmp_path / "base.toml"))
    with pytest.raises(ScenarioError) as caught:
        _load(tmp_path, f'{text}[[axes]]\nkey = "lateral.enabled"\nvalues = [true, false]\n')
    for surface in ("aileron", "rudder"):
        words = f"axes: lateral.enabled = False: there is no estimate 'surfaces.{surface}', unlike in the base; split it into two campaigns"
        assert any(problem.endswith(words) for problem in caught.value.problems), caught.value.problems
    _load(tmp_path, f'{text}[[axes]]\nkey = "lateral.roll.amplitude_deg_s"\nvalues = [5.0, 20.0]\n')
