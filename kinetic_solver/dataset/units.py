"""Units by name: the table [units] of a scene says what one length, one time and one particle are called.

The schema spells units in the words `particles`, `length` and `time`, with powers, as in "particles time length-2". With names
for these they are units that UDUNITS, cf tools and pint read, "s m^-2" say (pint takes "m-2" for a difference), and the file
claims the CF conventions; without, it does not. No number changes. Tests: tests/interface/test_units.py.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from kinetic_solver.scene import Scene
from kinetic_solver.scene.tables import Units

if TYPE_CHECKING:
    import xarray as xr

CONVENTIONS = "CF-1.8"
"""The oldest that has all that is used here, and the newest that both checkers know (docs/output.md)."""


def unit_in(units: Units | None, words: str) -> str:
    """The unit of the schema under a scene's names; as it is where the scene has none, and where it is spelled otherwise."""
    if units is None:
        return words
    names = {"particles": units.number, "length": units.length, "time": units.time}
    parts = []
    for word in words.split():
        found = re.fullmatch(r"(particles|length|time)(-?\d+)?", word)
        if found is None:
            return words
        if names[found[1]] != "1":
            parts.append(names[found[1]] + (f"^{found[2]}" if found[2] else ""))
    return " ".join(parts) or "1"


def conventions(scene: Scene) -> dict[str, str]:
    """The attribute that claims them; nothing where units have no names."""
    return {} if scene.units is None else {"Conventions": CONVENTIONS}


def name_units(dataset: xr.Dataset, units: Units | None) -> None:
    """All of a dataset's units, in place."""
    for variable in dataset.variables.values():
        if "units" in variable.attrs:
            variable.attrs = {**variable.attrs, "units": unit_in(units, variable.attrs["units"])}
