"""The closures: both cubics against the linearised (3)-(5), critical densities, M moments and their closed form."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinetic_solver.scene import Scene
from kinetic_solver.stability import closure_rates, critical_collision_number, critical_density
from kinetic_solver.stability.closure import marginal_wavenumber

MakeScene = Callable[..., Scene]


def growth(scene: Scene, mode: int, density: float) -> float:
    """The largest Re s of the cubic at that density."""
    gamma, sigma = scene.model.friction, scene.model.noise
    k, s = 2 * math.pi * mode / scene.pipe.length, scene.cross_section
    a, c = k * k * sigma, 1j * k * sigma * s * density
    return float(np.roots([1, 3 * gamma, 2 * gamma**2 + 3 * a - 3 * c, 2 * gamma * (a - c)]).real.max())


@pytest.mark.parametrize("mode", [1, 2, 5, 40, 4000])
def test_the_closure_turns_unstable_there(make_scene: MakeScene, mode: int) -> None:
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 1.7})
    rho_c = critical_density(scene, mode)
    assert growth(scene, mode, 0.999 * rho_c) < 0 < growth(scene, mode, 1.001 * rho_c)


def test_limits(make_scene: MakeScene) -> None:
    """R*_c → 7√3/9 for short waves, (4/3)^(1/4)/√k* for long ones."""
    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 1.7})
    to_group = 1.7 * math.sqrt(0.5) / 0.7
    assert critical_density(scene, 10**6) * to_group == pytest.approx(7 * math.sqrt(3) / 9, rel=1e-10)
    long = make_scene(
        collisions={"operator": "follow-the-leader", "cross_section": 1.7}, pipe={"length": 1e8}, initial={"modes": []}
    )
    assert critical_density(long) * to_group == pytest.approx((4 / 3) ** 0.25 / math.sqrt(long.groups.wavenumber), rel=1e-3)


def test_inf_where_there_is_none(make_scene: MakeScene) -> None:
    inelastic = {"operator": "inelastic", "cross_section": 1.7, "restitution": 0.5}
    assert critical_density(make_scene()) == critical_density(make_scene(collisions=inelastic)) == math.inf
    with pytest.raises(ValueError, match="mode = 0"):
        critical_density(make_scene(), 0)


@pytest.mark.parametrize(
    ("moments", "wavenumber", "expected"),
    [
        (3, 1.0, 1.4801),
        (5, 1.0, 2.4256),
        (8, 1.0, 3.5951),
        (2, 1e4, 1.0),
        (4, 1e4, 1.634884),
        (5, 1e4, 1.885713),
        (8, 1e4, 2.507493),
    ],
)
def test_closures_with_more_moments_turn_unstable_later(moments: int, wavenumber: float, expected: float) -> None:
    """Parameters unequal; three moments by the generator's eigenvalues as by the cubic."""
    gamma, sigma, cross_section = 0.7, 0.5, 1.9
    length = 2 * math.pi * math.sqrt(sigma) / (gamma * wavenumber)
    scene = Scene.model_validate(
        {
            "model": {"gravity": 1.3, "friction": gamma, "noise": sigma},
            "collisions": {"operator": "follow-the-leader", "cross_section": cross_section},
            "pipe": {"length": length},
            "run": {"end_time": 1.0},
        }
    )
    number = critical_density(scene, 1, moments) * cross_section * math.sqrt(sigma) / gamma
    assert number == pytest.approx(expected, abs=1e-4)


def test_the_generator_reproduces_the_cubic() -> None:
    from kinetic_solver.stability.closure import closure_generator

    for number in (0.4, 1.4, 3.1):
        for k in (0.2, 1.0, 7.0):
            s = np.linalg.eigvals(closure_generator(k, number, 3))
            cubic = np.roots([1, 3, 2 + 3 * k * k - 3j * k * number, 2 * (k * k - 1j * k * number)])
            assert np.abs(np.sort_complex(s) - np.sort_complex(cubic)).max() < 1e-10 * np.abs(cubic).max()


def linearised_closure(scene: Scene, mode: int) -> np.ndarray:
    """Eigenvalues of (3)-(5), linearised by hand: rates of (δρ, δu, δθ), with (8), (9) or with (14) times ρ²."""
    m, start = scene.model, scene.initial
    k = 2 * math.pi * mode / scene.pipe.length
    s, rho, gamma, sigma = scene.cross_section, start.density, m.friction, m.noise
    if scene.operator == "inelastic":
        c = s * (1 - scene.restitution**2) / math.sqrt(math.pi)
        low, high = 0.0, sigma
        for _ in range(200):  # the homogeneous temperature, by bisection
            theta = (low + high) / 2
            low, high = (theta, high) if gamma * (theta - sigma) + c * rho * theta**1.5 < 0 else (low, theta)
        u = m.gravity / gamma
        force = [0.0, 0.0]
        cooling = [-2 * c * theta**1.5, -3 * c * rho * math.sqrt(theta)]
    else:
        theta, u = sigma, (m.gravity - s * rho * sigma) / gamma
        # (1/ρ)∫v C = -Sρθ; (1/ρ)(∫v² C - 2u∫v C) = 0
        force, cooling = [-s * theta, -s * rho], [0.0, 0.0]
    ik = 1j * k
    matrix = np.array(
        [
            [-ik * u, -ik * rho, 0],
            [-ik * theta / rho + force[0], -ik * u - gamma, -ik + force[1]],
            [cooling[0], -2 * ik * theta, -ik * u - 2 * gamma + cooling[1]],
        ]
    )
    return np.linalg.eigvals(matrix)


@pytest.mark.parametrize("operator", ["follow-the-leader", "inelastic", None])
@pytest.mark.parametrize("mode", [1, 3, 20])
def test_rates_are_those_of_the_linearised_equations(make_scene: MakeScene, operator: str | None, mode: int) -> None:
    collisions = None if operator is None else {"operator": operator, "cross_section": 1.9}
    if operator == "inelastic":
        collisions = {"operator": operator, "cross_section": 1.9, "restitution": 0.3}
    scene = make_scene(collisions=collisions)
    expected = linearised_closure(scene, mode)
    found = closure_rates(scene, mode)
    assert (np.diff(found.real) <= 1e-12).all()
    for s in found:
        assert np.abs(expected - s).min() < 1e-11 * np.abs(expected).max()


@settings(max_examples=60)
@given(
    gamma=st.floats(0.05, 20),
    sigma=st.floats(0.05, 20),
    rate=st.floats(1e-90, 1e3) | st.just(0.0),
    restitution=st.floats(0, 0.999),
    length=st.floats(0.05, 500),
)
def test_the_closure_of_inelastic_collisions_is_stable(
    gamma: float, sigma: float, rate: float, restitution: float, length: float
) -> None:
    """Routh-Hurwitz, by the roots at random parameters."""
    scene = Scene.model_validate(
        {
            "model": {"friction": gamma, "noise": sigma},
            "collisions": {"operator": "inelastic", "cross_section": rate, "restitution": restitution},
            "pipe": {"length": length},
            "run": {"end_time": 1.0},
        }
    )
    assert (closure_rates(scene).real < 0).all()


@pytest.mark.parametrize(
    ("moments", "expected"),
    [(2, 1.0), (3, 7 * math.sqrt(3) / 9), (4, 1.634884), (5, 1.885713), (8, 2.507493), (32, 5.254186)],
)
def test_short_waves_in_closed_form(moments: int, expected: float) -> None:
    assert critical_collision_number(math.inf, moments) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("moments", [2, 3, 4, 7, 20, 64, 128])
def test_the_closed_form_is_the_limit_of_eigenvalues(moments: int) -> None:
    limit = critical_collision_number(math.inf, moments)
    assert critical_collision_number(3e4, moments) == pytest.approx(limit, rel=1e-5)
    assert 1 <= limit / (2 / 3 * math.sqrt(2 * (moments - 1))) < (1.07 if moments < 5 else 1.006)


def growing_waves(wavenumber: float, number: float, moments: int) -> int:
    """How many eigenvalues of the closure with M moments grow, exactly: by Routh's array in rational numbers.

    The closure's matrix is tridiagonal, -n on its diagonal and -nX the products of its off-diagonals, X = k² - ikR; so its
    characteristic polynomials obey p_{n+1} = -(n + s)p_n + nX p_{n-1}. p times its conjugate is real, with every root twice.
    """
    k, r = Fraction(wavenumber), Fraction(number)
    x, y = k * k, -k * r
    zero = (Fraction(0), Fraction(0))
    before, p = [(Fraction(1), Fraction(0))], [zero, (Fraction(-1), Fraction(0))]
    for n in range(1, moments):
        product = [(n * (x * a - y * b), n * (x * b + y * a)) for a, b in before]
        terms = zip([*p, zero], [zero, *p], [*product, zero, zero], strict=True)
        before, p = p, [(-n * a[0] - b[0] + c[0], -n * a[1] - b[1] + c[1]) for a, b, c in terms]
    real = [Fraction(0)] * (2 * moments + 1)
    for i, a in enumerate(p):
        for j, b in enumerate(p):
            real[i + j] += a[0] * b[0] + a[1] * b[1]
    upper, lower = real[::-2], real[-2::-2]
    column = [upper[0]]
    while lower:
        column.append(lower[0])
        factor = upper[0] / lower[0]
        upper, lower = lower, [a - factor * b for a, b in zip(upper[1:], [*lower[1:], Fraction(0)], strict=False)]
    return sum((a > 0) != (b > 0) for a, b in itertools.pairwise(column)) // 2


@pytest.mark.parametrize("moments", [2, 3, 4, 5, 8, 12])
@pytest.mark.parametrize("wavenumber", [1e-4, 0.01, 0.7, 20.0])
def test_critical_densities_in_exact_arithmetic(moments: int, wavenumber: float) -> None:
    """Nothing grows 1e-8 below R*_c, nor at half of it; something does 1e-8 above."""
    number = critical_collision_number(wavenumber, moments)
    assert [growing_waves(wavenumber, f * number, moments) for f in (0.5, 1 - 1e-8, 1 + 1e-8)] == [0, 0, 1]


@pytest.mark.parametrize("moments", [3, 4, 5, 8, 24])
def test_critical_densities_fall_with_the_wavenumber(moments: int) -> None:
    """Towards that of the shortest waves, which is the least of all."""
    numbers = [critical_collision_number(float(k), moments) for k in np.geomspace(0.05, 50.0, 25)]
    assert (np.diff(numbers) < 0).all()
    limit = critical_collision_number(math.inf, moments)
    assert limit < numbers[-1] < limit * (1 + 2e-3)


def test_the_bound_is_approached() -> None:
    """(2/3)√(2(M - 1)) from above, the closer the denser the zeros: they lie π√(2/M) apart at its minimum x = √(2M)."""
    for moments in (2, 3, 4, 5, 8, 9, 17, 33, 64, 127, 256):
        ratio = critical_collision_number(math.inf, moments) / (2 / 3 * math.sqrt(2 * (moments - 1)))
        assert 1 - 1e-14 < ratio < 1 + (math.pi / moments) ** 2 / 8 * (1 + 2 / moments)


def multiply(a: list[Fraction], b: list[Fraction]) -> list[Fraction]:
    out = [Fraction(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            out[i + j] += x * y
    return out


@pytest.mark.parametrize("moments", range(2, 13))
def test_the_identity_behind_the_closed_form(moments: int) -> None:
    """D = (x²/6 + (M-1)/3)K + x He_M He_{M-1}/(6(M-1)!) - He_M²/(3(M-1)!), in exact arithmetic."""
    he = [[Fraction(1)], [Fraction(0), Fraction(1)]]
    for n in range(1, moments):
        lower = [*(n * c for c in he[n - 1]), Fraction(0), Fraction(0)]
        he.append([a - b for a, b in zip([Fraction(0), *he[n]], lower, strict=True)])
    size = 2 * moments + 3

    def add(*terms: tuple[Fraction, list[Fraction]]) -> list[Fraction]:
        total = [Fraction(0)] * size
        for factor, polynomial in terms:
            for i, c in enumerate(polynomial):
                total[i] += factor * c
        return total

    squares = [(Fraction(1, math.factorial(n)), multiply(he[n], he[n])) for n in range(moments)]
    k, d = add(*squares), add(*((n * factor, square) for n, (factor, square) in enumerate(squares)))
    one = Fraction(1, math.factorial(moments - 1))
    right = add(
        (Fraction(1, 6), [Fraction(0), Fraction(0), *k][:size]),
        (Fraction(moments - 1, 3), k),
        (one / 6, [Fraction(0), *multiply(he[moments], he[moments - 1])]),
        (-one / 3, multiply(he[moments], he[moments])),
    )
    assert d == right


def test_many_moments_at_finite_wavelength() -> None:
    """Against eigenvalues in 120 digits; where double precision cannot say, neither does this."""
    assert critical_collision_number(1.0, 32) == pytest.approx(12.6957030542024, rel=1e-10)
    assert critical_collision_number(1.0, 64) == pytest.approx(24.5953447337, rel=1e-6)
    with pytest.raises(ValueError, match=r"moments = 128: at k\* = 1 double precision"):
        critical_collision_number(1.0, 128)


def test_arguments_out_of_range(make_scene: MakeScene) -> None:
    from kinetic_solver.stability import apparent_critical_density, density_gain

    scene = make_scene(collisions={"operator": "follow-the-leader", "cross_section": 1.7})
    for wrong in (0, -1, 1.5):
        with pytest.raises(ValueError, match=r"mode = .*: must be 1 or more, and whole"):
            closure_rates(scene, wrong)
    with pytest.raises(ValueError, match=r"wavenumber = 0"):
        critical_collision_number(0.0)
    with pytest.raises(ValueError, match=r"count = 0"):
        apparent_critical_density(scene, 0)
    with pytest.raises(ValueError, match=r"times = -1"):
        density_gain(scene, 1, np.array([-1.0]))


@pytest.mark.parametrize("wavenumber", [1e-3, 0.25, 1.0, 30.0, 1e4])
def test_marginal_wavenumber_inverts_the_critical_collision_number(wavenumber: float) -> None:
    assert marginal_wavenumber(critical_collision_number(wavenumber)) == pytest.approx(wavenumber, rel=1e-6)


def test_no_wave_is_marginal_below_the_shortest_ones() -> None:
    assert marginal_wavenumber(7 * math.sqrt(3) / 9) == math.inf
    assert marginal_wavenumber(0.3) == math.inf
