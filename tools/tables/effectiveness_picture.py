"""Draw docs/effectiveness.png from our own flights: the rivals, the tracking, level flight, and sigma beside the bound.

python tools/tables/effectiveness_picture.py [FILE]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from effectiveness import RIVALS, job, scenario

from flightbed import run

COLORS = {"scheduled": "#0072b2", "absolute": "#e69f00", "thesis": "#d55e00", "baseline": "#009e73"}


def main() -> None:
    """Fly and draw."""
    target = (
        Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[2] / "docs" / "effectiveness.png"
    )
    rivals = run(scenario(job(rivals=tuple(RIVALS)))).trace
    fixed, oracle = (run(scenario(job(adapt=adapt))).trace for adapt in (False, "oracle"))
    level = run(scenario(job(rivals=("scheduled", "thesis"), set=("command.kind=none",)))).trace
    figure, axes = plt.subplots(2, 2, figsize=(11, 7), constrained_layout=True)
    (first, tracking), (quiet, sigma) = axes
    for name, color in COLORS.items():
        first.plot(rivals["t_s"], rivals[f"{name}.effectiveness_smoothed"], color=color, lw=1.2, label=name)
    first.plot(rivals["t_s"], rivals["effectiveness_true"], "k--", lw=1, label="true")
    first.set(title="Mach 0.8, K to 0.2 at 4.5 s: smoothed estimates", ylabel="K", xlabel="t, s", ylim=(-0.05, 1.1))
    tracking.plot(rivals["t_s"], rivals["q_ref_deg_s"], "k--", lw=1, label="reference")
    tracking.plot(fixed["t_s"], fixed["q_deg_s"], color="#d55e00", lw=1, label="fixed law")
    tracking.plot(oracle["t_s"], oracle["q_deg_s"], color="#999999", lw=2, label="oracle")
    tracking.plot(rivals["t_s"], rivals["q_deg_s"], color="#0072b2", lw=1, label="adaptive")
    tracking.set(title="Pitch rate of the same flight", ylabel="q, deg/s", xlabel="t, s", ylim=(-15, 15))
    for name in ("scheduled", "thesis"):
        quiet.plot(level["t_s"], level[f"{name}.effectiveness"], color=COLORS[name], lw=0.8, label=name)
    quiet.plot(level["t_s"], level["effectiveness_true"], "k--", lw=1, label="true")
    quiet.set(title="Level flight, no command: absolute and deviation", ylabel="K", xlabel="t, s", ylim=(-0.05, 1.1))
    error = abs(rivals["scheduled.effectiveness_raw"] - rivals["effectiveness_true"])
    sigma.semilogy(rivals["t_s"], error, color="#999999", lw=0.6, label="achieved error")
    sigma.semilogy(
        rivals["t_s"], rivals["scheduled.effectiveness_std"], color="#0072b2", lw=1, label="sigma of the filter"
    )
    sigma.semilogy(rivals["t_s"], rivals["effectiveness_bound"], "k--", lw=1, label="Cramer-Rao bound, 30 samples")
    sigma.set(title="How well it knows", ylabel="K", xlabel="t, s", ylim=(1e-4, 1))
    for axis in axes.flat:
        axis.legend(fontsize=8, loc="upper right")
        axis.grid(alpha=0.3)
        axis.set_xlim(2.0, 16.5)
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    main()
