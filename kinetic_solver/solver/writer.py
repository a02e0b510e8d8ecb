"""What is computed and written at each frame: what `[output]` asks for then, and nothing else; in the laboratory."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import Recorder
from kinetic_solver.dataset.schema import scale_names
from kinetic_solver.operators.moments import Moments, moment_equations, moments
from kinetic_solver.plan import Plan
from kinetic_solver.plan.moving_frame import Place
from kinetic_solver.solver.budgets import Ledger
from kinetic_solver.solver.observation import Observation
from kinetic_solver.solver.regrid import ToOutput, resize


def start_shown(plan: Plan) -> Array:
    """The start on the output's grid."""
    frame, output = plan.reference_frame, plan.output
    if not output.scaled:
        return plan.start.distribution(output.x, output.v)
    return frame.unit * plan.start.distribution(output.x, frame.start + frame.unit * output.v)


class Writer:
    """Hands frames to a recorder."""

    def __init__(self, plan: Plan, recorder: Recorder, ledger: Ledger | None) -> None:
        self.schedule, self.output, self.whole, self.start = plan.schedule, plan.output, plan.whole, plan.start
        self.dimensions, self.unit = plan.schedule.dimensions(plan.scene), plan.reference_frame.unit
        self.recorder, self.ledger = recorder, ledger
        self.least = plan.scene.accuracy.rtol
        """Of the largest density: where it is less, mean velocity, temperature and heat flux are missing values."""
        self._places = self._missing = 0
        self._convert: ToOutput | None = None

    def write(
        self, frame: int, seen: Observation, diagnostics: dict[str, float], shown: Array | None = None, moments_too: bool = True
    ) -> None:
        """The frame of this number. `shown`, f on the output's grid, stands for what is seen, in the moments as well or in f."""
        due = self.schedule.due[frame]
        place = seen.plan.reference_frame.place(seen.clock)
        # Scaled velocities are the frame's, in other units.
        shown_from = Place(place.time, place.position, 0.0, 1 / self.unit) if self.output.scaled else place
        if self._convert is None or self._convert.source != seen.grid:
            self._convert = ToOutput(seen.grid, self.output)
        convert = self._convert
        in_lab = shown
        if in_lab is None and due & {"f", "moments"}:
            in_lab = convert(seen.f, shown_from)
        values: dict[str, dict[str, Any]] = {}
        if "f" in due:
            values["f"] = {"f": in_lab}
        if "moments" in due:
            assert in_lab is not None
            values["moments"] = self._moments(seen, place, convert, shown if moments_too else None)
            # Few places show the values of f there, from which its integral over x does not follow.
            known = shown is not None and self.output.nx >= seen.grid.nx
            w = shown.sum(axis=0) * self.output.dx if known and shown is not None else convert.over_x(seen.f, shown_from)
            values["moments"]["velocity_distribution"] = w
        if self.output.scaled:
            groups = {self.dimensions[group]: group for group in sorted(due & {"f", "moments"}, reverse=True)}
            for dimension, group in groups.items():  # the group that the schema gives them to
                scale, origin = scale_names(dimension)
                values[group] |= {scale: self.unit * place.scale, origin: place.velocity}
        if "scalars" in due:
            mass, momentum, energy = place.totals(seen.totals)
            values["scalars"] = {"mass": mass, "momentum": momentum, "energy": energy, **diagnostics}
        if "budgets" in due and self.ledger is not None:
            values["budgets"] = self.ledger.record(seen)
        if "moment_equations" in due:
            values["moment_equations"] = self._moment_equations(seen)
        self.recorder.record(float(self.schedule.times[frame]), values)

    def _moments(self, seen: Observation, place: Place, convert: ToOutput, shown: Array | None) -> dict[str, Any]:
        """Over the velocities that the solver holds, w = (v - U)/λ; of what is shown over those of the output."""
        if shown is not None:
            all_of_it = shown if self.whole == self.output else self.start.distribution(self.whole.x, self.whole.v)
            m, velocity, scale = moments(self.whole, all_of_it), 0.0, 1.0
        else:
            m = seen.moments
            if self.output.nx != seen.grid.nx or place.position != 0:
                m = moments(dataclasses.replace(seen.grid, nx=self.output.nx), convert.along_x(seen.f, place))
            velocity, scale = place.velocity, place.scale
        # Ratios of moments say nothing where the density is within its own error.
        given = self._given(m)
        self._places += given.size
        self._missing += int(np.isnan(given).sum())
        return {
            "density": m.density,
            "mean_velocity": given * (velocity + scale * m.mean_velocity),
            "temperature": given * scale**2 * m.temperature,
            "heat_flux": given * scale**3 * m.heat_flux,
        }

    def _moment_equations(self, seen: Observation) -> dict[str, Array]:
        """In a frame at rest, which they ask for. Products of f's waves are waves that its own grid may not hold: they are made
        on one that has the output's places, and no fewer than the solver's."""
        times = -(-seen.grid.nx // self.output.nx)
        grid = dataclasses.replace(seen.grid, nx=times * self.output.nx)
        f, operator = resize(seen.f, grid.nx), seen.scheme.operator
        terms = moment_equations(grid, seen.plan.inner.model, f, operator.rate(f) if operator is not None else None)
        given = self._given(moments(grid, f))
        return {name: (term if name.startswith("density") else given * term)[::times] for name, term in terms.items()}

    def _given(self, m: Moments) -> Array:
        """1 where there is a mean velocity and a temperature, else NaN."""
        return np.where((m.density >= self.least * m.density.max()) & (m.temperature > 0), 1.0, np.nan)

    @property
    def missing(self) -> str:
        """At how many places and frames so far mean velocity and temperature are not given, in words; "" where at none."""
        if not self._missing:
            return ""
        share = self._missing / self._places
        where = f"where density is below {self.least:g} of its largest"
        return f"mean velocity and temperature at {share:.2g} of all places and frames, {where}"
