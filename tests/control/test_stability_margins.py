"""Stability margins in K: against eigenvalues of independent matrices, against Sillence's boundary, and in flight."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete

from flightbed.analysis.result import fly_plan
from flightbed.avionics.lateral import LateralDirectional
from flightbed.avionics.short_period import ShortPeriod
from flightbed.control.base import Gains
from flightbed.control.design import design_integral, design_proportional
from flightbed.control.redesign import PitchWeights, pitch_lq
from flightbed.control.roll_yaw import RollYaw, RollYawWeights
from flightbed.control.stability_margins import lateral_margin, pitch_margins
from flightbed.core.units import DEG
from flightbed.flight.plan import plan
from flightbed.scenario.reading import load_scenario


def _radius(design: ShortPeriod, gains: Gains, K: float, believed: float, *, corrected: bool, effective: bool) -> float:
    """Spectral radius of the sampled loop of (alpha, q, position, integral), built without the state of the effective deflection."""
    A, b = design.with_actuator(K)
    Ad, Bd, *_ = cont2discrete((A, b[:, None], np.eye(3), np.zeros((3, 1))), 0.01)
    feedback = np.array([gains.alpha, gains.q, gains.elevator * (believed if effective else 1.0), gains.integral])
    M = np.zeros((4, 4))
    M[:3, :3] = Ad
    M[3, 1], M[3, 3] = -0.01, 1.0
    M[:3] += Bd @ feedback[None, :] / (believed if corrected else 1.0)
    return float(np.max(np.abs(np.linalg.eigvals(M if gains.integral else M[:3, :3]))))


@pytest.mark.parametrize(("corrected", "effective"), [(True, True), (True, False), (False, False)])
@pytest.mark.parametrize("law", ["proportional", "integral"])
def test_the_loop_is_stable_inside_and_not_outside(
    design: ShortPeriod, law: str, corrected: bool, effective: bool
) -> None:
    gains = design_proportional(design) if law == "proportional" else design_integral(design)
    found = pitch_margins(design, lambda _K: gains, control_hz=100, corrected=corrected, effective=effective)
    checked = 0
    for believed, low, high in zip(found.effectiveness_used, found.low, found.high, strict=True):

        def radius(K: float, believed: float = believed) -> float:
            return _radius(design, gains, K, believed, corrected=corrected, effective=effective)

        if np.isnan(low):
            assert radius(believed) >= 1.0
            continue
        assert max(radius(K) for K in np.linspace(1.001 * low, 0.999 * high, 200)) < 1.0
        assert radius(0.995 * low) > 1.0 or low == 0.0
        assert radius(1.005 * high) > 1.0
        checked += 1
    assert checked >= 10


def test_a_redesigned_law_has_separate_margins_for_every_k(design: ShortPeriod) -> None:
    weights = PitchWeights(3.0 * DEG, 3.0 * DEG, 3.0 * DEG)

    def gains(K: float) -> Gains:
        return pitch_lq(design, weights, control_hz=100, effectiveness=K)

    found = pitch_margins(design, gains, control_hz=100, corrected=False, effective=False)
    assert np.all(found.low < found.effectiveness_used)
    assert np.all(found.high > found.effectiveness_used)
    for believed, low, high in zip(found.effectiveness_used, found.low, found.high, strict=True):
        inside, outside = (
            _radius(design, gains(believed), K, believed, corrected=False, effective=False)
            for K in (1.01 * low, 0.99 * low)
        )
        assert inside < 1.0 < outside
        assert _radius(design, gains(believed), 0.99 * high, believed, corrected=False, effective=False) < 1.0


def test_sillence_s_boundary() -> None:
    """Sillence's linear aircraft, law and actuator reach the stability boundary near K = 0.08 (S Table 2); sampling hardly changes it."""
    planned = plan(load_scenario("thesis-loss", ["adaptation.enabled=false"]))
    assert planned.margins is not None
    low, _ = planned.margins.at(np.ones(1))
    assert low[0] == pytest.approx(0.08, abs=0.002)


@pytest.mark.parametrize(("left", "kept"), [(0.04, False), (0.5, True)])
def test_the_trace_shows_whether_a_loss_is_inside(left: float, kept: bool) -> None:
    """Without correction, on the linear aircraft."""
    scenario = load_scenario("thesis-loss", ["adaptation.enabled=false", f"failures.0.to={left}", "duration_s=30"])
    trace, metrics = fly_plan(plan(scenario))
    inside = trace["effectiveness_stable_min"][-1] < left < trace["effectiveness_stable_max"][-1]
    assert inside == kept
    assert metrics.departed != kept


def _unstable() -> LateralDirectional:
    """Roll and yaw of an aircraft that needs both surfaces: directionally unstable, a slow roll."""
    found = plan(load_scenario("aileron-loss")).lateral
    assert found is not None
    A = found.A.copy()
    A[2, 0] = -6.0
    return LateralDirectional(A, found.B, found.gravity, found.alpha_trim_rad, found.actuators_rad_s, found.tables)


def test_aileron_and_rudder_together() -> None:
    design = _unstable()
    weights = RollYawWeights(2.0 * DEG, 20.0 * DEG, 10.0 * DEG, 10.0 * DEG, 10.0 * DEG)
    law = RollYaw(design, weights, control_hz=100)
    found = lateral_margin(law, design, control_hz=100)
    assert 0.1 < found < 1.0

    def radius(ratios: tuple[float, float]) -> float:
        """Return the loop of (beta, p, r, positions) at the given K; the law uses K-hat = 1."""
        A, B = design.with_actuators(ratios)
        Ad, Bd, *_ = cont2discrete((A, B, np.eye(5), np.zeros((5, 2))), 0.01)
        return float(np.max(np.abs(np.linalg.eigvals(Ad - Bd @ law.F))))

    box = np.linspace(-1.0, 1.0, 41)
    inside = [radius((1 + 0.99 * found * a, 1 + 0.99 * found * b)) for a in box for b in box]
    outside = [radius((1 + 1.02 * found * a, 1 + 1.02 * found * b)) for a in box for b in box]
    assert max(inside) < 1.0 < max(outside)


def test_the_f16_s_roll_and_yaw_are_stable_at_any_effectiveness() -> None:
    """The open-loop modes are stable at Mach 0.8, and the law adds damping."""
    planned = plan(load_scenario("aileron-loss"))
    assert planned.lateral is not None
    weights = RollYawWeights(2.0 * DEG, 20.0 * DEG, 10.0 * DEG, 10.0 * DEG, 10.0 * DEG)
    law = RollYaw(planned.lateral, weights, control_hz=100)
    assert lateral_margin(law, planned.lateral, control_hz=100) == 1.0
