"""The signals of the loop, one value per control tick. SI and radians; only Truth is free of noise.

Signs: body axes forward-right-down; alpha, theta, q positive nose up; elevator positive trailing edge down;
nz is 1 in level flight.

They are named tuples, not dataclasses: equally immutable and faster to create; a flight creates four at every tick.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import NamedTuple


class Fault(NamedTuple):
    """Fault of an actuator or its surface, in addition to the effectiveness.

    Attributes:
        stuck: the actuator stays at its position.
        hardover_rad: the actuator runs to this position or to the stop before it, whatever the command; nan: it follows the command.
        floats: the surface is detached from its actuator and floats in the airstream; the position feedback is at the actuator and
            does not show this.
        bias_rad: deflection that acts in addition to the actuator's position; absent from the position feedback.
        rate_share: remaining share of the actuator's rate limit.

    """

    stuck: bool = False
    hardover_rad: float = nan
    floats: bool = False
    bias_rad: float = 0.0
    rate_share: float = 1.0


NO_FAULT = Fault()
SURFACES = ("elevator", "aileron", "rudder")


class Health(NamedTuple):
    """Health of the aircraft at a tick, the value that failures change. The default is the aircraft as built.

    Attributes:
        effectiveness: K, remaining share of the elevator's pitching moment; scales M_delta.
        elevator_force: remaining share of the elevator's lift and drag; scales Z_delta.
        cg_shift_cbar: shift of the c.g. aft of its take-off position, mean chords.
        aileron, rudder: remaining share of the moments and forces of the surface.
        faults: faults of the actuators of elevator, aileron and rudder.

    """

    effectiveness: float = 1.0
    elevator_force: float = 1.0
    cg_shift_cbar: float = 0.0
    aileron: float = 1.0
    rudder: float = 1.0
    faults: tuple[Fault, Fault, Fault] = (NO_FAULT, NO_FAULT, NO_FAULT)


HEALTHY = Health()


class Truth(NamedTuple):
    """True state of the plant. Available to sensors and trace, never to a law or an estimator.

    Attributes:
        elevator_mean_rad: mean elevator deflection over the control period that ends at this tick.
        effectiveness, elevator_force, cg_shift_cbar: the Health from this tick on.
        gust_up_m_s: vertical speed of the air in the scenario's gusts, up positive; alpha and airspeed include it.
        lift_n, drag_n, thrust_n: aerodynamic force up and aft in wind axes, and thrust of the engines along the fuselage; nan if the
            plant computes no forces.
        elevator_offset_rad: deflection that acts in addition to effectiveness x elevator, when the surface is biased or floats.

    """

    alpha_rad: float
    q_rad_s: float
    theta_rad: float
    phi_rad: float
    psi_rad: float
    airspeed_m_s: float
    mach: float
    altitude_m: float
    north_m: float
    east_m: float
    nz_g: float
    elevator_rad: float
    elevator_mean_rad: float
    effectiveness: float
    elevator_force: float = 1.0
    cg_shift_cbar: float = 0.0
    gust_up_m_s: float = 0.0
    lift_n: float = nan
    drag_n: float = nan
    thrust_n: float = nan
    elevator_offset_rad: float = 0.0


class LateralTruth(NamedTuple):
    """True state of roll and yaw, in a flight with commanded aileron and rudder.

    Attributes:
        beta_rad: sideslip, positive for airflow from the right.
        p_rad_s, r_rad_s: roll rate, right wing down positive; yaw rate, nose right positive.
        aileron_rad, rudder_rad: positions of the actuators; the ``_mean_`` fields are means over the control period that ends here.
        aileron_effectiveness, rudder_effectiveness, aileron_offset_rad, rudder_offset_rad: as for the elevator.

    """

    beta_rad: float
    p_rad_s: float
    r_rad_s: float
    aileron_rad: float
    rudder_rad: float
    aileron_mean_rad: float
    rudder_mean_rad: float
    aileron_effectiveness: float = 1.0
    rudder_effectiveness: float = 1.0
    aileron_offset_rad: float = 0.0
    rudder_offset_rad: float = 0.0


class LateralMeasurement(NamedTuple):
    """Sensor readings of roll and yaw; fields as in LateralTruth."""

    beta_rad: float
    p_rad_s: float
    r_rad_s: float
    aileron_rad: float
    rudder_rad: float
    aileron_mean_rad: float
    rudder_mean_rad: float


class LateralSample(NamedTuple):
    """Roll and yaw at one control tick."""

    p_cmd_rad_s: float
    p_ref_rad_s: float
    beta_cmd_rad: float
    beta_ref_rad: float
    truth: LateralTruth
    measurement: LateralMeasurement
    aileron_cmd_rad: float = nan
    rudder_cmd_rad: float = nan


class Measurement(NamedTuple):
    """The sensors' readings, the only measurements of the flight computer.

    Attributes:
        elevator_rad: surface position feedback at this tick.
        elevator_mean_rad: reading of the same transducer, averaged over the control period that ends at this tick.
        mach, altitude_m: from the air data computer.
        theta_rad, phi_rad: from the attitude reference.
        nz_g: from the accelerometer at the c.g.; 1 in level flight.

    """

    alpha_rad: float
    q_rad_s: float
    elevator_rad: float
    elevator_mean_rad: float
    mach: float = nan
    altitude_m: float = nan
    theta_rad: float = nan
    phi_rad: float = nan
    nz_g: float = nan


class Estimate(NamedTuple):
    """Estimate at one tick.

    Attributes:
        effectiveness: K-hat after the bounds.
        effectiveness_std: standard deviation of K-hat, from the filter's covariance.
        effectiveness_smoothed: ``effectiveness`` after first-order smoothing.
        effectiveness_raw: K-hat before the bounds.
        alpha_rad, q_rad_s: estimated state.
        nis: normalized innovation squared; chi-square with one degree of freedom per measurement (2) if the model holds; nan without
            innovation.
        alarms: number of changes of K declared so far; for a reconstruction, number of deviations declared that no K explains.
        innovation_alpha_rad, innovation_q_rad_s: readings minus their predictions; the ``_std`` fields hold their predicted standard
            deviations. nan for an estimator that does not predict them, 0 at tick 0.
        reconstructed_rad: reconstructed unknown input: of the elevator, the acting deflection, which is K times position plus any offset;
            of a gust, the angle of attack that it adds. This field and the following ones are nan without a reconstruction.
        reconstructed_std_rad: standard deviation of the reconstruction due to sensor noise; excludes its lag.
        offset_rad, offset_std_rad: deflection that acts in addition to K times position, and its standard deviation.
        verdict: 0: K explains the acting deflection; 1: it does not follow the position; 2: it does not follow the command.

    """

    effectiveness: float
    effectiveness_std: float
    effectiveness_smoothed: float
    effectiveness_raw: float
    alpha_rad: float
    q_rad_s: float
    nis: float
    alarms: float = 0.0
    innovation_alpha_rad: float = nan
    innovation_q_rad_s: float = nan
    innovation_alpha_std_rad: float = nan
    innovation_q_std_rad_s: float = nan
    reconstructed_rad: float = nan
    reconstructed_std_rad: float = nan
    offset_rad: float = nan
    offset_std_rad: float = nan
    verdict: float = nan


NOTHING_RECONSTRUCTED = (nan,) * 5  # last fields of an Estimate without reconstruction


class LoadFactorSample(NamedTuple):
    """Load factor at one control tick, in a flight commanded in g.

    Attributes:
        nz_cmd_g, nz_ref_g: commanded load factor, and the reference after the prefilter; both include the load factor of
            unaccelerated flight at the measured attitude, cos theta cos phi.
        throttle_norm: throttle command; nan without an autothrottle.
        model_a_0, model_a_1, model_b_0, model_b_1: identified model, as ``Plid.parameters``; nan for a law without identification.

    """

    nz_cmd_g: float
    nz_ref_g: float
    throttle_norm: float = nan
    model_a_0: float = nan
    model_a_1: float = nan
    model_b_0: float = nan
    model_b_1: float = nan


class Sample(NamedTuple):
    """All signals of one control tick, for the recorder.

    ``lateral`` is None unless aileron and rudder are commanded, ``load_factor`` is None unless the flight is commanded in g.
    """

    tick: int
    q_cmd_rad_s: float
    q_ref_rad_s: float
    truth: Truth
    measurement: Measurement
    estimates: tuple[Estimate, ...]
    elevator_cmd_rad: float
    lateral: LateralSample | None = None
    load_factor: LoadFactorSample | None = None


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of white Gaussian noise, one draw per tick. In order: rad, rad/s, rad, 1, m, rad, rad, g."""

    alpha_rad: float
    q_rad_s: float
    elevator_rad: float = 0.0
    mach: float = 0.0
    altitude_m: float = 0.0
    theta_rad: float = 0.0
    phi_rad: float = 0.0
    nz_g: float = 0.0


@dataclass(frozen=True)
class LateralNoise:
    """Standard deviations of white Gaussian noise, one draw per tick. In order: rad, rad/s, rad/s, rad, rad."""

    beta_rad: float
    p_rad_s: float
    r_rad_s: float
    aileron_rad: float = 0.0
    rudder_rad: float = 0.0
