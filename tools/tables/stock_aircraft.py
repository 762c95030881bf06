"""Trim and linearize every aircraft of JSBSim at one typical condition; write docs/stock-aircraft.md.

    python tools/tables/stock_aircraft.py [NAME ...]

Each in a process of its own: some of JSBSim's models crash the process.
"""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from flightbed.fdm.jsbsim import stock_names, version

PAGE = Path(__file__).resolve().parents[2] / "docs" / "stock-aircraft.md"
# Calibrated airspeed, kt, and altitude, ft.
CONDITIONS = {
    "737": (280, 20000), "787-8": (280, 30000), "A320": (280, 20000), "A4": (300, 15000), "B17": (150, 10000),
    "B747": (280, 20000), "Boeing314": (120, 3000), "C130": (200, 10000), "Camel": (80, 3000), "Concorde": (350, 30000),
    "DHC6": (140, 8000), "F4N": (350, 15000), "F80C": (300, 15000), "J3Cub": (60, 3000), "L17": (110, 4000),
    "L410": (150, 8000), "MD11": (290, 20000), "OV10": (160, 5000), "Pterosaur": (30, 500), "SGS": (50, 3000),
    "Short_S23": (120, 3000), "Shuttle": (250, 20000), "Submarine_Scout": (35, 1000), "T37": (200, 10000),
    "T38": (300, 15000), "X15": (300, 30000), "XB-70": (400, 30000), "ZLT-NT": (40, 1000), "c182": (120, 3000),
    "c310": (150, 5000), "dr1": (80, 3000), "f104": (400, 20000), "fokker100": (250, 15000), "fokker50": (180, 10000),
    "global5000": (250, 20000), "minisgs": (30, 1000), "p51d": (220, 10000), "paraglider": (25, 1000), "pc7": (160, 8000),
    "pogo-jsbsim": (250, 10000), "sgs126": (45, 3000), "sgs233": (50, 3000), "t6texan2": (180, 8000),
    "wrightFlyer1903": (28, 100), "x24b": (200, 20000), "f15": (350, 20000), "f16": (350, 20000), "f22": (350, 20000),
}  # fmt: skip
LIGHT = (100, 3000)  # all others


def _asked(name: str) -> tuple[int, int]:
    return CONDITIONS.get(name, LIGHT)


def _line(name: str) -> tuple[bool, str]:
    cas_kt, altitude_ft = _asked(name)
    condition = ["--cas-kt", str(cas_kt), "--altitude-ft", str(altitude_ft)]
    command = [sys.executable, "-m", "flightbed", "linearize", f"jsbsim:{name}", *condition, "--format", "json"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    except subprocess.TimeoutExpired:
        return False, f"| {name} | {cas_kt}, {altitude_ft} | no answer in a minute |"
    if done.returncode:
        messages = [line for line in done.stderr.splitlines() if line.startswith("flightbed:")]
        why = (
            messages[-1].removeprefix("flightbed: ") if messages else f"JSBSim ends the process, code {done.returncode}"
        )
        why = why.removeprefix(f"aircraft {name}: ").replace("|", "/")
        return False, f"| {name} | {cas_kt}, {altitude_ft} | {why} |"
    try:
        model = json.loads(done.stdout)
    except json.JSONDecodeError as error:
        return False, f"| {name} | {cas_kt}, {altitude_ft} | answer not readable: {error} |"
    trim = model["trim"]
    throttle = "none" if trim["throttle_norm"] is None else f"{trim['throttle_norm']:.2f}"
    shown = {}
    for mode in model["modes"]:
        re, im = mode["eigenvalue"]
        kind = next((k for k in ("short period", "Dutch roll", "roll", "spiral") if mode["name"].startswith(k)), None)
        if kind:
            shown.setdefault(kind, []).append(f"{re:.2f}" + (f"±{im:.2f}j" if im else ""))
    roots = " | ".join(", ".join(shown.get(k, ["-"])) for k in ("short period", "Dutch roll", "roll", "spiral"))
    notes = f"{len(model['kinks'])} kinks" if model["kinks"] else ""
    if model["drift"] > 1e-3:
        notes += f"{'; ' if notes else ''}own control system drifts ({model['drift']:.0e})"
    return True, (
        f"| {name} | {cas_kt}, {altitude_ft} | {trim['alpha_deg']:.2f} | {trim['elevator_cmd_norm']:+.3f} | {throttle} "
        f"| {trim['residual']:.0e} | {roots} | {notes} |"
    )


def main(names: list[str]) -> None:
    """Write the page, or print the lines of the aircraft named."""
    wanted = names or list(stock_names())
    with ThreadPoolExecutor(2) as pool:
        lines = dict(zip(wanted, pool.map(_line, wanted), strict=True))
    good = [text for fine, text in lines.values() if fine]
    bad = [text for fine, text in lines.values() if not fine]
    if names:
        print("\n".join(good + bad))
        return
    PAGE.write_text(
        f"""# JSBSim's own aircraft

Every aircraft in the jsbsim {version()} package, once, at the condition named (`python tools/tables/stock_aircraft.py` writes this
page): as it is, its own control system inside, gear up where it can be, flaps up, mixture and propeller levers fully
forward, no wind, level flight (a glide without an engine). {len(good)} of {len(lines)} trim and linearize.

## Trimmed and linearized

The elevator is a normalized command. Roots are in rad/s; kinks are derivatives that do not exist at this point of the tables.

| aircraft | kt CAS, ft | alpha, deg | elevator | throttle | residual | short period | Dutch roll | roll | spiral | notes |
|---|---|---|---|---|---|---|---|---|---|---|
"""
        + "\n".join(good)
        + "\n\n## Failures\n\n| aircraft | kt CAS, ft | reason |\n|---|---|---|\n"
        + "\n".join(bad)
        + "\n"
    )
    print(f"{PAGE.name}: {len(good)} of {len(lines)}")


if __name__ == "__main__":
    main(sys.argv[1:])
