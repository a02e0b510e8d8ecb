"""How many Hermite functions in v, and where to take their coefficients from."""

from __future__ import annotations

import math

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.operators.velocity import HermiteBasis
from kinetic_solver.plan.criterion import Criterion
from kinetic_solver.plan.scales import POINTS, Scales
from kinetic_solver.plan.waves import DROPPED, Waves
from kinetic_solver.scene import Scene
from kinetic_solver.stability.homogeneous import homogeneous_state
from kinetic_solver.theory.ornstein_uhlenbeck import transition

MOST_FUNCTIONS = 240
"""numpy's Gauss-Laguerre nodes, of which operator (12) needs three quarters as many, overflow beyond."""
ROOM = 20
"""Functions that must be left above those of the start, for what the flow makes of it. Chosen."""
MORE_WITH_COLLISIONS = (1.3, 4.0, 0.5)
"""(a, b, c): a times as many as free motion needs, b more, and c R_t² for what (6) amplifies. Chosen; the run looks at the last
coefficients and takes more where they count (solver/monitor.py)."""
GIVEN_PLACES = 128
"""Along x, at which the functions in an f(x, v) that was given are counted. Chosen."""
SPARE = 8
"""More, watched by the run: the last of them say whether there are enough."""
LOOKED_BEYOND = 3
"""How many times the functions that would pay are looked at, in case some in between happen to vanish. Chosen."""
ROUNDING = 1e-8
"""Coefficients of an eigenmode of (12) below it are rounding, which `points_for_coefficients` lifts up to 3e-9."""
CLOSED_FORM_REACH, TABULATED_REACH = 6.0, 8.5
"""Thermal velocities to which a start is looked at: 2√count more than the first where its tails are known in closed form; the
second, with (12), where beyond it there is nothing but rounding."""


def count(scales: Scales, waves: Waves, most: float = math.inf) -> Criterion:
    """Functions that hold the start, and the waves in v that free motion makes of its waves in x.

    Where they are more than there can be, infinitely many; raises SceneError if grid.velocity asks for them. With `most`
    infinitely many as well where they are seen to be more.
    """
    sigma = scales.scene.model.noise
    if math.ceil(MORE_WITH_COLLISIONS[1]) + SPARE > most and scales.law is not None:
        return Criterion(math.inf, "")
    n = _of_the_start(scales, int(min(MOST_FUNCTIONS, LOOKED_BEYOND * most)))
    if n > most:
        return Criterion(math.inf, "")
    if n >= MOST_FUNCTIONS - ROOM:
        if scales.scene.grid.velocity != "hermite":
            return Criterion(math.inf, "")
        low, high = float(scales.temperature.min()), float(scales.temperature.max())
        raise SceneError(
            f"grid.velocity = 'hermite': temperatures from {low:.3g} to {high:.3g} need more than {MOST_FUNCTIONS} "
            f"functions of variance noise = {sigma:g}; allowed here: 'points'"
        )
    n = max(n, _of_phase_mixing(scales, waves))
    if scales.law is not None:
        factor, more, amplified = MORE_WITH_COLLISIONS
        n = math.ceil(factor * n + more + amplified * scales.amplification**2)
    found = min(MOST_FUNCTIONS, max(SPARE, n + SPARE))
    return Criterion(found, f"{n + SPARE} Hermite functions hold the start and the phase mixing of its waves")


def basis_of(scene: Scene, functions: int) -> HermiteBasis:
    """About the homogeneous state's mean velocity, with the noise's variance."""
    state = homogeneous_state(scene)
    assert state is not None
    return HermiteBasis(state.mean_velocity, scene.model.noise, functions)


def sum_of_gaussians(basis: HermiteBasis, gaussians: initial.Gaussians, density: Array) -> Array:
    """Coefficients (nx, functions) of Gaussians in closed form, of this density together."""
    parts = [basis.maxwellian(density if share == 1 else share * density, u, theta) for share, u, theta in gaussians]
    return np.asarray(sum(parts[1:], parts[0]))


def points_for_coefficients(scene: Scene, basis: HermiteBasis, mean_velocity: float, temperature: float) -> Array:
    """Velocities from which to take the Hermite coefficients of a state about the homogeneous one.

    He_n/√n! grows as exp(w²/4). Where the state is known in closed form, so are its tails; with (12) the tails hold rounding,
    which would only be lifted.
    """
    thermal = math.sqrt(temperature)
    reach = (
        TABULATED_REACH if scene.law is not None and not scene.law.linearises else 2 * math.sqrt(basis.count) + CLOSED_FORM_REACH
    ) * thermal
    # Eight points to the basis's width, and two to every oscillation of its last function.
    points = math.ceil(reach / math.sqrt(basis.variance) * (8 + 2 * math.sqrt(basis.count)))
    return mean_velocity + reach * np.linspace(-1, 1, 2 * points + 1)


def _of_the_start(scales: Scales, functions: int) -> int:
    """The highest of the first functions that counts in the start."""
    scene, start = scales.scene, scales.start
    basis = basis_of(scene, functions)
    if start.gaussian or scene.initial.eigenmodes:
        spread = np.abs(sum_of_gaussians(basis, start.gaussians(scales.x), np.ones(POINTS))).max(axis=0)
    else:
        v = points_for_coefficients(scene, basis, start.mean_velocity, start.temperature)
        spread = np.abs(basis.coefficients(start.outline(scales.x[:: POINTS // GIVEN_PLACES], v), v)).max(axis=0)
        spread = spread / scales.density.mean()
    if scene.initial.eigenmodes:
        u0 = start.mean_velocity
        v = points_for_coefficients(scene, basis, u0, start.temperature)
        background = initial.eigenmode_background(scene, v, u0)
        shapes = np.array([background, *(shape for _, shape in initial.eigenmode_shapes(scene, v, u0))])
        coefficients = np.abs(basis.coefficients(shapes.real, v) + 1j * basis.coefficients(shapes.imag, v)).max(axis=0)
        if scene.law is not None and not scene.law.linearises:
            coefficients[coefficients < ROUNDING] = 0.0
        spread = np.maximum(spread, coefficients)
    return int(np.flatnonzero(spread > scales.rtol / DROPPED)[-1])


def _of_phase_mixing(scales: Scales, waves: Waves) -> int:
    """The highest function that counts in a free wave: after t the wave exp(ikx) of a Maxwellian has the coefficients
    exp(-k²D/2) (k√σ b)^n/√n!, with D and b as in theory/ornstein_uhlenbeck.py."""
    k, digits = waves.in_play
    sigma, orders, highest = scales.scene.model.noise, np.arange(MOST_FUNCTIONS), 0
    factorial = np.cumsum(np.log(np.maximum(orders, 1)))
    for t in np.linspace(0, scales.end, 33)[1:]:
        step = transition(scales.scene.model, float(t))
        moved = k[1:, None] * step.drift_time * math.sqrt(sigma)
        damped = digits[1:, None] - k[1:, None] ** 2 * step.displacement_variance / 2
        above = damped + orders * np.log(moved) - factorial / 2 > 0
        highest = max(highest, int(np.flatnonzero(above.any(axis=0))[-1]) if above.any() else 0)
    return highest
