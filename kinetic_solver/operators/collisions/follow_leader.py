"""Operator (6), follow the leader: C[f] = S f ρ (u - v) (Prigogine and Herman 1971)."""

from __future__ import annotations

from kinetic_solver.arrays import Array


class FollowLeader:
    """Conserves mass at every x; takes momentum at the rate S ρ²θ (8). The substep is exact in time and positive.

    `velocity`: uniform points (nv,); `cross_section`: S, dimensionless. Tests: tests/invariants/test_collisions.py.
    """

    conserves = ("mass",)

    def __init__(self, velocity: Array, cross_section: float) -> None:
        self.velocity = velocity
        self.cross_section = cross_section
        self.dv = float(velocity[1] - velocity[0])

    def rate(self, f: Array) -> Array:
        density = f.sum(axis=1, keepdims=True) * self.dv
        flux = (f @ self.velocity * self.dv)[:, None]
        return self.cross_section * f * (flux - density * self.velocity)

    def brought(self, moments: Array, dx: float) -> tuple[Array, Array]:
        """∫∫v C dv dx and ½∫∫v² C dv dx, the rates of momentum and energy, (…) each, from ∫v^n f dv, n = 0 … 3, (…, 4, nx)."""
        n, flux, second, third = (moments[..., power, :] for power in range(4))
        s = self.cross_section * dx
        return s * (flux * flux - n * second).sum(axis=-1), s / 2 * (flux * second - n * third).sum(axis=-1)

    def __call__(self, f: Array, dt: float) -> Array:
        """f exp(-Sρ v dt), brought back to the same ρ: the exact solution, since ρ stays as it is."""
        # Here, because it loads numba: runs in exact steps, most of those of (6), never come by.
        from kinetic_solver.operators.collisions.tilt import tilted

        return tilted(f, self.velocity, self.cross_section * dt * self.dv)
