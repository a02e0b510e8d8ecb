"""What a run will use, as it was decided before it starts: frame of reference, grid, window, step, schemes, and why."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.laws import CollisionLaw
from kinetic_solver.plan import in_finite_volumes, in_t
from kinetic_solver.plan.moving_frame import ReferenceFrame
from kinetic_solver.plan.scales import Scales
from kinetic_solver.plan.waves import Waves
from kinetic_solver.scene import (
    Deposit,
    DriftDiffusionScheme,
    Scene,
    Schedule,
    SteppingScheme,
    VelocityScheme,
)

STATE_ARRAYS = 30
"""Arrays of the size of f alive at once: the state, its transform, collision stages, diagnostics. Counted, generously."""
Stepping = SteppingScheme | Literal["homogeneous"]
"""What `[grid]` may name, and what serves runs of one place without tables (plan/homogeneous.py)."""
STEP_LENGTHS: Mapping[Stepping, int] = MappingProxyType(
    {"exact": 2, "strang": 2, "extrapolated": 8, "exponential": 3, "homogeneous": 0}
)
"""Lengths of steps for which tables are kept at a time."""


@dataclass(frozen=True)
class Plan:
    """The discretisation of one run."""

    scene: Scene
    """As it was given, in the laboratory."""
    start: initial.Start
    """Likewise; that in the frame of reference is `scales.start`."""
    schedule: Schedule
    """When anything is written, by the laboratory's clock."""
    reference_frame: ReferenceFrame
    scales: Scales
    """In the frame of reference, like `waves`."""
    waves: Waves
    grid: PhaseSpaceGrid
    """Of the first step: the run may change it."""
    output: PhaseSpaceGrid
    """Of the dataset, in the laboratory: fixed."""
    whole: PhaseSpaceGrid
    """The places of `output`, and velocities that hold all of f, whatever `output.velocity_window` shows of it."""
    velocity: VelocityScheme
    stepping: Stepping
    drift_diffusion: DriftDiffusionScheme
    deposit: Deposit | None
    time_step: float | None
    """The longest step, for exact ones that from link to link of their chain; None: from time 0 to each frame."""
    shortest_step: float
    """Exact steps shorter than this are not built upon: their kernel is not resolved."""
    expected_steps: int
    """Exactly so many; with error control, about."""
    error_share: float
    """Of rtol, to the local errors of steps."""
    reasons: Mapping[str, str] = field(default_factory=dict)
    """Of what was chosen: name → why."""

    @property
    def inner(self) -> Scene:
        """What is stepped: the scene in its frame of reference; its rtol is that of f (`choices.for_thin_places`)."""
        return self.scales.scene

    @property
    def law(self) -> CollisionLaw | None:
        """What collisions do; None where they do nothing."""
        return self.scales.law

    @functools.cached_property
    def finite_volume_spacing(self) -> float:
        """The dv at which finite volumes err by RULE_SHARE of rtol."""
        return in_finite_volumes.spacing(self.scales, self.waves, self.drift_diffusion, self.time_step)

    @property
    def tolerance(self) -> str:
        """That of f, in words: for messages."""
        asked, of_f = self.scene.accuracy.rtol, self.inner.accuracy.rtol
        return f"accuracy.rtol = {asked:g}" + (f", {of_f:.2g} of f, for u and θ where it is thin" if of_f < asked else "")

    @property
    def times(self) -> Array:
        """When anything is written, by the frame's clock."""
        return self.scales.times

    @property
    def symmetric(self) -> bool:
        """True where the quadrature path's base method is Strang's: both substeps are exact."""
        return self.velocity == "points" and self.scales.amplifies

    @property
    def controlled(self) -> bool:
        """True where steps are found while running."""
        return self.stepping in ("extrapolated", "exponential") and self.scene.grid.time_step is None

    @property
    def integrates(self) -> bool:
        """True where steps have rates to integrate on their way, for the budgets; Strang's have none."""
        return self.stepping in ("exponential", "homogeneous") or (self.stepping == "extrapolated" and not self.symmetric)

    @property
    def memory_time(self) -> float:
        """How long errors last (`in_t.memory_time`)."""
        return in_t.memory_time(self.scales)

    @property
    def first_step(self) -> float:
        """The longest that error control begins with."""
        return in_t.first_step(self.scales, self.waves)

    @property
    def memory(self) -> int:
        """Bytes: the arrays of f's size, and kernels and phases for the step lengths in use."""
        nx, nv = self.grid.nx, self.grid.nv
        propagators, kernels = 16 * (nx // 2 + 1) * nv**2, 8 * (nv**2 + 4 * nx * nv)
        tables = STEP_LENGTHS[self.stepping] * (propagators if self.velocity == "hermite" else kernels)
        return 8 * STATE_ARRAYS * nx * nv + tables + 8 * 3 * nv**2

    def with_inner(self, inner: Scene) -> Plan:
        """The same plan for another grid table or rtol of the scene in its frame, whose physics must be the same."""
        scales = replace(self.scales, scene=inner)
        return replace(self, scales=scales, waves=Waves(scales))
