"""An estimator of your own: write it, check its contract, and fly it together with the built-in one.

Run as a script, or cell by cell in editors that support `# %%`. docs/extending.md describes the interface.
"""

# %% The estimator: K by least squares over a window, from the differences between q and its one-tick prediction
from collections import deque
from math import sqrt

import flightbed
from flightbed.testing import check_estimator


class WindowLeastSquares:
    """K = sum(u e) / sum(u u) over the last samples; u is the change of q in a tick by a healthy elevator, e the measured one."""

    def __init__(self, settings, onboard):
        self.design, self.bounds, self.smoothing = onboard.design, settings.bounds, settings.smoothing
        A, b = onboard.design.discrete(onboard.control_hz)
        self.from_alpha, self.from_q, self.from_elevator = float(A[1, 0]), float(A[1, 1]), float(b[1])
        self.var = 2.0 * onboard.noise.q_rad_s**2  # variance of the difference of two readings
        self.window = deque(maxlen=settings.options.get("samples", 30))
        self.before, self.smoothed = None, 1.0

    def update(self, measurement):
        alpha, q = measurement.alpha_rad - self.design.alpha_trim_rad, measurement.q_rad_s
        if self.before is not None:
            expected = self.from_alpha * self.before[0] + self.from_q * self.before[1]
            added = q - expected + self.from_elevator * self.design.elevator_trim_rad
            self.window.append((self.from_elevator * measurement.elevator_mean_rad, added))
        self.before = alpha, q
        # Prior: K = 1 with a standard deviation of 0.63; it dominates when the window has little information.
        information = 1.0 / 0.63**2 + sum(u * u for u, _ in self.window) / self.var
        raw = (1.0 / 0.63**2 + sum(u * e for u, e in self.window) / self.var) / information
        bounded = min(max(raw, self.bounds[0]), self.bounds[1])
        self.smoothed += (1.0 - self.smoothing) * (bounded - self.smoothed)
        no_innovation = float("nan")
        return flightbed.Estimate(
            bounded, sqrt(1.0 / information), self.smoothed, raw, measurement.alpha_rad, q, no_innovation
        )


# %% Check the contract of an estimator; raises an AssertionError with one line per violation
checked = check_estimator(WindowLeastSquares, settings={"model": "short-period"})
print(f"contract satisfied; {checked.microseconds_per_update:.0f} us per update")
print(f"on the exact linear plant, median error {checked.error_at_half:.3f} at K = 0.5")

# %% Fly it on the nonlinear aircraft, together with the built-in estimator that the law uses
sets = ["estimators.1={name='mine', kind='window-ls', model='short-period', options={samples=30}}"]
with flightbed.using({"window-ls": WindowLeastSquares}):
    result = flightbed.run(flightbed.load_scenario("elevator-loss", sets))

print("\nestimator    K at end   median |error|   first within 20 %")
for name, m in result.metrics.estimators.items():
    first = "never" if m.first_within_20pct_s is None else f"{m.first_within_20pct_s:.2f} s"
    print(f"{name:12} {m.final:8.3f} {m.median_abs_error_post:16.3f} {first:>19}")
