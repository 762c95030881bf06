"""The commands `flightbed trim` and `flightbed linearize`: options -> conditions -> text, files and a picture."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from flightbed.aircraft.overlay import Aircraft
from flightbed.core.errors import InputError, NoTrimError
from flightbed.core.files import write_atomic
from flightbed.fdm.stock import StockAircraft
from flightbed.models.survey import formats
from flightbed.models.survey import rows as model_rows
from flightbed.models.survey.condition import (
    MOST,
    Point,
    Query,
    axis,
    find_aircraft,
    linearize_at,
    nearest_feasible,
    queries,
    trim_at,
)

Found = TypeVar("Found")
Plane = Aircraft | StockAircraft
_BINARY = ("npz", "mat", "parquet")


@dataclass(frozen=True)
class ModelOptions:
    """Options of a linear model.

    Attributes:
        part: ``"full"``, ``"longitudinal"``, ``"lateral"`` or ``"short-period"``.
        actuator: whether the elevator's actuator is part of the model.
        control_hz: rate of the discrete model, Hz; None for 100.
        validated: whether the model is compared with the nonlinear aircraft.

    """

    part: str = "full"
    actuator: bool = False
    control_hz: float | None = None
    validated: bool = False


def read_conditions(aircraft: str, condition: Any) -> tuple[Plane, list[Query]]:
    """Return the aircraft and the conditions of a command line. Raises InputError, UnknownNameError, AircraftError."""
    plane = find_aircraft(aircraft)  # first: without an aircraft an error in a condition is irrelevant
    given = [(name, text) for name in ("mach", "tas_fps", "cas_kt") if (text := getattr(condition, name)) is not None]
    if len(given) != 1:
        raise InputError("give exactly one of --mach, --tas-fps and --cas-kt")
    name, text = given[0]
    altitudes = axis(condition.altitude_ft, "--altitude-ft")
    speeds = axis(text, f"--{name.replace('_', '-')}")
    if len(altitudes) * len(speeds) > MOST:
        raise InputError(
            f"sweep: must have at most {MOST} conditions (got {len(altitudes) * len(speeds)}); use larger steps"
        )
    fixed = {
        key: getattr(condition, key)
        for key in ("gamma_deg", "load_factor", "bank_deg", "cg_shift_cbar", "effectiveness", "engine")
    }
    return plane, list(queries(altitudes, name, speeds, **fixed))


def trim_all(plane: Plane, queries: Sequence[Query], format_: str, output: Path | None) -> bytes:
    """Trim at all conditions; return the output. Raises InputError, NoTrimError."""
    _check_format(format_, len(queries), output)
    results: list[dict[str, Any]] = []
    rows: list[dict[str, Any]] = []
    for query, found in _each(plane, queries, lambda query: trim_at(plane, query)):
        if isinstance(found, NoTrimError):
            results.append(_failure(query, found))
            rows.append({**_given(query), "no_trim": str(found)})
        else:
            results.append(model_rows.trim_document(query, *found))
            rows.append({**_given(query), **results[-1]["trim"], "no_trim": ""})
    if format_ == "table":
        lines = ["\n".join(formats.trim_lines(d)) if "trim" in d else d["no_trim"] for d in results]
        return "".join(f"{line}\n" for line in lines).encode()
    if format_ == "parquet":
        return formats.parquet(rows)
    return (formats.json_text(results) if format_ == "json" else formats.csv_text(rows)).encode()


def linearize_all(
    plane: Plane,
    queries: Sequence[Query],
    format_: str,
    output: Path | None,
    options: ModelOptions,
    picture: Path | None,
) -> bytes:
    """Trim and linearize at all conditions; write the picture and return the output. Raises InputError, NoTrimError."""
    one = len(queries) == 1
    matrices = format_ not in ("csv", "parquet") and (format_ != "table" or one)
    if options.validated and (format_ not in ("table", "json") or (format_ == "table" and not one)):
        raise InputError("--validate: needs --format json, or the table of a single condition")
    if options.control_hz is not None and format_ in ("table", "csv", "parquet"):
        raise InputError(f"--control-hz: --format {format_} has no discrete model; use json, npz or mat")
    if (options.part != "full" or options.actuator) and not matrices:
        raise InputError("--part, --actuator: the table of a sweep has no matrices; use --format json")
    hz = 100.0 if options.control_hz is None else options.control_hz
    if not hz > 0.0:
        raise InputError(f"--control-hz: must be above 0 (got {hz:g})")
    _check_format(format_, len(queries), output)
    if picture is not None:
        from flightbed.models.survey.stability_map import check, draw

        check(picture, queries)
    points: list[Point] = []
    results: list[dict[str, Any]] = []
    rows: list[dict[str, Any]] = []
    for query, point in _each(plane, queries, lambda query: linearize_at(plane, query)):
        if isinstance(point, NoTrimError):
            results.append(_failure(query, point))
            rows.append({**_given(query), "no_trim": str(point)})
            continue
        points.append(point)
        rows.append(model_rows.row(point) | _given(query))
        if format_ == "json" or one:
            document = model_rows.document(
                point, control_hz=hz, validated=options.validated, part=options.part, actuator=options.actuator
            )
            results.append(document)
    if picture is not None:
        write_atomic(picture, draw(plane.name, queries, rows, picture.suffix), option="--picture")
    if format_ in ("npz", "mat"):
        return formats.binary(formats.arrays(points[0], results[0]), format_)
    if format_ == "parquet":
        return formats.parquet(rows)
    if format_ == "json":
        return formats.json_text(results).encode()
    if format_ == "csv":
        return formats.csv_text(rows).encode()
    return (formats.model_table(points[0], results[0]) if one else formats.sweep_table(rows)).encode()


def _check_format(format_: str, conditions: int, output: Path | None) -> None:
    if format_ in ("npz", "mat") and conditions > 1:
        raise InputError(
            f"--format {format_}: must have a single condition (got {conditions}); use json, csv or parquet"
        )
    if format_ in _BINARY and output is None:
        raise InputError(f"--format {format_}: is a binary format; name a file with -o")


def _each(
    plane: Plane, queries: Sequence[Query], work: Callable[[Query], Found]
) -> Iterator[tuple[Query, Found | NoTrimError]]:
    """Process the conditions; a failed trim is a result in a sweep and an error for a single condition."""
    if len(queries) == 1:
        try:
            yield queries[0], work(queries[0])
        except NoTrimError as error:
            error.feasible = nearest_feasible(plane, queries[0])
            near = "; ".join(_describe(name, value) for name, value in error.feasible.items())
            error.args = (f"{error}; nearest conditions with a trim: {near or 'none found'}",)
            raise
        return
    for query in _progress(queries):
        try:
            yield query, work(query)
        except NoTrimError as error:
            yield query, error


def _progress(queries: Sequence[Query]) -> Iterator[Query]:
    """Yield the conditions; show a progress bar on a terminal for 20 conditions or more."""
    if len(queries) < 20 or not sys.stderr.isatty():
        yield from queries
        return
    from rich.console import Console
    from rich.progress import track

    yield from track(queries, description="conditions", console=Console(stderr=True), transient=True)


_WORDS = {
    "mach": "Mach {:.4f}", "tas_fps": "{:.1f} ft/s true", "cas_kt": "{:.1f} kt calibrated", "altitude_ft": "{:.0f} ft",
    "load_factor": "{:.3f} g", "bank_deg": "{:.1f} deg of bank",
}  # fmt: skip


def _describe(name: str, value: float) -> str:
    return _WORDS[name.removesuffix("_above").removesuffix("_below")].format(value)


def _failure(query: Query, error: NoTrimError) -> dict[str, Any]:
    return {
        "condition": str(query),
        "no_trim": str(error),
        "nearest": error.nearest,
        "residual": error.residual,
        "binding": list(error.binding),
    }


def _given(query: Query) -> dict[str, float]:
    name, value = query.speed
    return {name: value, "altitude_ft": query.altitude_ft}
