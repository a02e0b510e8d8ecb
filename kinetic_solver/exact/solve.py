"""The exact solution at a scene's frames, as a Dataset of the common schema."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import MemoryRecorder
from kinetic_solver.errors import SceneError
from kinetic_solver.exact.solution import Solution
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.scene import INELASTIC, Scene

if TYPE_CHECKING:
    import xarray as xr


def solve(scene: Scene, x: ArrayLike | None = None, v: ArrayLike | None = None) -> xr.Dataset:
    """The exact solution at the scene's frames as a Dataset (docs/output.md); moments from the closed form, not from sums over v.

    `x` (uniform over one period from 0) and `v` (uniform) give the points, as `run["x"]`, `run["v"]` of a grid run; by default
    grid.nx or 64, and grid.nv or 128 points in grid.velocity_window or one that holds the solution.
    Raises SceneError for operator (12) and for a start from a file or an eigenmode, which have no closed form here.
    """
    if scene.operator == INELASTIC:
        raise SceneError(
            "collisions.operator = 'inelastic': has no closed form; allowed for the exact method: 'follow-the-leader', none"
        )
    if scene.initial.file is not None:
        raise SceneError("initial.file: has no closed form; the exact method starts from a Maxwellian")
    if scene.initial.eigenmodes:
        raise SceneError("initial.eigenmodes: have no closed form here; the exact method starts from a Maxwellian")
    grid = _grid(scene, x, v)
    recorder = MemoryRecorder(grid, scene, method="exact")
    for time in scene.times():
        state = Solution(scene, float(time))
        moments = state.moments(grid.x)
        rho, u, theta, q = moments
        f = state.distribution(grid.x, grid.v)
        frame: dict[str, dict[str, Array | float]] = {}
        if scene.output.f is not False:
            frame["f"] = {"f": f}
        if scene.output.moments is not False:
            frame["moments"] = {
                "density": rho,
                "mean_velocity": u,
                "temperature": theta,
                "heat_flux": q,
                "velocity_distribution": f.sum(axis=0) * grid.dx,
            }
        if scene.output.scalars is not False:
            frame["scalars"] = {
                "mass": rho.sum() * grid.dx,
                "momentum": (rho * u).sum() * grid.dx,
                "energy": (rho * (u**2 + theta)).sum() * grid.dx / 2,
            }
        recorder.record(float(time), frame)
    recorder.close()
    dataset = recorder.dataset()
    for name, points in (("x", x), ("v", v)):
        if points is not None:  # bit for bit as given: xarray aligns equal coordinates only
            dataset = dataset.assign_coords({name: (name, np.asarray(points, dtype=float), dataset[name].attrs)})
    return dataset


def _grid(scene: Scene, x: ArrayLike | None, v: ArrayLike | None) -> PhaseSpaceGrid:
    nx = np.size(x) if x is not None else scene.grid.nx or (1 if scene.homogeneous else 64)
    nv = np.size(v) if v is not None else scene.grid.nv or 128
    if v is not None:
        points = np.asarray(v, float)
        half = (points[-1] - points[0]) / (nv - 1) / 2
        low, high = float(points[0] - half), float(points[-1] + half)
    else:
        low, high = scene.grid.velocity_window or _window(scene)
    grid = PhaseSpaceGrid(nx, nv, scene.pipe.length, low, high)
    for name, given, points in (("x", x, grid.x), ("v", v, grid.v)):
        if given is not None and not np.allclose(given, points, rtol=1e-9, atol=1e-9 * (points[-1] - points[0])):
            raise ValueError(f"{name} must be uniform" + (" over one period, from 0" if name == "x" else ""))
    return grid


def _window(scene: Scene) -> tuple[float, float]:
    """Six standard deviations about every mean velocity at the start and at the end."""
    points = scene.pipe.length * np.arange(64) / 64
    means, spreads = [], []
    for time in (0.0, scene.run.end_time):
        _, u, theta, _ = Solution(scene, time).moments(points)
        means += [u.min(), u.max()]
        spreads.append(theta.max())
    reach = 6 * math.sqrt(max(spreads))
    return float(min(means)) - reach, float(max(means)) + reach
