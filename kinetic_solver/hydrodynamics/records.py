"""What the hydrodynamic method writes of a frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

from kinetic_solver.arrays import Array
from kinetic_solver.dataset import VARIABLES, Variables
from kinetic_solver.hydrodynamics.plan import Plan

_FIELDS = ("density", "mean_velocity", "temperature", "heat_flux")
_TOTALS = ("mass", "momentum", "energy")
BUDGETS = tuple(VARIABLES["budgets"])
_VARIABLES: Variables = {
    "moments": {name: VARIABLES["moments"][name] for name in _FIELDS},
    "scalars": {name: VARIABLES["scalars"][name] for name in _TOTALS},
    "budgets": VARIABLES["budgets"],
}
Values: TypeAlias = dict[str, Mapping[str, Any]]
"""Group → name → value."""


def variables(plan: Plan) -> Variables:
    """What a recorder of the plan's frames is to expect."""
    return {group: _VARIABLES[group] for group in plan.groups}


def values(fields: Iterable[Array], totals: Array, budget: Mapping[str, float] | None = None) -> Values:
    """Of a frame: ρ, u, θ and the heat flux at the output's points; ∫ρ, ∫ρu and ∫½ρ(u² + θ); and the group `budgets`."""
    return {
        "moments": dict(zip(_FIELDS, fields, strict=True)),
        "scalars": dict(zip(_TOTALS, totals.tolist(), strict=True)),
        "budgets": budget or {},
    }
