"""What is asked of a law before a run: shapes, and that it conserves what its author says."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.laws.law import RELATIVE_VELOCITIES, CollisionLaw, PairLaw

QUANTITIES = ("mass", "momentum", "energy")
ROUND_OFF = 1e-10
"""Of ∫|φC| dv, that ∫φC dv may be where a law conserves ∫φf dv, however fine rtol: sums of a few hundred rounded numbers."""


def check_given(law: object) -> None:
    """Raises SceneError for what is no collision law."""
    if not isinstance(law, CollisionLaw):
        found = law.__name__ if isinstance(law, type) else type(law).__name__
        what = "the class itself" if isinstance(law, type) else "of another type"
        raise SceneError(
            f"operator: {found} is {what}; allowed: an instance of a class that is made from CollisionLaw or PairLaw "
            "(docs/extending.md)"
        )
    if isinstance(law, PairLaw) and not hasattr(law, "cross_section"):
        raise SceneError(f"operator {law.label}: has no cross_section; allowed: a number that is 0 or more")


def check_law(law: CollisionLaw, f: Array, v: Array, rtol: float) -> None:
    """Looks at the rate of a state f (nx, nv): shape, numbers, and that what is conserved is so to rtol/100 of what is moved.

    Raises SceneError, with the size of what is wrong.
    """
    for quantity in law.conserves:
        if quantity not in QUANTITIES:
            raise SceneError(f"operator {law.label}: conserves = {law.conserves!r}: allowed: some of {', '.join(QUANTITIES)}")
    if "mass" not in law.conserves:
        raise SceneError(f"operator {law.label}: conserves = {law.conserves!r}: allowed: with 'mass', which every run keeps")
    if not law.has_rate:
        raise SceneError(f"operator {law.label}: has no rate(f, v); the grid needs one (particles need a PairLaw alone)")
    if isinstance(law, PairLaw):
        return check_pairs(law, math.sqrt(float(v.var())))
    rate = _called(law, "rate(f, v)", lambda: law.rate(f.copy(), v.copy()))
    if not isinstance(rate, np.ndarray) or rate.shape != f.shape:
        found = getattr(rate, "shape", type(rate).__name__)
        raise SceneError(
            f"operator {law.label}: rate(f, v) of an f of shape {f.shape} is {found}; allowed: an array of f's shape"
        )
    if rate.dtype.kind != "f" or not np.isfinite(rate).all():
        raise SceneError(f"operator {law.label}: rate(f, v) holds what is not a finite real number")
    for quantity in law.conserves:
        weight = v ** QUANTITIES.index(quantity)
        moved = np.abs(rate * weight).sum(axis=1)
        missed = np.abs((rate * weight).sum(axis=1))
        share = float(np.divide(missed, moved, out=np.zeros_like(missed), where=moved > 0).max())
        allowed = max(ROUND_OFF, rtol / 100)
        # Where nothing is moved, in a state that the law leaves alone, what is left is rounding of f itself.
        if share > allowed and missed.max() > ROUND_OFF * float((f * np.abs(weight)).sum(axis=1).max()):
            raise SceneError(
                f"operator {law.label}: says that it conserves {quantity}, but its rate makes {share:.2g} of what it moves; "
                f"allowed: {allowed:.1g}; mend rate(f, v), or leave {quantity!r} out of conserves"
            )


def check_frequency(law: CollisionLaw, density: float, temperature: float) -> None:
    """Raises SceneError where it bounds no step."""
    found = _called(law, "frequency(density, temperature)", lambda: law.frequency(density, temperature))
    if not (isinstance(found, int | float | np.floating) and 0 <= found < math.inf):
        raise SceneError(
            f"operator {law.label}: frequency({density:.3g}, {temperature:.3g}) is {found!r}; allowed: a finite number, 0 or more"
        )


def _called(law: CollisionLaw, what: str, call: Callable[[], Any]) -> Any:
    """What the law answers. Raises SceneError where it fails."""
    try:
        return call()
    except Exception as error:
        said = " ".join(str(error).split())
        raise SceneError(f"operator {law.label}: {what} fails: {type(error).__name__} {said}") from error


def check_pairs(law: PairLaw, thermal: float) -> None:
    """Outcomes of pairs: two finite velocities between those before, of the sums that are said to be conserved."""
    if not law.cross_section >= 0:
        raise SceneError(f"operator {law.label}: cross_section = {law.cross_section!r}: allowed: a number that is 0 or more")
    r = thermal * RELATIVE_VELOCITIES
    what = f"after(r, …) with r and the law's numbers {law.numbers}, for two velocities,"
    a, b = _called(law, what, lambda: law.places(r))
    outside = float(np.maximum(np.maximum(-a, b - r) / r, 0.0).max())
    if not (np.isfinite(a).all() and np.isfinite(b).all() and np.all(a <= b + 1e-12 * r)) or outside > 1e-12:
        raise SceneError(
            f"operator {law.label}: after(r, …) leaves velocities {outside:.2g} r outside those before, or the first ahead of "
            "the second; allowed: from 0 to r, in this order"
        )
    conserved = {"momentum": np.abs(a + b - r) / r, "energy": np.abs(a**2 + b**2 - r**2) / r**2}
    for quantity in law.conserves:
        size = float(conserved[quantity].max()) if quantity in conserved else 0.0
        if size > 1e-12:
            raise SceneError(
                f"operator {law.label}: says that it conserves {quantity}, but after(r, …) misses it by {size:.2g}; "
                f"mend it, or leave {quantity!r} out of conserves"
            )
