"""The laws and the correction, by hand-computed values."""

from __future__ import annotations

import pytest

from flightbed.control.base import Gains
from flightbed.control.correction import Adaptation
from flightbed.control.proportional import Proportional
from flightbed.control.proportional_integral import ProportionalIntegral
from flightbed.core.signals import Measurement

GAINS = Gains(alpha=0.5, q=0.4, elevator=-0.2, reference=-1.5, integral=-3.0)
AT_TRIM = Measurement(alpha_rad=0.1, q_rad_s=0.0, elevator_rad=-0.02, elevator_mean_rad=-0.02)


def test_proportional_holds_trim_and_sums_deviations() -> None:
    law = Proportional(GAINS, alpha_trim_rad=0.1, elevator_trim_rad=-0.02)
    assert law.demand(AT_TRIM, q_ref_rad_s=0.0, elevator_rad=-0.02, hold=False) == pytest.approx(-0.02)
    moved = Measurement(0.13, 0.05, 0.0, 0.0)
    expected = -0.02 - 1.5 * 0.04 + 0.5 * 0.03 + 0.4 * 0.05 - 0.2 * (-0.06 + 0.02)
    assert law.demand(moved, q_ref_rad_s=0.04, elevator_rad=-0.06, hold=False) == pytest.approx(expected)


def test_integral_adds_up_and_holds_at_the_stop() -> None:
    law = ProportionalIntegral(GAINS, alpha_trim_rad=0.1, elevator_trim_rad=-0.02, control_hz=100)

    def demand(*, hold: bool) -> float:
        return law.demand(AT_TRIM, q_ref_rad_s=0.1, elevator_rad=-0.02, hold=hold)

    first = demand(hold=False)
    assert demand(hold=False) - first == pytest.approx(-3.0 * 0.1 / 100)
    second = demand(hold=True)
    assert demand(hold=True) == pytest.approx(second)


@pytest.mark.parametrize(("feedback", "fed"), [("effective", 0.25 * -0.08), ("position", -0.08)])
def test_the_correction_multiplies_the_whole_deflection_trim_included(feedback: str, fed: float) -> None:
    adaptation = Adaptation(enabled=True, estimator=0, floor=0.08, feedback=feedback, min_rad=-0.4, max_rad=0.4)
    effectiveness_used = adaptation.effectiveness_used(0.25)
    assert adaptation.position_feedback(-0.08, effectiveness_used) == pytest.approx(fed)
    assert adaptation.command(-0.02, effectiveness_used) == pytest.approx(
        -0.08
    )  # K x -0.08 = -0.02, the trim that is needed


def test_floor_stops_and_off_switch() -> None:
    adaptation = Adaptation(enabled=True, estimator=0, floor=0.08, feedback="effective", min_rad=-0.4, max_rad=0.4)
    assert adaptation.effectiveness_used(0.01) == 0.08
    assert adaptation.command(0.2, 0.08) == 0.4
    assert adaptation.command(-0.2, 0.08) == -0.4
    off = Adaptation(enabled=False, estimator=0, floor=0.08, feedback="effective", min_rad=-0.4, max_rad=0.4)
    assert off.effectiveness_used(0.2) == 1.0
