"""JSON Schema of campaign files."""

from __future__ import annotations

from typing import Any

from flightbed.campaigns.settings import CampaignSettings
from flightbed.config.schema import schema_of

_DESCRIPTION = (
    "A campaign of flightbed: many flights of one scenario over a grid or with random values. This schema does not state: an axis has "
    "values, or from, to and count, or a distribution with its parameters; limits rise; no key is varied twice; axes of equal length with "
    "combine = 'paired'; the keys and values of the axes fit the base scenario; indices and points exist. `flightbed campaign` checks all "
    "of it."
)


def campaign_schema() -> dict[str, Any]:
    """Return the JSON Schema of a campaign file."""
    return schema_of(CampaignSettings, "flightbed campaign", _DESCRIPTION)
