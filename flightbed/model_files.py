"""Trim points and linear models -> text for people and files for tools."""

from __future__ import annotations

import csv
import io
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from flightbed.errors import OutputError
from flightbed.modes import longitudinal_modes
from flightbed.survey import Point


def model_table(point: Point, document: Mapping[str, Any]) -> str:
    """Return a linear model as text that fits 80 columns: point, matrices with names and units, modes, warnings."""
    model, q = point.model, point.qualities
    lines = [
        *trim_lines(document),
        "",
        "x' = A x + B u in deviations from trim; y = C x + D u; SI and radians",
        "states   " + ", ".join(f"{n} [{u}]" for n, u in model.states),
        "inputs   " + ", ".join(f"{n} [{u}]" for n, u in model.inputs),
        *_wrapped("outputs  ", [f"{n} [{u}]" for n, u in model.outputs]),
        "",
        *_matrix("A", model.A, [n for n, _ in model.states], [n for n, _ in model.states]),
        "",
        *_matrix("B", model.B, [n for n, _ in model.states], [n for n, _ in model.inputs]),
        "",
        "modes                          eigenvalue, rad/s   omega_n   zeta   time, s",
    ]
    for mode in longitudinal_modes(model):
        v = mode.eigenvalue
        value = f"{v.real:.4f}" + (f" +- {v.imag:.4f}j" if v.imag else "")
        which = "double" if v.real > 0 else "half"
        lines.append(
            f"  {mode.name:24}{value:>22}  {mode.omega_n_rad_s:8.4f}  {mode.zeta:5.2f}   {mode.time_to_half_or_double_s:.3g} {which}"
        )
    rating = (
        "two real roots: no CAP"
        if q.cap is None
        else (f"CAP {q.cap:.3g}, zeta {q.zeta:.2f}: " + (f"level {q.level}" if q.level else "below level 3"))
    )
    lines += ["", f"short period, MIL-F-8785C category A: n/alpha {q.n_alpha_g_rad:.3g} g/rad, {rating}"]
    enough = point.authority
    hold = (
        "no unstable short period"
        if enough.hold is None
        else (f"{enough.hold:.3f} to hold the unstable mode from {np.rad2deg(enough.alpha_rad):g} deg of alpha")
    )
    lines += _wrapped(f"elevator: smallest K {enough.trim:.3f} to trim; ", hold.split(" "), " ")
    for result in document.get("validation", ()):
        errors = ", ".join(f"{state} {error:.2%}" for state, error in result["errors"].items())
        lines += _wrapped(f"against the aircraft at {result['plant_hz']} Hz: ", errors.split(" "), " ")
    lines.append(f"differences: halving the step changes no entry by more than {model.step_error:.0e} of its row")
    for kink in model.kinks:
        lines += _wrapped("warning: on a kink, averaged: ", str(kink).split(" "), " ")
    return "\n".join(lines) + "\n"


def trim_lines(document: Mapping[str, Any]) -> list[str]:
    """Return a trim point as lines."""
    c, t = document["condition"], document["trim"]
    extra = "".join(
        f", {label} {c[key]:g}" for key, label, rest in
        (("cg_shift_cbar", "c.g. shift, cbar", 0.0), ("effectiveness", "K", 1.0)) if c[key] != rest
    )  # fmt: skip
    return [
        f"{document['aircraft']} at Mach {c['mach']:.4f}, {c['airspeed_m_s']:.2f} m/s, {c['altitude_m']:.1f} m, "
        f"gamma {np.rad2deg(c['gamma_rad']):g} deg{extra}",
        f"trim     alpha {t['alpha_deg']:.4f} deg, elevator {t['elevator_deg']:.4f} deg, throttle {t['throttle_norm']:.4f}",
        f"         theta {t['theta_deg']:.4f} deg, residual {t['residual']:.0e} (g, rad/s^2)",
    ]


def sweep_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a sweep as text."""
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
    """Return rows as CSV with a header; every key of any row is a column."""
    columns = list(dict.fromkeys(key for r in rows for key in r))
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, columns, lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()


def json_text(documents: Sequence[Mapping[str, Any]]) -> str:
    """Return one document, or a list of several, as JSON."""
    return json.dumps(documents[0] if len(documents) == 1 else list(documents), indent=2, allow_nan=False) + "\n"


def arrays(point: Point, document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a model as named arrays, for npz and mat files."""
    model, trimmed = point.model, point.trim
    return {
        "A": model.A, "B": model.B, "C": model.C, "D": model.D,
        "Ad": np.array(document["discrete"]["A"]), "Bd": np.array(document["discrete"]["B"]),
        "control_hz": float(document["discrete"]["control_hz"]),
        "A_short_period": point.design.A, "B_short_period": point.design.b[:, None],
        "states": np.array([n for n, _ in model.states]), "state_units": np.array([u for _, u in model.states]),
        "inputs": np.array([n for n, _ in model.inputs]), "input_units": np.array([u for _, u in model.inputs]),
        "outputs": np.array([n for n, _ in model.outputs]), "output_units": np.array([u for _, u in model.outputs]),
        "x_trim": np.array(trimmed.motion), "u_trim": np.array(trimmed.controls), "trim_residual": trimmed.residual,
    }  # fmt: skip


def binary(content: Mapping[str, Any], kind: str) -> bytes:
    """Return named arrays as the bytes of an npz or a mat file; in mat, names become cell arrays."""
    buffer = io.BytesIO()
    if kind == "npz":
        np.savez(buffer, **content)
    else:
        from scipy.io import savemat  # slow to import

        cells = {k: np.array(v, dtype=object) if np.asarray(v).dtype.kind == "U" else v for k, v in content.items()}
        savemat(cast(Any, buffer), cells)
    return buffer.getvalue()


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it appears whole or not at all. Raises OutputError."""
    try:
        handle, scratch = tempfile.mkstemp(dir=path.absolute().parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            Path(scratch).chmod(0o666 & ~_umask())
            Path(scratch).replace(path)
        except BaseException:
            Path(scratch).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"-o {path}: cannot be written: {error.strerror}") from None


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _matrix(name: str, values: Any, rows: Sequence[str], columns: Sequence[str]) -> list[str]:
    head = f"{name:9}" + "".join(f"{c:>13}" for c in columns)
    return [head, *(f"{r:9}" + "".join(f"{v:13.5g}" for v in line) for r, line in zip(rows, values, strict=True))]


def _wrapped(head: str, words: Sequence[str], joint: str = ", ", width: int = 80) -> list[str]:
    lines, line = [], head
    for i, word in enumerate(words):
        piece = word + (joint if i + 1 < len(words) else "")
        if len(line) + len(piece.rstrip()) > width and line.strip():
            lines.append(line.rstrip())
            line = " " * 9
        line += piece
    return [*lines, line.rstrip()]
