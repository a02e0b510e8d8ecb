"""
Sticky particles are not Gaussian
=================================

Inelastic collisions between particles that friction and noise keep moving. A cold start relaxes to a stationary state; its
temperature is below that of the noise, and its velocities are distributed with wider wings than a Gaussian's.
"""

import numpy as np
from matplotlib.figure import Figure

from kinetic_solver import Scene, solve
from kinetic_solver.scene import shipped

scene = Scene.from_toml(shipped("relaxation")).replace(**{"collisions.restitution": 0.0})
run = solve(scene)

figure = Figure(figsize=(10, 4), layout="constrained")
left, right = figure.subplots(1, 2)
run["temperature"].isel(x=0).plot(ax=left)
left.set(title="temperature", xlabel="time", ylabel="θ")

w = run["velocity_distribution"].isel(time=-1)
u, theta = (float(run[name].isel(time=-1, x=0)) for name in ("mean_velocity", "temperature"))
gaussian = float(w.integrate("v")) * np.exp(-((w["v"] - u) ** 2) / (2 * theta)) / np.sqrt(2 * np.pi * theta)
(w / gaussian).where(abs(w["v"] - u) < 3.5 * np.sqrt(theta)).plot(ax=right)
right.set(title="w(v) over the Gaussian of the same temperature", xlabel="v", ylabel="w(v) over the Gaussian")
kurtosis = float(((w["v"] - u) ** 4 * w).integrate("v") / w.integrate("v")) / theta**2
print(f"temperature {theta:.6f}, kurtosis {kurtosis:.4f} (Gaussian: 3)")
