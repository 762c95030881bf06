"""Kemp's chapter 6 on JSBSim's F-16: adaptive against scheduled, flutter and its remedies, elevator losses, accelerometer noise, time.

    python tools/tables/kemp_aircraft.py [--runs 20] [--workers N] [--only PART ...]

1. Cases 1 to 3 of the thesis, the last also behind a prefilter and with commands delayed by one tick: overshoot, undershoot, what the
   c.g. shift does, flutter, use of the elevator's rate. The seeds vary the sensors' noise.
2. Losses of elevator effectiveness before a pull-up, also with the scheduled law corrected by 1/K-hat; flutter without the sensors' noise.
3. Cases and loss with noise on the accelerometer, which the thesis does not have.
4. Loops, with the command's prefilter and without; from 333 to 680 ft/s.
5. The estimator ``plid`` beside the scheduled filter.
6. Microseconds of a demand of each law and of an update of the estimator ``plid``.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np

from flightbed.aircraft.overlay import Aircraft
from flightbed.analysis.pull_up import COLUMNS, PullUp, command_g, first_pulse, increment_g, pull_up
from flightbed.analysis.seeds import Flown, Job, fly_jobs, processes
from flightbed.campaigns.run import fly
from flightbed.core.units import DEG, FT
from flightbed.flight.assembly import assemble
from flightbed.flight.loop import fly as samples_of
from flightbed.flight.plan import plan
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.tables import Scenario
from flightbed.statistics.intervals import median_interval, share

# Of the thesis: first guess and variances of the listing of D, gains at once.
THESIS = (
    "control.identification.prior=thesis", "control.identification.prior_var=1", "control.identification.gain_filter_rad_s=0",
)  # fmt: skip
LAWS: dict[str, tuple[str, ...]] = {
    "scheduled": ("control.law=nz-scheduled",),
    "scheduled, soft": ("control.law=nz-scheduled", "control.poles=[[-1.68,0.84],[-1.68,-0.84],[-4.2,0]]"),
    "scheduled, as slow": ("control.law=nz-scheduled", "control.poles=[[-2.4,1.2],[-2.4,-1.2],[-6,0]]"),
    "adaptive": (),
    "adaptive, thesis": THESIS,
    "- its u filtered": (*THESIS, "control.identification.command_filter_rad_s=20"),
    "- its gains filtered": (*THESIS[:2], "control.identification.gain_filter_rad_s=5"),
}
CORRECTED = (
    "control.law=nz-scheduled", "adaptation.enabled=true", "adaptation.estimator=k", 'estimators=[{name="k"}]',
)  # fmt: skip
PREFILTER = ("command.filter_rad_s=3",)
QUIET = tuple(
    f"sensors.{key}={'1e-6' if key in ('alpha_std_deg', 'q_std_deg_s') else '0'}"
    for key in ("alpha_std_deg", "q_std_deg_s", "theta_std_deg", "phi_std_deg", "mach_std", "altitude_std_ft")
)
CASES: dict[str, tuple[str, tuple[str, ...]]] = {
    "1: 1 g, 1 s": ("cg-shift", ("failures=[]", "duration_s=16", "command.start_s=10", "command.period_s=1")),
    "2: c.g. at 10 s": ("cg-shift", ()),
    "3: throttle, c.g.": ("throttle-and-cg", ()),
    "2, prefilter 3 rad/s": ("cg-shift", PREFILTER),
    "3, prefilter 3 rad/s": ("throttle-and-cg", PREFILTER),
    "2, a tick late": ("cg-shift", ("rates.delay_ticks=1",)),
}
LOSS_LAWS = ("scheduled", "scheduled, as slow", "adaptive", "adaptive, thesis")
LOSSES = (0.5, 0.35, 0.2, 0.1)
NOISES_G = (0.002, 0.005, 0.01)


Measured = tuple[
    PullUp, float
]  # and the share of ticks, from the pulse's begin to 3 s after its release, at the rate limit


def _measured(scenario: Scenario, flights: Sequence[Flown]) -> list[Measured]:
    hz, limit = scenario.rates.control_hz, _rate_limit_deg_s(scenario)
    found = []
    for flown in flights:
        pulse = first_pulse(command_g(flown.columns), control_hz=hz)
        busy = np.nan
        if pulse is not None:
            begin, end, _ = pulse
            rate = np.abs(np.diff(flown.columns["elevator_deg"][begin : end + 3 * hz])) * hz
            busy = float(np.mean(rate > 0.98 * limit))
        found.append((pull_up(flown.columns, control_hz=hz, ticks=scenario.ticks), busy))
    return found


def _rate_limit_deg_s(scenario: Scenario) -> float:
    """Return the elevator's rate limit, deg/s."""
    aircraft = plan(scenario).aircraft
    assert isinstance(aircraft, Aircraft)
    return aircraft.actuator.rate_limit_rad_s / DEG


def _row(name: str, found: Sequence[Measured]) -> str:
    kept = [f for f, _ in found if not f.lost]
    busy = [share for f, share in found if not f.lost]
    lost = share(len(found) - len(kept), len(found))
    text = f"{name:>22} | {len(found) - len(kept):3d}/{len(found)} ({lost.low:.2f} to {lost.high:.2f})"
    if not kept:
        return text
    columns = (
        [100.0 * f.overshoot for f in kept], [100.0 * f.undershoot for f in kept], [f.disturbance_g for f in kept],
        [f.flutter_deg for f in kept], [f.tracking_rms_g for f in kept], [100.0 * b for b in busy],
    )  # fmt: skip
    for column in columns:
        m = median_interval(column)
        text += f" | {m.estimate:7.2f} ({m.low:7.2f} to {m.high:7.2f})"
    return text


def table(
    title: str, cases: dict[str, dict[str, Scenario]], runs: int, executor: Executor | None
) -> dict[str, dict[str, list[Measured]]]:
    """Fly and print a table for each case, a row for each law; returns the measured values."""
    jobs = [(case, law, scenario) for case, laws in cases.items() for law, scenario in laws.items()]
    flights = fly_jobs([Job(scenario, runs, (*COLUMNS, "elevator_deg")) for _, _, scenario in jobs], executor=executor)
    found: dict[str, dict[str, list[Measured]]] = {case: {} for case in cases}
    for (case, law, scenario), flown in zip(jobs, flights, strict=True):
        found[case][law] = _measured(scenario, flown)
    print(f"\n{title}: {runs * len(jobs)} flights. Medians of those not lost, with intervals of 95 %")
    heads = (
        "overshoot, %",
        "undershoot, %",
        "before it, g",
        "flutter, deg",
        "RMS of the error, g",
        "at the rate limit, %",
    )
    print(f"{'':>22} | {'lost, share':>19} | " + " | ".join(f"{head:>26}" for head in heads))
    for case, laws in found.items():
        print(f"  {case}")
        for law, measured in laws.items():
            print(_row(law, measured))
    return found


def cases(runs: int, executor: Executor | None) -> None:
    """Print the thesis's cases, the effect of the shift on the model, and the smaller overshoot of the adaptive law, seed by seed."""
    for shift in (0.0176, 0.0676):
        design = plan(load_scenario("cg-shift", (f"aircraft.cg_shift_cbar={shift}",))).load_factor
        assert design is not None
        print(f"c.g. {shift:g} of the chord aft of JSBSim's: M_alpha {design.here.A[1, 0]:.2f} 1/s^2")
    wanted = {
        case: {law: load_scenario(name, (*sets, *more)) for law, more in LAWS.items()}
        for case, (name, sets) in CASES.items()
    }
    found = table("1. Cases of chapter 6", wanted, runs, executor)
    for case, laws in found.items():
        for rival in ("scheduled", "scheduled, as slow", "scheduled, soft"):
            pairs = zip(laws["adaptive"], laws[rival], strict=True)
            less = median_interval([100.0 * (a.overshoot - s.overshoot) for (a, _), (s, _) in pairs])
            print(
                f"  {case}: overshoot, adaptive less {rival}: {less.estimate:.2f} ({less.low:.2f} to {less.high:.2f}) % of the command"
            )


def losses(runs: int, executor: Executor | None) -> None:
    """Print elevator losses without accelerometer noise, and flutter without any."""
    wanted = {
        f"K = {to}": {law: load_scenario("pull-up-loss", (f"failures.0.to={to}", *LAWS[law])) for law in LOSS_LAWS}
        for to in LOSSES
    }
    for case, laws in wanted.items():
        sets = (f"failures.0.to={case.split()[-1]}",)
        laws["corrected by 1/K"] = load_scenario("pull-up-loss", (*sets, *CORRECTED))
    wanted |= {
        f"K = {to}, prefilter 3 rad/s": {
            name: load_scenario("pull-up-loss", (f"failures.0.to={to}", *PREFILTER, *more))
            for name, more in (("scheduled", LAWS["scheduled"]), ("corrected by 1/K", CORRECTED), ("adaptive", ()))
        }
        for to in (0.35, 0.2)
    }
    table("2. Elevator losses", wanted, runs, executor)
    quiet = {"case 2": ("cg-shift", ())} | {f"K = {to}": ("pull-up-loss", (f"failures.0.to={to}",)) for to in LOSSES}
    print("\n   Flutter without the sensors' noise, deg")
    for law, more in LAWS.items():
        jobs = [Job(load_scenario(name, (*sets, *QUIET, *more)), 1, COLUMNS) for name, sets in quiet.values()]
        cells = []
        for (case, _), (flown,) in zip(quiet.items(), fly_jobs(jobs, executor=executor), strict=True):
            found = pull_up(flown.columns, control_hz=100, ticks=0)
            cells.append(f"{case} {found.flutter_deg:6.3f}")
        print(f"{law:>22} | " + " | ".join(cells))


def noise(runs: int, executor: Executor | None) -> None:
    """Print cases and a loss with noise on the accelerometer."""
    noisy = {
        f"{name}, accelerometer {std:g} g": {
            law: load_scenario(name, (f"sensors.nz_std_g={std}", *LAWS[law])) for law in LOSS_LAWS
        }
        for std in NOISES_G
        for name in ("cg-shift", "throttle-and-cg", "pull-up-loss")
    }
    table("3. Accelerometer noise", noisy, runs, executor)


def loops(runs: int, executor: Executor | None) -> None:
    """Print the tracking of 4 and 5 g in a loop."""
    print("\n4. A loop: a_n from 2 s after the command to its end, g")
    for size, filtered in ((4, 3), (4, 0), (5, 3)):
        for law in ("scheduled", "adaptive", "adaptive, thesis"):
            sets = (f"command.amplitude_g={size}", f"command.filter_rad_s={filtered}", *LAWS[law])
            scenario = load_scenario("loop", sets)
            (flights,) = fly_jobs([Job(scenario, runs, (*COLUMNS, "q_deg_s"))], executor=executor)
            least, most, turns = [], [], []
            for flown in flights:
                t, held = flown.columns["t_s"], increment_g(flown.columns)
                on = (t >= 7.0) & (t < 39.0)
                least.append(float(np.min(held[on])))
                most.append(float(np.max(held[on])))
                turns.append(float(np.sum(flown.columns["q_deg_s"])) / scenario.rates.control_hz)
            print(
                f"{law:>22}, {size} g, prefilter {filtered} rad/s | {min(least):6.2f} to {max(most):6.2f} "
                f"| turned {np.median(turns):5.0f} deg"
            )


def speeds(runs: int, executor: Executor | None) -> None:
    """Print the error of a_n to its reference, in intervals of 10 s, while the speed increases."""
    print("\n   While the speed goes up: RMS of a_n less its reference, g, over 0-10, 10-20, ... 50-60 s; medians")
    for law in ("scheduled", "adaptive", "adaptive, thesis"):
        scenario = load_scenario("speed-range", LAWS[law])
        (flights,) = fly_jobs([Job(scenario, runs, (*COLUMNS, "nz_ref_g", "airspeed_m_s"))], executor=executor)
        errors = []
        for flown in flights:
            reference = flown.columns["nz_ref_g"] - (flown.columns["nz_cmd_g"] - command_g(flown.columns))
            error = increment_g(flown.columns) - reference
            errors.append([float(np.sqrt(np.mean(part**2))) for part in np.split(error, 6)])
        speed = flights[0].columns["airspeed_m_s"] / FT
        cells = " ".join(f"{value:6.3f}" for value in np.median(errors, axis=0))
        print(f"{law:>22} | {cells} | {speed[0]:.0f} to {speed[-1]:.0f} ft/s")


def beside(runs: int, executor: Executor | None) -> None:
    """Print the estimates of K by ``plid`` and by the scheduled filter; neither corrects the law."""
    print(
        f"\n5. Medians of {runs} flights: median |K-hat - K| from 0.3 s after the failure; K-hat at the end; mean NEES"
    )
    kinds = '{name="filter"},{name="plid",kind="plid"},{name="slow",kind="plid",block_fade=1.001}'
    for name in ("elevator-loss", "level-loss", "recovery"):
        scenario = load_scenario(name, (f"estimators=[{kinds}]", "adaptation.oracle=true", "adaptation.enabled=true"))
        flown = fly(scenario, runs, executor=executor)
        for estimator in ("filter", "plid", "slow"):
            cells = []
            for metric in ("median_abs_error_post", "final", "nees_mean_post"):
                m = flown.quantity(f"{estimator}.{metric}").median
                cells.append(f"{m.estimate:8.4f} ({m.low:8.4f} to {m.high:8.4f})")
            print(f"{name:>22}, {estimator:>6} | " + " | ".join(cells))


def _timed(call: Callable[[], object], repeats: int) -> float:
    began = time.perf_counter()
    for _ in range(repeats):
        call()
    return (time.perf_counter() - began) / repeats * 1e6


def times() -> None:
    """Print the time of a demand and of an update, for the readings of a flight."""
    print("\n6. Microseconds of a call, median of nine rounds of 180")
    for name, more in (("nz-scheduled", LAWS["scheduled"]), ("nz-adaptive", ())):
        planned = plan(load_scenario("cg-shift", more))
        samples = list(samples_of(assemble(planned)))
        axis = assemble(planned).load_factor
        assert axis is not None
        readings = iter([sample.measurement for sample in samples])
        law = axis.law
        rounds = [
            _timed(lambda law=law, it=readings: law.demand(next(it), increment_ref_g=0.0, hold=False), 180)
            for _ in range(9)
        ]
        print(f"{name:>22} | {np.median(rounds):6.1f}")
    for form, precision in (("plain", "double"), ("factored", "double"), ("factored", "single")):
        entry = f'estimators=[{{name="plid", kind="plid", form="{form}", precision="{precision}"}}]'
        flight = assemble(plan(load_scenario("elevator-loss", (entry, "adaptation.enabled=false"))))
        readings = [sample.measurement for sample in samples_of(assemble(plan(load_scenario("elevator-loss", ()))))]
        update, it = flight.estimators[0].update, iter(readings)  # type: ignore[union-attr]
        rounds = [_timed(lambda update=update, it=it: update(next(it)), 180) for _ in range(9)]
        print(f"{f'plid, {form}, {precision}':>22} | {np.median(rounds):6.1f}")


# What there is to print, and how many runs of it are enough.
PARTS: dict[str, tuple[Callable[[int, Executor | None], None], int]] = {
    "cases": (cases, 1000),
    "losses": (losses, 1000),
    "noise": (noise, 1000),
    "loops": (loops, 5),
    "speeds": (speeds, 5),
    "beside": (beside, 1000),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", nargs="+", choices=[*PARTS, "times"], default=[*PARTS, "times"])
    given = parser.parse_args(arguments)
    with processes(given.workers) as executor:
        for name, (part, most) in PARTS.items():
            if name in given.only:
                part(min(given.runs, most), executor)
    if "times" in given.only:
        times()
    return 0


if __name__ == "__main__":
    sys.exit(main())
