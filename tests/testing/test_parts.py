"""Checks of laws, failures and commands: those of the documents and the built-in ones pass; each violation is found and named."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flightbed.config.kinds import LAWS, FailureSettings, LawSettings, PlainCommand, PlainFailure, PlainLaw
from flightbed.control.base import Law
from flightbed.control.proportional import Proportional
from flightbed.control.proportional_integral import ProportionalIntegralSettings
from flightbed.core.signals import Health, Measurement
from flightbed.failures.surface import Ramp
from flightbed.testing import CheckedLaw, ContractError, check_command, check_failure, check_law

History = Callable[[int], Health]


def sweep(settings: PlainCommand) -> Callable[[Any], Any]:
    return lambda t_s: np.where(t_s >= settings.start_s, 0.01 * np.sin(t_s), 0.0)


def intermittent(settings: PlainFailure, before: History, control_hz: int) -> History:
    start = round(settings.at_s * control_hz)

    def health(tick: int) -> Health:
        was = before(tick)
        return was if tick < start or (tick // 20) % 2 else was._replace(effectiveness=settings.to)

    return health


class Held(Proportional):
    """The built-in proportional law, built as own code."""

    def __init__(self, _settings: PlainLaw, design: Any, control_hz: int) -> None:
        made = LAWS.make(law="proportional").build(design, control_hz)
        super().__init__(made.gains, alpha_trim_rad=made.alpha_trim_rad, elevator_trim_rad=made.elevator_trim_rad)


def test_sound_parts_pass() -> None:
    check_command(sweep, settings={"start_s": 1.0})
    check_failure(intermittent, settings={"to": 0.4}, jsbsim=False)
    checked = check_law(Held)
    assert isinstance(checked, CheckedLaw)
    assert not checked.departed
    assert 0.1 < checked.tracking_rms_deg_s < 3.0


class OwnRamp(FailureSettings):
    """A settings class of own code."""

    to: float = 0.5
    """Share at the end."""

    def build(self, before: History, control_hz: int) -> History:
        return Ramp(at_s=self.at_s, to=self.to, over_s=1.0).build(before, control_hz)


class OwnLaw(LawSettings):
    """A settings class of own code."""

    gain: float = 1.0
    """A gain."""

    def build(self, design: Any, control_hz: int) -> Law:
        made: Law = ProportionalIntegralSettings().build(design, control_hz)
        return made


def test_settings_classes_pass() -> None:
    check_failure(OwnRamp, settings={"to": 0.3})
    assert not check_law(OwnLaw, settings={"gain": 2.0}).departed


def _command(values: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda _settings: values


def _scaled(t_s: Any) -> Any:
    t_s *= 2.0
    return np.zeros_like(t_s)


COMMANDS = {
    "building: raises": lambda _settings: 1 / 0,
    "values: raises": _command(lambda t_s: float(t_s)),
    "values: returns a float for 600 times": _command(lambda _t_s: 0.0),
    "values: returns an array of shape (3,)": _command(lambda _t_s: np.zeros(3)),
    "values: returns int64": _command(lambda t_s: np.zeros(len(t_s), dtype=np.int64)),
    "values: nan at t = 0 s": _command(lambda t_s: np.full(len(t_s), np.nan)),
    "values: a part of the times gives other values": _command(lambda t_s: t_s - t_s[0]),
    "times: modified": _command(_scaled),
    "repeatable: a second command": lambda _settings: (lambda made: lambda t_s: 0.0 * t_s + made)(_counted()),
}
_COUNT = [0.0]


def _counted() -> float:
    _COUNT[0] += 1.0
    return _COUNT[0]


@pytest.mark.parametrize("violation", COMMANDS)
def test_every_violation_of_a_command_is_found(violation: str) -> None:
    with pytest.raises(ContractError) as caught:
        check_command(COMMANDS[violation])
    assert any(line.startswith(violation) for line in caught.value.violations), caught.value.violations


def _failing(change: Callable[[Health, int], Any]) -> Callable[..., History]:
    return lambda _settings, before, _hz: lambda tick: change(before(tick), tick)


FAILURES = {
    "building: raises": lambda _settings: None,
    "health: raises": _failing(lambda was, tick: was if tick < 100 else was.nothing),  # type: ignore[attr-defined]
    "health: a float at tick 0": _failing(lambda _was, _tick: 0.5),
    "health: effectiveness is 1.5 at tick 100": _failing(lambda was, tick: was._replace(effectiveness=1.5) if tick >= 100 else was),
    "health: cg_shift_cbar is nan": _failing(lambda was, tick: was._replace(cg_shift_cbar=float("nan")) if tick >= 100 else was),
    "onset: acts at tick 50": _failing(lambda was, tick: was._replace(effectiveness=0.5) if tick >= 50 else was),
    "onset: never acts": _failing(lambda was, _tick: was),
    "repeatable: another health": _failing(
        lambda was, tick: was._replace(effectiveness=1.0 / (1.0 + _counted())) if tick >= 100 else was
    ),
}  # fmt: skip


@pytest.mark.parametrize("violation", FAILURES)
def test_every_violation_of_a_failure_is_found(violation: str) -> None:
    with pytest.raises(ContractError) as caught:
        check_failure(FAILURES[violation], jsbsim=False)
    assert any(line.startswith(violation) for line in caught.value.violations), caught.value.violations


class _Law(Held):
    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:
        found = super().demand(measurement, q_ref_rad_s=q_ref_rad_s, elevator_rad=elevator_rad, hold=hold)
        return self.changed(found)

    def changed(self, demand: float) -> float:
        return demand


class Raising(_Law):
    def changed(self, demand: float) -> float:
        raise ValueError(f"no demand {demand}")


class NotFinite(_Law):
    def changed(self, demand: float) -> float:
        return demand * float("nan")


class Shared(_Law):
    def changed(self, demand: float) -> float:
        return demand + 1e-9 * _counted()


class Integrating(_Law):
    total = 0.0

    def changed(self, demand: float) -> float:
        self.total += 1e-5
        return demand + self.total


class Designing(_Law):
    def __init__(self, settings: PlainLaw, design: Any, control_hz: int) -> None:
        super().__init__(settings, design, control_hz)
        self.design = design

    def changed(self, demand: float) -> float:
        self.design.A.flags.writeable = True
        self.design.A[0, 0] *= 1.0 + 1e-9
        return demand


LAW = {
    "building: raises": lambda _settings: None,
    "demand: raises": Raising,
    "demand: returns nan at tick 0": NotFinite,
    "repeatable: a second law": Shared,
    "hold: the demand still moves": Integrating,
    "design: modified": Designing,
}


@pytest.mark.parametrize("violation", LAW)
def test_every_violation_of_a_law_is_found(violation: str) -> None:
    with pytest.raises(ContractError) as caught:
        check_law(LAW[violation])
    assert any(line.startswith(violation) for line in caught.value.violations), caught.value.violations
