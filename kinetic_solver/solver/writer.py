"""What is computed and written at each frame: what `[output]` asks for then, and nothing else; in the laboratory."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import Recorder
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.collisions.protocol import CollisionRate
from kinetic_solver.operators.moments import moment_equations, moments
from kinetic_solver.plan import Plan
from kinetic_solver.plan.moving_frame import Place
from kinetic_solver.solver.budgets import Ledger
from kinetic_solver.solver.regrid import ToOutput


class Frames:
    """Hands frames to a recorder."""

    def __init__(self, plan: Plan, recorder: Recorder, ledger: Ledger | None) -> None:
        self.plan, self.recorder, self.ledger = plan, recorder, ledger
        output = plan.scene.output
        self._due = {group: plan.scene.times(getattr(output, group)) for group in type(output).model_fields}

    def _is_due(self, group: str, time: float) -> bool:
        return bool(np.any(np.abs(self._due[group] - time) <= 1e-9 * self.plan.scene.run.end_time))

    def write(
        self,
        time: float,
        grid: PhaseSpaceGrid,
        place: Place,
        f: Array,
        total: tuple[float, float, float],
        operator: CollisionRate | None,
        diagnostics: dict[str, float],
        shown: Array | None = None,
    ) -> None:
        """f on the solver's `grid`, in its frame at `place`. `shown`, on the output's grid, stands for f in the fields."""
        due = {group for group in self._due if self._is_due(group, time)}
        if not due:
            return
        out, convert = self.plan.output, ToOutput(grid, self.plan.output)
        in_lab = shown
        if in_lab is None and due & {"f", "moments"}:
            in_lab = convert(f, place)
        frame: dict[str, dict[str, Any]] = {}
        if "f" in due:
            frame["f"] = {"f": in_lab}
        if "moments" in due:
            assert in_lab is not None
            if shown is not None:
                m, velocity, scale = moments(out, shown), 0.0, 1.0
            else:  # over the velocities that the solver holds, w = (v - U)/λ
                m = moments(dataclasses.replace(grid, nx=out.nx), convert.along_x(f, place))
                velocity, scale = place.velocity, place.scale
            frame["moments"] = {
                "density": m.density,
                "mean_velocity": velocity + scale * m.mean_velocity,
                "temperature": scale**2 * m.temperature,
                "heat_flux": scale**3 * m.heat_flux,
                "velocity_distribution": in_lab.sum(axis=0) * out.dx,
            }
        if "scalars" in due:
            mass, momentum, energy = place.totals(total)
            frame["scalars"] = {"mass": mass, "momentum": momentum, "energy": energy, **diagnostics}
        if "budgets" in due and self.ledger is not None:
            frame["budgets"] = self.ledger.record()
        if "moment_equations" in due:
            rate = operator.rate(f) if operator is not None else None
            frame["moment_equations"] = moment_equations(grid, self.plan.inner.model, f, rate)
        self.recorder.record(time, frame)
