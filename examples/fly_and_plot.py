"""Fly a loss of elevator effectiveness with the adaptive law, with the fixed law, and without failure; plot pitch rate and K.

Run as a script, or cell by cell in editors that support `# %%`. It takes some seconds and writes elevator-loss.png.
"""

# %% Three scenarios: two that ship with flightbed, and one without its failure
import matplotlib.pyplot as plt

import flightbed

scenarios = {
    "adaptive": flightbed.load_scenario("elevator-loss"),
    "fixed law": flightbed.load_scenario("elevator-loss-fixed"),
    "no failure": flightbed.load_scenario("elevator-loss", ["failures=[]", "adaptation.enabled=false"]),
}

# %% Fly them
flights = {name: flightbed.run(scenario) for name, scenario in scenarios.items()}
for name, flight in flights.items():
    metrics = flight.metrics
    ended = (
        f"departed at {metrics.departed_at_s:.2f} s" if metrics.departed else f"flown to {flight.summary.flown_s:g} s"
    )
    tracking = metrics.tracking_rms_post_deg_s or metrics.tracking_rms_pre_deg_s
    print(f"{name:14} {ended:22} tracking error {tracking:.2f} deg/s RMS")

# %% Plot pitch rate and the estimate of K
adaptive = flights["adaptive"].trace
figure, (rate, share) = plt.subplots(2, 1, sharex=True, figsize=(9, 6), layout="constrained")
rate.plot(adaptive["t_s"], adaptive["q_ref_deg_s"], color="black", linewidth=0.8, label="reference")
for name, flight in flights.items():
    rate.plot(flight.trace["t_s"], flight.trace["q_deg_s"], label=name)
rate.set(ylabel="pitch rate, deg/s", ylim=(-15, 15))
rate.legend(loc="upper right")

k_hat, sigma = adaptive["scheduled.effectiveness"], adaptive["scheduled.effectiveness_std"]
share.fill_between(adaptive["t_s"], k_hat - 2 * sigma, k_hat + 2 * sigma, alpha=0.3, label="two sigma")
share.plot(adaptive["t_s"], k_hat, label="estimate")
share.plot(adaptive["t_s"], adaptive["effectiveness_true"], color="black", linewidth=0.8, label="truth")
share.set(xlabel="time, s", ylabel="effectiveness K", ylim=(0, 1.2))
share.legend(loc="upper right")

figure.savefig("elevator-loss.png", dpi=120)
print("plotted to elevator-loss.png")
