"""The row of one control tick: its layout, width and packing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain, islice
from struct import Struct
from typing import TypeVar

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

T = TypeVar("T", Truth, Measurement, Estimate, LateralTruth, LateralMeasurement, LoadFactorSample)

# column -> (field, factor from SI)
FLOWN_FIELDS = ("tick", "q_cmd_rad_s", "q_ref_rad_s", "elevator_cmd_rad")


# Fields of a flight with commanded aileron and rudder, after all others.
LATERAL_FIELDS = (
    *(name for name in LateralSample._fields if name not in ("truth", "measurement")),
    *LateralTruth._fields,
    *(f"{name}/measured" for name in LateralMeasurement._fields),
)


_ROW = (*FLOWN_FIELDS, *Truth._fields, *Measurement._fields)


LEADING = len(FLOWN_FIELDS)  # numbers of a row before Truth, Measurement and Estimates


def row_width(estimators: int, *, lateral: bool = False, load_factor: bool = False) -> int:
    """Return the number of floats in a row of a flight with this number of estimates."""
    optional = (len(LATERAL_FIELDS) if lateral else 0) + (len(LoadFactorSample._fields) if load_factor else 0)
    return len(_ROW) + estimators * len(Estimate._fields) + optional


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

    tick, q_cmd, q_ref, elevator_cmd = islice(numbers, LEADING)
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
