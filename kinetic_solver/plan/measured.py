"""Constants of the rules that were measured, each with where.

Errors are those of f over max f, against the closed form or, with operator (12), against refined runs, raised by the factor that
is named; benchmarks/accuracy_rules.py sweeps rtol and fails where a rule that uses them misses it. Constants that were chosen,
not measured, stand beside the rule that uses them, and say so.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from kinetic_solver.scene import FOLLOW_LEADER, INELASTIC, Deposit, DriftDiffusionScheme
from kinetic_solver.stepping import Signs

# -- collisions

DEPOSIT_ERROR: Mapping[Deposit, tuple[float, int]] = MappingProxyType(
    {"linear": (0.08, 2), "cubic": (0.03, 4), "quintic": (0.02, 6)}
)
"""(coefficient, order) of operator (12): error <= coefficient·(dv/√θ)^order·max(1, Sρ√θ·t), t the time that errors last.
benchmarks/accuracy_rules.py; 1.3 to 3 times what was measured."""
NOISELESS_DEPOSIT = 3.0
"""How many times larger that error is where noise hardly acts, and nothing smooths what collects within dv of the mean velocity.
benchmarks/hard_cases.py, free cooling."""

COOLING_FINER = 1.4
"""How many times finer dv is beside that in a frame that follows a cooling gas: for ε = 0, 0.5, 0.9 and rtol from 1e-4 to 1e-7
what a run estimates of the error asks for no finer one then."""

# -- drift-diffusion

FINITE_VOLUME_ERROR: Mapping[DriftDiffusionScheme, tuple[float, int]] = MappingProxyType(
    {"finite-volume": (0.05, 2), "finite-volume-8": (0.1, 8)}
)
"""(coefficient, order): error <= coefficient·weight·(dv/√σ)^order; the weight is `in_finite_volumes.tail_weight`.
benchmarks/accuracy_rules.py; about twice what was measured."""
SATURATED = 4.0
"""Relaxation times, 1/4 of one, over which the finite volumes' error adds up. benchmarks/accuracy_rules.py."""
STRONG_AMPLIFICATION = (4.0, 1.5)
"""Beyond R_t = 4 errors of order 8 grow as exp(1.5 R_t): the amplified tail is where f over the Maxwellian bends most.
benchmarks/accuracy_rules.py, R* from 0.3 to 5."""
MOST_DISPLACED = 4.0
"""Thermal velocities from the homogeneous state's mean beyond which the finite volumes' error grows no further.
benchmarks/accuracy_rules.py: starts up to 2.5√σ off, and θ0 up to 8σ."""
STEEPEST_FACE = 2.2
"""Largest dv times distance of a face from g/γ, over σ, at which finite volumes of order 8 keep that order (they fall back to
order 2 beyond: operators/velocity/finite_volume.py)."""

# -- steps in time

STRANG_ERROR: Mapping[str, float] = MappingProxyType({FOLLOW_LEADER: 0.015, INELASTIC: 0.06})
"""Coefficient: error <= coefficient·(rate·h)², times exp(0.3 R_t) for (6), (1 - ε²)² for (12).
benchmarks/accuracy_rules.py; twice what was measured."""
AMPLIFIED = 0.3
"""Errors of steps with (6) grow as exp(0.3 R_t) until the end of the run. benchmarks/accuracy_rules.py, R* from 0.3 to 5."""
AMPLIFIED_BY_PAIRS = 0.6
"""Likewise with a law of one's own, times the share by which its pairs slow down. With (6) written as such a law, R_t from 1 to
11 and rtol from 1e-2 to 1e-6, errors came to 0.61 rtol at most, and to 1.7 estimates; with 0.45 to 1.8 rtol and 3.3 estimates.
tests/interface/test_extending.py."""
LAWSON_ERROR = 1.2e-4
"""Error of the extrapolated Lawson method over (rate·h)^5; it only foretells how many steps. benchmarks/accuracy_rules.py."""
LAWSON_COLLISIONS = (0.42, 0.13, 3.5)
"""(A, α, p): a step of Lawson's method with (12) is told to err by A νh ((γ + αν) h)^p, ν where collisions are fastest; it only
foretells how many steps."""
STEPS_TO_A_DOUBLING = 1.0
"""Steps, those tried in vain among them, in which error control with (12) doubles its first ones; with the constants above the
number of steps is foretold within a factor of two in 94 % at rtol from 1e-3 to 1e-5, R* from 1e-6 to 100.
benchmarks/random_scenes.py, seeds 0 to 43, and random_kinds.py; tests/convergence/test_costs.py."""
AFTER_A_JUMP = (40.0, 0.02)
"""(n, A): of a density step under (12) error control begins with an nth of what it begins with otherwise, and goes on with steps
that are a share s of the time so far, A (νT)² s⁴ what they may err by, T the time for which errors last. Measured on the scenes
with steps of benchmarks/random_kinds.py at rtol from 1e-3 to 1e-5: within a factor of two but for one of six."""
LAWSON_SIGNS, EXPONENTIAL_SIGNS = Signs(1.2, 10.0, 0.75), Signs(0.2, 30.0, 0.25)
"""Of Lawson's method with pairs and of the exponential method (stepping/embedded.py). Powers and shares were chosen for the least
scatter over 800 steps of 62 scenes of benchmarks/random_scenes.py and random_kinds.py, R* from 1e-3 to 13, and 350 of ten: by a
factor of 2.7 and of 2.1, where the same power for all left 4.8. Gains are then twice and three times the median of what makes
errors of single steps; what runs tell is 1 to 4 times their error: benchmarks/steps_error.py."""
EXTRAPOLATED_GAIN = 1.2
"""G of the extrapolated Lawson method: a step that errs by e max f without the extrapolation errs by about G e^1.2 with it."""
EXTRAPOLATED_STRANG_STEP = (0.15, 1e-4, 1 / 8)
"""(a, r, p): error control with (6) takes steps of about a/rate·min(1, rtol/r)^p, p from order 8. benchmarks/time_steppers.py."""
BUDGET_STEP = 0.25
"""Longest step times (γ + Sρ√θ) at which the quintic spline of the budgets is good to about 1e-6 of what the terms bring.
tests/invariants/test_solver.py (residuals)."""
RULE_SHARE = 0.4
"""Of rtol, to what Strang's steps, and finite volumes, are each planned to err by: the sum with all else is to stay below it."""
STEP_PRODUCTS = 0.4
"""What products of a step's waves make of an error of f over max f under (12), over SΔρ dx³/λ², λ = √θ min(1/γ, 2t), t the
first frame's time; it falls as dx⁴ where that is small. tests/convergence/test_step_products.py."""
LEAST_RTOL_OF_A_STEP = 5e-5
"""Of f: below it a density step under (6) in the local gauge is not resolved. Errors there fall irregularly: R* = 4, L* = 8π,
t = 1/2: 6e-5 on 567 points, 2e-4 on 1125. benchmarks/accuracy_rules.py."""

# -- what is cheapest

HERMITE_PAYS = 3
"""How many times fewer Hermite functions than velocity points pay with (12): at rtol = 1e-8 with a fifth as many, 7 to 9 times
faster; at 1e-6 with half as many hardly. docs/rules.md, rules for the velocity."""
