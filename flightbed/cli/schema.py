"""The command `flightbed schema`."""

from __future__ import annotations

import json
from typing import Literal


def schema(file: Literal["scenario", "campaign"] = "scenario", /) -> None:
    """Print the JSON Schema of a file; editors with a TOML language server complete and check files with it.

    Args:
        file: The file: scenario or campaign.

    """
    from flightbed.campaigns.schema import campaign_schema
    from flightbed.scenario.schema import scenario_schema

    print(json.dumps({"scenario": scenario_schema, "campaign": campaign_schema}[file](), indent=2))
