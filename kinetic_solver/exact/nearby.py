"""f at given places and velocities, by an integral of its own for each, over starting points near the one it would have had
without noise. Of weak noise, and at early times, they are few, while sums that all velocities share take ever more terms.

A particle that is now at (x, v) came from y* + z, y* its starting point without noise, z ~ N(0, w²): the noise's part of
eX - bV alone, X and V displacement and velocity, which no start enters. Given z the rest is a Gaussian in v, so that

    f E = ∫ρ0(y) exp(SΦ0(y)) N(z; 0, w²) N(v; V's mean, variance given y and z) dz,   y = y* + z.

Without noise w = 0, and f is known along the path.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.exact.mixture import SIGMAS
from kinetic_solver.exact.panels import ORDER, Panels, resolved
from kinetic_solver.exact.setting import Setting, jumps, slopes

AT_ONCE = 40_000
"""Panels. Chosen, for memory."""
NEGLIGIBLE = 1e-13
"""Of f's Legendre coefficients, over the mean density and the widest Gaussian that f may have: what they leave out is less."""
LEAST_PANELS = 4
"""Of each integral."""
STEEP = 8.0
"""Powers of e by which exp(SΦ0 - Sρ̄y) may change over a panel at the outset."""


def count(at: Setting) -> float:
    """Terms of one point, or about as many; infinite where it should not be done like this."""
    if at.noiseless or not math.isfinite(at.place_variance):
        return math.inf
    return float(ORDER * max(_panels(at, theta) for _, _, theta in at.beams))


def distribution(at: Setting, x: Array, v: Array, log_scale: Array) -> Array:
    """f, (len(x), len(v)), `log_scale` being that of a `Mixture`."""
    f = np.zeros(x.size * v.size)
    rows, columns = (index.ravel() for index in np.indices((x.size, v.size)))
    points = max(1, AT_ONCE // max(_panels(at, theta) for _, _, theta in at.beams))
    for first in range(0, f.size, points):
        part = slice(first, first + points)
        i, j = rows[part], columns[part]
        for beam in at.beams:
            f[part] += _of_beam(at, beam, x[i], v[j], log_scale[i])
    return f.reshape(x.size, v.size)


def along_paths(at: Setting, x: Array, v: Array, log_scale: Array) -> Array:
    """f, (len(x), len(v)), without noise: every point has one starting point."""
    k = at.spread
    v0 = (v - k.velocity_shift) / k.decay
    y = (x - k.displacement_shift)[:, None] - k.drift_time * v0
    height, log = initial.density(at.scene, y) / k.decay, at.waves(y) - log_scale[:, None]
    f = np.zeros((x.size, v.size))
    for share, u0, theta0 in at.beams:
        u, theta = at.fields(y, u0, theta0)
        apart = v0 - u + at.growth * k.drift_time * theta  # moved as by `Setting.tilt`
        f += share * height * np.exp(log + at.tilt(u, theta) - apart**2 / (2 * theta)) / np.sqrt(2 * np.pi * theta)
    return f


def _of_beam(at: Setting, beam: tuple[float, float, float], x: Array, v: Array, log_scale: Array) -> Array:
    k, (share, u0, theta0) = at.spread, beam
    turn, left = at.of_velocity
    w = math.sqrt(at.place_variance)
    change = v - k.velocity_shift
    path = k.drift_time / k.decay * change
    # exp(Sρ̄y) moves both Gaussians, that in v and that in z.
    steep = at.growth * k.drift_time / k.decay
    ahead = (at.growth - steep * turn) * w * w

    def integrand(some: Panels) -> Array:
        z, of = some.nodes, some.owner
        origin = (x - k.displacement_shift)[of]
        y = origin[:, None] - (path[of][:, None] - z)
        u, theta = at.fields(y, u0, theta0)
        variance = theta * k.decay**2 + left
        apart = change[of][:, None] - k.decay * u - turn * z + steep * variance
        log = at.waves(y) + at.tilt(u, theta) - log_scale[of][:, None]
        log -= ((z - ahead) / w) ** 2 / 2 + apart**2 / (2 * variance)
        on_its_side = (origin - path[of] + some.centre)[:, None]
        rho = initial.density(at.scene, y if at.scene.initial.step is None else on_its_side)
        return np.asarray(rho * np.exp(log) / (2 * math.pi * w * np.sqrt(variance)))

    def checked(some: Panels) -> tuple[Array, NDArray[np.bool_]]:
        return integrand(some)[None], np.zeros(some.size, dtype=bool)

    # Far out in v little counts, and rounding of the exponent is large.
    least = NEGLIGIBLE * at.scene.initial.density / math.sqrt(at.hottest * k.decay**2 + k.velocity_variance) / w
    ends = (ahead - _reach(at), ahead + _reach(at))
    even = np.broadcast_to(np.linspace(*ends, _panels(at, theta0) + 1), (x.size, _panels(at, theta0) + 1))
    panels = resolved(Panels.between(np.concatenate([even, _jumps(at, x, path, ends)], axis=1)), checked, at.time, least)
    return share * np.bincount(panels.owner, (integrand(panels) * panels.weights).sum(axis=1), minlength=x.size)


def _reach(at: Setting) -> float:
    """How far z goes on either side of its mean; SΦ0 - Sρ̄y may favour both."""
    return SIGMAS * math.sqrt(at.place_variance) + max(at.steepness) * at.place_variance


def _panels(at: Setting, theta0: float) -> int:
    """So many that nothing changes by more than a few widths over any of them."""
    k, start = at.spread, at.scene.initial
    turn, left = at.of_velocity
    coldest = at.coldest if at.varied else theta0
    warmer = slopes(start.temperature_modes, at.length, theta0)[0] / coldest
    rate = (k.decay * slopes(start.velocity_modes, at.length)[0] + turn) / (3 * math.sqrt(coldest * k.decay**2 + left))
    rate += 2 * warmer + at.k_max + max(at.steepness) / STEEP
    return LEAST_PANELS + math.ceil(min(2 * _reach(at) * rate, 1e9))


def _jumps(at: Setting, x: Array, path: Array, ends: tuple[float, float]) -> Array:
    """Of the density, as z from the path's starting point, between the ends; (points, jumps)."""
    if at.scene.initial.step is None:
        return np.empty((x.size, 0))
    shift, length = at.spread.displacement_shift, at.length
    period = length * np.floor((x - shift - path) / length)
    places = jumps(at.scene, ends[0], length + ends[1])
    # Taken from the place first: a place on a jump has it exactly there.
    return np.clip(places - (x - period)[:, None] + shift + path[:, None], *ends)
