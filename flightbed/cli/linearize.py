"""The command `flightbed linearize`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from flightbed.cli.app import Flag
from flightbed.cli.completion import AircraftName
from flightbed.cli.condition import ConditionOptions, deliver


def linearize(
    aircraft: AircraftName,
    /,
    *,
    condition: ConditionOptions | None = None,
    format_: Annotated[Literal["table", "json", "csv", "parquet", "npz", "mat"], Parameter(name="--format")] = "table",
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    part: Literal["full", "longitudinal", "lateral", "short-period"] = "full",
    actuator: Flag = False,
    control_hz: float | None = None,
    validate: Flag = False,
    picture: Path | None = None,
) -> None:
    """Trim and linearize the rigid-body motion: matrices, modes, short period, discrete model.

    Args:
        format_: table for reading; json, csv or parquet (one row per condition), npz or mat (a single condition) for programs.
        output: File to write instead of stdout; required for parquet, npz and mat.
        part: States of the model.
        actuator: Add the elevator's actuator as a state; the input is then the elevator command.
        control_hz: Sampling rate of the discrete model in json, npz and mat, Hz. Default: 100.
        validate: Fly small doublets with the nonlinear aircraft at 200 and 400 Hz and report the error of the model; in json, and in
            the table of a single condition.
        picture: File for the stability map of a sweep, png, svg or pdf.

    """
    from flightbed.models.survey import sweep

    plane, queries = sweep.read_conditions(aircraft, condition or ConditionOptions())
    options = sweep.ModelOptions(part, actuator, control_hz, validate)
    deliver(sweep.linearize_all(plane, queries, format_, output, options, picture), output)
