"""The tables of a scene, as validated, frozen data; one class a table of the TOML. No numerics happen here. Unknown keys are
refused, with the nearest known name suggested.
"""

from __future__ import annotations

import difflib
import warnings
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from kinetic_solver.scene.messages import LONGEST_SHOWN, in_one_line, shorten
from kinetic_solver.scene.toml import of_python

MOST_FRAMES = 1_000_000
"""Of any cadence: more are asked for by a slip of the pen."""
FOLLOW_LEADER = "follow-the-leader"
"""The collision operator (6)."""
INELASTIC = "inelastic"
"""The collision operator (12)."""

Operator = Literal["follow-the-leader", "inelastic"]
VelocityScheme = Literal["points", "hermite"]
SteppingScheme = Literal["exact", "exponential", "extrapolated", "strang"]
DriftDiffusionScheme = Literal["kernel", "finite-volume-8", "finite-volume"]
Deposit = Literal["linear", "cubic", "quintic"]

LARGEST = 1e100
"""Of any number, and one over it the least of those that must be above 0: third powers of such numbers are numbers still."""
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NonNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Count = Annotated[int, Field(strict=True, ge=1)]
Velocities = Annotated[int, Field(strict=True, ge=8)]
Window = tuple[Real, Real]
ModeNumber = Annotated[int, Field(strict=True, ge=1, le=10_000)]
Fraction = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)]


class Table(BaseModel):
    """Frozen; refuses keys that it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    def __init__(self, /, **keys: Any) -> None:
        with in_one_line():
            super().__init__(**keys)

    # pydantic's core calls the __init__ of a table within a table where it is not marked as its own: the path to the key would
    # be lost then.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def model_validate(cls, obj: Any, **options: Any) -> Self:
        """A table from a dictionary. Raises SceneError, one line with the key, what was given, and what is allowed."""
        with in_one_line():
            return super().model_validate(obj, **options)

    @classmethod
    def model_validate_json(cls, json_data: str | bytes | bytearray, **options: Any) -> Self:
        """A table from JSON. Raises SceneError likewise."""
        with in_one_line():
            return super().model_validate_json(json_data, **options)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        if isinstance(data, dict):
            known = _names(cls)
            for key in (key for key in data if key not in known):
                raise ValueError(f"unknown key {shorten(key)} = {shorten(data[key])}; {_hint(cls, str(key), known)}")
            return {key: of_python(value) for key, value in data.items()}
        return data

    @field_validator("*", mode="after")
    @classmethod
    def _refuse_extreme_numbers(cls, value: Any, info: ValidationInfo) -> Any:
        for number in value if isinstance(value, tuple) else (value,):
            if not isinstance(number, float) or number == 0:
                continue
            field = cls.model_fields[str(info.field_name)]
            least = 1 / LARGEST if _above_zero(field) or _above_zero(field.annotation) else 0.0
            if not least <= abs(number) <= LARGEST:
                wrong = "large" if abs(number) > 1 else "small"
                raise ValueError(f"{number:g} is too {wrong}; allowed: {least:g} to {LARGEST:g}")
        return value


def _above_zero(kind: Any) -> bool:
    """Whether a field, or a type as annotated, takes only numbers above 0."""
    parts = (*get_args(kind), *getattr(kind, "metadata", ()))
    return getattr(kind, "gt", None) == 0 or any(_above_zero(part) for part in parts)


def _names(table: type[Table]) -> set[str]:
    return {field.alias or name for name, field in table.model_fields.items()} | set(table.model_fields)


def _hint(table: type[Table], key: str, known: set[str]) -> str:
    """The key that may have been meant: one of this name in a table below, or one with nearly this name."""
    below = [
        f"'{name}.{key}'"
        for name, field in table.model_fields.items()
        for part in (field.annotation, *get_args(field.annotation))
        if isinstance(part, type) and issubclass(part, Table) and key in _names(part)
    ]
    if below:
        return f"did you mean {' or '.join(below)}?"
    near = difflib.get_close_matches(key, sorted(known), n=1, cutoff=0.5) if len(key) <= LONGEST_SHOWN else []
    return f"did you mean {near[0]!r}?" if near else "allowed: " + ", ".join(sorted(known))


class Model(Table):
    """Coefficients of the Langevin equation (1): dv = (g - γ v) dt + √(2σγ) dW."""

    gravity: Real = 0.0
    """g, the acceleration of every particle; any sign. [length/time²]"""
    friction: NonNegative = 1.0
    """γ, the rate at which friction slows a particle down. [1/time]"""
    noise: NonNegative = 1.0
    """σ, a velocity variance: the temperature that friction and noise alone sustain. [length²/time²]"""


class Collisions(Table):
    """A binary collision operator: "follow-the-leader" (6) or "inelastic" (12)."""

    operator: Operator
    """What a collision does: the faster takes the slower one's velocity (follow-the-leader), or both lose relative velocity."""
    cross_section: NonNegative
    """S_C: the probability that an encounter is a collision (per particle that a simulated one stands for)."""
    restitution: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)] | None = None
    """ε of (11), from 0 (sticking) to 1 (elastic); required by, and only for, "inelastic"."""

    @model_validator(mode="after")
    def _restitution_belongs_to_inelastic(self) -> Collisions:
        if self.operator == INELASTIC and self.restitution is None:
            raise ValueError('restitution is missing; operator "inelastic" needs a number from 0 to 1')
        if self.operator == FOLLOW_LEADER and self.restitution is not None:
            raise ValueError(f'restitution = {self.restitution} is given, but operator "follow-the-leader" has none; remove it')
        return self


class Pipe(Table):
    """Where the particles move: periodic."""

    length: Positive
    """L, the period of the pipe. [length]"""


UnitName = Annotated[str, Field(strict=True, pattern=r"^([A-Za-zµμΩ°]+|1)$", max_length=30)]


class Units(Table):
    """What the scene's units are called, as in UDUNITS: names for files alone, no number depends on them."""

    length: UnitName
    """Name of the unit of length: "m", say."""
    time: UnitName
    """Name of the unit of time: "s", say."""
    number: UnitName = "1"
    """Name of the unit in which particles are counted: "1" for plain numbers."""


class Run(Table):
    """How long, and how often anything is written."""

    end_time: Positive
    """How long the run is, since its start, whatever `initial.time` is. [time]"""
    output_every: Positive | None = None
    """Frames are at 0, every output_every, and end_time; by default at 0 and end_time alone. [time]"""

    @model_validator(mode="after")
    def _countable(self) -> Run:
        if self.output_every is not None and self.end_time / self.output_every > MOST_FRAMES:
            raise ValueError(
                f"output_every = {self.output_every:g} makes more than {MOST_FRAMES} frames until end_time; raise it"
            )
        return self


Cadence = Annotated[bool, Field(strict=True)] | Positive


def _wrong_window(window: tuple[float, float] | None) -> str | None:
    """What is wrong with it, if anything."""
    if window is None or window[0] < window[1]:
        return None
    return f"velocity_window = [{window[0]}, {window[1]}] is reversed or empty; the first number must be the smaller one"


GROUPS = ("f", "moments", "scalars", "budgets", "moment_equations", "particles")
"""Of what is written: the keys of [output] that are cadences."""


class Output(Table):
    """What is written, and how often: false (never), true (every `run.output_every`), or a time interval of its own. And where
    fields are given."""

    f: Cadence = True
    """The distribution function f(x, v). [time]"""
    moments: Cadence = True
    """Density, mean velocity, temperature and heat flux over x, and the velocity distribution w(v). [time]"""
    scalars: Cadence = True
    """Mass, momentum and energy; minimum of f; what touches the window's edges; resolution. [time]"""
    budgets: Cadence = True
    """Rates of momentum and energy by term, what each term has brought since time 0, and the residual. [time]"""
    moment_equations: Cadence = False
    """Every term of the moment equations (3)-(5), with the heat-flux terms that the paper neglects. [time]"""
    particles: Cadence = False
    """Position and velocity of every particle; particles alone have them. [time]"""
    nx: Count | None = None
    """Points in x at which fields are given, whatever the solver uses; by default what it uses, and 64 or more."""
    nv: Annotated[int, Field(strict=True, ge=2)] | None = None
    """Points in v, likewise."""
    velocity_window: Window | None = None
    """The least and the largest velocity for which f and w(v) are given; by default what holds them. [length/time]"""

    @model_validator(mode="after")
    def _window(self) -> Output:
        if (wrong := _wrong_window(self.velocity_window)) is not None:
            raise ValueError(wrong)
        return self


class Accuracy(Table):
    """How close to the equation's solution the answer is to be."""

    rtol: Annotated[float, Field(strict=True, allow_inf_nan=False)] = 1e-4
    """Wanted: max|Δf| ≤ rtol·max|f|. Chooses what [grid] leaves open."""

    @model_validator(mode="after")
    def _reachable(self) -> Accuracy:
        if not 1e-10 <= self.rtol <= 0.1:
            raise ValueError(f"rtol = {self.rtol:g}: allowed: 1e-10 to 0.1")
        return self


class Grid(Table):
    """Discretisation. What is given is kept as given; the rest follows from rtol by the rules in docs/rules.md.

    `time_step` is the longest step: exact steps, which gain nothing from it, may be shorter.
    """

    nx: Count | None = None
    """Points in x; by default chosen."""
    nv: Velocities | None = None
    """Points in v, or Hermite functions; by default chosen."""
    velocity_window: Window | None = None
    """The least and the largest velocity; by default chosen. [length/time]"""
    time_step: Positive | None = None
    """The longest step; by default chosen. [time]"""
    velocity: VelocityScheme | None = None
    """How f is held in v: at points (the default; robust), or as nv Hermite functions about the homogeneous state."""
    stepping: SteppingScheme | None = None
    """How steps in time are made, by default chosen: exact (follow-the-leader or no collisions); high order with error
    control, for inelastic collisions also about their homogeneous state (exponential); or Strang's method, order 2."""
    drift_diffusion: DriftDiffusionScheme | None = None
    """What friction and noise do between velocity points, by default chosen: the exact Ornstein-Uhlenbeck kernel, or finite
    volumes of order 8 or 2 (positive)."""
    deposit: Deposit | None = None
    """How products of inelastic collisions are placed between grid points, by default chosen; only "linear" is positive."""

    @field_validator("velocity", mode="before")
    @classmethod
    def _old_word(cls, value: Any) -> Any:
        if value != "finite-volume":
            return value
        warnings.warn("grid.velocity = 'finite-volume': is now called 'points'; it chooses no finite volumes", stacklevel=2)
        return "points"

    @model_validator(mode="after")
    def _window(self) -> Grid:
        if (wrong := _wrong_window(self.velocity_window)) is not None:
            raise ValueError(wrong)
        return self


class Hydrodynamics(Table):
    """The hydrodynamic method."""

    moments: Annotated[int, Field(strict=True, ge=3, le=1000)] | None = None
    """M of the Hermite hierarchy, whose steps are matrices of this size; by default the closure (3)-(5) of the paper instead."""


class Particles(Table):
    """The particle ensemble."""

    count: Count = 100_000
    """Simulated particles per replica; each stands for density·length/count real ones."""
    cells: Count | None = None
    """In which collision partners are drawn; by default a quarter of the mean free path long."""
    time_step: Positive | None = None
    """By default a tenth of the shortest time in the scene. [time]"""
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 1
    """Of the random numbers."""
    replicas: Count = 8
    """Independent ensembles, whose scatter gives standard errors: with one there are none."""
    collisions: Literal["dsmc", "single-file"] = "dsmc"
    """Who collides: drawn in cells (direct simulation), or whoever overtakes."""
