"""
Figures 2 and 3 of the paper: particles
=======================================

Particles below and above the critical density of the paper's equations, at its three times: their density along the pipe, and
the distribution of their velocities beside a Gaussian and beside what the kinetic equation gives. Two thousand particles here,
for speed; ``kinetic-solver figure 3`` draws ten thousand.
"""

from kinetic_solver.analysis.paper_figures import draw_snapshots, figure_scene, snapshots, summary

below = snapshots(figure_scene(2, count=2000))
figure_2 = draw_snapshots(below)

# %%
# Above the critical density the particles cluster. It is not an instability: ten times as many cluster less.
above = snapshots(figure_scene(3, count=2000))
figure_3 = draw_snapshots(above)
print("\n".join(summary(above)))
