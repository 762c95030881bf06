"""The row of one control tick: its parts, the columns of the trace that show them, packing and unpacking."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain, islice
from struct import Struct
from types import MappingProxyType
from typing import NamedTuple, TypeVar

from flightbed.core.signals import (
    Estimate,
    LateralMeasurement,
    LateralSample,
    LateralTruth,
    LoadFactorSample,
    Measurement,
    Sample,
    Truth,
)
from flightbed.core.units import conversion, unit_of

T = TypeVar("T", Truth, Measurement, Estimate, LateralTruth, LateralMeasurement, LoadFactorSample)

FLOWN_FIELDS = ("tick", "q_cmd_rad_s", "q_ref_rad_s", "elevator_cmd_rad")
# Of a flight with commanded aileron and rudder.
LATERAL_FIELDS = (
    *(name for name in LateralSample._fields if name not in ("truth", "measurement")),
    *LateralTruth._fields,
    *(f"{name}/measured" for name in LateralMeasurement._fields),
)


class Part(NamedTuple):
    """Consecutive numbers of a row.

    Attributes:
        fields: names of the numbers, SI and radians.
        columns: column of the trace -> index of the field that it shows, and the factor from field to column.

    """

    fields: tuple[str, ...]
    columns: Mapping[str, tuple[int, float]]


def _part(fields: tuple[str, ...], shown: Mapping[str, str]) -> Part:
    """Return a part; ``shown`` gives the field of each column, whose name ends in its unit."""
    columns = {
        column: (fields.index(field), conversion(unit_of(field.removesuffix("/measured")), unit_of(column)))
        for column, field in shown.items()
    }
    return Part(fields, MappingProxyType(columns))


# The parts of a row, in this order; estimates follow one another, and the last two are those of some flights only.
FLOWN = _part(
    FLOWN_FIELDS,
    {
        "q_cmd_deg_s": "q_cmd_rad_s", "q_ref_deg_s": "q_ref_rad_s", "elevator_cmd_deg": "elevator_cmd_rad",
    },
)  # fmt: skip
TRUE = _part(
    Truth._fields,
    {
        "q_deg_s": "q_rad_s", "alpha_deg": "alpha_rad", "theta_deg": "theta_rad", "phi_deg": "phi_rad", "psi_deg": "psi_rad",
        "elevator_deg": "elevator_rad", "mach": "mach", "airspeed_m_s": "airspeed_m_s", "altitude_ft": "altitude_m",
        "north_m": "north_m", "east_m": "east_m", "nz_g": "nz_g", "effectiveness_true": "effectiveness",
        "elevator_force_true": "elevator_force", "cg_shift_cbar": "cg_shift_cbar", "gust_up_fps": "gust_up_m_s",
        "elevator_offset_deg": "elevator_offset_rad", "lift_n": "lift_n", "drag_n": "drag_n", "thrust_n": "thrust_n",
    },
)  # fmt: skip
MEASURED = _part(
    Measurement._fields,
    {
        "q_meas_deg_s": "q_rad_s", "alpha_meas_deg": "alpha_rad", "elevator_meas_deg": "elevator_rad",
        "elevator_mean_meas_deg": "elevator_mean_rad", "mach_meas": "mach", "altitude_meas_ft": "altitude_m",
        "theta_meas_deg": "theta_rad", "phi_meas_deg": "phi_rad", "nz_meas_g": "nz_g",
    },
)  # fmt: skip
ESTIMATED = _part(
    Estimate._fields,
    {
        "effectiveness": "effectiveness", "effectiveness_std": "effectiveness_std", "effectiveness_smoothed": "effectiveness_smoothed",
        "effectiveness_raw": "effectiveness_raw", "alpha_deg": "alpha_rad", "q_deg_s": "q_rad_s", "nis": "nis", "alarms": "alarms",
        "innovation_alpha_deg": "innovation_alpha_rad", "innovation_q_deg_s": "innovation_q_rad_s",
        "innovation_alpha_std_deg": "innovation_alpha_std_rad", "innovation_q_std_deg_s": "innovation_q_std_rad_s",
    },
)  # fmt: skip
_RECONSTRUCTED = _part(
    Estimate._fields,
    {
        "reconstructed_deg": "reconstructed_rad", "reconstructed_std_deg": "reconstructed_std_rad", "offset_deg": "offset_rad",
        "offset_std_deg": "offset_std_rad", "verdict": "verdict",
    },
)  # fmt: skip
# An estimate of an estimator that reconstructs an input; the other ones do not show these columns.
WITH_RECONSTRUCTION = Part(ESTIMATED.fields, MappingProxyType({**ESTIMATED.columns, **_RECONSTRUCTED.columns}))
LATERAL = _part(
    LATERAL_FIELDS,
    {
        "p_cmd_deg_s": "p_cmd_rad_s", "p_ref_deg_s": "p_ref_rad_s", "beta_cmd_deg": "beta_cmd_rad", "beta_ref_deg": "beta_ref_rad",
        "aileron_cmd_deg": "aileron_cmd_rad", "rudder_cmd_deg": "rudder_cmd_rad", "beta_deg": "beta_rad", "p_deg_s": "p_rad_s",
        "r_deg_s": "r_rad_s", "aileron_deg": "aileron_rad", "rudder_deg": "rudder_rad",
        "effectiveness_aileron_true": "aileron_effectiveness", "effectiveness_rudder_true": "rudder_effectiveness",
        "aileron_offset_deg": "aileron_offset_rad", "rudder_offset_deg": "rudder_offset_rad", "beta_meas_deg": "beta_rad/measured",
        "p_meas_deg_s": "p_rad_s/measured", "r_meas_deg_s": "r_rad_s/measured", "aileron_meas_deg": "aileron_rad/measured",
        "rudder_meas_deg": "rudder_rad/measured", "aileron_mean_meas_deg": "aileron_mean_rad/measured",
        "rudder_mean_meas_deg": "rudder_mean_rad/measured",
    },
)  # fmt: skip
IN_G = _part(
    LoadFactorSample._fields,
    {
        "nz_cmd_g": "nz_cmd_g", "nz_ref_g": "nz_ref_g", "throttle_cmd_norm": "throttle_norm", "model_a_0": "model_a_0",
        "model_a_1": "model_a_1", "model_b_0": "model_b_0", "model_b_1": "model_b_1",
    },
)  # fmt: skip


def parts_of(estimators: int, *, lateral: bool = False, load_factor: bool = False) -> list[Part]:
    """Return the parts of a row with this number of estimates, in order: the one definition of the row."""
    optional = [*([LATERAL] if lateral else []), *([IN_G] if load_factor else [])]
    return [FLOWN, TRUE, MEASURED, *([ESTIMATED] * estimators), *optional]


def row_width(estimators: int, *, lateral: bool = False, load_factor: bool = False) -> int:
    """Return the number of floats in a row of a flight with this number of estimates."""
    return sum(len(part.fields) for part in parts_of(estimators, lateral=lateral, load_factor=load_factor))


def row_packer(estimators: int, *, lateral: bool = False, load_factor: bool = False) -> Callable[[Sample], bytes]:
    """Return a function that packs a sample with this number of estimates into a row in the layout of ``from_rows``.

    Packing a whole row takes half the time of appending its numbers to a list.
    """
    pack = Struct(f"{row_width(estimators, lateral=lateral, load_factor=load_factor)}d").pack

    def row(sample: Sample) -> bytes:
        tick, q_cmd, q_ref, truth, measurement, estimates, elevator_cmd, lateral_sample, load_factor_sample = sample
        estimated = chain.from_iterable(estimates)
        in_g = load_factor_sample if load_factor and load_factor_sample is not None else ()
        if lateral_sample is None:
            return pack(tick, q_cmd, q_ref, elevator_cmd, *truth, *measurement, *estimated, *in_g)
        p_cmd, p_ref, beta_cmd, beta_ref, lateral_truth, lateral_reading, aileron_cmd, rudder_cmd = lateral_sample
        commands = p_cmd, p_ref, beta_cmd, beta_ref, aileron_cmd, rudder_cmd
        head = tick, q_cmd, q_ref, elevator_cmd
        return pack(*head, *truth, *measurement, *estimated, *commands, *lateral_truth, *lateral_reading, *in_g)

    return row


def sample_of(row: Sequence[float], estimators: int, *, lateral: bool = False, load_factor: bool = False) -> Sample:
    """Return the sample of a packed row with this number of estimates: the inverse of ``row_packer``."""
    numbers = iter(row)

    def take(kind: type[T]) -> T:
        return kind(*islice(numbers, len(kind._fields)))

    tick, q_cmd, q_ref, elevator_cmd = islice(numbers, len(FLOWN_FIELDS))
    truth, measurement = take(Truth), take(Measurement)
    estimates = tuple([take(Estimate) for _ in range(estimators)])
    turning = None
    if lateral:
        p_cmd, p_ref, beta_cmd, beta_ref, aileron_cmd, rudder_cmd = islice(numbers, 6)
        turning = LateralSample(
            p_cmd, p_ref, beta_cmd, beta_ref, take(LateralTruth), take(LateralMeasurement), aileron_cmd, rudder_cmd
        )
    in_g = take(LoadFactorSample) if load_factor else None
    return Sample(int(tick), q_cmd, q_ref, truth, measurement, estimates, elevator_cmd, turning, in_g)
