"""Shocks of (2) with operator (6), on the line: homogeneous states side by side, in closed form.

With Φ_x = ρ, Φ_t = -ρu and f = F exp(-SΦ) the equation for F is linear (docs/theory_details.md). The homogeneous state of
density ρ_i is one of its solutions, F_i = ρ_i N(v; u_i, σ) exp[S(ρ_i x - ρ_i u_i t)] with u_i = (g - Sρ_iσ)/γ, so sums of them
are too:

    f = Σ w_i ρ_i N(v; u_i, σ),   w_i ∝ exp[S(ρ_i x - ρ_i u_i t) + b_i],   Σ w_i = 1.

Two states make a shock that keeps its shape, three or more make shocks that catch up and merge. At every place f is a mixture
of the states' own Gaussians. Test: tests/exact/test_shocks.py."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import FOLLOW_LEADER, Scene

if TYPE_CHECKING:
    import xarray as xr


def shocks(scene: Scene, densities: ArrayLike, positions: ArrayLike, times: ArrayLike, x: ArrayLike, v: ArrayLike) -> xr.Dataset:
    """f(time, x, v) and its moments where homogeneous states of ascending `densities` meet at `positions` at time 0, on the line.

    `densities` (n,), above 0 and ascending, from left to right; `positions` (n - 1,), not descending, the fronts between
    neighbours, each where its two states would weigh the same were they alone (fronts nearer than a few 1/(SΔρ) overlap);
    `times`, `x` and `v` ascending, any x and t, before time 0 as well. Of the scene only model and collisions count: γ, σ and S
    above 0, operator (6). Moments are closed forms, not sums over v; sums are done in log space, so that any S is fine.
    Attributes: `shock_speeds` of the n - 1 fronts, (g - Sσ(ρ_i + ρ_{i+1}))/γ: the right one of two is always the slower, so
    they merge. Raises SceneError for another operator and for arguments that are not as said. Error: rounding."""
    import xarray as xr

    _refuse(scene)
    rho = _checked("densities", densities, least=2)
    fronts = _checked("positions", positions, least=1, strictly=False)
    t, places, velocities = _checked("times", times), _checked("x", x), _checked("v", v)
    if not rho[0] > 0:
        raise SceneError(f"densities: the least is {rho[0]:g}; allowed: above 0")
    if fronts.size != rho.size - 1:
        raise SceneError(f"positions: {fronts.size} given; allowed: {rho.size - 1}, one between each two of {rho.size} densities")
    g, gamma, sigma, s = scene.model.gravity, scene.model.friction, scene.model.noise, scene.cross_section
    u = (g - s * rho * sigma) / gamma
    # Of w_i: at time 0 neighbours weigh the same at the front between them
    offset = -s * np.append(0.0, np.cumsum(np.diff(rho) * fronts))
    exponent = s * rho * (places[None, :, None] - u * t[:, None, None]) + offset
    weight = np.exp(exponent - exponent.max(axis=2, keepdims=True))
    weight /= weight.sum(axis=2, keepdims=True)
    parts = weight * rho
    density = parts.sum(axis=2)
    mean = (parts @ u) / density
    apart = u - mean[:, :, None]
    temperature = sigma + (parts * apart**2).sum(axis=2) / density
    heat = (parts * apart**3).sum(axis=2) + 3 * sigma * (parts * apart).sum(axis=2)
    gaussians = np.exp(-((velocities - u[:, None]) ** 2) / (2 * sigma)) / np.sqrt(2 * np.pi * sigma)

    def over(dims: tuple[str, ...], values: Array, long_name: str, units: str) -> tuple[tuple[str, ...], Array, dict[str, Any]]:
        return dims, values, {"long_name": long_name, "units": units}

    place = ("time", "x")
    return xr.Dataset(
        {
            "f": over((*place, "v"), parts @ gaussians, "distribution function, point values", "particles time length-2"),
            "density": over(place, density, "density ρ", "particles length-1"),
            "mean_velocity": over(place, mean, "mean velocity u", "length time-1"),
            "temperature": over(place, temperature, "granular temperature θ, the velocity variance", "length2 time-2"),
            "heat_flux": over(place, heat, "heat flux, third central velocity moment of f", "particles length2 time-3"),
        },
        {
            "time": ("time", t, {"long_name": "time", "units": "time"}),
            "x": ("x", places, {"long_name": "position", "units": "length"}),
            "v": ("v", velocities, {"long_name": "velocity", "units": "length time-1"}),
        },
        {
            "method": "exact",
            "title": "Shocks of the kinetic equation (2) with follow-the-leader collisions, on the line",
            "scene": scene.model_dump_json(by_alias=True, exclude_none=True),
            "densities": rho,
            "positions": fronts,
            "shock_speeds": (g - s * sigma * (rho[:-1] + rho[1:])) / gamma,
        },
    )


def _refuse(scene: Scene) -> None:
    if scene.operator != FOLLOW_LEADER:
        given = "no collisions" if scene.operator is None else f"collisions.operator = {scene.operator!r}"
        raise SceneError(f"{given}: shocks are exact for 'follow-the-leader' with collisions.cross_section above 0 alone")
    for name, value in (("friction", scene.model.friction), ("noise", scene.model.noise)):
        if value == 0:
            raise SceneError(f"model.{name} = 0: shocks are between homogeneous states, which need both; allowed: above 0")


def _checked(name: str, given: ArrayLike, least: int = 1, strictly: bool = True) -> Array:
    """One-dimensional, finite and ascending."""
    values = np.atleast_1d(np.asarray(given, dtype=float))
    if values.ndim != 1 or values.size < least:
        raise SceneError(f"{name}: has shape {values.shape}; allowed: a list of {least} or more numbers")
    if not np.isfinite(values).all():
        raise SceneError(f"{name}: has a number that is not finite; allowed: finite ones")
    steps = np.diff(values)
    if (steps <= 0).any() if strictly else (steps < 0).any():
        place = int(np.argmax(steps <= 0 if strictly else steps < 0))
        order = "ascending" if strictly else "not descending"
        raise SceneError(f"{name}: {values[place]:g} is followed by {values[place + 1]:g}; allowed: {order} numbers")
    return values
