"""The values that flow through the loop, one per control tick. SI and radians; what is noise-free is only in Truth.

Signs: body axes forward-right-down; alpha, theta, q positive nose up; elevator positive trailing edge down;
nz is 1 in level flight.

They are named tuples, not dataclasses: immutable all the same, and a flight makes four of them at every tick.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple


class Fault(NamedTuple):
    """What is wrong between the command to a surface and the deflection that acts, beside its effectiveness.

    Attributes:
        stuck: the actuator stays where it is.
        driven_to_rad: the actuator goes there, or to the stop before it, whatever is commanded; nan if it does as it is told.
        floats: the surface has come off its actuator and trails in the stream; the position feedback, which is at the actuator, does not
            show it.
        bias_rad: deflection that acts beside the actuator's; the position feedback does not show it.
        rate_share: share of the actuator's rate limit that is left.

    """

    stuck: bool = False
    hardover_rad: float = nan
    floats: bool = False
    bias_rad: float = 0.0
    rate_share: float = 1.0


NO_FAULT = Fault()
SURFACES = ("elevator", "aileron", "rudder")


class Health(NamedTuple):
    """What is left of the aircraft at a tick: the value that failures change. The default is the aircraft as built.

    Attributes:
        effectiveness: K, share of the elevator's pitching moment that still acts; scales M_delta.
        elevator_force: share of the elevator's lift and drag that still acts; scales Z_delta.
        cg_shift_cbar: how far the c.g. lies aft of where it was at take-off, mean chords.
        aileron, rudder: share of all that the surface does that still acts.
        faults: of the actuators of elevator, aileron and rudder.

    """

    effectiveness: float = 1.0
    elevator_force: float = 1.0
    cg_shift_cbar: float = 0.0
    aileron: float = 1.0
    rudder: float = 1.0
    faults: tuple[Fault, Fault, Fault] = (NO_FAULT, NO_FAULT, NO_FAULT)


HEALTHY = Health()


class Truth(NamedTuple):
    """What the plant knows. Goes to sensors and trace, never to a law or an estimator.

    Attributes:
        elevator_mean_rad: mean deflection that moved the aircraft over the control period that ends at this tick.
        effectiveness, elevator_force, cg_shift_cbar: the Health from this tick on.
        gust_up_m_s: vertical speed of the air in the scenario's gusts, up positive; alpha and airspeed include it.
        lift_n, drag_n, thrust_n: aerodynamic force up and aft, in wind axes, and of the engines along the fuselage; nan if the plant has
            no forces.
        elevator_offset_rad: deflection that acts beside effectiveness x elevator, of a surface that is biased or floats.

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
    """What the plant knows of roll and yaw, in a flight whose aileron and rudder are commanded.

    Attributes:
        beta_rad: sideslip, positive when the air comes from the right.
        p_rad_s, r_rad_s: roll rate, right wing down positive; yaw rate, nose right positive.
        aileron_rad, rudder_rad: positions of the actuators; the _mean_ over the control period that ends at this tick.
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
    """What the flight computer knows of roll and yaw: fields as in LateralTruth, read."""

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
    """What the flight computer knows: the sensors' readings.

    Attributes:
        elevator_rad: surface position feedback at this tick.
        elevator_mean_rad: the same transducer, averaged over the control period that ends at this tick.
        mach, altitude_m: air data computer.
        theta_rad, phi_rad: attitude reference.
        nz_g: accelerometer at the c.g.; 1 in level flight.

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
    """What an estimator says at a tick.

    Attributes:
        effectiveness: K-hat after the bounds.
        effectiveness_std: its standard deviation, from the filter's covariance.
        effectiveness_smoothed: first-order smoothing of ``effectiveness``.
        effectiveness_raw: K-hat before the bounds.
        alpha_rad, q_rad_s: the state.
        nis: normalized innovation squared; chi-square with as many degrees of freedom as measurements (2) if the model holds; nan where
            there is no innovation.
        alarms: how many changes of K have been declared so far; of an estimator that reconstructs, how often what no K explains.
        innovation_alpha_rad, innovation_q_rad_s: readings less what the estimator had predicted of them, and their standard deviations
            as it believes them; nan for an estimator that does not predict them, 0 at tick 0.
        reconstructed_rad: what an unknown input is found to be; of an elevator the deflection that acts, K times position and all that is
            beside it; of a gust the angle of attack that it adds. nan, as all that follows, for an estimator that reconstructs none.
        reconstructed_std_rad: its standard deviation by the sensors' noise; how fast it follows is not in it.
        offset_rad, offset_std_rad: deflection that acts beside K times position, and its standard deviation.
        verdict: 0 if K explains what acts; 1 if what acts does not follow the position, 2 if it does not follow the command.

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


NOTHING_RECONSTRUCTED = (nan,) * 5  # the last fields of an Estimate that reconstructs no input


class LoadFactorSample(NamedTuple):
    """Load factor at one control tick, in a flight that is commanded in g.

    Attributes:
        nz_cmd_g, nz_ref_g: load factor that is asked for, and what the prefilter makes of it: the command plus what level flight has at
            the attitude that is measured, cos theta cos phi.
        throttle_norm: command to the engine; nan where the throttle stays.
        model_a_0, model_a_1, model_b_0, model_b_1: what the law has identified, as ``Plid.parameters``; nan if nothing.

    """

    nz_cmd_g: float
    nz_ref_g: float
    throttle_norm: float = nan
    model_a_0: float = nan
    model_a_1: float = nan
    model_b_0: float = nan
    model_b_1: float = nan


class Sample(NamedTuple):
    """All of one control tick, as the recorder sees it.

    ``lateral`` is there only in a flight whose aileron and rudder are commanded, ``load_factor`` only in one that is commanded in g.
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
