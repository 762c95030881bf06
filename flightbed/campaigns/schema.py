"""JSON Schema of campaign files."""

from __future__ import annotations

from typing import Any

from flightbed.campaigns.settings import CampaignSettings
from flightbed.config.schema import schema_of

_DESCRIPTION = (
    "A campaign of flightbed: many flights of one scenario over a grid or with random values. This schema does not state: low is below "
    "high, with the mean between them, and min is at most max; no key is varied twice, nor inside another varied key; axes have equal "
    "lengths with combine = 'paired'; the keys and values of the axes fit the base scenario, and the metrics are columns; indices and "
    "points exist; numbers are finite, and whole numbers have no decimal point. `flightbed campaign` checks all of it."
)


def campaign_schema() -> dict[str, Any]:
    """Return the JSON Schema of a campaign file."""
    return schema_of(CampaignSettings, "flightbed campaign", _DESCRIPTION)
