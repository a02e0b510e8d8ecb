"""How a run of the closure chooses its points: refined until two resolutions agree, in the norm that the flow allows.

Where a frame is smooth on both, the finer one's error is taken for 1/7 of their largest difference (order 3, in time; in x it
is 5). Where the steepest difference between neighbours does not halve with dx the frame has a jump; there no scheme converges
in the maximum norm, and the difference in L1, of order 1, stands for the finer one's error."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.hydrodynamics.closure import Frames, run_closure
from kinetic_solver.hydrodynamics.plan import Plan

MOST_WORK, SETTLE = 2e8, 2e7
"""Points times steps of the finest run that rtol may ask for: two minutes at the 0.6 μs each that 1024 points take on one core;
and of the run that is taken where that would not be enough."""
LONGEST = 0.4
"""Steps of the coarsest run in units of 1/γ, beyond which order 3 cannot be seen; halved with dx."""
FEWEST = 16
"""Points that are worth being the coarser of two runs, where grid.nx is given."""

STEEPER = 0.7
"""How many times the steepest difference between neighbours of a smooth field may fall at most when dx is halved: 0.5, and the
rest for fields that are just resolved."""


@dataclass(frozen=True)
class Agreement:
    """Of two runs, one with half the other's points: the errors of the finer one."""

    largest: float
    """In the maximum norm, over the frames that are smooth: max|Δρ| over max ρ, max|Δθ| over max θ, max|Δu| over max(|u|, √θ)."""
    integral: float
    """In L1, over the frames that are not: the same with means in the place of maxima."""
    jumps_from: float
    """Time of the first frame with a jump; inf without."""

    @property
    def error(self) -> float:
        return max(self.largest, self.integral)

    def attributes(self) -> dict[str, str | float]:
        where = "jumps" if np.isfinite(self.jumps_from) else "smooth"
        found: dict[str, str | float] = {"flow": where, "error_maximum_norm": self.largest}
        if where == "jumps":
            found |= {"error_L1": self.integral, "jumps_from": self.jumps_from}
        return found


def agreement(times: Array, coarse: Array, fine: Array, rtol: float) -> Agreement:
    """Of the fields at `times`, as far as both came: shapes (frames, 4, n) and (frames, 4, 2n), or both (frames, 4, 1)."""
    largest, integral, jumps_from = 0.0, 0.0, float("inf")
    for time, old, new in zip(times, coarse[:, :3], fine[:, :3], strict=False):
        rho, u, theta = new
        scales = np.array([rho.max(), max(np.abs(u).max(), np.sqrt(theta.max())), theta.max()])
        difference = np.abs(new[:, :: new.shape[1] // old.shape[1]] - old) / scales[:, None]
        if difference.max() / 7 > rtol and _jumps(old, new):
            jumps_from = min(jumps_from, float(time))
            integral = max(integral, float(difference.mean(axis=1).max()))
        else:
            largest = max(largest, float(difference.max()) / 7)
    return Agreement(largest, integral, jumps_from)


def _jumps(coarse: Array, fine: Array) -> bool:
    steepest = [np.abs(np.diff(field[0], append=field[0, :1])).max() for field in (coarse, fine)]
    return bool(steepest[1] > STEEPER * steepest[0])


def refined_run(plan: Plan, watch: Callable[[float], None] | None = None) -> tuple[Frames, dict[str, str | float]]:
    """`run_closure` at a resolution that meets rtol, with the fields at the output's points, and attributes that say so.

    A given grid.nx is kept, and the run with half as many points, if that is a whole number, gives the error. Where rtol is not
    met, with grid.nx or for want of points, it warns. Of runs that stop the frames that they reach count."""
    scene, times, rtol = plan.scene, plan.schedule.times, plan.scene.accuracy.rtol
    given, shown = scene.grid, plan.output.nx
    gamma = scene.model.friction
    longest = LONGEST / gamma if gamma > 0 else math.inf
    if shown == 1:
        levels = [1] * 20
    elif given.nx is not None:
        levels = [shown // 2, shown] if shown % 2 == 0 and shown >= 2 * FEWEST else [shown]
    else:
        levels = [shown // 2 * 2**n for n in range(20)]
    frames, coarse, found = None, None, None
    for place, nx in enumerate(levels):
        bound = longest / 2**place
        if given.time_step is not None:
            bound = given.time_step * (2 if place < len(levels) - 1 and given.nx is not None else 1)
        frames = run_closure(scene, times, nx, bound, 2.0**place, watch)
        found = agreement(times, coarse.fields, frames.fields, rtol) if coarse is not None else None
        if found is not None:
            # Work grows as nx²; errors fall as 1/nx with jumps, else as 1/nx³
            wanted = frames.work * max(4.0, (found.error / rtol) ** (2.0 if found.integral > rtol else 2 / 3))
            if found.error <= rtol or 4 * frames.work > (MOST_WORK if wanted <= MOST_WORK else SETTLE):
                break
        coarse = frames
    assert frames is not None
    points = frames.fields.shape[2]
    attributes: dict[str, str | float] = {"points": str(points)}
    if found is not None:
        attributes |= found.attributes()
        if found.error > rtol:
            remedy = "raise accuracy.rtol" if given.nx is None else "raise grid.nx or accuracy.rtol"
            text = f"the error is about {found.largest:.2g} in the maximum norm"
            if math.isfinite(found.jumps_from):
                text += (
                    f" while the flow is smooth, and {found.integral:.2g} in L1 from t = {found.jumps_from:.6g} on, with jumps"
                )
            warnings.warn(f"{text} (accuracy.rtol = {rtol:g}); {remedy}", stacklevel=4)
    return dataclasses.replace(frames, fields=frames.fields[:, :, :: points // shown]), attributes
