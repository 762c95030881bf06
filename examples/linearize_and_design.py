"""Trim and linearize the F-16, design a pitch-rate law with python-control, and compare it with the built-in design.

Run as a script, or cell by cell in editors that support `# %%`.
"""

# %% Trim at Mach 0.8, 20,000 ft, and linearize
import control
import numpy as np

import flightbed
from flightbed.control.design import design_proportional, reference_gain
from flightbed.core.units import DEG, FT

f16 = flightbed.load_aircraft("f16")
airframe = flightbed.JsbsimAirframe(f16, mach=0.8, altitude_m=20000 * FT)
point = flightbed.trim(airframe)
model = flightbed.linearize(airframe, point)
print(f"trim: alpha {point.alpha_rad / DEG:.2f} deg, elevator {point.elevator_rad / DEG:.2f} deg")

# %% The design model: alpha, q and the elevator position, which follows its command with a first-order lag
lag = f16.actuator.lag_rad_s
plant = model.subset("short-period").with_actuator("elevator", lag).to_control()
print("states:", ", ".join(plant.state_labels))
print("open-loop poles, rad/s:", np.round(np.sort(plant.poles().real), 2))

# %% LQR: one degree per second of pitch rate costs as much as 1.5 deg of elevator
weights = np.zeros((3, 3))
weights[1, 1] = 1.5**2
k_lqr, _, _ = control.lqr(plant.A, plant.B[:, [0]], weights, np.eye(1))

# %% The built-in design places poles; its gains have the opposite sign convention to control.lqr
design = flightbed.short_period(model, actuator_rad_s=lag)
placed = design_proportional(design)
gains = {"LQR": -k_lqr[0], "pole placement": np.array([placed.alpha, placed.q, placed.elevator])}

# %% Close the loop around the full longitudinal model, including speed and altitude, and apply a step of the reference.
# In flight the reference passes a prefilter of 3 rad/s, which removes most of the overshoot.
whole = model.subset("longitudinal").with_actuator("elevator", lag).to_control()
fed_back = [whole.state_labels.index(name) for name in plant.state_labels]
command = whole.input_labels.index("elevator_cmd")
pitch_rate = whole.output_labels.index("q")
t = np.linspace(0.0, 3.0, 601)
for name, k in gains.items():
    feedback = np.zeros((1, whole.nstates))
    feedback[0, fed_back] = k
    b = whole.B[:, [command]]
    closed = control.ss(whole.A + b @ feedback, b * reference_gain(design, k), whole.C[[pitch_rate], :], 0)
    q = control.step_response(closed, t).outputs
    rise = t[np.argmax(q >= 0.9)]
    poles = np.linalg.eigvals(design.with_actuator()[0] + np.outer(design.with_actuator()[1], k))
    shown = [f"{p.real:.2f}{f' +- {p.imag:.2f}j' if p.imag else ''}" for p in sorted(poles, key=abs) if p.imag >= 0.0]
    print(f"{name}: short-period poles {', '.join(shown)} rad/s")
    print(f"    a step of q: 90 % after {rise:.2f} s, peak {q.max():.2f}, {q[-1]:.2f} at 3 s")
