"""The kinetic spectrum: eigenvalues and eigenfunctions of (2), linearised about the homogeneous state.

(6): s_n(k) = -iku_h - nγ - (σ/γ)(k² - ikSρ), n = 0, 1, 2, …, exact: Re s < 0 for every k ≠ 0 at every density.
(12): numerically (stability/inelastic.py), each eigenvalue with its distance to the same on a coarser grid. For k → 0,
Re s = -(k²/γ) d(ρθ_h)/dρ.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinetic_solver.arrays import Array
from kinetic_solver.scene import Scene
from kinetic_solver.stability.closure import closure_rates, critical_density
from kinetic_solver.stability.flow import flow_of
from kinetic_solver.stability.units import Complex, dimensionless, mode_numbers, wavenumber

if TYPE_CHECKING:
    import xarray as xr

FIRST_MODES = range(1, 9)
"""Modes of the pipe that are looked at where no others are named."""


def kinetic_rates(scene: Scene, mode: int = 1, count: int = 4) -> tuple[Complex, Array]:
    """(s, uncertainty) of the `count` leading branches of mode n, waves exp(ikx + st), by falling growth rate; shape (count,).

    The uncertainty is 0 for the exact ones of (6). Raises SceneError without friction and noise. Tests: tests/linear_theory/.
    """
    flow, units = flow_of(scene)
    s, uncertainty = flow.rates(dimensionless(scene, mode), count)
    return units.rate(s, wavenumber(scene, mode)), units.gamma * uncertainty


def mean_velocity(scene: Scene) -> float:
    """u_h of the homogeneous state."""
    return flow_of(scene)[1].mean_velocity


def eigenfunction(scene: Scene, mode: int, branch: int, v: ArrayLike) -> Complex:
    """δf(v)/ρ̄ of a branch, ∫δf dv = ρ̄: of unit relative density. f_h + Re[A δf exp(ikx)] is a wave of relative density |A|."""
    flow, units = flow_of(scene)
    scale = np.sqrt(units.sigma)
    return flow.eigenfunction(dimensionless(scene, mode), branch, units.velocity(np.asarray(v, dtype=float))) / scale


def homogeneous_distribution(scene: Scene, v: ArrayLike) -> Array:
    """f_h(v)/ρ̄: a Gaussian for (6), solved for with (12)."""
    flow, units = flow_of(scene)
    return flow.distribution(units.velocity(np.asarray(v, dtype=float))) / np.sqrt(units.sigma)


def spectrum(scene: Scene, mode: int = 1, count: int = 4, velocities: int = 201) -> xr.Dataset:
    """Leading branches and their eigenfunctions; dims (branch, v), v within 7 thermal velocities √θ_h of u_h."""
    import xarray as xr

    flow, units = flow_of(scene)
    s, uncertainty = kinetic_rates(scene, mode, count)
    width = np.sqrt(flow.temperature * units.sigma)
    v = units.mean_velocity + np.linspace(-7, 7, velocities) * width
    functions = np.array([eigenfunction(scene, mode, branch, v) for branch in range(count)])
    rate, unit = "time-1", "time length-1"
    return xr.Dataset(
        {
            "growth_rate": ("branch", s.real, {"long_name": "growth rate Re s", "units": rate}),
            "frequency": ("branch", s.imag, {"long_name": "Im s, waves exp(ikx + st)", "units": rate}),
            "uncertainty": ("branch", uncertainty, {"long_name": "uncertainty of s; 0 where exact", "units": rate}),
            "eigenfunction_real": (("branch", "v"), functions.real, {"long_name": "Re δf/ρ, unit density", "units": unit}),
            "eigenfunction_imag": (("branch", "v"), functions.imag, {"long_name": "Im δf/ρ, unit density", "units": unit}),
            "homogeneous": ("v", homogeneous_distribution(scene, v), {"long_name": "homogeneous state f_h/ρ", "units": unit}),
        },
        {"branch": np.arange(count), "v": ("v", v, {"long_name": "velocity", "units": "length time-1"})},
        {"scene": scene.model_dump_json(by_alias=True, exclude_none=True), "mode": mode},
    )


def growth_rates(scene: Scene, modes: int | Iterable[int] = FIRST_MODES) -> xr.Dataset:
    """The leading s of each mode by the three-moment closure and by the kinetic equation, and ρ_c; dims (mode,).

    `closure_growth_rate` says what the paper's (3)-(5) do, `kinetic_growth_rate` what (2) itself does. `critical_density`
    is the closure's, inf where it has none. All branches: `closure_rates`, `kinetic_rates`.
    """
    import xarray as xr

    numbers = mode_numbers(modes)
    closure = np.array([closure_rates(scene, n)[0] for n in numbers])
    kinetic, uncertainty = (np.array(part) for part in zip(*(kinetic_rates(scene, n, 1) for n in numbers), strict=True))

    def over_modes(values: Array, long_name: str, units: str) -> tuple[str, Array, dict[str, str]]:
        return "mode", values, {"long_name": long_name, "units": units}

    return xr.Dataset(
        {
            "wavenumber": over_modes(np.array([wavenumber(scene, n) for n in numbers]), "wavenumber k", "length-1"),
            "critical_density": over_modes(
                np.array([critical_density(scene, n) for n in numbers]),
                "critical density of the closure",
                "particles length-1",
            ),
            "closure_growth_rate": over_modes(closure.real, "Re s of the three-moment closure", "time-1"),
            "closure_frequency": over_modes(closure.imag, "Im s of the three-moment closure", "time-1"),
            "kinetic_growth_rate": over_modes(kinetic[:, 0].real, "Re s of the kinetic equation", "time-1"),
            "kinetic_frequency": over_modes(kinetic[:, 0].imag, "Im s of the kinetic equation", "time-1"),
            "kinetic_uncertainty": over_modes(uncertainty[:, 0], "uncertainty of the kinetic s; 0 where exact", "time-1"),
        },
        {"mode": ("mode", numbers, {"long_name": "mode number n, k = 2πn/L", "units": "1"})},
        {"scene": scene.model_dump_json(by_alias=True, exclude_none=True), "convention": "waves exp(ikx + st)"},
    )
