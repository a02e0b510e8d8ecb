"""Velocity moments of f and the moment equations (3)-(5) evaluated on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.fourier import derivative
from kinetic_solver.scene import Model


@dataclass(frozen=True)
class Moments:
    """Fields over x, each of shape (nx,). Where the density is zero, velocity and temperature are NaN: they do not exist."""

    density: Array
    """ρ = ∫f dv [particles/length]."""
    mean_velocity: Array
    """u = ∫v f dv/ρ."""
    temperature: Array
    """θ = ∫(v - u)² f dv/ρ, a velocity variance (k_B T/m)."""
    heat_flux: Array
    """q = ∫(v - u)³ f dv."""


def moments(grid: PhaseSpaceGrid, f: Array) -> Moments:
    """Moments of f (nx, nv) by the trapezoidal rule, spectrally accurate in dv."""
    density = f.sum(axis=1) * grid.dv
    with np.errstate(divide="ignore", invalid="ignore"):
        u = f @ grid.v * grid.dv / density
        c = grid.v[None, :] - u[:, None]
        fc2 = f * c * c
        temperature = fc2.sum(axis=1) * grid.dv / density
    return Moments(density, u, temperature, (fc2 * c).sum(axis=1) * grid.dv)


def velocity_moments(grid: PhaseSpaceGrid, f: Array) -> Array:
    """∫v^n f dv, n = 0 … 3, of f (nx, nv); shape (4, nx)."""
    return np.asarray((f @ (grid.v[:, None] ** np.arange(4) * grid.dv)).T)


def totals(grid: PhaseSpaceGrid, f: Array) -> tuple[float, float, float]:
    """(mass, momentum, energy): ∫∫f, ∫∫v f, ½∫∫v² f dv dx."""
    over_x = f.sum(axis=0) * (grid.dx * grid.dv)
    return float(over_x.sum()), float(over_x @ grid.v), float(over_x @ grid.v**2) / 2


def moment_equations(grid: PhaseSpaceGrid, model: Model, f: Array, collision_rate: Array | None) -> dict[str, Array]:
    """Every term of (3)-(5) as a contribution to ∂ρ/∂t, ∂u/∂t and ∂θ/∂t at each x, and the residual of each equation.

    (5) here keeps the heat flux, -(1/ρ)∂q/∂x, which the paper's closure drops. The left-hand sides are moments of (2)
    itself, its transport, drift, diffusion and collisions applied to f (x-derivatives spectral); the residual is what the
    sum of the terms leaves of them. It is round-off where f vanishes at the window's edges, so it also shows a lost tail.
    """
    m = moments(grid, f)
    rho, u, theta, q = m.density, m.mean_velocity, m.temperature, m.heat_flux

    def ddx(field: Array) -> Array:
        return derivative(field, grid.wavenumbers)

    # Moments of the drift and diffusion terms by parts: ∫φ(-∂((g - γv) f) + σγ ∂²f) = ∫(φ'(g - γv) + φ''σγ) f.
    v, dv = grid.v, grid.dv
    g, gamma, sigma = model.gravity, model.friction, model.noise
    transported = -v * ddx(f)
    if collision_rate is not None:
        transported = transported + collision_rate
    drift = (g - gamma * v) * f
    rate0 = transported.sum(axis=1) * dv
    rate1 = (transported @ v + drift.sum(axis=1)) * dv
    rate2 = (transported @ v**2 + 2 * (drift @ v) + 2 * sigma * gamma * f.sum(axis=1)) * dv
    du_dt = (rate1 - u * rate0) / rho
    dtheta_dt = (rate2 - 2 * u * rate1 + (u**2 - theta) * rate0) / rho

    zero = np.zeros(grid.nx)
    c1 = (collision_rate @ v) * dv if collision_rate is not None else zero
    c2 = (collision_rate @ v**2) * dv if collision_rate is not None else zero
    du = ddx(u)
    terms = {
        "density_rate": rate0,
        "density_rate_advection": -u * ddx(rho),
        "density_rate_compression": -rho * du,
        "mean_velocity_rate": du_dt,
        "mean_velocity_rate_advection": -u * du,
        "mean_velocity_rate_pressure": -ddx(rho * theta) / rho,
        "mean_velocity_rate_gravity": np.full(grid.nx, g),
        "mean_velocity_rate_friction": -gamma * u,
        "mean_velocity_rate_collisions": c1 / rho,
        "temperature_rate": dtheta_dt,
        "temperature_rate_advection": -u * ddx(theta),
        "temperature_rate_compression": -2 * theta * du,
        "temperature_rate_heat_flux": -ddx(q) / rho,
        "temperature_rate_friction": -2 * gamma * theta,
        "temperature_rate_noise": np.full(grid.nx, 2 * gamma * sigma),
        "temperature_rate_collisions": (c2 - 2 * u * c1) / rho,
    }
    for field in ("density", "mean_velocity", "temperature"):
        parts = [value for name, value in terms.items() if name.startswith(f"{field}_rate_")]
        terms[f"{field}_rate_residual"] = terms[f"{field}_rate"] - np.sum(parts, axis=0)
    return terms
