"""Pseudo-random binary sequence, of zero mean."""

from __future__ import annotations

import numpy as np

from flightbed.command.base import Command, Vector
from flightbed.command.pulses import pulses


def inverse_repeat(register_bits: int) -> Vector:
    """Return the signs of one inverse-repeat sequence, (2 (2^n - 1),) of +1 and -1.

    A maximum-length sequence of L = 2^n - 1 bits, twice, with every second bit of the whole turned over; so the second half is the
    first upside down. The mean is exactly zero, where a plain maximum-length sequence leaves 1/L, which for a pitch rate adds up. The
    spectrum has odd lines only, all equal but for the roll-off of held bits and a weak line L, and what even orders of the aircraft's
    nonlinearity answer falls between them. A random telegraph has none of this for sure in one short record, which is all that a
    flight has.

    Source:
        Godfrey, Perturbation Signals for System Identification (1993), ch. 1; the feedback taps are scipy's.
    """
    from scipy.signal import max_len_seq  # slow to import

    bits, _ = max_len_seq(register_bits)
    twice = np.tile(2.0 * bits - 1.0, 2)
    twice[1::2] *= -1.0
    return twice


def prbs(
    *, amplitude_rad_s: float, switch_s: float, register_bits: int, seed: int, count: int, start_s: float = 0.0
) -> Command:
    """Fly ``count`` inverse-repeat sequences of +-amplitude, then nothing; each lasts 2 (2^n - 1) switch_s.

    Args:
        amplitude_rad_s: height of the pulses.
        switch_s: the sign may change every switch_s.
        register_bits: n, length of the shift register.
        seed: bits by which the sequence is turned round; seeds that differ by less than 2 (2^n - 1) give different commands, each with the
            same spectrum.

    """
    signs = inverse_repeat(register_bits)
    return pulses(
        np.roll(signs, -(seed % len(signs))),
        amplitude_rad_s=amplitude_rad_s,
        period_s=len(signs) * switch_s,
        count=count,
        start_s=start_s,
    )
