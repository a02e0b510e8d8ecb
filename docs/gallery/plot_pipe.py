"""
The paper's pipe, above its critical density
============================================

A large wave in a pipe of particles that follow their leaders, at R* = 2. The paper's hydrodynamic equations call this unstable.
The kinetic equation steepens the wave into a front, which moves and decays.
"""

from kinetic_solver import Scene, exact, solve
from kinetic_solver.analysis.plotting import overview
from kinetic_solver.scene import shipped

scene = Scene.from_toml(shipped("pipe"))
run = solve(scene)
figure = overview(run)

# %%
# The scene has a closed form, which shares no numerics with the grid. At the same places and velocities:
truth = exact.solve(scene, run["x"], run["v"])
difference = abs(run["f"] - truth["f"]).max() / truth["f"].max()
print(f"asked for {scene.accuracy.rtol:g}, estimated {float(run['error_estimate'].max()):.1e}, true {float(difference):.1e}")
