"""Printed data of Kemp (1987): plants, noises, settings, and numbers that the text claims; no value in this module is computed."""

from __future__ import annotations

from types import MappingProxyType

# S 3.2: plant -> coefficients of the transfer function's denominator and numerator, highest power first.
TRANSFER_FUNCTIONS = MappingProxyType(
    {
        "A": ((1.0, -1.8, 1.3, -0.4), (-1.8, 1.3, -0.4)),
        "B": ((1.0, -1.0, 2.0, -3.0), (-3.0, 2.0, -1.0)),
        "C": ((1.0, -1.8, 1.3, -0.4), (1.5, -2.0, -0.5)),
        "D": ((1.0, -2.5, 3.0, -1.0), (-1.0, -2.5, 3.0)),
        "F": ((1.0, -1.7692, 0.7826), (-0.1025, 0.15)),  # S 5.4
    }
)

# S 3.2: case -> (r, q). The list prints q = 0.01 for both cases 4 and 5; according to S 3.3 case 5 has 10 % of the input's power.
NOISES = MappingProxyType(
    {1: (0.0, 0.0), 2: (0.005, 0.0), 3: (0.01, 0.0), 4: (0.0, 0.01), 5: (0.0, 0.1), 6: (0.005, 0.005), 7: (0.01, 0.01)}
)
NOISE_WORDS = MappingProxyType(
    {
        1: "no noise", 2: "low measurement noise", 3: "moderate measurement noise", 4: "moderate process noise",
        5: "high process noise", 6: "low measurement and process noise", 7: "moderate measurement and process noise",
    }
)  # fmt: skip

PRIOR_VAR = 200.0  # eqs (3.5), (5.17)
NOISE_PRIOR_VAR = 10.0  # of c, eq (3.15)
FADE = 1.001  # S 4.4, S 5.4
DEADBEAT = 8  # S 3.3: k at which the estimates of order 3 are exact, counted from k = 0
TRACKING_START = 12  # S 4.4: sample of the initial convergence with fading, "around"
SAMPLES = 150  # last sample in the figures of plant D
B_LOST, B_OUTPUT = 90, 1e20  # S 3.3: the output of plant B exceeds 1e20 by the 90-th sample
D_OUTPUT = 1e15  # S 3.3: the output of plant D "did not go much above" this out to 150 samples

# S 4.4, plant E: (1.5 z^2 - beta z - 0.5) / (z^3 - alpha z^2 + 1.5 z - 0.5).
E_FIXED = (1.5, 0.5, 1.5, 0.5)
E_CHANGES = (50, 100, 150)
E_SAMPLES = 200
E_CASES = MappingProxyType(
    {1: (0.0, 0.0), 2: (0.005, 0.0), 3: (0.0, 0.01), 4: (0.0, 0.0)}
)  # noises of 2 and 3 are not printed

# S 5.4: case -> (r, q, whether the filtered output is integrated); case -> closed-loop pole, with all poles at the same place.
ADAPTIVE = MappingProxyType(
    {
        1: (0.0, 0.0, False), 2: (0.005, 0.0, False), 3: (0.001, 0.0001, False), 4: (0.005, 0.0, True), 5: (0.001, 0.0001, True),
    }
)  # fmt: skip
POLE = MappingProxyType({1: 0.5, 2: 0.8, 3: 0.8, 4: 0.8, 5: 0.8})
FIRST_INTEGRAL_GAIN = -0.01
F_SUMS = MappingProxyType(
    {"first": 1.7692, "unstable": 1.9, "last": 1.75}
)  # sum of the poles; unstable: 1.3 and 0.6, last: 0.88 +- 0.13j, with an unchanged product
F_CHANGES = MappingProxyType({1: (150, 250), 2: (200,), 3: (200,), 4: (200,), 5: (200,)})
