"""(2) with operator (6), cut after M Hermite moments, as an initial value problem: what a closure makes of a scene.

With three moments it has the linearisation of the paper's (3)-(5). Its own waves, and its instability, are the closure's;
the kinetic equation's are in stability/spectrum.py and in the grid solver's runs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene, fourier_sum
from kinetic_solver.stability.flow import flow_of

if TYPE_CHECKING:
    import xarray as xr


def truncated_run(scene: Scene, moments: int = 3, nx: int = 64, rtol: float = 1e-10) -> xr.Dataset:
    """Density, mean velocity and temperature (time, x) of the nonlinear truncation with a_0 … a_{M-1}, at the scene's frames.

    f = Σ a_n(x) φ_n(w) M(w), w = (v - u_h)/√σ, with the moment a_M set to 0:

        ∂a_n/∂t = -nγ a_n + Sρ̄√σ √n a_{n-1} - [u_h + √σ w]∂a/∂x + S√σ (a_1 a_n - a_0 [w a]_n),
        [w a]_n = √n a_{n-1} + √(n+1) a_{n+1}.

    Derivatives in x by Fourier transform, time by a method of order 8 to `rtol` (DOP853; E. Hairer, S. P. Nørsett and G. Wanner
    1993). Mass is conserved to round-off. Above its critical density a run may blow up; it then ends at the last frame before.
    Raises SceneError for operator (12), a start from a file, a step, a pulse, beams or an eigenmode, without friction and noise,
    and for moments < 3 (M = 2 has no temperature). Test: tests/linear_theory/test_truncation.py.
    """
    import xarray as xr
    from scipy.integrate import solve_ivp

    _refuse(scene, moments)
    _, units = flow_of(scene)
    gamma, root, u_h = units.gamma, math.sqrt(units.sigma), units.mean_velocity
    s, length = scene.cross_section, scene.pipe.length
    drag = s * scene.initial.density * root
    x = length * np.arange(nx) / nx
    ik = 2j * np.pi * np.fft.rfftfreq(nx, length / nx)
    if nx % 2 == 0:
        ik[-1] = 0.0
    n = np.arange(moments)[:, None]

    def times_w(a: Array) -> Array:
        out = np.zeros_like(a)
        out[1:] += np.sqrt(n[1:]) * a[:-1]
        out[:-1] += np.sqrt(n[1:]) * a[1:]
        return out

    def rate(_: float, flat: Array) -> Array:
        a = flat.reshape(moments, nx)
        moved = times_w(a)
        result = -gamma * n * a + s * root * (a[1] * a - a[0] * moved)
        result[1:] += drag * np.sqrt(n[1:]) * a[:-1]
        result -= np.fft.irfft(ik * np.fft.rfft(u_h * a + root * moved, axis=1), n=nx, axis=1)
        return result.ravel()

    start = _maxwellian(scene, x, moments, u_h, units.sigma)
    times = scene.times()
    found = solve_ivp(
        rate,
        (0.0, times[-1]),
        start.ravel(),
        "DOP853",
        times,
        rtol=rtol,
        atol=1e-14 * scene.initial.density,
        events=_Escape(start),
    )
    a = found.y.T.reshape(len(found.t), moments, nx)
    drift = a[:, 1] / a[:, 0]
    temperature = 1 + math.sqrt(2) * a[:, 2] / a[:, 0] - drift**2
    fields = {
        "density": (a[:, 0], "particles length-1", "density ρ"),
        "mean_velocity": (u_h + root * drift, "length time-1", "mean velocity u"),
        "temperature": (units.sigma * temperature, "length2 time-2", "granular temperature θ, the velocity variance"),
    }
    return xr.Dataset(
        {name: (("time", "x"), values, {"units": unit, "long_name": text}) for name, (values, unit, text) in fields.items()},
        {"time": ("time", found.t, {"units": "time"}), "x": ("x", x, {"units": "length"})},
        {
            "method": "hydrodynamics",
            "moments": moments,
            "scene": scene.model_dump_json(by_alias=True, exclude_none=True),
        },
    )


def _refuse(scene: Scene, moments: int) -> None:
    start = scene.initial
    if moments < 3:
        raise SceneError(f"moments = {moments}: allowed: 3 or more")
    if scene.law is not None and not scene.law.linearises:
        raise SceneError('collisions.operator = "inelastic": the truncated run is for "follow-the-leader" or no collisions')
    for key, given in (
        ("file", start.file),
        ("step", start.step),
        ("pulse", start.pulse),
        ("beams", start.beams),
        ("eigenmodes", start.eigenmodes),
    ):
        if given:
            raise SceneError(f"initial.{key}: a truncated run starts from a Maxwellian with modes; remove it")


def _maxwellian(scene: Scene, x: Array, moments: int, u_h: float, sigma: float) -> Array:
    """a_n of ρ N(v; u, θ), shape (moments, nx): E[He_{n+1}] = y E[He_n] + n(θ/σ - 1)E[He_{n-1}], y = (u - u_h)/√σ."""
    start, length = scene.initial, scene.pipe.length
    density = start.density * (1 + fourier_sum(start.modes, x, length))
    base = u_h if start.mean_velocity is None else start.mean_velocity
    y = (base + fourier_sum(start.velocity_modes, x, length) - u_h) / math.sqrt(sigma)
    theta = (sigma if start.temperature is None else start.temperature) * (1 + fourier_sum(start.temperature_modes, x, length))
    expected = [np.ones_like(x), y]
    for n in range(1, moments - 1):
        expected.append(y * expected[n] + n * (theta / sigma - 1) * expected[n - 1])
    return np.array([density * value / math.sqrt(math.factorial(n)) for n, value in enumerate(expected)])


class _Escape:
    """A terminal event: moments a thousand times what they were."""

    terminal = True

    def __init__(self, start: Array) -> None:
        self._limit = 1e3 * float(np.abs(start).max())

    def __call__(self, _: float, flat: Array) -> float:
        return self._limit - float(np.abs(flat).max())
