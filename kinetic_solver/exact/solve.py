"""The exact solution at a scene's frames, as a Dataset of the common schema."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.dataset import Frame, MemoryRecorder, Variables, schema
from kinetic_solver.errors import SceneError
from kinetic_solver.exact.solution import Solution
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.machine import too_large
from kinetic_solver.progress import Progress, telling
from kinetic_solver.scene import Scene, Schedule, check_is_scene

if TYPE_CHECKING:
    import xarray as xr

ARRAYS = 6
"""Of the size of f, alive at once while a frame is made and written. Counted, generously."""

VARIABLES: Variables = {
    "f": schema.VARIABLES["f"],
    "moments": schema.VARIABLES["moments"],
    "scalars": {name: schema.VARIABLES["scalars"][name] for name in ("mass", "momentum", "energy")},
}
"""Those of the common schema that a closed form has: no diagnostics, no budgets."""
PLACES = 64
"""Points in x where no key says how many; of fewer, w(v) is made from more. Chosen."""
TOTALS_TOLERANCE, MOST_PLACES = 1e-10, 4096
"""Of the mass, to which places on the pipe are added, and the most of them. Chosen: sums over a period converge all at once."""


def solve(
    scene: Scene, x: ArrayLike | None = None, v: ArrayLike | None = None, progress: bool | Progress | None = None
) -> xr.Dataset:
    """The exact solution at the scene's frames as a Dataset (docs/output.md); moments from the closed form, not from sums over v.

    `x` (uniform over one period from 0) and `v` (uniform) give the points, as `run["x"]`, `run["v"]` of a grid run; by default
    grid.nx or 64, and grid.nv or 128 points in grid.velocity_window or one that holds the solution. `progress` as of
    `kinetic_solver.solve`.
    Error: below 1e-13 of the largest value, and what exact/solution.py says of rounding. Where there are no particles mean
    velocity and temperature are NaN.
    Raises SceneError for operator (12) with ε < 1 and for a start from a file or an eigenmode, which have no closed form here,
    for points that are not uniform, and at times so late that it would take too many starting points.
    """
    check_is_scene(scene)
    grid, schedule = points(scene, x, v), Schedule.of(scene, VARIABLES)
    recorder = MemoryRecorder(grid, scene, schedule, "exact", VARIABLES)
    with telling(progress) as told:
        for time, frame in frames(scene, grid, schedule):
            recorder.record(time, frame)
            if told is not None and time > 0:
                told(time, scene.run.end_time)
    recorder.close()
    dataset = recorder.dataset()
    for name, given in (("x", x), ("v", v)):
        if given is not None:  # bit for bit as given: xarray aligns equal coordinates only
            dataset = dataset.assign_coords({name: (name, np.asarray(given, dtype=float), dataset[name].attrs)})
    return dataset


def frames(scene: Scene, grid: PhaseSpaceGrid, schedule: Schedule, first: int = 0) -> Iterator[tuple[float, Frame]]:
    """What is due at each time of the schedule from the `first` on, at the points of the grid; f is made only where it, or
    w(v) = ∫f dx, is due."""
    for time, due in zip(schedule.times[first:].tolist(), schedule.due[first:], strict=True):
        state = Solution(scene, time)
        frame: dict[str, dict[str, Array | float]] = {}
        if due & {"f", "moments"}:
            # Of few places w(v) = ∫f dx is made from more, among which they are.
            finer = -(-PLACES // grid.nx) if "moments" in due and not scene.homogeneous else 1
            f = state.distribution(grid.length / (finer * grid.nx) * np.arange(finer * grid.nx), grid.v)
            w, f = f.mean(axis=0) * grid.length, f[::finer]
        if due & {"moments", "scalars"}:
            rho, u, theta, q = state.moments(grid.x)
        if "f" in due:
            frame["f"] = {"f": f}
        if "moments" in due:
            frame["moments"] = dict(zip(VARIABLES["moments"], (rho, u, theta, q, w), strict=True))
        if "scalars" in due:
            frame["scalars"] = dict(zip(VARIABLES["scalars"], totals(state, rho, u, theta), strict=True))
        yield time, frame


def totals(state: Solution, rho: Array, u: Array, theta: Array) -> tuple[float, float, float]:
    """(mass, momentum, energy) over the pipe, from the moments at nx even points of a period.

    The mass is known. At time 0 the others are integrals between the jumps, without collisions they follow from those; else they
    are sums over as many points as give the mass to TOTALS_TOLERANCE, or over MOST_PLACES.
    """
    scene, length = state.scene, state.scene.pipe.length
    mass = scene.initial.density * length
    if state.setting.at_start:
        return mass, *state.start_totals()
    if scene.cross_section == 0:
        p, energy = state.start_totals()
        step = state.spread
        e, shift = step.decay, step.velocity_shift
        return mass, e * p + shift * mass, e * e * energy + e * shift * p + mass * (shift**2 + step.velocity_variance) / 2
    nx = rho.size
    while abs(rho.mean() * length / mass - 1) > TOTALS_TOLERANCE and nx < MOST_PLACES:
        nx = 4 * nx if nx > 1 else 64
        rho, u, theta, _ = state.moments(length * np.arange(nx) / nx)
    scale = mass / rho.mean()
    momentum, energy = (np.where(rho > 0, rho * part, 0.0).mean() for part in (u, u**2 + theta))
    return mass, float(momentum) * scale, float(energy) * scale / 2


def points(scene: Scene, x: ArrayLike | None = None, v: ArrayLike | None = None) -> PhaseSpaceGrid:
    """The points of the scene's exact solution, as `solve` has them. Raises SceneError as `solve` does."""
    if scene.law is not None and not scene.law.linearises:
        raise SceneError(
            "collisions.operator = 'inelastic': has no closed form; allowed for the exact method: 'follow-the-leader', none"
        )
    if scene.initial.file is not None:
        raise SceneError("initial.file: has no closed form; the exact method starts from a Maxwellian")
    if scene.initial.eigenmodes:
        raise SceneError("initial.eigenmodes: have no closed form here; the exact method starts from a Maxwellian")
    return _grid(scene, x, v)


def _grid(scene: Scene, x: ArrayLike | None, v: ArrayLike | None) -> PhaseSpaceGrid:
    shown = scene.output
    nx = np.size(x) if x is not None else shown.nx or scene.grid.nx or (1 if scene.homogeneous else PLACES)
    nv = np.size(v) if v is not None else shown.nv or scene.grid.nv or 128
    for name, given in (("x", x), ("v", v)):
        if given is not None and not (np.size(given) > (name == "v") and np.all(np.diff(given) > 0)):
            raise SceneError(f"{name}: must increase, and be {'two' if name == 'v' else 'one'} at least")
    if v is not None:
        velocities = np.asarray(v, float)
        half = (velocities[-1] - velocities[0]) / (nv - 1) / 2
        low, high = float(velocities[0] - half), float(velocities[-1] + half)
    else:
        low, high = shown.velocity_window or scene.grid.velocity_window or _window(scene)
    if (why := too_large(8 * ARRAYS * nx * nv)) is not None:
        raise SceneError(f"grid: nx = {nx}, nv = {nv} {why}; reduce nx or nv")
    if nx == 1 and not scene.homogeneous:
        key = "grid.nx" if x is None else "x"
        raise SceneError(f"{key}: one place does not hold a scene that depends on x; allowed: more of them")
    within = _window(scene)
    if high <= within[0] or low >= within[1]:
        key = "v" if v is not None else "output.velocity_window" if shown.velocity_window else "grid.velocity_window"
        raise SceneError(
            f"{key}: from {low:g} to {high:g} f is zero everywhere; allowed: velocities between {within[0]:.4g} and "
            f"{within[1]:.4g}"
        )
    grid = PhaseSpaceGrid(nx, nv, scene.pipe.length, low, high)
    for name, given, wanted in (("x", x, grid.x), ("v", v, grid.v)):
        if given is not None and not np.allclose(given, wanted, rtol=1e-9, atol=1e-9 * (wanted[-1] - wanted[0])):
            raise SceneError(f"{name}: must be uniform" + (" over one period, from 0" if name == "x" else ""))
    return grid


def _window(scene: Scene) -> tuple[float, float]:
    """Six standard deviations about every mean velocity at the start and at the end."""
    places = scene.pipe.length * np.arange(64) / 64
    means, spreads = [], []
    for share, mean, temperature in initial.beams(scene):
        # Each beam keeps the velocities that it would have alone: F is linear, and exp(-SΦ) does not depend on v.
        of_beam = {"beams": (), "mean_velocity": mean, "temperature": temperature} if share < 1 else {}
        alone = scene.model_copy(update={"initial": scene.initial.model_copy(update=of_beam)})
        for time in (0.0, scene.run.end_time):
            _, u, theta, _ = Solution(alone, time).moments(places)
            means += [np.nanmin(u), np.nanmax(u)]  # in a vacuum there are none
            spreads.append(np.nanmax(theta))
    reach = 6 * math.sqrt(max(spreads))
    return float(min(means)) - reach, float(max(means)) + reach
