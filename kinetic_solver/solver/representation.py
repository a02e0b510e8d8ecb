"""How f is held while it is stepped: at velocity points or as Hermite coefficients, behind one interface.

What a run needs of either is the same: a start, point values for output, the parts of (2) as substeps and rates, and the way
from one grid to another.
"""

from __future__ import annotations

import functools
from typing import Any, Protocol

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.laws import FollowTheLeader, Inelastic
from kinetic_solver.operators.collisions import (
    CollisionRate,
    FollowLeader,
    FollowLeaderHermite,
    InelasticHermite,
    PairCollisions,
    in_hermite,
    on_points,
)
from kinetic_solver.operators.homogeneous import ShapedCollisions
from kinetic_solver.operators.linear import HermiteLinearStep, LinearStep
from kinetic_solver.operators.linearised import GridLinearisedStep, HermiteLinearisedStep
from kinetic_solver.operators.linearised.grid import Lifted
from kinetic_solver.operators.moments import totals
from kinetic_solver.operators.velocity import (
    DriftDiffusion,
    Expansion,
    FiniteVolume,
    HighOrderFiniteVolume,
    OrnsteinUhlenbeckKernel,
)
from kinetic_solver.operators.velocity.kernel import resolution
from kinetic_solver.plan import Plan, homogeneous
from kinetic_solver.plan.in_hermite import basis_of, points_for_coefficients, sum_of_gaussians
from kinetic_solver.solver.regrid import regrid, resize
from kinetic_solver.stepping import BaseMethod, Rate, Substep, lawson, strang


class Representation(Protocol):
    """A state is an array whose first axis is x."""

    def start(self) -> Array:
        """The state at time 0."""
        ...

    def points(self, state: Array) -> Array:
        """f at the grid's points, (nx, nv)."""
        ...

    def totals(self, state: Array) -> tuple[float, float, float]:
        """(mass, momentum, energy)."""
        ...

    def weights(self) -> Array:
        """W with state.sum(axis=0) @ W = totals, to rounding; (columns of a state, 3)."""
        ...

    def carried(self, state: Array, grid: PhaseSpaceGrid) -> Array:
        """A state that was held in the same way on this other grid. Mass is kept to round-off."""
        ...

    @property
    def linear(self) -> Substep:
        """(2) without collisions over h, exact in time."""
        ...

    def linearised(self, tolerance: float) -> GridLinearisedStep | HermiteLinearisedStep:
        """(2) with operator (6), exact in time."""
        ...

    def lifted_start(self, step: Any) -> Any:
        """The start as that step holds it, where it is known better than from `start`; else None."""
        ...

    @property
    def rate(self) -> Rate:
        """Of collisions."""
        ...

    def split(self) -> BaseMethod:
        """The base method of the quadrature path: Strang where collisions have an exact substep, else Lawson."""
        ...


def make_representation(plan: Plan) -> Representation:
    return HermiteCoefficients(plan) if plan.velocity == "hermite" else VelocityPoints(plan)


class VelocityPoints:
    """f(x_i, v_j) itself, (nx, nv); drift-diffusion as a matrix between the points."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    @functools.cached_property
    def linear(self) -> Substep:
        return LinearStep(self.plan.grid, self.plan.inner.model, self._drift_diffusion())

    def start(self) -> Array:
        grid = self.plan.grid
        start = self.plan.scales.start
        density = start.resolved_density(grid.x)
        f = start.distribution(grid.x, grid.v, density)
        # The sum over any window is the density: so the mass is the same on whatever grid a run goes on.
        summed = f.sum(axis=1) * grid.dv
        return f * np.divide(density, summed, where=summed != 0, out=np.ones_like(summed))[:, None]

    def points(self, state: Array) -> Array:
        return state

    def totals(self, state: Array) -> tuple[float, float, float]:
        return totals(self.plan.grid, state)

    def weights(self) -> Array:
        v = self.plan.grid.v
        return np.stack([np.ones_like(v), v, v**2 / 2], axis=1) * (self.plan.grid.dx * self.plan.grid.dv)

    def carried(self, state: Array, grid: PhaseSpaceGrid) -> Array:
        return regrid(state, grid, self.plan.grid)

    def linearised(self, tolerance: float) -> GridLinearisedStep:
        scene, grid, law = self.plan.inner, self.plan.grid, self.plan.law
        assert isinstance(law, FollowTheLeader)
        # Steps too short for the kernel are not built upon (stepping/exact_steps.py): its band-limited form will do.
        kernel = OrnsteinUhlenbeckKernel(grid, scene.model, resolution=resolution(scene.accuracy.rtol))
        drift_diffusion = kernel if self.plan.drift_diffusion == "kernel" else self._drift_diffusion()
        return GridLinearisedStep(grid, scene.model, law.cross_section, drift_diffusion, tolerance)

    def lifted_start(self, step: GridLinearisedStep) -> Lifted | None:
        """Of a step in the density, whose product with exp(SΦ) on the points would converge slowly: cut off after it."""
        scene, grid, s = self.plan.inner, self.plan.grid, self.plan.scales.cross_section
        if scene.initial.step is None or s == 0:
            return None
        if self.plan.waves.local_gauge:
            return Lifted(self.start(), mean_density=None, jumps=True)
        density = initial.resolved_lifted_density(scene, s, grid.x)
        f = self.plan.scales.start.distribution(grid.x, grid.v, np.ones(grid.nx))
        f /= (f.sum(axis=1) * grid.dv)[:, None]
        return step.lifted(f * density[:, None], scene.initial.density)

    @property
    def rate(self) -> Rate:
        operator = collision_operator(self.plan)
        assert operator is not None
        return operator.rate

    def split(self) -> BaseMethod:
        operator = collision_operator(self.plan)
        if self.plan.stepping == "strang" or self.plan.symmetric:
            assert isinstance(operator, FollowLeader | PairCollisions)
            return strang(operator, self.linear)
        return lawson(self.rate, self.linear)

    def _drift_diffusion(self) -> DriftDiffusion:
        grid, model = self.plan.grid, self.plan.inner.model
        if model.friction < 0:
            return Expansion(grid, -model.friction, self.plan.scales.theta_end)
        if self.plan.drift_diffusion == "finite-volume":
            return FiniteVolume(grid, model)
        if self.plan.drift_diffusion == "finite-volume-8":
            return HighOrderFiniteVolume(grid, model)
        # Operator (6) amplifies errors in the slow tail: there a step too short for the kernel must stay accurate relative to f.
        amplified = self.plan.scales.amplifies and model.friction * model.noise > 0
        return OrnsteinUhlenbeckKernel(grid, model, HighOrderFiniteVolume(grid, model) if amplified else None)


class HermiteCoefficients:
    """Coefficients (nx, nv) of Hermite functions about the homogeneous state; the linear part in closed form."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.basis = basis_of(plan.inner, plan.grid.nv)
        self._values = self.basis.values(plan.grid.v)
        self.linear: Substep = HermiteLinearStep(plan.grid, self.basis, plan.inner.model)

    def start(self) -> Array:
        scene, grid = self.plan.inner, self.plan.grid
        start = self.plan.scales.start
        if not start.gaussian:
            v = points_for_coefficients(scene, self.basis, start.mean_velocity, start.temperature)
            return self.basis.coefficients(start.distribution(grid.x, v), v)
        return sum_of_gaussians(self.basis, start.gaussians(grid.x), start.resolved_density(grid.x))

    def points(self, state: Array) -> Array:
        return state @ self._values

    def totals(self, state: Array) -> tuple[float, float, float]:
        return self.basis.totals(state, self.plan.grid.dx)

    def weights(self) -> Array:
        return np.array([self.basis.totals(unit[None], self.plan.grid.dx) for unit in np.eye(self.basis.count)])

    def carried(self, state: Array, grid: PhaseSpaceGrid) -> Array:
        """Functions that are added have the coefficient 0; those that are given up are small, or the run would not."""
        count = self.plan.grid.nv
        more = np.pad(resize(state, self.plan.grid.nx), ((0, 0), (0, max(0, count - state.shape[1]))))
        return more[:, :count]

    def linearised(self, tolerance: float) -> HermiteLinearisedStep:
        grid, scene, law = self.plan.grid, self.plan.inner, self.plan.law
        assert isinstance(law, FollowTheLeader)
        return HermiteLinearisedStep(
            grid.length, grid.nx, self.basis, scene.model, law.cross_section, scene.initial.density, tolerance
        )

    def lifted_start(self, step: HermiteLinearisedStep) -> None:
        return None

    @property
    def rate(self) -> Rate:
        assert self.plan.law is not None
        operator = in_hermite(self.plan.law, self.basis)
        assert operator is not None
        return operator.rate

    def split(self) -> BaseMethod:
        return lawson(self.rate, self.linear)


def collision_operator(plan: Plan) -> CollisionRate | None:
    """The operator of the plan's law, for f on the plan's velocity points; None without collisions."""
    law = plan.law
    if law is None:
        return None
    if plan.stepping == "homogeneous":
        assert isinstance(law, Inelastic)
        points = homogeneous.shape_grid(plan.scales)
        return ShapedCollisions(plan.grid, law, points.half, points.count)
    if plan.velocity == "hermite" and not law.linearises:
        operator = in_hermite(law, basis_of(plan.inner, plan.grid.nv))
        assert operator is not None
        return _AtPoints(operator, plan.grid.v)
    return on_points(law, plan.grid.v, plan.deposit)


class _AtPoints:
    """An operator in Hermite functions, for f on velocity points."""

    def __init__(self, operator: FollowLeaderHermite | InelasticHermite, velocity: Array) -> None:
        self.operator, self.velocity = operator, velocity
        self.conserves = operator.conserves
        self._values = operator.basis.values(velocity)

    def rate(self, f: Array) -> Array:
        return self.operator.rate(self.operator.basis.coefficients(f, self.velocity)) @ self._values
