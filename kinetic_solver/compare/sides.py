"""One of two datasets, as values on a common grid with each replica's share, whatever kind of dataset it is."""

from __future__ import annotations

import dataclasses
import functools
import math
from pathlib import Path

import numpy as np
import xarray as xr
from pydantic import ValidationError
from scipy.interpolate import make_interp_spline

from kinetic_solver.arrays import Array
from kinetic_solver.compare.systematic import systematic_parts
from kinetic_solver.errors import SceneError
from kinetic_solver.scene import Scene, one_line

PARTS = 20
"""Into which the particles of a single ensemble are divided, to estimate errors as of independent particles."""
MOST_POINTS = 33
"""In x, on which raw particles are seen."""
OVER_X = ("density", "mean_velocity", "temperature")
TOTALS = ("velocity_of_all", "variance_of_all")
SAME_TIME = 1e-9


@dataclasses.dataclass(frozen=True)
class Values:
    """A field at one time: its points (n,), and each replica's share (replica, n), of which they are the mean."""

    points: Array
    replicas: Array | None = None
    inflation: float = 1.0
    """Of the variance over that of the replicas' scatter: for parts of a single ensemble, S(k)."""
    errors: tuple[Array, int] | None = None
    """Where the replicas' shares are not there: standard errors (n,), and the number of replicas that they come from."""

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the scatter; 0 where nothing scatters."""
        if self.errors is not None:
            return self.errors[1] - 1
        return 0 if self.replicas is None else len(self.replicas) - 1

    @property
    def variance(self) -> Array:
        """Of the points, (n,)."""
        if self.errors is not None:
            return np.asarray(self.inflation * self.errors[0] ** 2)
        if self.replicas is None:
            return np.zeros(self.points.shape)
        return np.asarray(self.inflation * self.replicas.var(axis=0, ddof=1) / len(self.replicas))

    @property
    def covariance(self) -> Array:
        if self.replicas is None:
            return np.zeros((self.points.size, self.points.size))
        return self.inflation / len(self.replicas) * np.atleast_2d(np.cov(self.replicas, rowvar=False))

    def over(self, matrix: Array) -> Values:
        """Linear statistics (q,) of the points, matrix (q, n)."""
        replicas = None if self.replicas is None else self.replicas @ matrix.T
        return Values(matrix @ self.points, replicas, self.inflation)


def mean_of(values: list[Values]) -> Values:
    """Over frames: each replica's mean is its share."""
    points = np.mean([v.points for v in values], axis=0)
    if values[0].replicas is None:
        return Values(points)
    return Values(points, np.mean([v.replicas for v in values if v.replicas is not None], axis=0), values[0].inflation)


class Side:
    """A run's dataset, or positions and velocities of particles. Raises SceneError where it is neither."""

    def __init__(self, source: str | Path | xr.Dataset, name: str) -> None:
        from particles.files import particle_names

        self.name = name
        self.dataset = _opened(source)
        self.scene = _scene_of(self.dataset, name)
        raw = particle_names(self.dataset) is not None
        if "density" not in self.dataset and not raw:
            raise SceneError(f"{name}: has neither density over (time, x) nor positions and velocities of particles")
        replicas = self.dataset.sizes.get("replica", 1)
        self.particles = raw and ("density" not in self.dataset or replicas < 2)
        """Whether its fields are made of its particles here."""
        self.stochastic = self.particles or self.dataset.attrs.get("method") == "particles"
        self.fields_usable = self.particles or not self.stochastic or replicas > 1
        self.bounds = {} if self.scene is None else systematic_parts(self.dataset, self.scene)
        self.law = self.scene
        """The scene whose density particles without one take, and whose S(k) a single ensemble is taken to have."""
        self._seen: tuple[tuple[float, int], dict[str, Array]] | None = None
        """Fields of raw particles last made, with their time and points in x: all that is compared at a time is made of them."""

    @functools.cached_property
    def shape(self) -> tuple[int, int]:
        """(replicas, particles of each) of raw particles."""
        x, _ = self.ensemble(0)
        return x.shape[0], x.shape[1]

    @property
    def bound(self) -> float:
        return sum(self.bounds.values())

    def describe(self) -> str:
        method = self.dataset.attrs.get("method", "particles that others made")
        if self.particles:
            replicas, count = self.shape
            shape = f", {count} particles" + (f" in each of {replicas} replicas" if replicas > 1 else ", one ensemble")
        elif self.stochastic and self.scene is not None:
            shape = f", {self.scene.particles.count} particles in each of {self.scene.particles.replicas} replicas"
        else:
            shape = f", {self.dataset.sizes['x']} × {self.dataset.sizes['v']} points"
        parts = ", ".join(f"{name} {size:.1e}" for name, size in self.bounds.items())
        return f"{self.name}: {method}{shape}; systematic part at most {parts or 'not known: taken as 0'}"

    @property
    def parts(self) -> int:
        """Of a single ensemble. Raises SceneError where it is too small for two."""
        _, count = self.shape
        if count < 4:
            raise SceneError(f"{self.name}: {count} particles have no standard errors; allowed: 4 or more, or replicas")
        return min(PARTS, count // 2)

    @property
    def number(self) -> float:
        """Of particles in all replicas; inf of what has none."""
        if self.particles:
            return float(math.prod(self.shape))
        if not self.stochastic or self.scene is None:
            return math.inf
        return float(self.scene.particles.count * self.scene.particles.replicas)

    @property
    def particles_of_a_replica(self) -> float:
        """Or of what stands for one."""
        if self.particles:
            replicas, count = self.shape
            return count if replicas > 1 else count / self.parts
        return self.scene.particles.count if self.scene is not None else math.nan

    # -- where and when

    def times(self, name: str) -> Array:
        """Of the frames of a field that are there."""
        if self.particles:
            from particles.files import particle_names, time_dimension

            names = particle_names(self.dataset)
            assert names is not None
            dimension = time_dimension(self.dataset[names[0]])
            if dimension is None:
                return np.array([float(self.dataset["time"])]) if "time" in self.dataset.coords else np.array([math.nan])
            if dimension not in self.dataset.coords:
                if self.dataset.sizes[dimension] == 1:
                    return np.array([math.nan])
                raise SceneError(f"{self.name}: its frames have no times; allowed: a coordinate {dimension!r}")
            times = self.dataset[dimension].values
            if times.dtype.kind not in "fiu":
                raise SceneError(f"{self.name}: its times are of type {times.dtype}; allowed: numbers")
            frames = self.dataset[names[0]].transpose(dimension, ...).values.reshape(times.size, -1)
            return np.asarray(times, dtype=float)[np.isfinite(frames).any(axis=1)]
        if name not in self.dataset:
            return np.empty(0)
        values = self.dataset[name]
        dimension = str(values.dims[0])
        whole = np.isfinite(values.values.reshape(values.sizes[dimension], -1)).any(axis=1)
        return np.asarray(values[dimension].values, dtype=float)[whole]

    def frame(self, name: str, time: float) -> int:
        dimension = self.dataset[name].dims[0]
        return int(np.abs(self.dataset[dimension].values - time).argmin())

    @property
    def nx(self) -> int:
        return MOST_POINTS if self.particles else int(self.dataset.sizes["x"])

    @property
    def v(self) -> Array | None:
        return None if self.particles else np.asarray(self.dataset["v"].values, dtype=float)

    # -- fields

    def over_x(self, time: float, nx: int, v: Array, length: float) -> dict[str, Values]:
        """`OVER_X` at nx points of the period, of the moments' waves that these can hold."""
        if self.particles:
            found = self._fields(time, nx, v, length)
            return {name: self._values(found, name) for name in OVER_X}
        frame = {name: self.dataset[name].values[self.frame(name, time)] for name in OVER_X}
        rho, u, theta = (frame[name] for name in OVER_X)
        moments = np.stack([rho, rho * u, rho * (theta + u**2)])[None]
        if self.stochastic:
            shares = [self.dataset[f"{name}_replica"].values[self.frame(name, time)] for name in OVER_X]
            r, du, dtheta = shares[0], shares[1] - u, shares[2] - theta
            j = u * r + rho * du
            moments = np.stack([r, j, rho * dtheta + 2 * u * j - (u**2 - theta) * r], axis=1)
        return _fields_of(_resampled(moments, nx), self.stochastic)

    def at_points(self, time: float, nx: int) -> dict[str, Values]:
        """`OVER_X` at nx points, of all waves: where nothing scatters."""
        rho, u, theta = (self.dataset[name].values[self.frame(name, time)] for name in OVER_X)
        moments = _at_points(np.stack([rho, rho * u, rho * (theta + u**2)])[None], nx)
        return _fields_of(moments, False)

    def unresolved(self, time: float) -> float:
        """Sum of the amplitudes in the highest eighth of the moments' waves, over their maxima: what may be folded onto others.

        Of points of the closed form, and of density steps; a grid solver's waves are in its error estimate.
        """
        stepped = self.scene is not None and self.scene.initial.step is not None
        if self.stochastic or not (stepped or self.dataset.attrs.get("method") == "exact"):
            return 0.0
        rho, u, theta = (self.dataset[name].values[self.frame(name, time)] for name in OVER_X)
        return max(_highest(values[:, None]) for values in (rho, rho * u, rho * (theta + u**2)))

    def unresolved_f(self, time: float) -> float:
        """Likewise of f."""
        return 0.0 if self.stochastic else _highest(self.dataset["f"].values[self.frame("f", time)])

    def totals(self, time: float, nx: int, v: Array, length: float) -> dict[str, Values]:
        """Of all particles together: `TOTALS`, each (1,)."""
        names = ("mass", "momentum", "energy")
        if self.particles:
            found = self._fields(time, nx, v, length)
            shares = np.array([found[f"{name}_replica"] for name in names])
        elif self.stochastic:
            shares = np.array([self.dataset[f"{name}_replica"].values[self.frame(name, time)] for name in names])
        else:
            shares = np.array([[float(self.dataset[name][self.frame(name, time)])] for name in names])
        mass, momentum, energy = shares.mean(axis=1)
        u, own = momentum / mass, shares[:, :, None]
        variance = 2 * energy / mass - u**2
        velocity = Values(np.array([u]), u + (own[1] - u * own[0]) / mass, self._inflation() if self.particles else 1.0)
        spread = variance + (2 * own[2] - 2 * u * own[1] + (u**2 - variance) * own[0]) / mass
        found_values = {
            "velocity_of_all": velocity,
            "variance_of_all": dataclasses.replace(velocity, points=np.array([variance]), replicas=spread),
        }
        if self.stochastic:
            return found_values
        return {name: Values(values.points) for name, values in found_values.items()}

    def distribution(self, time: float, v: Array, nx: int, length: float) -> Values:
        """w(v)."""
        name = "velocity_distribution"
        if self.particles:
            return self._values(self._fields(time, nx, v, length), name)
        frame, own = self.frame(name, time), self.v
        points = _over_v(own, self.dataset[name].values[frame], v)
        if not self.stochastic:
            return Values(points)
        return Values(points, _over_v(own, self.dataset[f"{name}_replica"].values[frame], v))

    def phase_space(self, time: float, nx: int, v: Array, length: float, scatter: bool) -> Values:
        """f at nx points and at v, flattened; of a particle run its own nx, and some of its own v.

        `scatter` says whether the other side is of particles: only waves that nx points hold are kept then.
        """
        if self.particles:
            found = self._fields(time, nx, v, length)
            replicas, _ = self.shape
            errors = found["f_stderr"].ravel(), replicas if replicas > 1 else self.parts
            return Values(found["f"].ravel(), None, self._inflation(), errors)
        frame, own = self.frame("f", time), self.v
        f = self.dataset["f"].values[frame]
        if not self.stochastic:
            return Values(_over_v(own, (_resampled if scatter else _at_points)(f.T, nx).T, v).ravel())
        assert own is not None
        assert self.scene is not None
        kept = np.isin(own, v)
        error = self.dataset["f_stderr"].values[frame][:, kept]
        return Values(f[:, kept].ravel(), None, 1.0, (error.ravel(), self.scene.particles.replicas))

    def _values(self, found: dict[str, Array], name: str) -> Values:
        replicas = found[f"{name}_replica"]
        return Values(found[name], replicas, self._inflation())

    def _inflation(self) -> float:
        from kinetic_solver.stability import structure_factor

        law = self.law
        if self.shape[0] > 1 or law is None or law.operator is None or law.model.friction * law.model.noise == 0:
            return 1.0
        return float(structure_factor(law, range(1, 9)).max())

    def ensemble(self, frame: int) -> tuple[Array, Array]:
        from particles.files import frame_of_particles

        return frame_of_particles(self.dataset, frame)

    def _fields(self, time: float, nx: int, v: Array, length: float) -> dict[str, Array]:
        from particles.estimators import Sampler, fields

        if self._seen is not None and self._seen[0] == (time, nx):
            return self._seen[1]
        times = self.times("density")
        x, u = self.ensemble(0 if np.isnan(times).all() else int(np.nanargmin(np.abs(times - time))))
        if not (np.isfinite(x).all() and np.isfinite(u).all()):
            raise SceneError(f"{self.name}: positions or velocities at t = {time:g} are not finite")
        assert self.law is not None
        if len(x) > 1:
            parts = list(zip(x, u, strict=True))
        else:  # at random: particles may be in an order
            shuffled = np.random.default_rng(0).permutation(x.shape[1])
            parts = [(x[0, chosen], u[0, chosen]) for chosen in np.array_split(shuffled, self.parts)]
        samples = []
        for places, velocities in parts:
            sampler = Sampler(length, nx, v, self.law.initial.density * length / places.size)
            samples.append(sampler.sample(np.ascontiguousarray(places), np.ascontiguousarray(velocities)))
        self._seen = (time, nx), fields(samples, length, nx, v)
        return self._seen[1]


def _highest(values: Array) -> float:
    """Sum over the highest eighth of the waves of values (nx, nv) of their largest amplitude, over the largest value."""
    size = np.abs(np.fft.rfft(values, axis=0, norm="forward")).max(axis=1)
    largest = np.abs(values).max()
    return float(2 * size[-(size.size // 8) :].sum() / largest) if size.size >= 8 and largest > 0 else 0.0


def _scene_of(dataset: xr.Dataset, name: str) -> Scene | None:
    if "scene" not in dataset.attrs:
        return None
    try:
        return Scene.model_validate_json(dataset.attrs["scene"])
    except ValidationError as error:
        raise SceneError(f"{name}: its attribute 'scene' is none ({one_line(error)})") from None


def _opened(source: str | Path | xr.Dataset) -> xr.Dataset:
    if isinstance(source, xr.Dataset):
        return source
    if not Path(source).is_file():
        raise SceneError(f"{source}: there is no such file")
    try:
        return xr.open_dataset(source)
    except (OSError, ValueError):
        raise SceneError(f"{source}: is not a readable netCDF file") from None


def _resampled(points: Array, nx: int) -> Array:
    """Values at nx points of the waves that they can hold, without the Nyquist wave of an even nx, along the last axis."""
    modes = np.fft.rfft(points, axis=-1, norm="forward")
    return np.asarray(np.fft.irfft(modes[..., : (nx - 1) // 2 + 1], n=nx, axis=-1, norm="forward"))


def _at_points(points: Array, nx: int) -> Array:
    """The trigonometric interpolant at nx points, along the last axis."""
    own = points.shape[-1]
    if own == nx:
        return points
    modes = np.fft.rfft(points, axis=-1, norm="forward")
    weight = np.full(modes.shape[-1], 2.0)
    weight[0] = 1.0
    if own % 2 == 0:
        weight[-1] = 1.0
    waves = np.exp(2j * np.pi * np.outer(np.arange(weight.size), np.arange(nx)) / nx)
    return np.asarray(((weight * modes) @ waves).real)


def _fields_of(moments: Array, stochastic: bool) -> dict[str, Values]:
    """ρ, u, θ from (replica, 3, nx) of ρ, ρu, ρ(θ + u²); the replicas' shares by the delta method."""
    rho, j, e = moments.mean(axis=0)
    positive = np.where(rho > 0, rho, np.nan)
    u = j / positive
    theta = e / positive - u**2
    if not stochastic:
        return {"density": Values(rho), "mean_velocity": Values(u), "temperature": Values(theta)}
    r, jr, er = moments[:, 0], moments[:, 1], moments[:, 2]
    return {
        "density": Values(rho, r),
        "mean_velocity": Values(u, u + (jr - u * r) / positive),
        "temperature": Values(theta, theta + (er - 2 * u * jr + (u**2 - theta) * r) / positive),
    }


def _over_v(own: Array | None, values: Array, v: Array) -> Array:
    """Values (…, nv) at the points v within `own`, by a quintic spline."""
    assert own is not None
    if own.size == v.size and np.allclose(own, v, rtol=0, atol=1e-12 * np.abs(own).max()):
        return values
    return np.asarray(make_interp_spline(own, values, k=5, axis=-1)(v))
