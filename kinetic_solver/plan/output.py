"""Where fields are given, whatever grid the solver uses."""

from __future__ import annotations

import math
from dataclasses import replace

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import GivenStart
from kinetic_solver.machine import too_large
from kinetic_solver.plan.continuing import with_its_points
from kinetic_solver.plan.limits import FEWER_VELOCITIES, MOST_VELOCITIES
from kinetic_solver.plan.moving_frame import ReferenceFrame
from kinetic_solver.plan.refusal import Refused, Remedy
from kinetic_solver.plan.scales import Scales
from kinetic_solver.scene import Scene

LEAST_PLACES, LEAST_VELOCITIES = 65, 64
"""At which fields are given where no key says how many; one place where nothing depends on x. Chosen: a wave, and a Maxwellian,
look smooth on them, and an odd number of places holds whole waves, for whoever starts from them."""
NARROWED = 0.1
"""Scale of a noiseless frame from which on it is to blame. Chosen: for words only."""
APART = 1e-9
"""Of the largest velocity, that neighbours must be apart for doubles to tell them well. Chosen."""
OUTPUT_ARRAYS = 4
"""Arrays of the output's size alive at once: f interpolated in x, in v, and as it is written. Counted, generously."""


def output_grids(
    grid: PhaseSpaceGrid, frame: ReferenceFrame, times: Array, here: Scales
) -> tuple[PhaseSpaceGrid, PhaseSpaceGrid]:
    """`Plan.output` and `Plan.whole`: what [output] says, else what [grid] says, else the points of the file that the run goes on
    from, else the solver's and enough to be looked at."""
    scene, start = here.scene, here.start
    whole, given = _holding_all(grid, frame, times, scene), scene.output
    of_file = start if isinstance(start, GivenStart) and start.of_file else None
    nx = given.nx or (grid.nx if scene.grid.nx or grid.nx == 1 else max(LEAST_PLACES, grid.nx))
    if of_file is not None and not (given.nx or scene.grid.nx):
        nx = of_file.table.f.shape[0]
    whole = replace(whole, nx=nx)
    if frame.cooling > 0 and given.velocity_window is None:
        # Over (v - U)/s nothing narrows.
        scaled = replace(whole, low=grid.low / frame.unit, high=grid.high / frame.unit, scaled=True)
        return replace(scaled, nv=given.nv or max(LEAST_VELOCITIES, whole.nv)), whole
    if of_file is not None and not (given.nv or given.velocity_window or scene.grid.nv or scene.grid.velocity_window):
        output = with_its_points(whole, of_file, here)
        return output, whole
    low, high = given.velocity_window or (whole.low, whole.high)
    nv = whole.nv if scene.grid.nv else max(LEAST_VELOCITIES, math.ceil((high - low) / whole.dv - 1e-9))
    output = replace(whole, nv=given.nv or nv, low=low, high=high)
    if whole.dv < APART * (farthest := max(abs(whole.low), abs(whole.high))):
        raise Refused(
            f"initial.mean_velocity: of velocities as large as {farthest:.3g} doubles cannot tell those {whole.dv:.3g} apart",
            FEWER_VELOCITIES,
        )
    if (why := too_large(8 * OUTPUT_ARRAYS * output.nx * output.nv)) is not None:
        given_keys = (Remedy("output.nx", "less"), Remedy("output.nv", "less"))
        raise Refused(f"output: nx = {output.nx}, nv = {output.nv} {why}", (*given_keys, *FEWER_VELOCITIES))
    return output, whole


def _holding_all(grid: PhaseSpaceGrid, frame: ReferenceFrame, times: Array, scene: Scene) -> PhaseSpaceGrid:
    """Holds all that the solver's first window holds, at every frame, with its resolution."""
    if not frame.moving:
        return grid
    if frame.cooling > 0:
        return replace(grid, low=frame.start + grid.low, high=frame.start + grid.high)  # the start's: what follows is narrower
    places = [frame.place(float(clock)) for clock in times]
    low = min(place.velocity + place.scale * grid.low for place in places)
    high = max(place.velocity + place.scale * grid.high for place in places)
    nv = math.ceil((high - low) / (grid.dv * min(place.scale for place in places)) - 1e-9)
    if nv > MOST_VELOCITIES:
        narrow = min(place.scale for place in places) < NARROWED
        why = (
            "without noise the velocity distribution becomes so narrow"
            if narrow
            else f"the flow takes velocities so far apart, from {low:.3g} to {high:.3g},"
        )
        raise Refused(
            f"run.end_time = {scene.run.end_time:g}: {why} that the output would need {nv:.3g} of them, more than "
            f"{MOST_VELOCITIES}",
            FEWER_VELOCITIES,
        )
    return PhaseSpaceGrid(grid.nx, nv, grid.length, low, high)
