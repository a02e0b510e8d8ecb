"""What a collision law is."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError

PROBE_POINTS = 96
"""Velocity points on which `CollisionLaw.frequency` looks at an unknown law."""
PROBE_WAVES = (1, 3, 7)
"""Waves in v, over the whole window of 12 thermal velocities, that it is asked about."""

RELATIVE_VELOCITIES = np.linspace(0.05, 12.0, 240)
"""Of a thermal one, at which the outcome of a pair is looked at."""


class CollisionLaw:
    """A collision operator C[f], local in x: the record of what it does. Subclass it, give `rate`, say what it conserves.

    Attributes that are numbers or text are its parameters: they go into the file, and a run is resumed with the same ones only.
    A frozen dataclass does well. Test: tests/interface/test_extending.py.
    """

    name: ClassVar[str] = ""
    """Of the law in files and messages; that of the class where it is empty."""
    conserves: ClassVar[tuple[str, ...]] = ("mass",)
    """Of "mass", "momentum" and "energy", at every x. Checked on the start of every run; without mass there is no run."""
    linearises: ClassVar[bool] = False
    """Whether a change of variables makes (2) linear, and an exact step of any length: operator (6) alone
    (docs/theory_details.md). Such a law amplifies: a disturbance slower than the mean by w grows as exp(νw) while friction has
    not brought it back."""

    def rate(self, f: Array, v: Array) -> Array:
        """∂f/∂t by collisions, (nx, nv): f (nx, nv) holds point values at uniform velocities v (nv,)."""
        raise SceneError(f"operator {self.label}: has no rate(f, v); the grid needs one")

    @property
    def has_rate(self) -> bool:
        """Whether the grid can run it."""
        return type(self).rate is not CollisionLaw.rate

    @property
    def parameters(self) -> dict[str, float | str]:
        """The public attributes of the instance that are numbers or text."""
        return {
            name: value for name, value in vars(self).items() if not name.startswith("_") and isinstance(value, int | float | str)
        }

    @property
    def label(self) -> str:
        return self.name or type(self).__name__

    def described(self) -> str:
        """As an attribute of files: name and parameters, in JSON."""
        return json.dumps({"name": self.label, "parameters": self.parameters}, sort_keys=True)

    @property
    def dissipation(self) -> float:
        """The share of the energy of relative motion that a collision takes: by what collisions forget. 0 says nothing."""
        return 0.0

    def slows(self, temperature: float) -> float:
        """By how much a pair of thermal particles is slower together after a collision, over their relative velocity: 1 of (6), 0
        where momentum is conserved, negative where pairs become faster. Such a law amplifies as (6) does, by that share: what is
        slower than the mean, or of a negative share what is faster. 0 also of a law that says nothing of pairs."""
        return 0.0

    def frequency(self, density: float, temperature: float) -> float:
        """Collisions per particle and time of thermal particles, 1/time: bounds the steps in time.

        Here an estimate: how fast the rate makes short waves in v of a Maxwellian decay. A law that knows better says so.
        """
        thermal = math.sqrt(temperature)
        v = 6 * thermal * (2 * (np.arange(PROBE_POINTS) + 0.5) / PROBE_POINTS - 1)
        maxwellian = density * np.exp(-(v**2) / (2 * temperature)) / math.sqrt(2 * math.pi * temperature)
        changes = 1e-3 * maxwellian * np.cos(np.pi * np.array(PROBE_WAVES)[:, None] * v / thermal)
        base = np.tile(maxwellian, (len(PROBE_WAVES), 1))
        answer = self.rate(base + changes, v) - self.rate(base, v)
        return float((np.abs(answer).max(axis=1) / np.abs(changes).max(axis=1)).max())


class PairLaw(CollisionLaw):
    """A law for pairs: particles that meet collide with the probability `cross_section`, at the rate S |v - v'| of (6) and (12).

    It depends on their relative velocity alone, and needs no rate: the grid sums over pairs, the particles draw them.
    """

    cross_section: float
    """S, dimensionless."""

    @staticmethod
    def after(r: float, *numbers: float) -> tuple[float, float]:
        """The two velocities after a collision, counted from that of the slower particle, the faster one coming with r > 0 more.

        (0, 0) is follow the leader, (0, r) changes nothing; both lie between 0 and r, the first being the one left behind. What
        follows r are the law's numbers, in the order of its attributes. A plain function: numba compiles it for the particles.
        """
        raise SceneError("a law of pairs needs after(r, …)")

    @property
    def has_rate(self) -> bool:
        return True

    @property
    def numbers(self) -> tuple[float, ...]:
        """The parameters that are numbers, in their order: what `after` is handed."""
        return tuple(float(value) for value in self.parameters.values() if not isinstance(value, str))

    def places(self, r: Array) -> tuple[Array, Array]:
        """`after` for many relative velocities."""
        return outcomes(type(self).after, self.numbers, r)

    def slows(self, temperature: float) -> float:
        """The share farthest from 0 among relative velocities up to 12√θ."""
        if "momentum" in self.conserves:
            return 0.0
        r = math.sqrt(temperature) * RELATIVE_VELOCITIES
        shares = (r - np.sum(self.places(r), axis=0)) / r
        return float(shares[np.abs(shares).argmax()])

    def frequency(self, density: float, temperature: float) -> float:
        """Sρ√θ."""
        return self.cross_section * density * math.sqrt(temperature)


def outcomes(after: Callable[..., tuple[float, float]], numbers: tuple[float, ...], r: Array) -> tuple[Array, Array]:
    """`PairLaw.after` of a law with these numbers, for many relative velocities."""
    both = np.array([after(one, *numbers) for one in r.tolist()], dtype=float).reshape(len(r), 2)
    return both[:, 0], both[:, 1]
