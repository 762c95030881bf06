"""Tables of flights commanded in load factor (g): online identification and autothrottle."""

from __future__ import annotations

from typing import Annotated, Literal

from flightbed.settings.base import NonNegative, Positive, Settings, Share, between


class Identification(Settings):
    """Online identification of the law nz-adaptive: PLID's prior and noise variances (g^2), and filters of gains and command (rad/s).

    Kemp's thesis uses prior = "thesis", prior_var = 1 and neither filter.
    """

    prior: Literal["linearization", "thesis"] = "linearization"
    prior_var: Positive = 1e-3
    process_var: Positive = 0.01
    output_var: NonNegative = 1e-8
    block_fade: Annotated[float, between(1, 2)] = 1.001
    form: Literal["factored", "plain"] = "factored"
    precision: Literal["double", "single"] = "double"
    patience: Annotated[int, between(0, 100000)] = 0
    gain_filter_rad_s: NonNegative = 5.0
    command_filter_rad_s: NonNegative = 0.0


class Autothrottle(Settings):
    """Bang-bang autothrottle of flights commanded in g; it holds the initial true airspeed.

    With then_fps > 0 it holds then_fps (ft/s) from then_at_s on. Throttle settings are normalized, 0 to 1.
    """

    enabled: bool = False
    low_norm: Share = 0.1
    high_norm: Share = 1.0
    then_fps: NonNegative = 0.0
    then_at_s: NonNegative = 0.0
