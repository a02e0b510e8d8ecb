"""What a run by any method will use, and why, in rows of words."""

from __future__ import annotations

from kinetic_solver.analysis.describe import Row, describe
from kinetic_solver.scene import Scene

ON_THE_GRID = "Run on the grid"
"""The title of `describe`'s section."""


def rows_of_plan(scene: Scene, method: str) -> list[Row]:
    """Raises SceneError where the method cannot run the scene. None of a method that there is not: the run says so."""
    if method == "grid":
        return dict(describe(scene))[ON_THE_GRID]
    if method == "particles":
        from particles.plan import make_plan
        from particles.report import rows

        return rows(make_plan(scene))
    if method == "exact":
        from kinetic_solver.exact.solve import points

        grid = points(scene)
        given = f"{grid.nx} places and {grid.nv} velocities on [{grid.low:.5g}, {grid.high:.5g}]"
        return [("closed form", f"at {given}   output, grid: nx, nv, velocity_window; no steps in time")]
    if method == "hydrodynamics":
        return _of_hydrodynamics(scene)
    return []


def _of_hydrodynamics(scene: Scene) -> list[Row]:
    from kinetic_solver.hydrodynamics import make_plan

    plan = make_plan(scene)
    equations = "the paper's closure (3)-(5)" if plan.moments is None else f"{plan.moments} Hermite moments"
    open_end = "more until accuracy.rtol is met" if scene.grid.nx is None and plan.moments is None else "as given or chosen"
    return [
        ("equations", f"{equations}   hydrodynamics.moments"),
        ("points", f"{plan.points}   {open_end}"),
        ("fields given at", f"{plan.output.nx} places   output.nx"),
        ("frames", f"{len(plan.schedule.times)}"),
    ]
