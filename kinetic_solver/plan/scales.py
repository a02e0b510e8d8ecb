"""What the physics of a scene asks to be resolved: extremes of its fields, rates, and how far (6) amplifies. Computed once.

Symbols as in docs/rules.md: y standard deviations of tail, θ_max and θ_min, ν = Sρ_max√θ_max, R_t = ν(1 - exp(-γt))/γ.
"""

from __future__ import annotations

import contextlib
import functools
import math
from dataclasses import dataclass

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.initial import SceneStart, Start
from kinetic_solver.laws import CollisionLaw, FollowTheLeader, Inelastic
from kinetic_solver.scene import Scene
from kinetic_solver.stability.homogeneous import rough_temperature_at
from kinetic_solver.stability.scaling import cooling_state
from kinetic_solver.theory.ornstein_uhlenbeck import Transition, transition

POINTS = 4096
"""Places on the pipe at which the start is looked at: enough for a wave of mode 500."""
TAIL = 40.0
"""A Gaussian counts as ended where it has fallen to rtol over this; a cell further in it is a few times more."""
THIN = 10.0
"""How many times thinner than the densest a place may be before f must be more accurate than rtol for the sake of its mean
velocity and temperature. tests/convergence/test_thin_places.py."""
EDGE_OF_THIN = 2.0
"""Likewise of what the window cuts off. With 10 θ erred by 1.0 rtol (1e-3) at the front of a gas that flows into vacuum, (12),
with 2 by 0.24. tests/convergence/test_thin_places.py."""
PAIRS_ARE_DENSE = 0.1
"""Of rtol, below which f need not go for the sake of thin places with (12): what its rate errs by lies where f is large. At half
of rtol u and θ beside a step of ratio 1e-3 erred by up to 0.95 rtol (1e-4), at a tenth by 0.2."""
LEAST_RTOL = 1e-10
"""Nothing finer is asked of f: round-off is near."""
HAFF_SHORT = 2.0
"""A cooling gas does not stay Maxwellian, and was seen up to so many times colder than Haff's law has it (docs/rules.md)."""


@dataclass(frozen=True)
class Scales:
    """Of one scene, in the frame of reference in which it is solved."""

    scene: Scene
    law: CollisionLaw | None
    """What collisions do: the scene's, or one that was brought along; None where they do nothing."""
    times: Array
    """When anything is written, by the frame's clock; the first is 0."""
    lab_friction: float
    """γ in the laboratory, which a noiseless frame takes out of `scene`."""
    start: Start
    density: Array
    """At `POINTS` places over the pipe: the start."""
    mean_velocity: Array
    """Likewise, of each of the Gaussians that the start is made of, or bounded by: (Gaussians, POINTS)."""
    temperature: Array
    """Of each Gaussian, likewise."""
    spread: float
    """The hottest place at the start, of all Gaussians together."""
    narrowest: float
    """The variance of a Gaussian as fine in v as the start is anywhere."""
    whole: Transition
    """Of friction and noise over the whole run."""
    theta_end: float
    """The hottest place at the end."""
    theta_min: float
    """The coldest temperature at any place and time: bounds dv."""
    of_edges: float
    """Of max f, what may lie beyond the window's edges: rtol, or less where f is thin."""

    @property
    def rtol(self) -> float:
        return self.scene.accuracy.rtol

    @property
    def end(self) -> float:
        return self.scene.run.end_time

    @functools.cached_property
    def x(self) -> Array:
        return self.scene.pipe.length * np.arange(self.density.size) / self.density.size

    @property
    def tail(self) -> float:
        """y: standard deviations at which a Gaussian is `of_edges`/40 of its maximum."""
        return math.sqrt(2 * math.log(TAIL / self.of_edges))

    @functools.cached_property
    def rho_max(self) -> float:
        return float(self.density.max())

    @functools.cached_property
    def theta_max(self) -> float:
        """The hottest temperature at any place and time: bounds the window."""
        return max(float(self.temperature.max()), self.theta_end)

    @property
    def hottest(self) -> float:
        """The largest variance of v at any place and time: bounds rates."""
        return max(self.theta_max, self.spread)

    @property
    def cross_section(self) -> float:
        """S of operator (6); 0 of any other law."""
        return self.law.cross_section if isinstance(self.law, FollowTheLeader) else 0.0

    @functools.cached_property
    def of_one_shape(self) -> bool:
        """True where the start is made of Gaussians that are the same at every x, but for their density."""
        uniform = not (np.ptp(self.mean_velocity, axis=1).any() or np.ptp(self.temperature, axis=1).any())
        return self.start.gaussian and uniform

    @functools.cached_property
    def thinnest(self) -> float:
        """The least density at the start, over the largest."""
        return float(self.density.min()) / self.rho_max

    def stricter(self, rtol: float) -> float:
        """What f must meet for its mean velocity and temperature to meet rtol, where density is rtol of its largest or more."""
        of_f = min(rtol, max(LEAST_RTOL, THIN * max(rtol, self.thinnest) * rtol))
        return max(of_f, PAIRS_ARE_DENSE * rtol) if self.of_pairs else of_f

    def stricter_at_edges(self, rtol: float) -> float:
        """Likewise of what the window cuts off: ahead of a front into thin places only the fastest particles are."""
        return min(rtol, max(LEAST_RTOL, EDGE_OF_THIN * max(rtol, self.thinnest) * rtol))

    @property
    def cooling(self) -> bool:
        """True in a frame that follows a cooling gas, whose friction is negative (moving_frame.py)."""
        return self.scene.model.friction < 0

    @property
    def forgetting(self) -> float:
        """The rate at which errors of the past are forgotten; 0 where nothing but collisions forgets them."""
        return abs(self.scene.model.friction)

    @functools.cached_property
    def means(self) -> tuple[float, float]:
        """The least and the largest mean velocity, at the start and at the end as gravity and friction alone would have it."""
        return self._until_the_end(float(self.mean_velocity.min()), float(self.mean_velocity.max()))

    @property
    def flow(self) -> tuple[float, float]:
        """Likewise of the flow itself, where `means` are those of Gaussians that bound the start."""
        return self._until_the_end(*self.start.mean_velocities(self.x))

    def _until_the_end(self, least: float, largest: float) -> tuple[float, float]:
        if self.cooling:
            return least, largest  # collisions stop what the frame spreads
        both = [least, largest, *(self.whole.velocity_shift + mean * self.whole.decay for mean in (least, largest))]
        return min(both), max(both)

    @property
    def collision_rate(self) -> float:
        """ν = Sρ√θ at the largest density and temperature (of other laws: their own `frequency`)."""
        return self._frequency(self.hottest)

    def _frequency(self, theta: float) -> float:
        return 0.0 if self.law is None else self.law.frequency(self.rho_max, theta)

    @property
    def amplifies(self) -> bool:
        """True with (6): a disturbance in the slow tail grows."""
        return self.law is not None and self.law.linearises

    @property
    def of_pairs(self) -> bool:
        """True where collisions multiply the waves of f with each other: with (12), and laws of one's own."""
        return self.law is not None and not self.amplifies

    @property
    def amplification(self) -> float:
        """R_t: under (6) a slow disturbance w√θ from the mean grows by up to exp(R_t w) until the end
        (docs/theory_details.md)."""
        return self.collision_rate * self.whole.drift_time

    @functools.cached_property
    def slows(self) -> float:
        """The share of (6)'s amplification that a law of one's own has (`CollisionLaw.slows`)."""
        return 0.0 if self.law is None or self.amplifies else self.law.slows(self.theta_max)

    @property
    def slowing(self) -> float:
        """R_t√θ, by which (6) moves the hottest Gaussian of the start, at the most."""
        return self._frequency(self.theta_max) * self.whole.drift_time * math.sqrt(self.theta_max)

    @property
    def noise_hardly_acts(self) -> bool:
        """True where nothing is noisy, or little of a relaxation time passes: what free motion folds in v stays folded."""
        return self.scene.model.noise == 0 or self.scene.model.friction * self.end < 0.1

    @property
    def shifted(self) -> bool:
        """True where velocities are shifted or contracted without noise: only in a frame at rest (moving_frame.py)."""
        model = self.scene.model
        return model.friction * model.noise == 0 and (model.friction > 0 or model.gravity != 0)

    @property
    def amplified_shift(self) -> bool:
        """True where, besides, (6) amplifies what the periodic shift brings round into the slow tail."""
        return self.amplifies and self.shifted


def scales_of(
    scene: Scene,
    times: Array,
    lab_friction: float | None = None,
    law: CollisionLaw | None = None,
    start: Start | None = None,
    of_edges: float | None = None,
    density: Array | None = None,
) -> Scales:
    """The scales of a scene that is written at these times of its own clock. `law` and `start` stand in for the scene's own, and
    `of_edges` for its rtol at the window's edges. `density` is `Scales.density`, where another frame of reference knows it."""
    law = scene.law if law is None else law
    start = SceneStart(scene) if start is None else start
    x = scene.pipe.length * np.arange(POINTS) / POINTS
    density, gaussians = start.density(x) if density is None else density, start.gaussians(x)
    temperature = np.array([theta for _, _, theta in gaussians])
    whole = transition(scene.model, scene.run.end_time)
    theta_end = float(temperature.max()) * whole.decay**2 + whole.velocity_variance
    coldest = start.narrowest(x)
    theta_min = min(coldest, coldest * whole.decay**2 + whole.velocity_variance)
    if scene.model.friction < 0:
        assert isinstance(law, Inelastic)
        # The frame is such that θ ends where it started, as a state finer than its own Maxwellian.
        theta_end = start.temperature
        theta_min = min(coldest, theta_end * cooling_state(law.restitution).narrowest)
    else:
        theta_end, theta_min = _cooled(law, scene, whole, density, coldest, theta_end, theta_min)
    return Scales(
        scene,
        law,
        times,
        scene.model.friction if lab_friction is None else lab_friction,
        start,
        density,
        np.array([mean for _, mean, _ in gaussians]),
        temperature,
        start.hottest(x),
        coldest,
        whole,
        theta_end,
        theta_min,
        scene.accuracy.rtol if of_edges is None else of_edges,
    )


@functools.singledispatch
def _cooled(
    law: CollisionLaw | None, scene: Scene, whole: Transition, density: Array, coldest: float, theta_end: float, theta_min: float
) -> tuple[float, float]:
    """(hottest at the end, coldest at any time) with collisions, from those of friction and noise alone.

    Of a law that is not known to cool these are taken; where it does, the run finds dv too coarse and mends it.
    """
    return theta_end, theta_min


@_cooled.register
def _(
    law: Inelastic, scene: Scene, whole: Transition, density: Array, coldest: float, theta_end: float, theta_min: float
) -> tuple[float, float]:
    if float(density.min()) > 0:
        # The hottest place is the thinnest one, and no hotter than its own stationary state.
        thinnest = _temperature_at(scene, float(density.min()))
        theta_end = min(theta_end, theta_end if thinnest is None else thinnest)
    # The densest place cools most: as without noise, but not below its own stationary state.
    densest = _temperature_at(scene, float(density.max()))
    cooled = _haff(law, whole, float(density.max()), coldest) / HAFF_SHORT
    return theta_end, min(theta_min, max(cooled, 0.0 if densest is None else densest))


def _haff(law: Inelastic, whole: Transition, density: float, theta: float) -> float:
    """The temperature at the end of free cooling at a density: √θ' = -γ√θ - Cρθ, C = S(1 - ε²)/√π (Haff 1983)."""
    c = law.cross_section * (1 - law.restitution**2) / math.sqrt(math.pi) * density
    return (math.sqrt(theta) * whole.decay / (1 + c * math.sqrt(theta) * whole.drift_time)) ** 2


def _temperature_at(scene: Scene, density: float) -> float | None:
    """Of the homogeneous state. None where there is none, and where it cannot be computed: it only makes a grid smaller."""
    with contextlib.suppress(SceneError):
        return rough_temperature_at(scene, density)
    return None
