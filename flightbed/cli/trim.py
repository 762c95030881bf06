"""The command `flightbed trim`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from flightbed.cli.completion import AircraftName
from flightbed.cli.condition import ConditionOptions, deliver


def trim(
    aircraft: AircraftName,
    /,
    *,
    condition: ConditionOptions | None = None,
    format_: Annotated[Literal["table", "json", "csv", "parquet"], Parameter(name="--format")] = "table",
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
) -> None:
    """Find steady flight (level, climb, pull-up, turn): angle of attack and controls.

    Args:
        format_: table for reading; json, csv or parquet for programs.
        output: File to write instead of stdout; required for parquet.

    """
    from flightbed.models.survey import sweep

    plane, queries = sweep.read_conditions(aircraft, condition or ConditionOptions())
    deliver(sweep.trim_all(plane, queries, format_, output), output)
