"""Units and conversion factors: ``flightbed.core.units`` under its public name."""

from flightbed.core.units import *  # noqa: F403
