"""A start that somebody hands to a run: f(x, v) as a callable, or as a DataArray.

It is taken as it is: its own mean density replaces `initial.density`. Of a callable nothing is known beforehand: its window and
its resolution are found by looking at it (looking.py). A DataArray is what its points say, and between them the trigonometric
interpolant in x and v; beyond its velocities it is 0.
Tests: tests/interface/test_given_starts.py.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.initial.from_file import read_state
from kinetic_solver.initial.looking import DROPPED, EDGE, PLACES, VELOCITIES, Function, Table, look
from kinetic_solver.initial.periodic import Complex, amplitudes, coefficients, interpolated
from kinetic_solver.initial.sampled import between_points, check, from_data_array
from kinetic_solver.initial.start import Gaussians, Start
from kinetic_solver.scene import Initial, Scene

if TYPE_CHECKING:
    import xarray as xr

Given: TypeAlias = "Callable[[Array, Array], Any] | xr.DataArray"
"""f(x, v), which gives an array (nx, nv) for arrays x (nx, 1) and v (1, nv); or a DataArray with dimensions x and v."""

REACH = 40.0
"""Thermal velocities of the noise on either side of the terminal velocity, and of 0, in which a callable is looked at first.
Chosen."""
STRONG = 0.1
"""Of the strongest wave along x besides the mean: the waves that particles are to resolve. Chosen."""
EMPTY = 1e-6
"""Of the largest density: thinner places have no temperature that matters. Chosen."""


def take(scene: Scene, given: Given) -> tuple[Scene, GivenStart]:
    """The start, and the scene with its mean density, velocity and temperature.

    Raises SceneError where [initial] says anything, and where f has not the shape of x and v, is not finite, is negative,
    does not end in v, or is not resolved by any reasonable number of points.
    """
    if said := sorted(key for key in scene.initial.model_fields_set - {"time"} if getattr(scene.initial, key) not in (None, ())):
        raise SceneError(
            f"initial.{said[0]}: is given together with an f(x, v) of one's own, which is taken as it is; allowed: neither this "
            "nor any other key of [initial] but time"
        )
    length, rtol = scene.pipe.length, scene.accuracy.rtol
    if not (hasattr(given, "dims") and hasattr(given, "name")):
        if hasattr(given, "dims") or not callable(given):
            raise SceneError(
                f"initial: is of type {type(given).__name__}; allowed: a callable f(x, v), or a DataArray with dimensions x and v"
            )
        name = f"callable {getattr(given, '__qualname__', type(given).__name__)}"
        f, model = _checked(given, name), scene.model
        middle = model.gravity / model.friction if model.friction > 0 else 0.0
        thermal = math.sqrt(model.noise) if model.noise > 0 else 1.0
        first = scene.grid.velocity_window or _where_it_is(f, length, (middle, 0.0), REACH * thermal)
        table = look(f, name, length, first, rtol)
    else:
        array = cast("xr.DataArray", given)
        name = f"DataArray {array.name or ''}".rstrip()
        f, table = from_data_array(array, name, length, rtol)
    start = GivenStart(name, length, rtol, f, table, tabulated=not callable(given) or hasattr(given, "dims"))
    return recorded(scene, start), start


def of_file(scene: Scene) -> tuple[Scene, GivenStart, bool]:
    """The last f of `initial.file` as a start that can be seen from any frame, the scene with its means instead of the file, and
    whether f is resolved to accuracy.rtol and has ended in v, so that any grid may be chosen for it.

    Warns of what had to be changed of the file. Raises SceneError as `read_state`.
    """
    there = read_state(scene)
    for text in there.changed:
        warnings.warn(f"initial.file = {scene.initial.file!r}: {text}", stacklevel=2)
    name, length, rtol = f"the last f of {scene.initial.file}", scene.pipe.length, scene.accuracy.rtol
    f, table = between_points(there.f, there.first, there.v, length, rtol)
    try:
        check(f, table, name, length, rtol)
        resolved = True
    except SceneError:
        f, table = between_points(there.f, there.first, there.v, length, rtol, by_splines=True)
        resolved = False
    start = GivenStart(name, length, rtol, f, table, of_file=True, tabulated=True)
    return _with_means(scene, start), start, resolved


def recorded(scene: Scene, start: Start) -> Scene:
    """The scene that a dataset says that it is of: with the means of a start that was given."""
    if not isinstance(start, GivenStart) or start.of_file:
        return scene
    return _with_means(scene, start)


def _with_means(scene: Scene, start: GivenStart) -> Scene:
    means = start.means.model_copy(update={"time": scene.initial.time}) if scene.initial.time else start.means
    return scene.model_copy(update={"initial": means})


def notes_of(start: Start | None) -> dict[str, str]:
    """What a dataset says of a start that is not in its scene, as attributes: its name, and a sum that no other start has."""
    if not isinstance(start, GivenStart) or start.of_file:
        return {}
    return {"initial": f"given: {start.name}", "initial_sha256": sha256(np.ascontiguousarray(start.table.f).data).hexdigest()}


def _where_it_is(f: Function, length: float, middles: tuple[float, ...], reach: float) -> tuple[float, float]:
    """The window, of this reach about one of these velocities, in which f is largest: weak friction has its terminal velocity far
    from where any particle is."""
    places = length * np.arange(PLACES) / PLACES
    windows = [(middle - reach, middle + reach) for middle in dict.fromkeys(middles)]
    return max(windows, key=lambda window: float(f(places, np.linspace(window[0], window[1], VELOCITIES)).max()))


def _checked(given: Callable[[Array, Array], Any], name: str) -> Function:
    def f(x: Array, v: Array) -> Array:
        try:
            values = np.asarray(given(x[:, None], v[None, :]))
        except Exception as error:
            raise SceneError(
                f"initial = {name}: fails with x of shape ({x.size}, 1) and v of shape (1, {v.size}): "
                f"{type(error).__name__} {' '.join(str(error).split())}"
            ) from error
        if values.dtype.kind not in "fiu":
            raise SceneError(f"initial = {name}: gives values of type {values.dtype}; allowed: real numbers")
        if values.ndim > 2 or any(n not in (1, size) for n, size in zip(values.shape[::-1], (v.size, x.size), strict=False)):
            raise SceneError(
                f"initial = {name}: gives shape {values.shape} for x of shape ({x.size}, 1) and v of shape (1, {v.size}); "
                f"allowed: ({x.size}, {v.size})"
            )
        if not np.isfinite(values).all():
            raise SceneError(
                f"initial = {name}: f is not finite for some v from {v[0]:.4g} to {v[-1]:.4g}; allowed: finite numbers"
            )
        return np.array(np.broadcast_to(values, (x.size, v.size)), dtype=float)

    return f


@dataclass(frozen=True, eq=False)
class GivenStart:
    """A `Start` (start.py), seen from a frame that moves with `frame`."""

    name: str
    length: float
    rtol: float
    f: Function
    """In the laboratory."""
    table: Table
    """f on points that resolve it, in the laboratory."""
    frame: float = 0.0
    of_file: bool = False
    """True where a dataset's scene names the file that it is from."""
    tabulated: bool = False
    """True where f is known at the table's points, and interpolated between them."""
    band_limited = False
    gaussian = False
    closed_form = False

    def seen_from(self, velocity: float) -> GivenStart:
        return dataclasses.replace(self, frame=velocity)

    @property
    def homogeneous(self) -> bool:
        return self.table.f.shape[0] == 1

    @cached_property
    def _moments(self) -> Array:
        """∫f, ∫v f and ∫v² f dv at the table's places, (3, nx), in the laboratory."""
        powers = np.stack([np.ones_like(self.table.v), self.table.v, self.table.v**2])
        return np.asarray(powers @ self.table.f.T * self.table.dv)

    @property
    def mean_density(self) -> float:
        return float(self._moments[0].mean())

    @property
    def mean_velocity(self) -> float:
        return float(self._moments[1].mean()) / self.mean_density - self.frame

    @property
    def temperature(self) -> float:
        return float(self._moments[2].mean()) / self.mean_density - (self.mean_velocity + self.frame) ** 2

    @property
    def means(self) -> Initial:
        """What a scene can say of it."""
        return Initial(density=self.mean_density, mean_velocity=self.mean_velocity, temperature=self.temperature)

    @cached_property
    def _density(self) -> Complex:
        return coefficients(self._moments[0])

    def density(self, x: Array) -> Array:
        return interpolated(self._density, x, self.length)

    def resolved_density(self, x: Array) -> Array:
        kept = self._density[: x.size // 2 + 1].copy()
        if kept.size > 1 and 2 * (kept.size - 1) == x.size:
            kept[-1] *= 2  # the wave that changes sign from point to point stands for itself and its mirror image
        return np.asarray(np.fft.irfft(kept * x.size, n=x.size))

    def density_integral(self, x: Array) -> Array:
        k = 2 * np.pi / self.length * np.arange(self._density.size)
        waves = np.zeros_like(self._density)
        waves[1:] = self._density[1:] / (1j * k[1:])
        return self.mean_density * x + interpolated(waves, x, self.length) - 2 * float(waves.real.sum())

    def mean_velocities(self, x: Array) -> tuple[float, float]:
        mean = self.local_state()[0]
        return float(mean.min()), float(mean.max())

    @property
    def dense(self) -> NDArray[np.bool_]:
        """Which places of the table have any density to speak of, (nx,)."""
        return np.asarray(self._moments[0] > EMPTY * self._moments[0].max())

    def local_state(self) -> tuple[Array, Array]:
        """Mean velocities and temperatures at these places."""
        density, momentum, energy = self._moments[:, self.dense]
        mean = momentum / density
        return mean - self.frame, energy / density - mean**2

    def hottest(self, x: Array) -> float:
        return float(self.local_state()[1].max())

    def gaussians(self, x: Array) -> Gaussians:
        """One at either end of f's window, that falls to rtol/40 at its edge."""
        tail, low, high = math.sqrt(2 * math.log(EDGE / self.rtol)), *(end - self.frame for end in self.table.ends)
        theta = min(self.temperature, ((high - low) / (2 * tail)) ** 2)
        ends = (low + tail * math.sqrt(theta), high - tail * math.sqrt(theta))
        return [(0.5, np.full(x.shape, end), np.full(x.shape, theta)) for end in ends]

    @property
    def window(self) -> tuple[float, float]:
        return self.table.low - self.frame, self.table.high - self.frame

    @property
    def laboratory(self) -> tuple[float, float]:
        """The window in the laboratory."""
        return self.table.low, self.table.high

    @cached_property
    def _narrowest(self) -> float:
        shortest = int(np.flatnonzero(amplitudes(self.table.f, 1) > self.rtol / DROPPED)[-1]) + 1
        q = 2 * math.pi / (self.table.high - self.table.low) * shortest
        return 2 * math.log(DROPPED / self.rtol) / q**2

    def narrowest(self, x: Array) -> float:
        return self._narrowest

    @cached_property
    def strong_mode(self) -> int:
        """The highest wave along x that is a tenth of the strongest; 0 where nothing depends on x."""
        waves = amplitudes(self.table.f, 0)[1:]
        return int(np.flatnonzero(waves >= STRONG * waves.max())[-1]) + 1 if waves.size else 0

    def distribution(self, x: Array, v: Array, density: Array | None = None) -> Array:
        return self.f(x, v + self.frame)

    def outline(self, x: Array, v: Array) -> Array:
        return self.distribution(x, v)
