"""
Figure 1 of the paper: the critical density
===========================================

Above it, a wave of that mode number grows in the paper's hydrodynamic equations (3)-(5). Short waves are the first to grow.
The kinetic equation that these equations approximate is stable at every density: its growth rates are below zero throughout.
"""

from matplotlib.figure import Figure

from kinetic_solver import Scene, stability

critical = stability.figure_1()
figure_1 = Figure(figsize=(7, 4), layout="constrained")
axes = figure_1.subplots()
critical["critical_density"].plot(ax=axes, marker="o", markersize=3)
axes.set(title="closure: critical density of each mode", xlabel="mode number n", ylabel="critical density")
print(f"least critical density {critical.attrs['least_critical_density']:.4g}, of the shortest waves")

# %%
# Growth rates at R* = 2, above the least critical density, by the closure and by the equation:
scene = Scene.model_validate(
    {
        "collisions": {"operator": "follow-the-leader", "cross_section": 2.0},
        "pipe": {"length": 25.0},
        "run": {"end_time": 1.0},
    }
)
rates = stability.growth_rates(scene, range(1, 13))
rates_figure = Figure(figsize=(7, 4), layout="constrained")
axes = rates_figure.subplots()
rates["closure_growth_rate"].plot(ax=axes, marker="o", label="closure (3)-(5)")
rates["kinetic_growth_rate"].plot(ax=axes, marker="s", label="kinetic equation (2)")
axes.axhline(0, color="0.6", linewidth=0.8)
axes.set(title="R* = 2: growth rates", xlabel="mode number n", ylabel="Re s", ylim=(-2, 0.8))
axes.legend(loc="lower left", frameon=False)
