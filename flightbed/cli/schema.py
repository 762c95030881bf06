"""The command `flightbed schema`."""

from __future__ import annotations

from typing import Literal


def schema(file: Literal["scenario", "campaign", "aircraft"] = "scenario", /) -> None:
    """Print the JSON Schema of a file; editors with a TOML language server complete and check files with it.

    Args:
        file: The file: scenario, campaign or aircraft (aircraft.toml).

    """
    print(schema_text(file), end="")


def schema_text(file: Literal["scenario", "campaign", "aircraft"]) -> str:
    """Return the JSON Schema of a file as text, as it is shipped in scenarios/schema/."""
    import json

    from flightbed.aircraft.schema import aircraft_schema
    from flightbed.campaigns.schema import campaign_schema
    from flightbed.scenario.schema import scenario_schema

    made = {"scenario": scenario_schema, "campaign": campaign_schema, "aircraft": aircraft_schema}[file]()
    return json.dumps(made, indent=2) + "\n"
