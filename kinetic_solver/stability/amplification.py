"""What a stable but non-normal flow makes of disturbances and of noise: transient growth, the structure factor of N particles.

Derivations and figures: docs/stability_details.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene
from kinetic_solver.stability.flow import flow_of
from kinetic_solver.stability.spectrum import FIRST_MODES
from kinetic_solver.stability.units import dimensionless, mode_numbers
from kinetic_solver.threads import with_one_blas_thread

if TYPE_CHECKING:
    import xarray as xr

HIGHEST_COLLISION_NUMBER = 300.0
"""R* up to which `apparent_critical_density` looks: S(k) of (12) is known to 1e-4 up to there."""


def growth_times(scene: Scene, mode: int, count: int = 200) -> Array:
    """Times at which growth has begun, peaked and decayed: geometric from 0.01/γ to (12 + 1/k*²)/γ; 0 is added."""
    return np.append(0.0, np.geomspace(0.01, 12 + 1 / dimensionless(scene, mode) ** 2, count)) / scene.model.friction


def density_gain(scene: Scene, mode: int = 1, times: Array | None = None) -> Array:
    """G_ρ(t): the largest |δρ(t)|²/ρ² that a wave of mode n can reach from ‖δf(0)‖ = 1, for each of `times` (`growth_times`).

    The norm is ‖δf‖² = ∫|δf|²/M dv/ρ², M the Maxwellian of ρ = 1 at u_h and θ_h. A density wave in equilibrium, δf = δρ M, has
    ‖δf‖ = |δρ|/ρ: so √G_ρ says how many times higher a density wave can get than it is in a plain one of the same norm.
    (6): closed form at any R*,

        G_ρ = exp(-2k²(t - q)) [R² + k² exp((R² + k²)q²)]/(R² + k²),  q = 1 - exp(-t),  γ = σ = 1,

    reached from δf(0) ∝ M φ_t* (stability/follow_leader.py), particles slower than the rest by up to R*q√σ. (12): by matrix
    exponentials.
    Raises SceneError without friction and noise. Test: tests/linear_theory/test_transient_growth.py.
    """
    flow, units = flow_of(scene)
    chosen = growth_times(scene, mode) if times is None else np.asarray(times, dtype=float)
    if (chosen < 0).any():
        raise SceneError(f"times = {chosen.min():g}, …: must be 0 or more")
    return flow.density_gain(dimensionless(scene, mode), units.gamma * chosen)


def largest_density_gain(scene: Scene, mode: int = 1) -> tuple[float, float]:
    """(G_ρ, t) where G_ρ is largest, to 1e-4: the vertex of a parabola through log G_ρ at the three largest of `growth_times`."""
    t = growth_times(scene, mode)
    gain = density_gain(scene, mode, t)
    n = int(gain.argmax())
    if not (1 < n < t.size - 1 and math.isfinite(gain[n])):
        return float(gain[n]), float(t[n])
    x, y = np.log(t[n - 1 : n + 2]), np.log(gain[n - 1 : n + 2])
    step, slope, curvature = x[1] - x[0], (y[2] - y[0]) / 2, y[2] - 2 * y[1] + y[0]
    shift = -slope / curvature if curvature < 0 else 0.0
    return math.exp(y[1] + slope * shift / 2), math.exp(x[1] + shift * step)


@with_one_blas_thread
def transient_growth(scene: Scene, mode: int = 1, times: Array | None = None) -> xr.Dataset:
    """G(t) = max ‖δf(t)‖²/‖δf(0)‖², the same for the density alone, and the initial state that grows most; dims (time, v).

    The norm is that of `density_gain`. `optimal_real`, `optimal_imag`: δf(0)/ρ, of norm 1, for the largest G among `times`.
    (6): to 1e-6 in as many Hermite functions as that needs; raises SceneError where that is more than 512 (R* ≈ 10).
    """
    import xarray as xr
    from scipy.linalg import expm, svd

    flow, units = flow_of(scene)
    k = dimensionless(scene, mode)
    equations = flow.equations(k)
    generator = equations.generator(k)
    chosen = growth_times(scene, mode, 60) if times is None else np.asarray(times, dtype=float)
    gain, by_density = np.empty(chosen.size), np.empty(chosen.size)
    best = np.zeros(equations.count, dtype=complex)
    for i, t in enumerate(chosen):
        left, singular, right = svd(expm(units.gamma * t * generator))
        gain[i] = singular[0] ** 2
        by_density[i] = float(np.sum(np.abs((left * singular)[0] @ right) ** 2))
        if gain[i] >= gain[: i + 1].max():
            # The phase is free: the density that it reaches is made real.
            best = right[0].conj() * np.exp(-1j * np.angle(left[0, 0]))
    width = math.sqrt(units.sigma)
    w = math.sqrt(flow.temperature) * np.linspace(-9, 7, 321)
    optimal = equations.distribution(best, w) / width
    one, per_velocity = {"units": "1"}, {"units": "time length-1"}
    return xr.Dataset(
        {
            "gain": ("time", gain, {"long_name": "largest growth of the squared norm of δf"} | one),
            "density_gain": ("time", by_density, {"long_name": "largest squared relative density from norm 1"} | one),
            "optimal_real": ("v", optimal.real, {"long_name": "Re δf(0)/ρ of the largest growth"} | per_velocity),
            "optimal_imag": ("v", optimal.imag, {"long_name": "Im δf(0)/ρ of the largest growth"} | per_velocity),
        },
        {
            "time": ("time", chosen, {"long_name": "time", "units": "time"}),
            "v": ("v", units.mean_velocity + width * w, {"long_name": "velocity", "units": "length time-1"}),
        },
        {
            "scene": scene.model_dump_json(by_alias=True, exclude_none=True),
            "mode": mode,
            "norm": "integral of |δf|²/M over v, M the Maxwellian of the homogeneous state's temperature",
        },
    )


def structure_factor(scene: Scene, modes: int | Iterable[int] = FIRST_MODES) -> xr.DataArray:
    """S(k): the variance of a density mode of N particles in the stationary state over that of an ideal gas; dims (mode,).

    ⟨|ρ_k|²⟩ = S(k) ρ²/N, ρ_k = (1/L)∫ρ exp(-ikx) dx, as long as S(k)/N ≪ 1. (6): one integral, to 1e-12
    (`FollowLeaderFlow.structure_factor`); for k → 0 it is exp(R*²)(1 + erf R*). (12): from the Lyapunov equation, to 5e-6 for
    R* ≤ 100 and 1e-4 to 300; for k → 0 it is σ/(d(ρθ_h)/dρ). 1 without collisions.
    Raises SceneError without friction and noise. Test: tests/linear_theory/test_structure_factor.py.
    """
    import xarray as xr

    numbers = mode_numbers(modes)
    flow, _ = flow_of(scene)
    values = [flow.structure_factor(dimensionless(scene, n)) for n in numbers]
    return xr.DataArray(
        values,
        {"mode": ("mode", numbers, {"long_name": "mode number n, k = 2πn/L", "units": "1"})},
        ("mode",),
        "structure_factor",
        {"long_name": "structure factor S(k)", "units": "1"},
    )


def apparent_critical_density(scene: Scene, count: int, mode: int = 1, level: float = 1.0) -> float:
    """The density at which S(k)/N = `level` for N = `count` particles: where noise alone makes waves of that relative variance.

    No property of the equation, but of the number of particles: with (6) it grows as √ln N, R* ≈ √ln(N·level/2) for long waves.
    inf where S(k) does not get there below R* = 300. Linear theory fails near it: it is the place of a crossover, no threshold.
    """
    from scipy.optimize import brentq

    if count < 1 or not level > 0:
        raise SceneError(f"count = {count}, level = {level}: must be 1 or more, and above 0")
    unit = scene.initial.density / scene.groups.collision_number if scene.operator else math.inf
    wanted = math.log(level * count)

    def excess(number: float) -> float:
        initial = scene.initial.model_copy(update={"density": number * unit})
        flow, _ = flow_of(scene.model_copy(update={"initial": initial}))
        return math.log(flow.structure_factor(dimensionless(scene, mode))) - wanted

    if math.isinf(unit) or excess(HIGHEST_COLLISION_NUMBER) < 0:
        return math.inf
    if excess(1e-9) >= 0:
        return 0.0
    # S(k) grows with R*; in steps of 1.5, so that S stays far from overflow.
    above = 1.0
    while excess(above) < 0:
        above *= 1.5
    return unit * float(brentq(excess, 1e-9, above, xtol=1e-9))
