"""
A shock, exactly
================

Two homogeneous flows side by side, the dense one in front. Their front keeps its shape for ever, and at each place f is a mixture
of the two flows' own Gaussians. In the middle of a strong shock f has two peaks: the two populations of the paper's Figure 3.
"""

import numpy as np
from matplotlib.figure import Figure

from kinetic_solver import Scene, exact

scene = Scene.model_validate(
    {
        "model": {"gravity": 1.0, "friction": 0.7, "noise": 0.5},
        "collisions": {"operator": "follow-the-leader", "cross_section": 2.5},
        "pipe": {"length": 10.0},
        "run": {"end_time": 1.0},
    }
)
x, v = np.linspace(-3, 3, 241), np.linspace(-6, 3, 181)
shock = exact.shocks(scene, densities=[0.4, 2.0], positions=[0.0], times=[0.0], x=x, v=v).isel(time=0)

figure = Figure(figsize=(10, 4), layout="constrained")
left, right = figure.subplots(1, 2)
shock["f"].plot(ax=left, x="x", rasterized=True, cmap="magma", cbar_kwargs={"label": "f"})
left.set(title="f(x, v)", xlabel="x", ylabel="v")
for place, line in ((-0.6, "-"), (0.0, "--"), (0.6, ":")):
    at = shock["f"].sel(x=place, method="nearest")
    (at / at.integrate("v")).plot(ax=right, ls=line, lw=2, label=f"x = {place:g}")
right.set(title="velocities at three places", xlabel="v", ylabel="f/ρ", ylim=(0, 0.75))
right.legend(loc="upper center", ncols=3, frameon=False)
print("speed of the front:", shock.attrs["shock_speeds"])
