"""The table [initial]: the state at time 0, as validated, frozen data."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from kinetic_solver.arrays import Array
from kinetic_solver.scene.tables import Fraction, ModeNumber, NonNegative, Positive, Real, Table


class Mode(Table):
    """cos·cos(2π mode x/L) + sin·sin(2π mode x/L)."""

    mode: ModeNumber
    """Waves in the pipe."""
    cos: Real = 0.0
    """Amplitude of the cosine; unit: that of what has the modes. [1 or length/time]"""
    sin: Real = 0.0
    """Amplitude of the sine; unit: that of what has the modes. [1 or length/time]"""


class Eigenmode(Mode):
    """A wave of the shape that a branch of the linearised equation has in v (docs/stability_details.md), of this relative
    density."""

    branch: Annotated[int, Field(strict=True, ge=0, le=20)] = 0
    """Which wave of this mode: 0 decays most slowly, 1 next, …"""


class DensityStep(Table):
    """A density step: `ratio` times the outer density between the fractions `from` and `to` of L; the mean stays the scene's."""

    start: Fraction = Field(alias="from")
    """Where the step begins, of L."""
    end: Fraction = Field(alias="to")
    """Where it ends, of L."""
    ratio: NonNegative
    """Density between over that outside."""

    @model_validator(mode="after")
    def _ordered(self) -> DensityStep:
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
        if m.cos:  # plans look at thousands of places, and most modes have but one of the two
            total += m.cos * np.cos(phase)
        if m.sin:
            total += m.sin * np.sin(phase)
    return total


def _minimum(modes: Modes) -> float:
    """The least value of the Fourier sum, on a grid fine enough (64 points a wavelength) to be within 0.2 % of its swing."""
    if not modes:
        return 0.0
    n = 64 * max(m.mode for m in modes)
    return float(fourier_sum(modes, np.arange(n) / n, 1.0).min())


class Pulse(Table):
    """A Gaussian on a uniform background: density = background·[1 + height·Σ exp(-(x/L - at - m)²/(2 width²))], the sum over all
    whole m, which makes it periodic; the mean stays the scene's."""

    at: Fraction
    """Where the Gaussian has its centre, of L."""
    width: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1e-3, le=1)]
    """Its standard deviation, of L; below a thousandth the places at which a start is looked at would miss it."""
    height: Real
    """Of the Gaussian over the background; below 0 it is a dip."""

    @property
    def whole(self) -> float:
        """The mean density over the background."""
        return 1 + self.height * self.width * math.sqrt(2 * math.pi)

    @model_validator(mode="after")
    def _positive(self) -> Pulse:
        # With width = 1 the next of the neighbours would add exp(-40).
        top = float(np.exp(-((np.arange(-8, 9) / self.width) ** 2) / 2).sum())
        if 1 + self.height * top < 0:
            raise ValueError(
                f"pulse height = {self.height:g} makes the density negative; allowed with width = {self.width:g}: "
                f"{-1 / top:.4g} or more"
            )
        return self


class Beam(Table):
    """A part of the particles, with a Maxwellian of its own, the same at every x."""

    share: Positive
    """Of all particles; the shares add up to 1."""
    mean_velocity: Real
    """Of the beam. [length/time]"""
    temperature: Positive
    """Of the beam, a velocity variance. [length²/time²]"""


class Initial(Table):
    """The state at time 0: a Maxwellian in v at every x, or several, or f (or particles) from a netCDF file."""

    density: Positive = 1.0
    """Mean density ρ̄. [particles/length]"""
    modes: Modes = ()
    """Relative Fourier amplitudes of the density."""
    step: DensityStep | None = None
    """A step profile instead of `modes`."""
    pulse: Pulse | None = None
    """A Gaussian instead of `modes`."""
    mean_velocity: Real | None = None
    """u0; by default the homogeneous state's. [length/time]"""
    temperature: Positive | None = None
    """θ0, a velocity variance; by default the homogeneous state's. [length²/time²]"""
    velocity_modes: Modes = ()
    """Absolute Fourier amplitudes added to the mean velocity. [length/time]"""
    temperature_modes: Modes = ()
    """Relative Fourier amplitudes of the temperature."""
    beams: tuple[Beam, ...] = ()
    """Several Maxwellians at every x, instead of `mean_velocity` and `temperature`."""
    eigenmodes: tuple[Eigenmode, ...] = ()
    """Eigenmodes on the homogeneous state, instead of all the above but `density`."""
    file: str | None = None
    """A file to start from, instead of all the above (density still sets the scene's groups): f(x, v) or particles in netCDF,
    particles in CSV."""
    time: Real = 0.0
    """What the clock says at the start: written times go on from here. For a run from another's last frame, its time. [time]"""

    @property
    def density_modes(self) -> Modes:
        """The relative Fourier amplitudes of the density, whatever it is that has them."""
        return (*self.modes, *self.eigenmodes)

    def _given(self, besides: set[str]) -> list[str]:
        """The keys that say something, those of a scene written by a run included."""
        return sorted(key for key in self.model_fields_set - besides if getattr(self, key) not in (None, ()))

    @model_validator(mode="after")
    def _physical(self) -> Initial:
        profiles = [key for key in ("modes", "step", "pulse") if getattr(self, key)]
        if len(profiles) > 1:
            raise ValueError(f"{' and '.join(profiles)} are both given; allowed: one of them")
        if self.step is not None and self.step.ratio == 0 and self.step.end - self.step.start == 1:
            raise ValueError("step from = 0, to = 1, ratio = 0 leaves no particles; allowed: ratio > 0, or a part of the pipe")
        if self.eigenmodes:
            clash = self._given({"eigenmodes", "density", "time"})
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
        if self.beams:
            alone = ("mean_velocity", "temperature", "velocity_modes", "temperature_modes")
            if clash := [key for key in alone if getattr(self, key) not in (None, ())]:
                raise ValueError(f"beams are given together with {', '.join(clash)}; beams have these of their own")
            total = math.fsum(beam.share for beam in self.beams)
            if not abs(total - 1) <= 1e-9:
                raise ValueError(f"beams: the shares add up to {total:.10g}; allowed: 1")
        if self.file is not None:
            clash = self._given({"file", "density", "time"})
            if clash:
                raise ValueError(f"file is given together with {', '.join(clash)}; a file replaces them")
        return self
