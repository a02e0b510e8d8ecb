"""The scene: what is simulated, as validated, immutable data. No numerics happen here.

A scene is read from TOML (`Scene.from_toml`) or built from the same keys in Python (`Scene.model_validate`). Unknown keys
are refused, with the nearest known name suggested. Units are the user's own; they must be consistent (length L, time T,
number of particles). Symbols and conventions: docs/theory.md; equation numbers are those of the paper cited there.
"""

from __future__ import annotations

import difflib
import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from kinetic_solver.arrays import Array

MOST_FRAMES = 1_000_000
FOLLOW_LEADER = "follow-the-leader"
INELASTIC = "inelastic"

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NonNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Count = Annotated[int, Field(strict=True, ge=1)]
ModeNumber = Annotated[int, Field(strict=True, ge=1, le=10_000)]
Fraction = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)]


class SceneError(ValueError):
    """A scene or a command is wrong. The message is one line: which key, what was given, what is allowed."""


def shorten(value: Any) -> str:
    """repr, cut to the length of a message."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        if isinstance(data, dict):
            known = {field.alias or name for name, field in cls.model_fields.items()} | set(cls.model_fields)
            for key in data:
                if key not in known:
                    near = difflib.get_close_matches(str(key), sorted(known), n=1, cutoff=0.5)
                    hint = f"did you mean {near[0]!r}?" if near else "allowed: " + ", ".join(sorted(known))
                    raise ValueError(f"unknown key {key!r} = {shorten(data[key])}; {hint}")
        return data


class Model(_Table):
    """Coefficients of the Langevin equation (1): dv = (g - γ v) dt + √(2σγ) dW."""

    gravity: Real = 0.0
    """g, an acceleration [length/time²]; any sign."""
    friction: NonNegative = 1.0
    """γ [1/time]."""
    noise: NonNegative = 1.0
    """σ, a velocity variance [length²/time²]: the temperature that friction and noise alone sustain."""


class Collisions(_Table):
    """A binary collision operator: (6) "follow-the-leader" or (12) "inelastic"."""

    operator: Literal["follow-the-leader", "inelastic"]
    cross_section: NonNegative
    """S_C, dimensionless: the probability that an encounter is a collision (per particle that a simulated one stands for)."""
    restitution: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)] | None = None
    """ε of (11), from 0 (sticking) to 1 (elastic); required by, and only for, "inelastic"."""

    @model_validator(mode="after")
    def _restitution_belongs_to_inelastic(self) -> Collisions:
        if self.operator == INELASTIC and self.restitution is None:
            raise ValueError('restitution is missing; operator "inelastic" needs a number from 0 to 1')
        if self.operator == FOLLOW_LEADER and self.restitution is not None:
            raise ValueError(f'restitution = {self.restitution} is given, but operator "follow-the-leader" has none; remove it')
        return self


class Pipe(_Table):
    length: Positive
    """L, the period of the pipe [length]."""


class Mode(_Table):
    """cos·cos(2π mode x/L) + sin·sin(2π mode x/L)."""

    mode: ModeNumber
    cos: Real = 0.0
    sin: Real = 0.0


class Eigenmode(Mode):
    """A wave of the shape that a branch of the linearised equation has in v (docs/stability.md), of this relative density."""

    branch: Annotated[int, Field(strict=True, ge=0, le=20)] = 0
    """0 decays most slowly, 1 next, …"""


class Step(_Table):
    """A density step: `ratio` times the outer density between the fractions `from` and `to` of L; the mean stays the scene's."""

    start: Fraction = Field(alias="from")
    end: Fraction = Field(alias="to")
    ratio: NonNegative

    @model_validator(mode="after")
    def _ordered(self) -> Step:
        if not self.start < self.end:
            raise ValueError(f"step from = {self.start}, to = {self.end}: 'from' must be less than 'to'")
        return self


Modes = tuple[Mode, ...]


def fourier_sum(modes: Modes, x: ArrayLike, length: float) -> Array:
    """Σ cos·cos(2π mode x/L) + sin·sin(2π mode x/L), with the shape of `x`."""
    x = np.asarray(x, dtype=float)
    total = np.zeros(x.shape)
    for m in modes:
        phase = 2 * np.pi * m.mode * x / length
        total += m.cos * np.cos(phase) + m.sin * np.sin(phase)
    return total


def _minimum(modes: Modes) -> float:
    """The least value of the Fourier sum, on a grid fine enough (64 points a wavelength) to be within 0.2 % of its swing."""
    if not modes:
        return 0.0
    n = 64 * max(m.mode for m in modes)
    return float(fourier_sum(modes, np.arange(n) / n, 1.0).min())


class Initial(_Table):
    """The state at time 0: a Maxwellian in v at every x, or f (or particles) from a netCDF file."""

    density: Positive = 1.0
    """Mean density ρ̄ [particles/length]."""
    modes: Modes = ()
    """Relative Fourier amplitudes of the density."""
    step: Step | None = None
    """A step profile instead of `modes`."""
    mean_velocity: Real | None = None
    """u0; None means the homogeneous state's."""
    temperature: Positive | None = None
    """θ0, a velocity variance; None means the homogeneous state's."""
    velocity_modes: Modes = ()
    """Absolute Fourier amplitudes added to the mean velocity."""
    temperature_modes: Modes = ()
    """Relative Fourier amplitudes of the temperature."""
    eigenmodes: tuple[Eigenmode, ...] = ()
    """Eigenmodes on the homogeneous state, instead of all the above but `density`."""
    file: str | None = None
    """A netCDF file to start from, instead of all the above (density still sets the scene's groups)."""

    @property
    def density_modes(self) -> Modes:
        """The relative Fourier amplitudes of the density, whatever it is that has them."""
        return (*self.modes, *self.eigenmodes)

    def _given(self, besides: set[str]) -> list[str]:
        """The keys that say something, those of a scene written by a run included."""
        return sorted(key for key in self.model_fields_set - besides if getattr(self, key) not in (None, ()))

    @model_validator(mode="after")
    def _physical(self) -> Initial:
        if self.modes and self.step is not None:
            raise ValueError("modes and step are both given; allowed: one of them")
        if self.step is not None and self.step.ratio == 0 and self.step.end - self.step.start == 1:
            raise ValueError("step from = 0, to = 1, ratio = 0 leaves no particles; allowed: ratio > 0, or a part of the pipe")
        if self.eigenmodes:
            clash = self._given({"eigenmodes", "density"})
            if clash:
                raise ValueError(f"eigenmodes are given together with {', '.join(clash)}; allowed: with density alone")
        if (low := 1 + _minimum(self.density_modes)) < -1e-12:
            which = "eigenmodes" if self.eigenmodes else "modes"
            raise ValueError(f"{which} make the density negative (minimum {low:.4g} times the mean); reduce their amplitudes")
        if (low := 1 + _minimum(self.temperature_modes)) <= 0:
            raise ValueError(
                f"temperature_modes make the temperature negative or zero (minimum {low:.4g} times the mean); "
                "reduce their amplitudes"
            )
        if self.file is not None:
            clash = self._given({"file", "density"})
            if clash:
                raise ValueError(f"file is given together with {', '.join(clash)}; a file replaces them")
        return self


class Run(_Table):
    end_time: Positive
    output_every: Positive | None = None
    """Frames at 0, every output_every, and end_time; None means end_time."""

    @model_validator(mode="after")
    def _countable(self) -> Run:
        if self.output_every is not None and self.end_time / self.output_every > MOST_FRAMES:
            raise ValueError(
                f"output_every = {self.output_every:g} makes more than {MOST_FRAMES} frames until end_time; raise it"
            )
        return self


Cadence = Annotated[bool, Field(strict=True)] | Positive


class Output(_Table):
    """What is written, and how often: false (never), true (every `run.output_every`), or a time interval of its own."""

    f: Cadence = True
    """f(x, v)."""
    moments: Cadence = True
    """Density, mean velocity, temperature and heat flux over x, and the velocity distribution w(v)."""
    scalars: Cadence = True
    """Mass, momentum and energy; minimum of f; what touches the window's edges; resolution."""
    budgets: Cadence = True
    """Rates of momentum and energy by term, what each term has brought since time 0, and the residual."""
    moment_equations: Cadence = False
    """Every term of the moment equations (3)-(5), with the heat-flux terms that the paper neglects."""
    particles: Cadence = False
    """Position and velocity of every particle; particles alone have them."""


class Accuracy(_Table):
    rtol: Annotated[float, Field(strict=True, allow_inf_nan=False)] = 1e-4
    """Wanted: max|Δf| ≤ rtol·max|f|. Chooses what [grid] leaves open."""

    @model_validator(mode="after")
    def _reachable(self) -> Accuracy:
        if not 1e-10 <= self.rtol <= 0.1:
            raise ValueError(f"rtol = {self.rtol:g}: allowed: 1e-10 to 0.1")
        return self


class Grid(_Table):
    """Discretisation. What is given is kept as given; the rest follows from rtol by the rules in docs/accuracy.md.

    `time_step` is the longest step: exact steps, which gain nothing from it, may be shorter.
    """

    nx: Count | None = None
    nv: Annotated[int, Field(strict=True, ge=8)] | None = None
    velocity_window: tuple[Real, Real] | None = None
    time_step: Positive | None = None
    velocity: Literal["finite-volume", "hermite"] | None = None
    """How f depends on v: points (robust, the default), or nv Hermite functions about the homogeneous state."""
    stepping: Literal["exact", "extrapolated", "strang"] | None = None
    """In time: exact (no collisions, and operator (6)); high order with error control; or Strang's method, order 2."""
    drift_diffusion: Literal["kernel", "finite-volume-8", "finite-volume"] | None = None
    """Between velocity points: the exact Ornstein-Uhlenbeck kernel, or finite volumes of order 8 or 2 (positive)."""
    deposit: Literal["linear", "cubic", "quintic"] | None = None
    """How operator (12) places collision products between grid points; only "linear" is positive."""

    @model_validator(mode="after")
    def _window(self) -> Grid:
        if self.velocity_window is not None and not self.velocity_window[0] < self.velocity_window[1]:
            low, high = self.velocity_window
            raise ValueError(f"velocity_window = [{low}, {high}] is reversed or empty; the first number must be the smaller one")
        return self


class Particles(_Table):
    """The particle ensemble."""

    count: Count = 100_000
    """Simulated particles per replica; each stands for density·length/count real ones."""
    cells: Count | None = None
    time_step: Positive | None = None
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 1
    replicas: Count = 1
    collisions: Literal["dsmc", "single-file"] = "dsmc"


class Groups(_Table):
    """The dimensionless groups of a scene."""

    collision_number: float
    """R* = S ρ̄ √σ/γ: collisions per relaxation time of a thermal particle."""
    wavenumber: float
    """k* = (2π/L) √σ/γ of the longest wave: the thermal free path in units of L/2π."""
    length: float
    """L* = L γ/√σ."""


class Scene(_Table):
    """Everything that defines a run of equation (2)."""

    model: Model = Model()
    collisions: Collisions | None = None
    pipe: Pipe
    initial: Initial = Initial()
    run: Run
    output: Output = Output()
    accuracy: Accuracy = Accuracy()
    grid: Grid = Grid()
    particles: Particles = Particles()

    @model_validator(mode="after")
    def _cadences_are_countable(self) -> Scene:
        for group in Output.model_fields:
            cadence = getattr(self.output, group)
            if not isinstance(cadence, bool) and self.run.end_time / cadence > MOST_FRAMES:
                raise ValueError(f"output.{group} = {cadence:g} makes more than {MOST_FRAMES} frames until end_time; raise it")
        return self

    @model_validator(mode="after")
    def _eigenmodes_have_a_state_to_be_about(self) -> Scene:
        if self.initial.eigenmodes and self.model.friction * self.model.noise == 0:
            raise ValueError(
                f"initial.eigenmodes are about a stationary state, and model.friction = {self.model.friction:g}, "
                f"model.noise = {self.model.noise:g} have none; allowed: both above 0"
            )
        return self

    @classmethod
    def from_toml(cls, path: str | Path, overrides: dict[str, Any] | None = None) -> Scene:
        """Read a scene; `overrides` maps dotted keys to values, as in {"grid.nx": 64}.

        A relative `initial.file` is relative to the scene's folder. Raises SceneError, with a message of one line.
        """
        path = Path(path)
        try:
            data = tomllib.loads(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not a UTF-8 text file"
            raise SceneError(f"{path}: cannot be read ({reason})") from None
        except tomllib.TOMLDecodeError as error:
            raise SceneError(f"{path}: not valid TOML: {error}") from None
        for dotted, value in (overrides or {}).items():
            _set_dotted(data, dotted, value)
        start = data.get("initial", {}).get("file") if isinstance(data.get("initial"), dict) else None
        if isinstance(start, str):
            data["initial"]["file"] = str(path.parent / start)
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            raise SceneError(f"{path}: {one_line(error)}") from None

    @property
    def cross_section(self) -> float:
        """S_C; 0 without collisions."""
        return self.collisions.cross_section if self.collisions else 0.0

    @property
    def restitution(self) -> float:
        """ε; 1 where nothing is inelastic."""
        return 1.0 if self.collisions is None or self.collisions.restitution is None else self.collisions.restitution

    @property
    def operator(self) -> Literal["follow-the-leader", "inelastic"] | None:
        """The operator that acts: None without collisions, for S_C = 0, and for elastic ones (ε = 1), whose (12) is zero."""
        if self.collisions is None or self.collisions.cross_section == 0:
            return None
        if self.collisions.operator == INELASTIC and self.restitution == 1:
            return None
        return self.collisions.operator

    @property
    def homogeneous(self) -> bool:
        """True where nothing in the scene depends on x."""
        i = self.initial
        varied = (*i.density_modes, *i.velocity_modes, *i.temperature_modes)
        stepped = i.step is not None and i.step.ratio != 1
        return i.file is None and not stepped and not any(m.cos or m.sin for m in varied)

    @property
    def groups(self) -> Groups:
        g, s = self.model.friction, math.sqrt(self.model.noise)
        path = s / g if g > 0 else (math.inf if s > 0 else math.nan)
        return Groups(
            collision_number=self.cross_section * self.initial.density * path if self.cross_section else 0.0,
            wavenumber=2 * math.pi / self.pipe.length * path,
            length=self.pipe.length / path if path else math.inf,
        )

    @property
    def output_every(self) -> float:
        return self.run.output_every or self.run.end_time

    def times(self, cadence: bool | float = True) -> Array:
        """Frame times: 0, every cadence, and end_time; empty for False."""
        if cadence is False:
            return np.empty(0)
        every = self.output_every if cadence is True else float(cadence)
        end = self.run.end_time
        # A cadence that divides end_time up to rounding makes its last multiple the end, not a frame just beside it.
        n = math.floor(end / every * (1 + 1e-12))
        times = every * np.arange(n + 1)
        if end - times[-1] > 1e-9 * every:
            return np.append(times, end)
        times[-1] = end
        return times


def _set_dotted(data: dict[str, Any], dotted: str, value: Any) -> None:
    *parents, last = dotted.split(".")
    table = data
    for name in parents:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise SceneError(f"--set {dotted}: {name!r} is not a table")
    table[last] = value


def parse_override(text: str) -> tuple[str, Any]:
    """ "a.b=value", with the value in TOML ("0.5", "true", "[1, 2]"); a bare word is taken as text."""
    key, separator, raw = text.partition("=")
    if not separator or not key.strip():
        raise SceneError(f"--set {text!r}: expected a.b=value")
    try:
        parsed = tomllib.loads(f"value = {raw}")
        if set(parsed) != {"value"}:
            raise SceneError(f"--set {text!r}: expected one value")
        value = parsed["value"]
    except tomllib.TOMLDecodeError:
        value = raw.strip()
    return key.strip(), value


def one_line(error: ValidationError) -> str:
    """A pydantic error as one line: the key, what was given, what is allowed (the first problem, and how many more)."""
    problems = error.errors()
    first = problems[0]
    where = ".".join(str(part) for part in first["loc"] if not _is_union_branch(str(part)))
    message = first["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:].replace("tuple", "pair of numbers")
    if first["type"] == "missing":
        text = f"{where}: is missing"
    elif first["type"] == "value_error":
        text = f"{where}: {message}" if where else message
    else:
        text = f"{where} = {shorten(first['input'])}: {message}"
    if "\n" in text:
        text = " ".join(text.split())
    if first["loc"][:1] == ("output",) and first["type"] != "value_error":
        message = "input should be false, true, or a time interval greater than 0"
        text = f"{where} = {shorten(first['input'])}: {message}"
    others = len({tuple(map(str, p["loc"][:2])) for p in problems}) - 1
    return text + (f" (and {others} more)" if others > 0 else "")


def _is_union_branch(part: str) -> bool:
    return part.startswith(("constrained-", "function-", "bool", "float", "tuple["))
