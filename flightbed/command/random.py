"""Pseudo-random binary sequence with zero mean."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from flightbed.command.base import Command, Count, Vector
from flightbed.command.pulses import pulse_conflicts, pulses
from flightbed.config.kinds import ShapedCommand, Surroundings
from flightbed.config.table import NonNegative, Positive, between


def inverse_repeat(register_bits: int) -> Vector:
    """Return the signs of one inverse-repeat sequence, (2 (2^n - 1),) of +1 and -1.

    A maximum-length sequence of L = 2^n - 1 bits is repeated once and every second bit of the result inverted; the second half is
    therefore the negative of the first. The mean is exactly zero; a plain maximum-length sequence has the mean 1/L, which a pitch rate
    integrates. The spectrum has odd lines only, equal except for the roll-off of held bits and a weak line L; the aircraft's
    even-order nonlinearities respond between these lines. A random telegraph signal guarantees none of this in one short record.

    Source:
        Godfrey, Perturbation Signals for System Identification (1993), ch. 1; feedback taps from scipy.
    """
    from scipy.signal import max_len_seq  # slow to import

    bits, _ = max_len_seq(register_bits)
    twice = np.tile(2.0 * bits - 1.0, 2)
    twice[1::2] *= -1.0
    return twice


def prbs(
    *, amplitude_rad_s: float, switch_s: float, register_bits: int, seed: int, count: int, start_s: float = 0.0
) -> Command:
    """Fly ``count`` inverse-repeat sequences of +-amplitude; zero before and after. Each lasts 2 (2^n - 1) switch_s.

    Args:
        amplitude_rad_s: height of the pulses.
        switch_s: duration of one bit.
        register_bits: n, length of the shift register.
        seed: cyclic shift of the sequence, bits; seeds that differ by less than 2 (2^n - 1) give different commands with the same
            spectrum.
        count: number of sequences.
        start_s: start of the command.

    """
    signs = inverse_repeat(register_bits)
    return pulses(
        np.roll(signs, -(seed % len(signs))),
        amplitude_rad_s=amplitude_rad_s,
        period_s=len(signs) * switch_s,
        count=count,
        start_s=start_s,
    )


class PseudoRandom(ShapedCommand):
    """A pseudo-random binary sequence of zero mean that switches at most every switch_s, count times."""

    kind: Literal["random"] = "random"
    count: Count = 3
    """Number of sequences; each lasts 2 (2^register_bits - 1) switch_s."""
    start_s: NonNegative = 0.0
    """Start."""
    switch_s: Positive = 0.3
    """Shortest time between two changes of sign."""
    register_bits: Annotated[int, between(2, 12)] = 4
    """Length of the shift register."""
    seed: Annotated[int, between(0, 2**63 - 1)] = 0
    """Cyclic shift of the sequence, in bits."""

    def build(self, amplitude_rad_s: float) -> Command:
        """Return the command over time."""
        return prbs(
            amplitude_rad_s=amplitude_rad_s,
            switch_s=self.switch_s,
            register_bits=self.register_bits,
            seed=self.seed,
            count=self.count,
            start_s=self.start_s,
        )

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:
        """Return the problem of pulses shorter than a tick."""
        return pulse_conflicts(f"{place}.switch_s", self.switch_s, pulses=1, control_hz=surroundings.control_hz)
