"""Trim points and linear models -> text tables, and files (JSON, CSV, Parquet, npz, mat)."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from flightbed.core.units import unit_of
from flightbed.models.linearize import LATERAL, Matrix
from flightbed.models.survey.condition import Point


def model_table(point: Point, document: Mapping[str, Any]) -> str:
    """Return a linear model as text of 80 columns: trim point, matrices with names and units, modes, warnings."""
    q = point.qualities
    names = {kind: [(v["name"], v["unit"]) for v in document[kind]] for kind in ("states", "inputs", "outputs")}
    states, inputs = ([name for name, _ in names[kind]] for kind in ("states", "inputs"))
    A, B = np.array(document["A"]), np.array(document["B"])
    lines = [*trim_lines(document), "", "x' = A x + B u in deviations from trim; y = C x + D u; SI and radians"]
    for kind, pairs in names.items():
        lines += _wrapped(f"{kind:9}", [f"{n} [{u}]" for n, u in pairs])
    lines += [
        "",
        *_blocks(A, B, states, inputs),
        "modes                          eigenvalue, rad/s   omega_n   zeta   time, s",
    ]
    for mode in document["modes"]:
        re, im = mode["eigenvalue"]
        value = f"{re:.4f}" + (f" +- {im:.4f}j" if im else "")
        seconds = np.log(2.0) / max(abs(re), 1e-6)
        digits = f"{seconds:.3g}" if seconds < 100.0 else f"{seconds:.0f}"
        time = f"{digits} {'double' if re > 0 else 'half'}" if abs(re) > 1e-6 else "neutral"
        lines.append(f"  {mode['name']:24}{value:>22}  {mode['omega_n_rad_s']:8.4f}  {mode['zeta']:5.2f}   {time}")
    rating = (
        "two real roots: no CAP"
        if q.cap is None
        else (f"CAP {q.cap:.3g}, zeta {q.zeta:.2f}: " + (f"level {q.level}" if q.level else "below level 3"))
    )
    rated = f"n/alpha {q.n_alpha_g_rad:.3g} g/rad, {rating}"
    lines += ["", *_wrapped("short period, MIL-F-8785C category A: ", rated.split(" "), " ")]
    enough = point.authority
    hold = (
        "no unstable short period"
        if enough.hold is None
        else (f"{enough.hold:.3f} to hold the unstable mode from {np.rad2deg(enough.alpha_rad):g} deg of alpha")
    )
    lines += _wrapped(f"elevator: smallest K {enough.trim:.3f} to trim; ", hold.split(" "), " ")
    for result in document.get("validation", ()):
        errors = ", ".join(f"{state} {error:.2%}" for state, error in result["errors"].items())
        lines += _wrapped(f"error against the aircraft at {result['plant_hz']} Hz: ", errors.split(" "), " ")
    for name, source in document["sources"].items():
        if name not in ("jsbsim", "aircraft_sha256"):
            lines += _wrapped(f"{name}: ", source.split(" "), " ")
    lines.append(f"differences: halving the step changes no entry by more than {document['step_error']:.0e} of its row")
    if document["drift"] > 1e-3:
        text = f"the aircraft's own control system drifted by {document['drift']:.0e} during the differences"
        lines += _wrapped("warning: ", text.split(" "), " ")
    for kink in document["kinks"]:
        lines += _wrapped("warning: kink, mean slope used: ", kink.split(" "), " ")
    return "\n".join(lines) + "\n"


def _blocks(A: Matrix, B: Matrix, states: Sequence[str], inputs: Sequence[str]) -> list[str]:
    """Return A and B in blocks of at most five columns; coupling blocks below 1e-3 of their rows are omitted."""
    lateral = {name for name, _ in LATERAL}
    groups = [[s for s in states if (s in lateral) == side] for side in (False, True)]
    lines: list[str] = []
    for rows in groups:
        for columns in groups:
            if not rows or not columns:
                continue
            block = A[np.ix_([states.index(s) for s in rows], [states.index(s) for s in columns])]
            own = A[np.ix_([states.index(s) for s in rows], [states.index(s) for s in rows])]
            if rows is not columns and np.max(np.abs(block)) <= 1e-3 * np.max(np.abs(own)):
                continue
            title = "A" if rows is columns else "A, coupling"
            for part in (columns[i : i + 5] for i in range(0, len(columns), 5)):
                picked = block[:, [columns.index(c) for c in part]]
                lines += [title, *_matrix(picked, rows, part), ""]
    lines += ["B", *_matrix(B, states, inputs), ""]
    return lines


def trim_lines(document: Mapping[str, Any]) -> list[str]:
    """Return a trim point as lines of text."""
    c, t = document["condition"], document["trim"]
    extra = [
        f"{label} {c[key]:g}" for key, label, rest in
        (("load_factor", "load factor", None), ("cg_shift_cbar", "c.g. shift, cbar", 0.0), ("effectiveness", "K", 1.0))
        if c[key] != rest
    ]  # fmt: skip
    if c["bank_rad"]:
        extra.append(f"bank {np.rad2deg(c['bank_rad']):g} deg")
    units = dict.fromkeys(("alpha", "elevator", "theta", "beta"), "deg") | dict.fromkeys("pqr", "deg_s")
    units["throttle"] = "norm"
    names = {f"{name}_{unit}": (name, unit.replace("_", "/")) for name, unit in units.items()}
    names |= {k: (k.removesuffix("_cmd_norm") + " command", "") for k in t if k.endswith("_cmd_norm")}
    names |= {k: (k.removesuffix("_deg"), "deg") for k in ("aileron_deg", "rudder_deg") if k in t}
    always = ("alpha_deg", "elevator_deg", "throttle_norm", "theta_deg")
    words = [
        f"{name} {t[key]:.4f} {unit}".rstrip().replace(" norm", "")
        for key, (name, unit) in names.items()
        if t.get(key) is not None and (key in always or abs(t[key]) > 5e-5)
    ]
    head = f"{document['aircraft']} at Mach {c['mach']:.4f}, {c['airspeed_m_s']:.2f} m/s, {c['altitude_m']:.1f} m, "
    return [
        *_wrapped(head, [f"gamma {round(np.rad2deg(c['gamma_rad']), 4) + 0.0:g} deg", *extra]),
        *_wrapped("trim     ", [*words, f"residual {t['residual']:.0e} (g, rad/s^2)"]),
    ]


def sweep_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a sweep as a text table."""
    lines = ["  Mach  altitude,ft  alpha,deg  elev,deg  thr   M_alpha  M_delta  fastest  K min"]
    for r in rows:
        start = f"{r['mach']:6.3f}  {r['altitude_ft']:11.0f}"
        if r["no_trim"]:
            lines += _wrapped(f"{start}  ", r["no_trim"].split(" "), " ")
        else:
            lines.append(
                f"{start}  {r['alpha_deg']:9.3f}  {r['elevator_deg']:8.3f}  {r['throttle_norm']:4.2f}  {r['M_alpha']:7.3f}  "
                f"{r['M_delta']:7.2f}  {r['fastest_unstable_rad_s']:+7.3f} "
                f"{max(r['effectiveness_min_trim'], r['effectiveness_min_hold'] or 0.0):6.3f}{' kink' if r['kinks_short_period'] else ''}"
            )
    return "\n".join(lines) + "\n"


def csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as CSV with a header; the columns are the union of all keys."""
    columns = list(dict.fromkeys(key for r in rows for key in r))
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, columns, lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()


def parquet(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Return rows as Parquet; the columns are the union of all keys, null where a row has no value, units in the column metadata."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    columns = list(dict.fromkeys(key for r in rows for key in r))
    table = pa.table({c: pa.array([r.get(c) for r in rows]) for c in columns})
    fields = [f.with_metadata({"unit": unit_of(f.name)}) for f in table.schema]
    buffer = io.BytesIO()
    pq.write_table(table.cast(pa.schema(fields)), buffer)
    return buffer.getvalue()


def json_text(documents: Sequence[Mapping[str, Any]]) -> str:
    """Return a single document, or a list of several, as JSON."""
    return json.dumps(documents[0] if len(documents) == 1 else list(documents), indent=2, allow_nan=False) + "\n"


def arrays(point: Point, document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a model as named arrays, the content of npz and mat files."""
    trimmed = point.trim
    matrices = {name: np.array(document[name]) for name in "ABCD"}
    names = {
        key: np.array([v[field] for v in document[kind]])
        for kind in ("states", "inputs", "outputs")
        for key, field in ((kind, "name"), (f"{kind[:-1]}_units", "unit"))
    }
    return {
        **matrices,
        "Ad": np.array(document["discrete"]["A"]), "Bd": np.array(document["discrete"]["B"]),
        "control_hz": float(document["discrete"]["control_hz"]),
        "A_short_period": point.design.A, "B_short_period": point.design.b[:, None],
        **names,
        "x_trim": np.array(trimmed.motion), "u_trim": np.array(trimmed.controls), "trim_residual": trimmed.residual,
    }  # fmt: skip


def binary(content: Mapping[str, Any], kind: str) -> bytes:
    """Return named arrays as the bytes of an npz or mat file; arrays of names are cell arrays in mat."""
    buffer = io.BytesIO()
    if kind == "npz":
        np.savez(buffer, **content)
    else:
        from scipy.io import savemat  # slow to import

        cells = {k: np.array(v, dtype=object) if np.asarray(v).dtype.kind == "U" else v for k, v in content.items()}
        savemat(cast(Any, buffer), cells)
    return buffer.getvalue()


def _matrix(values: Any, rows: Sequence[str], columns: Sequence[str]) -> list[str]:
    head = " " * 13 + "".join(f"{c:>13}" for c in columns)
    return [
        head,
        *(f"  {r:11}" + "".join(f"{v:13.5g}" for v in _clean(line)) for r, line in zip(rows, values, strict=True)),
    ]


def _clean(line: Any) -> Any:
    """Replace round-off of the differences by 0."""
    return np.where(np.abs(line) < 1e-8 * np.max(np.abs(line)), 0.0, line)


def _wrapped(head: str, words: Sequence[str], joint: str = ", ", width: int = 80) -> list[str]:
    lines, line = [], head
    for i, word in enumerate(words):
        piece = word + (joint if i + 1 < len(words) else "")
        if len(line) + len(piece.rstrip()) > width and line.strip():
            lines.append(line.rstrip())
            line = " " * 9
        line += piece
    return [*lines, line.rstrip()]
