"""Where a dataset comes from, as attributes."""

from __future__ import annotations

import functools
import json
import re
import sys
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import numpy as np

from kinetic_solver.laws import CollisionLaw
from kinetic_solver.scene import Scene

PACKAGES = ("numpy", "scipy", "numba", "pyfftw", "xarray", "netCDF4")


@functools.cache
def _version(package: str) -> str:
    """As metadata.version, which reads all that a package says of itself where one line is wanted: 3 ms for all of them."""
    said = metadata.distribution(package).read_text("METADATA")
    found = re.search(r"^Version: (\S+)", said or "", re.MULTILINE)
    return found[1] if found is not None else metadata.version(package)


@functools.cache
def _packages() -> str:
    return json.dumps({name: _version(name) for name in PACKAGES})


def version() -> str:
    """Of this software."""
    return _version("kinetic-solver")


def attributes(scene: Scene, method: str) -> dict[str, str | np.int32]:
    """Provenance: the scene as one JSON text, version, command, seed, packages."""
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]).encode(errors="replace").decode()
    created = datetime.now(UTC).isoformat(timespec="seconds")
    return {
        "title": "One-dimensional kinetic equation with friction, noise and collisions",
        "method": method,
        "scene": scene.model_dump_json(by_alias=True, exclude_none=True),
        "source": f"kinetic-solver {version()}",
        "version": version(),
        "command": command,
        # In a classic file, which has no longer whole numbers: a longer seed as text.
        "seed": np.int32(seed) if (seed := scene.particles.seed) < 2**31 else str(seed),
        "packages": _packages(),
        "created": created,
        "history": f"{created} {command}",
    }


def law_attribute(operator: CollisionLaw | None) -> dict[str, str]:
    """`law`: name and parameters of a collision law that a run was given beside its scene; nothing where there was none."""
    return {} if operator is None else {"law": operator.described()}
