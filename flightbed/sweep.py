"""What `flightbed trim` and `flightbed linearize` do: options -> conditions -> text, files and a picture."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from flightbed import documents, model_files, survey
from flightbed.aircraft import Aircraft
from flightbed.errors import InputError, NoTrimError
from flightbed.stock import StockAircraft
from flightbed.survey import Point, Query

Found = TypeVar("Found")
Plane = Aircraft | StockAircraft
_BINARY = ("npz", "mat", "parquet")


@dataclass(frozen=True)
class Shape:
    """How a linear model is wanted: which part, with the actuator or not, discrete at which rate, validated or not."""

    part: str = "full"
    actuator: bool = False
    control_hz: float | None = None
    validated: bool = False


def asked(aircraft: str, condition: Any) -> tuple[Plane, list[Query]]:
    """Return the aircraft and the conditions of a command line. Raises InputError."""
    plane = survey.find_aircraft(aircraft)  # first: with no aircraft, no condition helps
    given = [(name, text) for name in ("mach", "tas_fps", "cas_kt") if (text := getattr(condition, name)) is not None]
    if len(given) != 1:
        raise InputError("give exactly one of --mach, --tas-fps and --cas-kt")
    name, text = given[0]
    altitudes = survey.axis(condition.altitude_ft, "--altitude-ft")
    speeds = survey.axis(text, f"--{name.replace('_', '-')}")
    if len(altitudes) * len(speeds) > survey.MOST:
        raise InputError(f"a sweep has at most {survey.MOST} conditions ({len(altitudes) * len(speeds)} are asked for)")
    fixed = {
        key: getattr(condition, key)
        for key in ("gamma_deg", "load_factor", "bank_deg", "cg_shift_cbar", "effectiveness", "engine")
    }
    return plane, list(survey.queries(altitudes, name, speeds, **fixed))


def trim_all(plane: Plane, queries: Sequence[Query], format_: str, output: Path | None) -> bytes:
    """Trim at all conditions; return what is to be written. Raises InputError, NoTrimError."""
    _check_format(format_, len(queries), output)
    told: list[dict[str, Any]] = []
    rows: list[dict[str, Any]] = []
    for query, found in _each(plane, queries, lambda query: survey.trim_at(plane, query)):
        if isinstance(found, NoTrimError):
            told.append(_refusal(query, found))
            rows.append({**_given(query), "no_trim": str(found)})
        else:
            told.append(documents.trim_document(query, *found))
            rows.append({**_given(query), **told[-1]["trim"], "no_trim": ""})
    if format_ == "table":
        lines = ["\n".join(model_files.trim_lines(d)) if "trim" in d else d["no_trim"] for d in told]
        return "".join(f"{line}\n" for line in lines).encode()
    if format_ == "parquet":
        return model_files.parquet(rows)
    return (model_files.json_text(told) if format_ == "json" else model_files.csv_text(rows)).encode()


def linearize_all(
    plane: Plane, queries: Sequence[Query], format_: str, output: Path | None, shape: Shape, picture: Path | None
) -> bytes:
    """Trim and linearize at all conditions; write the picture, return what is to be written. Raises InputError, NoTrimError."""
    one = len(queries) == 1
    if shape.validated and (format_ not in ("table", "json") or (format_ == "table" and not one)):
        raise InputError("--validate: is told in json, and in the table of one condition")
    if shape.control_hz is not None and format_ in ("table", "csv", "parquet"):
        raise InputError(f"--control-hz: there is no discrete model in --format {format_}; use json, npz or mat")
    if (shape.part != "full" or shape.actuator) and (format_ in ("csv", "parquet") or (format_ == "table" and not one)):
        raise InputError("--part, --actuator: a sweep's table has one line a condition and no matrices; use json")
    hz = 100.0 if shape.control_hz is None else shape.control_hz
    if not hz > 0.0:
        raise InputError(f"--control-hz: must be above 0 (got {hz:g})")
    _check_format(format_, len(queries), output)
    if picture is not None:
        from flightbed.stability_map import check, draw

        check(picture, queries)
    points: list[Point] = []
    told: list[dict[str, Any]] = []
    rows: list[dict[str, Any]] = []
    for query, point in _each(plane, queries, lambda query: survey.linearize_at(plane, query)):
        if isinstance(point, NoTrimError):
            told.append(_refusal(query, point))
            rows.append({**_given(query), "no_trim": str(point)})
            continue
        points.append(point)
        rows.append(documents.row(point) | _given(query))
        if format_ == "json" or one:
            document = documents.document(
                point, control_hz=hz, validated=shape.validated, part=shape.part, actuator=shape.actuator
            )
            told.append(document)
    if picture is not None:
        model_files.write_whole(picture, draw(plane.name, queries, rows, picture.suffix), option="--picture")
    if format_ in ("npz", "mat"):
        return model_files.binary(model_files.arrays(points[0], told[0]), format_)
    if format_ == "parquet":
        return model_files.parquet(rows)
    if format_ == "json":
        return model_files.json_text(told).encode()
    if format_ == "csv":
        return model_files.csv_text(rows).encode()
    return (model_files.model_table(points[0], told[0]) if one else model_files.sweep_table(rows)).encode()


def _check_format(format_: str, conditions: int, output: Path | None) -> None:
    if format_ in ("npz", "mat") and conditions > 1:
        raise InputError(
            f"--format {format_}: holds one condition ({conditions} are asked for); use json, csv or parquet"
        )
    if format_ in _BINARY and output is None:
        raise InputError(f"--format {format_}: is binary; name a file with -o")


def _each(
    plane: Plane, queries: Sequence[Query], work: Callable[[Query], Found]
) -> Iterator[tuple[Query, Found | NoTrimError]]:
    """Work through the conditions; one that cannot be trimmed is an answer in a sweep, an error when it is alone."""
    if len(queries) == 1:
        try:
            yield queries[0], work(queries[0])
        except NoTrimError as error:
            error.feasible = survey.nearest_feasible(plane, queries[0])
            near = "; ".join(_in_words(name, value) for name, value in error.feasible.items())
            error.args = (f"{error}; nearest that can be trimmed: {near or 'none found'}",)
            raise
        return
    for query in _progress(queries):
        try:
            yield query, work(query)
        except NoTrimError as error:
            yield query, error


def _progress(queries: Sequence[Query]) -> Iterator[Query]:
    """Show a bar on a terminal, when there is something to wait for."""
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


def _in_words(name: str, value: float) -> str:
    return _WORDS[name.removesuffix("_above").removesuffix("_below")].format(value)


def _refusal(query: Query, error: NoTrimError) -> dict[str, Any]:
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
