"""What a finished run says of itself."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

from kinetic_solver.plan import choices
from kinetic_solver.solver.estimate import ErrorEstimate
from kinetic_solver.solver.scheme import Scheme

TOLERATED = 1.7
"""Times rtol that the estimate may come to without a warning: a sum of bounds, of which a run lets either edge of the window have
0.3 of rtol, the collision rate 0.7 and the steps with (12) 1 (solver/monitor.py, plan/in_t.py). They do not meet at one place:
the true errors of 200 random scenes at three rtol were half of rtol at the most (docs/accuracy.md)."""


@dataclass(frozen=True)
class Report:
    error: float
    """Estimated, over max f."""
    limited_by: str
    """What of the discretisation limits it, in words."""
    grids: str
    """All that the run used, with the times from which on."""
    missing: str
    """Where mean velocity and temperature are not given, in words; empty where they are everywhere."""

    def attributes(self) -> dict[str, str]:
        """For the dataset."""
        return {"limited_by": self.limited_by, "grids": self.grids, **({"missing": self.missing} if self.missing else {})}


def last_words(scheme: Scheme, estimate: ErrorEstimate, of_steps: float, shortest: float, warned: bool) -> None:
    """Warns where the estimated error exceeds rtol, and where given steps were too long, or too short for the kernel.

    `of_steps`: the sum of the steps' estimated errors over max f; `shortest`: of all steps; `warned`: whether the run has said
    already what is too coarse.
    """
    plan, scene = scheme.plan, scheme.plan.inner
    rtol = plan.scene.accuracy.rtol
    # The estimate is about f, where that is written.
    if estimate.total > TOLERATED * rtol and plan.scene.output.f is not False and not warned:
        warnings.warn(
            f"the estimated error, {estimate.total:.2g} of max f, exceeds accuracy.rtol = {rtol:g}; it is limited by "
            f"{estimate.limited_by()}; refine that, lower accuracy.rtol, or certify the run",
            stacklevel=3,
        )
    if plan.stepping not in ("extrapolated", "exponential") or plan.law is None:
        return
    if plan.symmetric:
        finest = shortest / scheme.stepper.method.counts[-1]  # type: ignore[attr-defined]
        choices.warn_of_an_unresolved_kernel(plan.scales, plan.grid, finest, plan.drift_diffusion)
    if scene.grid.time_step is not None and of_steps > scene.accuracy.rtol:
        warnings.warn(
            f"grid.time_step = {scene.grid.time_step:g}: the steps' errors may add up to {of_steps:.2g} of max f "
            f"(accuracy.rtol = {scene.accuracy.rtol:g}); reduce it, or leave it out",
            stacklevel=3,
        )
