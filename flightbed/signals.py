"""The values that flow through the loop, one per control tick. SI and radians; what is noise-free is only in Truth.

Signs: body axes forward-right-down; alpha, theta, q positive nose up; elevator positive trailing edge down;
nz is 1 in level flight.

They are named tuples, not dataclasses: immutable all the same, and a flight makes four of them at every tick.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple


class Health(NamedTuple):
    """What is left of the aircraft at a tick: the value that failures change. The default is the aircraft as built.

    Attributes:
        effectiveness: K, share of the elevator's pitching moment that still acts; scales M_delta.
        elevator_force: share of the elevator's lift and drag that still acts; scales Z_delta.
        cg_shift_cbar: how far the c.g. lies aft of where it was at take-off, mean chords.

    """

    effectiveness: float = 1.0
    elevator_force: float = 1.0
    cg_shift_cbar: float = 0.0


HEALTHY = Health()


class Truth(NamedTuple):
    """What the plant knows. Goes to sensors and trace, never to a law or an estimator.

    Attributes:
        elevator_mean_rad: mean deflection that moved the aircraft over the control period that ends at this tick.
        effectiveness, elevator_force, cg_shift_cbar: the Health from this tick on.
        gust_up_m_s: vertical speed of the air in the scenario's gusts, up positive; alpha and airspeed include it.
        lift_n, drag_n, thrust_n: aerodynamic force up and aft, in wind axes, and of the engines along the fuselage; nan if the plant has
            no forces.

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


class Measurement(NamedTuple):
    """What the flight computer knows: the sensors' readings.

    Attributes:
        elevator_rad: surface position feedback at this tick.
        elevator_mean_rad: the same transducer, averaged over the control period that ends at this tick.
        mach, altitude_m: air data computer.
        theta_rad, phi_rad: attitude reference.

    """

    alpha_rad: float
    q_rad_s: float
    elevator_rad: float
    elevator_mean_rad: float
    mach: float = nan
    altitude_m: float = nan
    theta_rad: float = nan
    phi_rad: float = nan


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
        alarms: how many changes of K have been declared so far.
        innovation_alpha_rad, innovation_q_rad_s: readings less what the estimator had predicted of them, and their standard deviations
            as it believes them; nan for an estimator that does not predict them, 0 at tick 0.

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


class Sample(NamedTuple):
    """All of one control tick, as the recorder sees it."""

    tick: int
    q_cmd_rad_s: float
    q_ref_rad_s: float
    truth: Truth
    measurement: Measurement
    estimates: tuple[Estimate, ...]
    elevator_cmd_rad: float
