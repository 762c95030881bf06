"""The tables of docs/commands.md: properties of the commands, gain of the phase search, information in dither.

python tools/tables/commands.py [--seeds 20]
"""

from __future__ import annotations

import argparse

import numpy as np
from cells import likely

from flightbed.command.base import Vector, energy, profile, relative_peak_factor
from flightbed.command.multisine import flat_phases, one_period, schroeder_phases
from flightbed.config.kinds import COMMANDS
from flightbed.core.units import DEG
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario

HZ = 100
KINDS = ("constant", "doublet", "3-2-1-1", "chirp", "multisine", "random")
BANDS = (range(1, 10), range(1, 11), range(2, 12), range(1, 21), range(1, 32), range(21, 41))
FLIGHTS = {
    "without": ["command.kind=none"],
    **{f"{a:g} deg/s": [f"command.amplitude_deg_s={a}"] for a in (0.2, 0.5, 1.0)},
}


def crest(u: Vector) -> float:
    """Return max |u| / rms u."""
    return float(np.max(np.abs(u)) / np.sqrt(np.mean(u**2)))


def below(u: Vector, hz: float) -> float:
    """Return the share of a record's energy below a frequency, from its transform, zero outside the record."""
    power = np.abs(np.fft.rfft(u, 8 * len(u))) ** 2
    power[1:] *= 2.0
    return float(np.sum(power[np.fft.rfftfreq(8 * len(u), 1.0 / HZ) < hz]) / np.sum(power))


def table_of_kinds() -> None:
    """Print the kinds at 5 deg/s with default keys, over the duration of the command; the step over that of the doublets."""
    print(
        "| kind | lasts, s | mean, deg/s | RPF | crest | energy, deg^2/s | below 1 Hz | after the prefilter | below 1 Hz |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    doublets = COMMANDS.make(kind="doublet")
    for kind in KINDS:
        settings = COMMANDS.make(kind=kind)
        sequence_s = 2 * (2**settings.register_bits - 1) * settings.switch_s if kind == "random" else doublets.period_s
        ticks = round(sequence_s * doublets.count * HZ)
        flown = profile(settings.rate(), ticks=ticks, control_hz=HZ, filter_rad_s=settings.filter_rad_s)
        u, ref = flown.q_cmd_rad_s / DEG, flown.q_ref_rad_s / DEG
        print(
            f"| `{kind}` | {ticks / HZ:g} | {round(float(np.mean(u)), 2) + 0.0:.2f} | {relative_peak_factor(u):.2f} | {crest(u):.2f} "
            f"| {energy(u, control_hz=HZ):.0f} | {below(u, 1.0):.0%} | {energy(ref, control_hz=HZ):.0f} | {below(ref, 1.0):.0%} |"
        )


def table_of_phases() -> None:
    """Print the peak factors of Schroeder's phases and of the phases in flight."""
    print("| harmonics | RPF, Schroeder | RPF, flown | crest, Schroeder | crest, flown |\n|---|---|---|---|---|")
    for numbers in BANDS:
        theirs, ours = (one_period(numbers, p) for p in (schroeder_phases(len(numbers)), flat_phases(numbers)))
        print(
            f"| {numbers[0]} to {numbers[-1]} | {relative_peak_factor(theirs):.3f} | {relative_peak_factor(ours):.3f} "
            f"| {crest(theirs):.3f} | {crest(ours):.3f} |"
        )


def table_of_dither(scenario: str, extra: list[str], seeds: int) -> None:
    """Print the estimates of a loss by the two filters, over the amplitude of the dither."""
    print("| dither | filter | median error of K | smoothed RMS | first within 20 %, s | never | nz RMS before, g |")
    print("|---|---|---|---|---|---|---|")
    for label, overrides in FLIGHTS.items():
        flown = [run(load_scenario(scenario, [*extra, *overrides, f"seed={seed}"])) for seed in range(seeds)]
        shaken = np.median([np.std(r.trace["nz_g"][r.trace["t_s"] < r.summary.failed_at_s]) for r in flown])
        for name in ("scheduled", "short-period"):
            found = [r.metrics.estimators[name] for r in flown]
            entries = [m.first_within_20pct_s for m in found if m.first_within_20pct_s is not None]
            errors = [m.median_abs_error_post for m in found], [m.rms_error_smoothed_post for m in found]
            print(
                f"| {label} | {name} | {likely(errors[0], '.3f')} | {likely(errors[1], '.3f')} | {likely(entries, '.2f')} "
                f"| {seeds - len(entries)} of {seeds} | {shaken:.3f} |"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    seeds = parser.parse_args().seeds
    table_of_kinds()
    print()
    table_of_phases()
    for title, extra in (
        ("dithered-level", []),
        ("the same with the c.g. where it is", ["aircraft.cg_shift_cbar=0.0"]),
    ):
        print(f"\n{title}, {seeds} seeds, median (5 % - 95 %)\n")
        table_of_dither("dithered-level", extra, seeds)
