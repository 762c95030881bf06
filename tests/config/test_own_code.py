"""External code: flown only with permission by name; its errors name file and line."""

from __future__ import annotations

import hashlib
import json
import math
import pickle
import sys
import textwrap
import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flightbed
from flightbed.analysis.events import failures
from flightbed.analysis.seeds import Job, fly_jobs, processes
from flightbed.analysis.summary_text import command
from flightbed.avionics.onboard import OnBoard
from flightbed.cli import main as cli
from flightbed.config import families, own_code
from flightbed.config.kinds import CommandSettings, EstimatorSettings, PlainCommand, PlainEstimator
from flightbed.config.options import Options
from flightbed.config.own_code import load, names_without_option, use_options, using
from flightbed.config.table import between, only_with
from flightbed.core.errors import EstimateError, ExtensionError, InputError, ScenarioError, UnknownNameError
from flightbed.core.signals import Estimate, Measurement
from flightbed.core.sources import digest
from flightbed.core.units import DEG
from flightbed.estimation.loop_gain.estimator import LoopGain, LoopGainSettings
from flightbed.failures.base import HealthHistory
from flightbed.report.flight_report import rerun_command
from flightbed.runs.run import run
from flightbed.scenario.own_code import check_named, named_extensions, named_plug_ins
from flightbed.scenario.reading import load_scenario
from tests.command_line import flightbed as command_line

FILTER = '''\
from pathlib import Path

from flightbed import Estimate

Path("imported").touch()


class Fixed:
    """Constant estimate of K."""

    def __init__(self, settings, onboard):
        self.k, self.ticks = settings.options["k"], 0

    def update(self, measurement):
        self.ticks += 1
        return Estimate(self.k, 0.0, self.k, self.k, measurement.alpha_rad, measurement.q_rad_s, 0.0)
'''
QUICK = ["duration_s=0.2"]
OWN = ["estimators.0.kind=own_filter:Fixed", "estimators.0.options.k=0.7"]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working directory with own_filter.py; modules imported from it are removed afterwards."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_filter.py").write_text(FILTER)
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


def _sets(*overrides: str) -> list[str]:
    return [word for override in overrides for word in ("--set", override)]


def _write(name: str, text: str) -> None:
    Path(name).write_text(textwrap.dedent(text))


# Permission


def test_a_scenario_alone_imports_nothing(here: Path) -> None:
    done = command_line("run", "nominal", *_sets(*QUICK, *OWN), cwd=here)
    assert done.returncode == 2
    assert done.stderr == (
        "flightbed: --set estimators.0.kind: 'own_filter:Fixed' is code outside flightbed; add --use own_filter:Fixed to allow it, "
        'or in Python fly it within flightbed.using("own_filter:Fixed")\n'
    )
    assert not Path("imported").exists()
    for kind in ("own_filter:Fixed", "own_filter.py:Fixed", "own_filter:", ":Fixed"):
        with pytest.raises(ScenarioError, match="is code outside flightbed"):
            load_scenario({"schema": 1, "name": "x", "duration_s": 1.0, "estimators": [{"name": "a", "kind": kind}]})
    assert not Path("imported").exists()


@pytest.mark.parametrize(
    ("key", "family"),
    [("estimators.0.kind", "estimators"), ("control.law", "laws"), ("failures.0.kind", "failures"), ("command.kind", "commands")],
)  # fmt: skip
def test_every_place_that_names_code_asks_for_permission(key: str, family: str) -> None:
    with pytest.raises(ScenarioError, match=f"--set {key}: 'a:b' is code outside flightbed; add --use a:b to allow it"):
        load_scenario("elevator-loss", [f"{key}=a:b"])
    with pytest.raises(ExtensionError, match="'a:b' is code outside flightbed"):
        families.factory(family, "a:b")


def test_permitted_code_flies_and_the_run_lists_it(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONSAFEPATH", "1")  # like the installed command: the working directory is not on sys.path
    permit = ["--use", "own_filter:Fixed"]
    done = command_line("run", "nominal", *_sets(*QUICK, *OWN), *permit, "--rerun", "off", "--out", "x", cwd=here)
    assert done.returncode == 0, done.stderr
    sha256 = hashlib.sha256(FILTER.encode()).hexdigest()
    assert f"own code  own_filter:Fixed (sha256 {sha256[:12]})" in done.stdout
    stored = json.loads((here / "x" / "metrics.json").read_text())
    assert stored["extensions"] == [{"name": "own_filter:Fixed", "sha256": sha256, "imports": {}}]
    assert stored["estimators"]["scheduled"]["final"] == 0.7
    resolved = tomllib.loads((here / "x" / "scenario.toml").read_text())
    assert resolved["estimators"][0]["kind"] == "own_filter:Fixed"
    assert resolved["estimators"][0]["options"] == {"k": 0.7}
    assert "options" not in resolved["control"]
    with using("own_filter:Fixed"):
        assert flightbed.run(load_scenario("x/scenario.toml")).summary.to_dict()["extensions"] == stored["extensions"]


def test_a_run_without_own_code_says_so() -> None:
    assert flightbed.run(load_scenario("nominal", QUICK)).summary.extensions == ()


def test_a_use_that_the_scenario_does_not_name_is_an_error(here: Path) -> None:
    with pytest.raises(InputError) as caught:
        cli.app(["run", "nominal", *_sets(*QUICK), "--use", "own_filter:Fixed"])
    assert str(caught.value) == (
        "--use own_filter:Fixed: the scenario does not name it; name it, as in --set estimators.0.kind=own_filter:Fixed, or leave it out"
    )
    assert caught.value.exit_code == 2
    assert not (here / "runs").exists()
    with using("own_filter:Fixed", "own_filter.py:Fixed"):
        scenario = load_scenario("nominal", [*QUICK, *OWN])
        check_named(scenario, ["own_filter:Fixed", "own_filter:Fixed"])
        with pytest.raises(InputError, match="--use own_filter.py:Fixed: .* did you mean own_filter:Fixed"):
            check_named(scenario, ["own_filter.py:Fixed"])


def test_permission_ends_with_its_block(here: Path) -> None:
    with using("own_filter:Fixed"):
        scenario = load_scenario("nominal", [*QUICK, *OWN])
        found: list[int] = []
        thread = Thread(target=lambda: found.append(len(families.in_use())))
        thread.start()
        thread.join()
        assert found == [0]
        with using({"inner": Still}):
            assert set(families.in_use()) == {"own_filter:Fixed", "inner"}
        assert set(families.in_use()) == {"own_filter:Fixed"}
    assert families.in_use() == {}
    with pytest.raises(ExtensionError, match=r"'own_filter:Fixed' is code outside flightbed; add --use"):
        flightbed.run(scenario)


# Import


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("own_filter", "own code own_filter: must be module:Attribute or path/to/file.py:Attribute, for example my_filter:MyFilter"),
        ("own_filter:", "own code own_filter:: must be module:Attribute or path"),
        (":Fixed", "own code :Fixed: must be module:Attribute or path"),
        ("own_filtr:Fixed", "own code own_filtr:Fixed: module 'own_filtr' is neither installed nor in the working directory; check the name, or give the file, as in path/to/my_filter.py:MyFilter"),
        ("own.filter:Fixed", "own code own.filter:Fixed: module 'own' is neither"),
        ("own_filtr.py:Fixed", "own code own_filtr.py:Fixed: own_filtr.py cannot be read: No such file or directory"),
        ("own_filter:Fixd", "own code own_filter:Fixd: {here}/own_filter.py has no 'Fixd'; did you mean Fixed?"),
        ("own_filter.py:Fixed.make", "own code own_filter.py:Fixed.make: {here}/own_filter.py has no 'make'; check the name"),
        ("constant:K", "own code constant:K: is a float, which is not callable; name a class or a function"),
        ("needs:X", "own code needs:X: cannot be imported: needs.py:3: ModuleNotFoundError: No module named 'no_such_package'"),
        ("wrong.py:X", "own code wrong.py:X: cannot be imported: wrong.py:2: SyntaxError: invalid syntax"),
        ("wrong:X", "own code wrong:X: cannot be imported: wrong.py:2: SyntaxError: invalid syntax"),
        ("fails:X", "own code fails:X: cannot be imported: fails.py:1: ZeroDivisionError: division by zero"),
        ("quits.py:X", "own code quits.py:X: cannot be imported: quits.py:2: SystemExit: 3"),
        ("control:Mine", "own code control:Mine: module 'control' was imported from "),
        ("control:Mine", "has no 'Mine'; to use the file in the working directory, name it control.py:Mine"),
    ],
)  # fmt: skip
def test_import_errors_are_one_line(here: Path, name: str, message: str) -> None:
    _write("constant.py", "K = 1.0\n")
    _write("needs.py", "import math\n\nimport no_such_package\n")
    _write("wrong.py", "x = 1\nclass X(\n")
    _write("fails.py", "1 / 0\n")
    _write("quits.py", "import sys\nsys.exit(3)\n")
    _write("control.py", "class Mine: ...\n")
    path, modules = list(sys.path), set(sys.modules)
    with pytest.raises(ExtensionError) as caught:
        load(name)
    message = message.replace("{here}", str(here))
    if message == "own code wrong.py:X: cannot be imported: wrong.py:2: SyntaxError: invalid syntax":
        message = message.partition("invalid")[0]  # the rest of the message is Python's
    assert message.partition(" invalid syntax")[0] in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert caught.value.exit_code == 2
    assert sys.path == path
    assert not {m for m in set(sys.modules) - modules if m.startswith("flightbed_own") and "own_filter" not in name}


def test_modules_are_imported_from_the_working_directory_and_beside_the_file(here: Path) -> None:
    (here / "below" / "package").mkdir(parents=True)
    _write("below/package/__init__.py", "")
    _write("below/package/filters.py", "class Kind:\n    class Inner: ...\n")
    _write("below/helper.py", "VALUE = 3\n")
    _write("below/mine.py", "from helper import VALUE\n\ndef make(): return VALUE\n")
    path = list(sys.path)
    assert load("below.package.filters:Kind.Inner").factory.__qualname__ == "Kind.Inner"
    assert load("below/mine.py:make").factory() == 3
    assert sys.path == path
    sys.modules.pop("helper")
    with pytest.raises(
        ExtensionError, match=r"cannot be imported: below/mine.py:1: ModuleNotFoundError: No module named 'helper'"
    ):
        load("below.mine:make")


def test_a_file_is_executed_once_per_text(here: Path) -> None:
    _write(
        "counted.py", "from dataclasses import dataclass\n\n@dataclass\nclass A:\n    x: 'int' = 0\n\nclass B(A): ...\n"
    )
    first = load("counted.py:A")
    assert load("counted.py:A").factory is first.factory
    assert issubclass(load("counted.py:B").factory, first.factory)
    _write("counted.py", "class A: ...\n")
    second = load("counted.py:A")
    assert second.factory is not first.factory
    assert second.sha256 == hashlib.sha256(b"class A: ...\n").hexdigest() != first.sha256
    assert not (here / "__pycache__").exists()


# Classes given in Python


class Still:
    """K is the value of an option, or 1."""

    def __init__(self, settings: Any, onboard: Any) -> None:
        self.k = settings.options.get("k", 1.0)

    def update(self, m: Measurement) -> Estimate:
        return Estimate(self.k, 0.1, self.k, self.k, m.alpha_rad, m.q_rad_s, 0.0)


class Late(Still):
    """Fails after a few ticks."""

    ticks = 0

    def update(self, m: Measurement) -> Any:
        self.ticks += 1
        if self.ticks == 11:
            raise RuntimeError("I am\n late")
        return super().update(m) if self.ticks != 6 or self.k != 0.5 else None


def _late_line() -> int:
    import inspect

    source, first = inspect.getsourcelines(Late)
    return first + next(i for i, line in enumerate(source) if "raise" in line)


def test_classes_given_in_python_fly_under_a_name() -> None:
    with using({"still": Still, "also": lambda settings, onboard: Still(settings, onboard)}):
        scenario = load_scenario("nominal", [*QUICK, "estimators.0.kind=still", "estimators.0.options.k=0.25", "estimators.1={name='b', kind='also'}"])  # fmt: skip
        assert [own.name for own in named_extensions(scenario)] == ["still", "also"]
        result = flightbed.run(scenario)
        assert result.trace["b.effectiveness"].tolist() == [1.0] * 20
    assert [own.name for own in result.summary.extensions] == ["still", "also"]
    assert result.summary.extensions[0].sha256 == hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
    assert result.trace[f"{scenario.estimators[0].name}.effectiveness"].tolist() == [0.25] * 20
    assert result.summary.metrics.estimators["b"].nees_mean_post is None
    with pytest.raises(
        ScenarioError,
        match=r"estimators\.0\.kind: unknown estimator; known: differentiated-rls, input-kalman, loop-gain",
    ):
        load_scenario("nominal", ["estimators.0.kind=still"])
    with pytest.raises(UnknownNameError, match="unknown estimator 'still'"):
        flightbed.fly(scenario)


def test_code_without_a_file_has_no_hash() -> None:
    names: dict[str, Any] = {"Still": Still}
    exec("class Typed(Still): ...", names)
    with using({"typed": names["Typed"], "part": partial(Still)}):
        summary = flightbed.run(load_scenario("nominal", [*QUICK, "estimators.0.kind=part", "estimators.1={name='t', kind='typed'}"])).summary  # fmt: skip
    part, typed = summary.extensions
    assert (typed.name, typed.sha256) == ("typed", None)
    assert part.sha256 is not None


@pytest.mark.parametrize(
    ("own", "message"),
    [
        ({"loop-gain": Still}, "own code loop-gain: is the name of one of flightbed's estimators; choose another"),
        ({"doublet": Still}, "own code doublet: is the name of one of flightbed's commands; choose another"),
        ({"a:b": Still}, "own code 'a:b': a name must be letters, digits, - and _, and start with a letter or digit"),
        (
            [Still],
            f'flightbed.using: takes names, "my_filter:MyFilter", or mappings, {{"mine": MyFilter}} (got {[Still]!r})',
        ),
        ({"mine": 3}, "own code mine: is a int, which is not callable; give a class or a function"),
    ],
)
def test_invalid_names_and_objects_given_in_python(own: Any, message: str) -> None:
    with pytest.raises(ExtensionError) as caught, using(own):
        pass
    assert str(caught.value) == message


def test_an_estimator_with_zero_std_has_no_nees(here: Path) -> None:
    sets = ["duration_s=1", "failures.0.at_s=0.2", "failures.0.to=0.5", "estimators.1={name='still', kind='still'}"]
    with using("own_filter:Fixed", {"still": Still}):
        metrics = flightbed.run(load_scenario("nominal", [*sets, *OWN])).metrics
    exact, uncertain = metrics.estimators["scheduled"], metrics.estimators["still"]
    assert exact.nees_mean_post is None
    assert uncertain.nees_mean_post == pytest.approx(25.0)  # the estimate is 1 +- 0.1, K is 0.5
    assert exact.median_abs_error_post == pytest.approx(0.2)


# Errors


def _no_arguments() -> None:
    pass


@pytest.mark.parametrize(
    ("factory", "message"),
    [
        (_no_arguments, "own code mine: cannot be built: TypeError: _no_arguments() takes 0 positional arguments but 2 were given; docs/extending.md lists the arguments of each factory"),
        (lambda settings, onboard: settings.options["gain"], "KeyError: 'no option gain; options: none'"),
        (lambda settings, onboard: 3, "own code mine: returns a int, which has no method update(); docs/extending.md shows the interface"),
    ],
)  # fmt: skip
def test_factory_errors_are_one_line(factory: Callable[..., Any], message: str) -> None:
    with using({"mine": factory}), pytest.raises(ExtensionError) as caught:
        flightbed.run(load_scenario("nominal", [*QUICK, "estimators.0.kind=mine"]))
    assert message in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("key", "arguments", "needs"),
    [("control.law", 3, "has no method demand()"), ("failures.0.kind", 3, "is not callable"), ("command.kind", 1, "is not callable")],
)  # fmt: skip
def test_products_of_factories_of_other_families(key: str, arguments: int, needs: str) -> None:
    made: list[int] = []

    def make(*given: Any) -> object:
        made.append(len(given))
        return object()

    with using({"mine": make}), pytest.raises(ExtensionError, match=rf"own code mine: returns a object, which {needs}"):
        flightbed.run(
            load_scenario("nominal", [*QUICK, f"{key}=mine", *(["failures.0.at_s=0.1"] if "fail" in key else [])])
        )
    assert made == [arguments]


def test_errors_in_flight_have_file_line_and_time() -> None:
    line = f"own code late: fails at t = 0.1 s, tick 10: {Path(__file__)}:{_late_line()}: RuntimeError: I am late"
    with using({"late": Late}):
        scenario = load_scenario("nominal", [*QUICK, "estimators.0.kind=late"])
        samples = flightbed.fly(scenario)
        with pytest.raises(ExtensionError) as caught:
            flightbed.run(scenario)
    assert (
        str(caught.value).replace("tests/config/test_own_code.py", str(Path(__file__))) == line
        or str(caught.value) == line
    )
    assert isinstance(caught.value.__cause__, RuntimeError)
    ticks = []
    with pytest.raises(ExtensionError, match="fails at t = 0.1 s, tick 10"):  # also after the permission has ended
        ticks.extend(sample.tick for sample in samples)
    samples = flightbed.fly(load_scenario("nominal", QUICK))
    with pytest.raises(KeyError):  # no external code: the exception is unchanged
        raise KeyError(next(samples).tick)


def test_invalid_return_values_have_name_and_time() -> None:
    sets = [*QUICK, "estimators.0.kind=late", "estimators.0.options.k=0.5"]
    adapting = ["adaptation.enabled=true", "adaptation.estimator=scheduled"]
    with using({"late": Late}), pytest.raises(ExtensionError) as caught:
        flightbed.run(load_scenario("nominal", [*sets, *adapting]))
    assert str(caught.value).startswith(
        "own code late: returned an invalid value at t = 0.05 s, tick 5: AttributeError: 'NoneType'"
    )
    assert "flightbed.testing.check_estimator" in str(caught.value)


def test_an_invalid_command_is_an_error() -> None:
    with using({"mine": lambda settings: lambda t_s: None}), pytest.raises(ExtensionError) as caught:
        flightbed.run(load_scenario("nominal", [*QUICK, "command.kind=mine"]))
    assert str(caught.value).startswith("own code mine: returned an invalid value: TypeError:")


def test_errors_in_numpy_name_the_line_of_the_users_file(here: Path) -> None:
    _write("helper_of_mine.py", "import numpy as np\n\ndef solve():\n    np.linalg.inv(np.zeros((2, 2)))\n")
    _write("law.py", "import helper_of_mine\n\n\ndef law(settings, design, control_hz):\n    helper_of_mine.solve()\n")
    with using("law.py:law"), pytest.raises(ExtensionError) as caught:
        flightbed.run(load_scenario("nominal", [*QUICK, "control.law=law.py:law"]))
    assert (
        str(caught.value) == "own code law.py:law: cannot be built: helper_of_mine.py:4: LinAlgError: Singular matrix"
    )


# Other processes


def test_external_code_flies_in_worker_processes(here: Path) -> None:
    """By name, or as an importable object; equal to the last bit to a flight in this process."""
    quick = ["duration_s=1", "estimators=[{name='own', kind='own_filter.py:Fixed', model='short-period', options={k=0.5}}]", "adaptation.estimator=own", "failures=[]"]  # fmt: skip
    with using("own_filter.py:Fixed", {"still": Still, "local": lambda settings, onboard: Still(settings, onboard)}):
        scenario = load_scenario("thesis-loss", [*quick, "control.state_from="])
        columns = ("own.effectiveness", "q_deg_s")
        jobs = [Job(scenario, 2, columns), Job(_kind(scenario, "still"), 1, columns)]
        here_and_now = fly_jobs(jobs)
        with ThreadPoolExecutor(1) as threads:
            (threaded,) = fly_jobs(jobs[:1], executor=threads)
        with processes(2) as executor:
            assert executor is not None
            there = fly_jobs(jobs, executor=executor)
            with pytest.raises(
                ExtensionError, match="own code local: cannot be sent to other processes .* path/to/file.py:Attr"
            ):
                fly_jobs([Job(_kind(scenario, "local"), 1)], executor=executor)
            Path("own_filter.py").unlink()
            with pytest.raises(ExtensionError, match=r"own_filter.py:Fixed: own_filter.py cannot be read"):
                fly_jobs(jobs, executor=executor)
    for ours, theirs in zip([*here_and_now, threaded], [*there, here_and_now[0]], strict=True):
        for one, other in zip(ours, theirs, strict=True):
            assert [one.columns[c].tobytes() for c in columns] == [other.columns[c].tobytes() for c in columns]
    assert set(there[0][0].columns["own.effectiveness"]) == {0.5}
    assert not np.array_equal(there[0][0].columns["q_deg_s"], there[0][1].columns["q_deg_s"])


def _kind(scenario: Any, kind: str) -> Any:
    (estimator,) = scenario.estimators
    return scenario.model_copy(update={"estimators": (estimator.model_copy(update={"kind": kind}),)})


# Options

_SCALARS = st.one_of(st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False, allow_infinity=False), st.text(max_size=9))  # fmt: skip
_VALUES = st.recursive(_SCALARS, lambda inner: st.lists(inner, max_size=3), max_leaves=5)


_OPTIONS = st.dictionaries(st.text(min_size=1, max_size=9), _VALUES, max_size=4)


@settings(max_examples=40)
@given(_OPTIONS)
def test_options_survive_a_round_trip(options: dict[str, Any]) -> None:
    _assert_it_survives(options)


@pytest.mark.long
@given(_OPTIONS)
def test_many_options_survive_a_round_trip(options: dict[str, Any]) -> None:
    _assert_it_survives(options)


def _assert_it_survives(options: dict[str, Any]) -> None:
    table = {
        "schema": 1,
        "name": "x",
        "duration_s": 1.0,
        "estimators": [{"name": "a", "kind": "mine", "options": options}],
    }
    with using({"mine": Still}):
        scenario = load_scenario(table)
        again = load_scenario(tomllib.loads(scenario.to_toml()))
    assert again == scenario
    assert hash(again) == hash(scenario)
    assert ("options" in scenario.to_toml()) >= bool(options)
    assert [type(v) for v in again.estimators[0].options.values()] == [
        tuple if isinstance(v, list) else type(v) for v in options.values()
    ]


def test_set_reaches_options_in_every_table() -> None:
    sets = [
        f"{place}.options.{key}"
        for place in ("estimators.0", "failures.0", "control", "command")
        for key in ("gain=2", "taps=[1, 2.5]")
    ]
    kinds = ["estimators.0.kind=mine", "failures.0.kind=mine", "control.law=mine", "command.kind=mine"]
    with using({"mine": Still}):
        scenario = load_scenario("elevator-loss", [*kinds, *sets])
    for table in (scenario.estimators[0], scenario.failures[0], scenario.control, scenario.command):
        assert dict(table.options) == {"gain": 2, "taps": (1, 2.5)}
    assert scenario.to_toml().count("options]") == 4


def test_empty_options_are_not_written() -> None:
    with using({"mine": Still}):
        scenario = load_scenario("elevator-loss", ["command={kind='mine'}"])
        assert "options" not in scenario.to_toml()
        assert isinstance(scenario.command, PlainCommand)
        assert scenario.command.options == Options() == {}
        assert load_scenario(tomllib.loads(scenario.to_toml())) == scenario


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("estimators.0.options.gain=2", "--set: estimators.0.options: 'loop-gain' has no such key (own code has it); remove it"),
        ("control.options.gain=2", "--set: control.options: 'proportional' has no such key (own code has it); remove it"),
        ("failures.0.options.a=2", "--set: failures.0.options: 'effectiveness' has no such key (own code has it); remove it"),
        ("command.options.a=2", "--set: command.options: 'doublet' has no such key (own code has it); remove it"),
    ],
)  # fmt: skip
def test_invalid_options(override: str, message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("elevator-loss", [override])
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("command.options=2", "--set command.options: must be a table (got 2)"),
        ("command.options.a.b=2", "scenarios/elevator-loss.toml: command.options.a: must be text, a finite number, true or false, or a list of these (got {'b': 2})"),
        ("command.options.a=inf", "--set command.options.a: must be text, a finite number, true or false, or a list of these (got inf)"),
        ("command.options.a=[1, [nan]]", "--set command.options.a: must be text, a finite number, true or false, or a list of these (got [1, [nan]])"),
        ("command.options.a=1999-12-31", "--set command.options.a: must be text, a finite number, true or false, or a list of these (got datetime.date(1999, 12, 31))"),
    ],
)  # fmt: skip
def test_invalid_options_of_own_code(override: str, message: str) -> None:
    with using({"mine": Still}), pytest.raises(ScenarioError) as caught:
        load_scenario("elevator-loss", ["command.kind=mine", override])
    assert str(caught.value) == message


def test_options_are_immutable_and_name_a_missing_key() -> None:
    options = Options({"taps": [1, [2]]})
    assert options["taps"] == (1, (2,))
    with pytest.raises(TypeError):
        options["taps"] = 3  # type: ignore[index]
    with pytest.raises(KeyError, match="no option gain; options: taps"):
        options["gain"]
    assert options.get("gain", 5) == 5
    assert "gain" not in options
    assert repr(options) == "Options({'taps': (1, (2,))})"


def test_a_plain_class_has_the_keys_that_every_estimator_needs() -> None:
    keys = ["estimators.1.smoothing=0.5", "estimators.1.prior.effectiveness_std=0.1", "estimators.1.options.taps=3"]
    with using({"mine": Still}):
        own = load_scenario("elevator-loss", ["estimators.1={name='x', kind='mine'}", *keys]).estimators[1]
        assert isinstance(own, PlainEstimator)
        assert (own.smoothing, own.prior.effectiveness_std, dict(own.options)) == (0.5, 0.1, {"taps": 3})
        assert own.model_dump(exclude={"options", "prior"}).keys() == {"name", "kind", "model", "smoothing", "bounds"}
        with pytest.raises(ScenarioError, match="--set: estimators.1.memory: 'mine' has no such key .'loop-gain', 'two-stage' have it.; remove it"):  # fmt: skip
            load_scenario("elevator-loss", ["estimators.1={name='x', kind='mine'}", "estimators.1.memory=fading"])


class Typed(EstimatorSettings):
    """Settings class of own code."""

    gain: Annotated[float, between(0, 1)] = 0.5
    """K-hat."""
    made: Annotated[Literal["estimator", "nothing", "error"], only_with(gain=0.5)] = "estimator"
    """Result of build."""

    def build(self, onboard: Any) -> Any:
        if self.made == "error":
            raise RuntimeError("no such model")
        return Still(self, onboard) if self.made == "estimator" else 3

    @property
    def options(self) -> dict[str, float]:
        return {"k": self.gain}


TYPED = "estimators.1={name='x', kind='typed'}"


def test_a_settings_class_of_own_code_has_its_own_keys() -> None:
    with using({"typed": Typed}):
        scenario = load_scenario("nominal", [*QUICK, TYPED, "estimators.1.gain=0.25"])
        result = flightbed.run(scenario)
        assert load_scenario(tomllib.loads(scenario.to_toml())) == scenario
    assert result.trace["x.effectiveness"].tolist() == [0.25] * 20
    assert [own.name for own in result.summary.extensions] == ["typed"]


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("gain=2", "--set estimators.1.gain: must be between 0 and 1 (got 2)"),
        ("gian=0", "--set: unknown key estimators.1.gian; did you mean gain?"),
        ("window=3", "--set: estimators.1.window: 'typed' has no such key ('input-kalman', 'loop-gain', 'retrospective-cost', 'two-stage' have it); remove it"),
    ],
)  # fmt: skip
def test_keys_of_a_settings_class_of_own_code_are_checked(key: str, message: str) -> None:
    with using({"typed": Typed}), pytest.raises(ScenarioError) as caught:
        load_scenario("nominal", [TYPED, f"estimators.1.{key}"])
    assert list(caught.value.problems) == [message]


@pytest.mark.parametrize(
    ("made", "message"),
    [
        ("error", r"own code typed: cannot be built: .*test_own_code.py:\d+: RuntimeError: no such model"),
        ("nothing", r"own code typed: returns a int, which has no method update\(\)"),
    ],
)
def test_a_settings_class_that_builds_no_estimator_is_an_error(made: str, message: str) -> None:
    with using({"typed": Typed}), pytest.raises(ExtensionError, match=message):
        flightbed.run(load_scenario("nominal", [*QUICK, TYPED, f"estimators.1.made={made}"]))


def test_the_table_of_an_external_failure() -> None:
    with using({"mine": Still}):
        own = load_scenario("elevator-loss", ["failures.0={kind='mine', at_s=0.2}"])
        written = {"kind": "mine", "at_s": 0.2, "surface": "elevator", "to": 1.0}
        assert tomllib.loads(own.to_toml())["failures"] == [written]
        assert failures(own) == ["at 0.2 s the failure 'mine' begins"]
        with pytest.raises(ScenarioError, match=r"failures\.0\.over_s: 'mine' has no such key \('ramp' has it\)"):
            load_scenario("elevator-loss", ["failures.0.kind=mine", "failures.0.over_s=3"])
        with pytest.raises(ScenarioError, match=r"failures\.0\.surface: the stock laws control aileron and rudder"):
            load_scenario("elevator-loss", ["failures.0.kind=mine", "failures.0.surface=rudder"])


def test_the_table_of_an_external_command() -> None:
    """The amplitude of every place comes as amplitude_deg_s."""
    seen: list[CommandSettings] = []

    def mine(settings: CommandSettings) -> Callable[[Any], Any]:
        seen.append(settings)
        return np.zeros_like

    mines = [
        "command={kind='mine', amplitude_g=2.0, options={a=3}}",
        "lateral.sideslip={kind='mine', amplitude_deg=1.7}",
    ]
    with using({"mine": mine}):
        own = load_scenario("nominal", ["lateral.enabled=true", *mines, "lateral.roll={kind='mine', count=7}"])
        written = tomllib.loads(own.to_toml())
        with pytest.raises(ScenarioError, match=r"command\.seed: 'mine' has no such key \('random' has it\)"):
            load_scenario("nominal", [*mines, "command.seed=1"])
        own.command.rate(), own.command.load_factor(), own.lateral.roll.rate(), own.lateral.sideslip.angle()
    rest = {"start_s": 0.0, "period_s": 4.5, "count": 3, "filter_rad_s": 3.0}
    in_pitch = {"kind": "mine", "amplitude_deg_s": 5.0, "amplitude_g": 2.0, **rest, "options": {"a": 3}}
    assert written["command"] == in_pitch
    assert written["lateral"]["sideslip"] == {"kind": "mine", "amplitude_deg": 1.7, **rest}
    assert [s.model_dump()["amplitude_deg_s"] for s in seen] == [5.0, 2.0 / DEG, 5.0, 1.7]
    assert command(own) == "mine, amplitude 2 g, a 3; prefilter 3 rad/s"
    assert command(own, "lateral.roll") == "mine, count 7; prefilter 3 rad/s"


class _SaysNan(LoopGain):
    def update(self, measurement: Measurement) -> Estimate:
        return super().update(measurement)._replace(effectiveness_smoothed=float("nan"))


def _says_nan(settings: PlainEstimator, onboard: OnBoard) -> _SaysNan:
    return _SaysNan(LoopGainSettings(name=settings.name).config(), onboard)


def test_a_nan_of_the_correcting_estimator_is_an_error() -> None:
    keys = ["estimators.0.kind=bad", "duration_s=0.5"]
    with using({"bad": _says_nan}):
        with pytest.raises(EstimateError, match="estimators.0: smoothed K is nan at t = 0 s"):
            run(load_scenario("nominal", keys))
        beside = run(load_scenario("nominal", [*keys, "adaptation.enabled=false"]))  # harmless
    assert beside.summary.metrics.estimators["scheduled"].nis_expected == 2.0


def test_a_failure_with_nan_is_an_error() -> None:
    def nothing(settings: object, before: HealthHistory, control_hz: int) -> HealthHistory:
        return lambda tick: before(tick)._replace(effectiveness=float("nan")) if tick >= 20 else before(tick)

    keys = ["failures.0.kind=bad", "failures.0.at_s=0.2", "duration_s=0.5", "adaptation.enabled=false"]
    with using({"bad": nothing}), pytest.raises(ExtensionError, match="the health is not finite from t = 0.2 s"):
        run(load_scenario("elevator-loss", keys))


def test_a_file_that_changes_before_a_worker_loads_it_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text("def make(settings, onboard):\n    return 1\n")
    packed = pickle.dumps(load("mine.py:make"))
    assert pickle.loads(packed).unpack().name == "mine.py:make"
    (tmp_path / "mine.py").write_text("def make(settings, onboard):\n    return 2\n")
    with pytest.raises(ExtensionError, match="its file has changed since the flights began"):
        pickle.loads(packed).unpack()


def test_the_command_that_flies_it_again_is_quoted_and_honest() -> None:
    names = ["my dir/est.py:E", "at-hand"]
    assert use_options(names) == " --use 'my dir/est.py:E'"
    assert names_without_option(names) == ["at-hand"]
    page = rerun_command(
        "schema = 1", use_options(names), {"python": "3", "flightbed": "1"}, names_without_option(names)
    )
    assert any("'at-hand' was given in Python, and no command can name it" in text for text in page.text)


def test_a_health_that_is_not_finite_is_named_with_its_time_and_value() -> None:
    def broken(settings: Any, before: Any, control_hz: int) -> Any:
        return lambda tick: before(tick)._replace(effectiveness=math.nan) if tick >= 0.5 * control_hz else before(tick)

    keys = ["duration_s=1", "failures=[]", "failures.0={kind='broken', at_s=0.5}"]
    message = (
        r"failures: the health is not finite from t = 0\.5 s on \(got effectiveness_true = nan\); return finite values"
    )
    with using({"broken": broken}), pytest.raises(ExtensionError, match=message):
        flightbed.run(load_scenario("thesis-loss", keys))


def test_the_sources_of_an_installed_kind_count_with_its_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = tmp_path / "site-packages"
    info = site / "plugged-1.dist-info"
    for folder in (site / "plugged", info):
        folder.mkdir(parents=True)
    sources = {"plugged/__init__.py": "", "plugged/gain.py": "GAIN = 1.0\n", "beside.py": ""}
    main = "import beside\nfrom plugged.gain import GAIN\ndef build(settings, onboard): ...\n"
    for name, text in {**sources, "plugged/kind.py": main}.items():
        (site / name).write_text(text)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: plugged\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[flightbed.estimators]\nplugged-kind = plugged.kind:build\n")
    monkeypatch.syspath_prepend(site)
    families._installed.cache_clear()
    try:
        scenario = load_scenario("nominal", ["estimators.0.kind=plugged-kind"])
        hashes = {
            name: hashlib.sha256(sources[name].encode()).hexdigest().encode() for name in sources if name != "beside.py"
        }
        assert named_plug_ins(scenario) == {"plugged-kind": digest({"": main.encode(), **hashes})}
        assert named_plug_ins(load_scenario("nominal")) == {}
    finally:
        families._installed.cache_clear()
        own_code.installed_sha256.cache_clear()
