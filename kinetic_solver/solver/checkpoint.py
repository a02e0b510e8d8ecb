"""All that a run must know to go on with the same bits: taken of a march after a step, and given to another one.

Nothing here is resampled or rounded: the state is the solver's own, and so is the memory of its stepper. What follows from the
scene is not kept but made again: the plan but for what the run changed of it, the scheme, tables.
Tests: tests/faults/test_resume.py.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from typing import Any

from kinetic_solver.errors import SolverStopped
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.homogeneous import Shape
from kinetic_solver.operators.linearised import GridLinearisedStep, HermiteLinearisedStep, Lifted
from kinetic_solver.plan import Plan
from kinetic_solver.solver.adaptation import History
from kinetic_solver.solver.budgets import Mark
from kinetic_solver.solver.cut_off import CutOff
from kinetic_solver.solver.homogeneous import Place
from kinetic_solver.solver.kernel_error import Spectrum
from kinetic_solver.solver.loop import Good, March
from kinetic_solver.solver.observation import Observation
from kinetic_solver.solver.scheme import Scheme, assemble
from kinetic_solver.stepping import Chain, ExactSteps, Link, Pace

TYPES = (Chain, CutOff, History, Lifted, Link, Mark, Pace, PhaseSpaceGrid, Place, Shape, Spectrum)
"""The dataclasses that a snapshot holds."""


def snapshot(march: March) -> dict[str, Any] | None:
    """A tree (dataset/trees.py) of TYPES. None where the state of the moment fails the monitor's checks, or waits for them and
    would fail: the run is then about to go back, or to stop, and is to be asked again after its next step."""
    if not (march.judged or _holds(march)):
        return None
    return {
        "frame": march.frame,
        "plan": _changed(march.scheme.plan, march.first_plan),
        "now": _seen(march.now),
        "memory": march.memory,
        "interval": (march.began, march.within),
        "good": {"seen": _seen(march.good.seen), "mark": march.good.mark},
        "history": march.history,
        "grids": list(march.grids),
        "ledger": None if march.ledger is None else march.ledger.state(),
        "estimate": march.estimate.state(),
        "warned": dict(march.monitor.warned),
        "diagnostics": dict(march.diagnostics),
        "noted": _noted(march.scheme),
        "counts": (march.steps, march.looks),
        "steps": (march.errors, march.shortest),
    }


def restore(march: March, state: Mapping[str, Any]) -> None:
    """The march, new and of the same scene, is where the one was that the snapshot was taken of."""
    march.scheme = scheme = assemble(dataclasses.replace(march.first_plan, **state["plan"]))
    march.frame, (march.began, march.within), march.judged = state["frame"], state["interval"], True
    march.now, march.memory = _observation(scheme, state["now"]), state["memory"]
    march.good = Good(_observation(scheme, state["good"]["seen"]), state["good"]["mark"])
    march.history, march.grids = state["history"], list(state["grids"])
    if march.ledger is not None:
        march.ledger.restore(state["ledger"])
    march.estimate.restore(state["estimate"])
    march.monitor.warned.update(state["warned"])
    march.diagnostics = dict(state["diagnostics"])
    march.steps, march.looks = state["counts"]
    march.behind, (march.errors, march.shortest) = 0.0, state["steps"]
    step = _linearised(scheme)
    for name, value in state["noted"].items():
        setattr(step, name, value)


def _holds(march: March) -> bool:
    """A judgement beside those of the run: it warns of nothing and leaves no trace."""
    warned = dict(march.monitor.warned)
    try:
        with warnings.catch_warnings(action="ignore"):
            return march.monitor.judge(march.now, march.history.share).problem is None
    except SolverStopped:
        return False
    finally:
        march.monitor.warned = warned


def _changed(plan: Plan, first: Plan) -> dict[str, Any]:
    """The fields that the run has changed."""
    names = [field.name for field in dataclasses.fields(plan)]
    return {name: getattr(plan, name) for name in names if getattr(plan, name) is not getattr(first, name)}


def _seen(seen: Observation) -> dict[str, Any]:
    return {"clock": seen.clock, "state": seen.state, "since": seen.since, "error": seen.error}


def _observation(scheme: Scheme, seen: Mapping[str, Any]) -> Observation:
    return Observation.of(scheme, seen["clock"], seen["state"], seen["since"], seen["error"])


def _linearised(scheme: Scheme) -> GridLinearisedStep | HermiteLinearisedStep | None:
    step = scheme.stepper.exact if isinstance(scheme.stepper, ExactSteps) else None
    return step if isinstance(step, GridLinearisedStep | HermiteLinearisedStep) else None


def _noted(scheme: Scheme) -> dict[str, float]:
    """The largest so far of what the linearised step notes of its own accuracy."""
    step = _linearised(scheme)
    if step is None:
        return {}
    names = ("density_defect", "gauge_range") if isinstance(step, HermiteLinearisedStep) else ("density_defect",)
    return {name: getattr(step, name) for name in names}
