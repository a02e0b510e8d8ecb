"""Runs that go on from points in v that somebody chose before: of a file, or of a DataArray.

Between such points f is known no better than to rounding of its maximum, and (6) amplifies that where f is far smaller: so a grid
takes these points themselves, every m-th of them, or others besides. Test: tests/exact/test_continued_runs.py.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import GivenStart
from kinetic_solver.laws import CollisionLaw, FollowTheLeader
from kinetic_solver.plan import in_v
from kinetic_solver.plan.in_t import grown
from kinetic_solver.plan.scales import Scales, scales_of
from kinetic_solver.scene import Scene

SAME = 1e-9
"""Of a distance between two velocities: rounding."""
LEFT_OUT = 0.1
"""Of a file's window, that the solver's may reach beyond it without the output's doing so, unless (6) amplifies what is there: at
the edges of both f has ended. Chosen: a run that goes on is then written at the same velocities."""
STRONG = 5.0
"""R_t from which on (6) is written at the very points at which it is solved, for whoever goes on from them: rounding in the slow
tail, which interpolation leaves there, grows by exp(R_t w). Chosen; with less a run goes on as well, and fewer velocities are
faster (tests/exact/test_continued_runs.py)."""
HOPELESS = 1.0
"""Of max f, that (6) may make of what a start leaves out: with more, nothing of the run would be right."""


def check_tail(scales: Scales) -> None:
    """What (6) makes until the end of what is missing in the slow tail of a start that is known at points: beyond their lowest
    velocity, and where f is negative, which is the error of whoever wrote it. Warns beyond rtol, and raises SceneError beyond
    `HOPELESS`."""
    start, law = scales.start, scales.law
    if not (isinstance(start, GivenStart) and start.tabulated and isinstance(law, FollowTheLeader)):
        return
    table, mean, theta = start.table, *start.local_state()
    f, v = table.f[start.dense], table.v - start.frame
    gain = law.cross_section * f.sum(axis=1) * table.dv * scales.whole.drift_time
    missing = np.maximum(-f, 0.0)
    lowest = int(np.flatnonzero((f > 0).any(axis=0))[0])
    missing[:, lowest] = np.abs(f[:, lowest])
    with np.errstate(divide="ignore"):
        exponent = gain[:, None] * (mean[:, None] - v) - (gain**2 * theta / 2)[:, None]
        size = np.log(missing / f.max()) + np.maximum(exponent, 0.0)
    lost = grown(float(size.max()))
    if lost <= scales.rtol:
        return
    text = (
        f"initial = {start.name}: what it leaves out below v = {table.v[int(size.max(axis=0).argmax())]:.4g}, follow-the-leader "
        f"collisions make {lost:.2g} of max f until the end (accuracy.rtol = {scales.rtol:g})"
    )
    if lost > HOPELESS:
        raise SceneError(f"{text}; allowed: a start with a slower tail, as of a run to a smaller rtol; or a shorter run.end_time")
    warnings.warn(f"{text}; start from one with a slower tail, or end the run before", stacklevel=3)


def on_its_points(grid: PhaseSpaceGrid, start: GivenStart) -> PhaseSpaceGrid:
    """At least as fine and as wide as `grid`, with the start's own velocities among its own, or its own among them."""
    own = start.table.dv
    coarser = math.floor(grid.dv / own * (1 + SAME))
    dv = own * coarser if coarser else own / math.ceil(own / grid.dv * (1 - SAME))
    return _through(start.window[0] + own / 2, dv, grid)


def with_its_points(grid: PhaseSpaceGrid, start: GivenStart, here: Scales) -> PhaseSpaceGrid:
    """The output's: the start's own velocities, and where the flow leaves them more at the same distance, to the edges of `grid`,
    which holds all that the solver does; `grid` itself where it is finer."""
    own, (low, high) = start.table, start.laboratory
    if grid.dv < own.dv * (1 - 1 / grid.nv - SAME):  # a frame that moves brings its points to a whole number
        return grid
    left_out = 0.0 if here.amplifies else LEFT_OUT * (high - low)
    wide = replace(
        grid,
        low=grid.low if grid.low < low - left_out else low,
        high=grid.high if grid.high > high + left_out else high,
    )
    return _through(low + own.dv / 2, own.dv, wide)


def on_the_files_grid(scene: Scene, start: GivenStart, law: CollisionLaw | None) -> tuple[Scene, dict[str, str]]:
    """The scene on the grid of a file whose f no other grid would hold better, as wide as the flow comes to be, where [grid]
    names no other; and why."""
    end = scene.run.end_time
    needed = in_v.window(scales_of(scene, np.array([0.0, end]), law=law, start=start))
    (low, high), table = start.laboratory, start.table
    wide = PhaseSpaceGrid(table.f.shape[0], table.f.shape[1], scene.pipe.length, min(low, needed.low), max(high, needed.high))
    whole = _through(low + table.dv / 2, table.dv, wide)
    of_file: dict[str, Any] = {"nx": whole.nx}
    if scene.grid.velocity_window is None:
        of_file |= {"nv": whole.nv, "velocity_window": (whole.low, whole.high)}
    missing = {name: value for name, value in of_file.items() if getattr(scene.grid, name) is None}
    on_it = scene.model_copy(update={"grid": scene.grid.model_copy(update=missing)})
    return on_it, dict.fromkeys(missing, "as in initial.file")


def _through(point: float, dv: float, grid: PhaseSpaceGrid) -> PhaseSpaceGrid:
    """No narrower than `grid`, of this spacing, with a velocity at that point."""
    edge = point - dv / 2
    below = math.ceil((edge - grid.low) / dv - SAME)
    low = edge - below * dv
    nv = math.ceil((grid.high - low) / dv - SAME)
    return replace(grid, nv=nv, low=low, high=low + nv * dv)
