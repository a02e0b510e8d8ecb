"""How many points in x: every criterion counts Fourier modes, of which nx = 2·modes + 1 points hold so many.

Bounds the error of f by the waves that are left out (below rtol/10 each), and of products, which make waves of their own.
"""

from __future__ import annotations

import math

import numpy as np

from kinetic_solver.arrays import Array
from kinetic_solver.plan import measured
from kinetic_solver.plan.criterion import Criterion
from kinetic_solver.plan.refusal import MORE_RTOL, Refused, Remedy
from kinetic_solver.plan.scales import Scales
from kinetic_solver.plan.waves import DROPPED, GIVEN_NX, MOST_MODES, MOST_OF_A_STEP, SMOOTH, Waves

WATCHED = 8 / 7
"""The highest eighth of the modes stays empty at first: the monitor looks at it (solver/monitor.py)."""
DAMPED = 1.25
"""In the local gauge a fifth: it damps the highest tenth of the modes (operators/transport.py, resolved waves)."""
ROOM = 4
"""Modes besides. Chosen: a start of one mode still has somewhere to put its products."""
FEWER_MODES = (
    MORE_RTOL,
    Remedy("pipe.length", "less"),
    Remedy("collisions.cross_section", "less"),
    Remedy("initial.density", "less"),
)
"""What may bring the number of modes down."""
THIN = 0.02
"""Of the largest density, added to ρ where 1/ρ is looked at: places thinner than that add nothing to f. Chosen."""


def points(scales: Scales, waves: Waves) -> Criterion:
    """nx. Raises Refused where more than MOST_MODES modes would be needed."""
    scene = scales.scene
    if scales.start.homogeneous:
        return Criterion(1, "nothing depends on x")
    n = max(1, waves.highest_mode)  # one point does not hold what depends on x, however little
    reason = f"{n} modes of the initial state"
    if scales.law is not None:
        more = fronts(scales, scales.density) if scales.amplifies else followers(scales, waves)
        if scene.initial.step is not None and not waves.products_of_a_step:
            # f exp(SΦ) is what evolves, from waves that are known: nothing is multiplied.
            n = _with_room(max(n, more.value), waves)
            reason += f" times exp(SΦ), and no fewer than {math.ceil(more.value)} for {more.reason}"
        else:
            n = max(_with_room(2 * n + more.value, waves), products_of_a_step(scales, waves))
            reason += f", their products, and {math.ceil(more.value)} for {more.reason}"
        if scales.amplifies and scene.initial.step is None and not waves.local_gauge:
            # The global gauge transforms f exp(SΦ), which has waves of its own.
            n = max(n, math.ceil(WATCHED * waves.highest(waves.lifted_amplitudes)))
    if n > MOST_MODES:
        raise Refused(f"pipe.length = {scene.pipe.length:g}: {n:.3g} modes would be needed, more than {MOST_MODES}", FEWER_MODES)
    return Criterion(fast_odd(2 * n + 1), reason)


def products_of_a_step(scales: Scales, waves: Waves) -> int:
    """Modes that keep what products of a step's waves miss below rtol/3 of f: it falls as dx³ (`measured.STEP_PRODUCTS`)."""
    error = error_of_step_products(scales, waves, 1)
    if error == 0:
        return 0
    modes = math.ceil((3 * error / scales.rtol) ** (1 / 3) / 2)
    if modes > (most := MOST_OF_A_STEP["products"]) and scales.scene.grid.nx is None:
        raise Refused(
            "accuracy.rtol: the products of a jump's waves that these collisions make would need "
            f"{modes:.3g} modes, more than {most}",
            (MORE_RTOL, Remedy("collisions.cross_section", "less"), Remedy("run.output_every", "more")),
            (SMOOTH, GIVEN_NX),
        )
    return modes


def error_of_step_products(scales: Scales, waves: Waves, nx: int) -> float:
    """What products of a step's waves with (12) miss of f on nx points, over its maximum; 0 of everything else."""
    friction, law = scales.scene.model.friction, scales.law
    if not waves.products_of_a_step or scales.amplifies or law is None or friction <= 0:
        return 0.0
    contrast = law.frequency(float(np.ptp(scales.density)), scales.theta_max) / math.sqrt(scales.theta_max)
    path = math.sqrt(scales.narrowest) * min(1 / friction, 2 * float(scales.times[1]))
    return measured.STEP_PRODUCTS * contrast * (scales.scene.pipe.length / nx) ** 3 / path**2


def points_from_now_on(scales: Scales, waves: Waves, modes: int, density: Array) -> int:
    """nx for the rest of a run, from the highest mode that f has now, and its density."""
    if scales.law is None:
        return fast_odd(2 * modes + 1)
    more = fronts(scales, density).value if scales.amplifies else 0.0
    return fast_odd(2 * _with_room(2 * modes + more, waves) + 1)


def fronts(scales: Scales, density: Array) -> Criterion:
    """Modes of the fronts that (6) can make of a density: tanh profiles of width 2/(S Δρ), with the spectrum exp(-πk/(SΔρ))
    (docs/theory_details.md: shocks)."""
    contrast = scales.cross_section * float(np.ptp(density))
    k = contrast * math.log(DROPPED / scales.rtol) / math.pi
    return Criterion(k * scales.scene.pipe.length / (2 * math.pi), "the fronts that collisions can make")


def followers(scales: Scales, waves: Waves) -> Criterion:
    """Modes of fields that follow the density under (12): temperature and velocity are functions such as 1/ρ, with harmonics of
    their own, of which noise and phase mixing kill the higher half."""
    if scales.scene.initial.step:
        return Criterion(0.0, "the harmonics in fields that follow the density")
    follows = np.abs(np.fft.rfft(1 / (scales.density + THIN * scales.rho_max)))
    return Criterion(waves.highest(follows / follows.max()) / 2, "the harmonics in fields that follow the density")


def _with_room(modes: float, waves: Waves) -> int:
    return math.ceil((DAMPED if waves.local_gauge else WATCHED) * (modes + ROOM))


def least_points(scales: Scales) -> int:
    """nx below which the start's own waves cannot be held at all."""
    start = scales.scene.initial
    modes = (*start.density_modes, *start.velocity_modes, *start.temperature_modes)
    return 2 * max((m.mode for m in modes), default=1) + 1


def fast_odd(n: int) -> int:
    """The least odd number ≥ n with no prime factor above 7: a fast transform without a Nyquist mode."""
    n |= 1
    while True:
        rest = n
        for prime in (3, 5, 7):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return n
        n += 2
