"""S(k): the integral, two Lyapunov equations, limits, and the apparent critical density."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from kinetic_solver.scene import Scene
from kinetic_solver.stability import apparent_critical_density, structure_factor
from kinetic_solver.stability.closure import closure_generator
from kinetic_solver.stability.follow_leader import FollowLeaderFlow
from kinetic_solver.stability.hermite import follow_leader_equations, inelastic_equations, lyapunov_structure_factor
from kinetic_solver.stability.inelastic import _discretisation, inelastic_flow
from kinetic_solver.theory.hermite import hermite_functions

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.7}
INELASTIC = {"operator": "inelastic", "cross_section": 1.7, "restitution": 0.4}


@pytest.mark.parametrize(
    ("number", "quarter", "one"),
    [
        (0.5, 1.90, 1.59),
        (1.0, 4.70, 3.00),
        (1.347, 10.8, 5.36),
        (2.0, 92.9, 25.1),
        (3.0, 1.27e4, 1.25e3),
        (4.0, 1.3e7, 5.3e5),
    ],
)
def test_reference_values(number: float, quarter: float, one: float) -> None:
    flow = FollowLeaderFlow(number)
    assert flow.structure_factor(0.25) == pytest.approx(quarter, rel=6e-3)
    assert flow.structure_factor(1.0) == pytest.approx(one, rel=6e-3)


@pytest.mark.parametrize("wavenumber", [0.05, 0.25, 1.0, 4.0])
@pytest.mark.parametrize("number", [0.0, 0.5, 2.0, 4.0])
def test_integral_and_pair_correlations(wavenumber: float, number: float) -> None:
    """(6): one integral against the Lyapunov equation of the pair correlations."""
    expected = lyapunov_structure_factor(follow_leader_equations(number, 64), wavenumber)
    assert FollowLeaderFlow(number).structure_factor(wavenumber) == pytest.approx(expected, rel=1e-11)


def noise_matrix(number: float, count: int) -> np.ndarray:
    """2 diag(n) + B: what friction's noise and each collision of (6) change, squared, by Gauss quadrature."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(count + 1)
    t, outer = np.polynomial.laguerre.laggauss(count // 2 + 2)
    noise = 2 * np.diag(np.arange(float(count)))
    for y, weight in zip(np.sqrt(2 * t), outer / math.sqrt(math.pi), strict=True):
        fast, slow = (hermite_functions((nodes + side * y) / math.sqrt(2), np.ones(nodes.size), count) for side in (1, -1))
        noise += number * weight * ((slow - fast) * weights / math.sqrt(2 * math.pi)) @ (slow - fast).T
    return noise


@pytest.mark.parametrize(("wavenumber", "number"), [(0.25, 0.5), (1.0, 1.347), (0.5, 2.0)])
def test_covariance_with_the_noise_matrix(wavenumber: float, number: float) -> None:
    """The covariance's own Lyapunov equation, with the noise of friction and collisions, has the same S."""
    generator = closure_generator(wavenumber, number, 40)
    covariance = solve_continuous_lyapunov(generator, -noise_matrix(number, 40).astype(complex))
    assert FollowLeaderFlow(number).structure_factor(wavenumber) == pytest.approx(covariance[0, 0].real, rel=1e-9)


@pytest.mark.parametrize(("number", "expected"), [(0.25, 1.35864), (1.0, 5.00898), (1.5, 18.6539)])
def test_long_and_short_waves(number: float, expected: float) -> None:
    flow = FollowLeaderFlow(number)
    limit = math.exp(number**2) * (1 + math.erf(number))
    assert limit == pytest.approx(expected, rel=2e-6)
    assert flow.structure_factor(1e-4) == pytest.approx(limit, rel=1e-7)
    excess = [flow.structure_factor(k) - 1 for k in (1e4, 1e7)]
    assert excess[0] / excess[1] == pytest.approx(100.0, rel=0.02)  # S - 1 falls as k^(-2/3)


@pytest.mark.parametrize(("restitution", "number"), [(0.0, 1.0), (0.5, 10.0), (0.9, 100.0), (0.5, 300.0)])
def test_inelastic_compressibility(restitution: float, number: float) -> None:
    """S(k → 0) = σ/(d(ρθ_h)/dρ): the deviation falls as k²."""

    def pressure(change: float) -> float:
        return (1 + change) * inelastic_flow(restitution, number * (1 + change)).temperature

    h = 0.01
    limit = 12 * h / (8 * (pressure(h) - pressure(-h)) - (pressure(2 * h) - pressure(-2 * h)))
    flow = inelastic_flow(restitution, number)
    extrapolated = (4 * flow.structure_factor(0.02) - flow.structure_factor(0.04)) / 3
    assert extrapolated == pytest.approx(limit, rel=1e-6)


@pytest.mark.parametrize(("restitution", "number", "worst"), [(0.0, 1.0, 1e-8), (0.9, 100.0, 1e-7), (0.5, 300.0, 1e-6)])
def test_convergence_in_functions(restitution: float, number: float, worst: float) -> None:
    flow = inelastic_flow(restitution, number)
    base = flow._base
    more = inelastic_equations(restitution, number, base.temperature, base.w, base.f * base.dv, 64)
    for wavenumber in (0.25, 4.0):
        assert flow.structure_factor(wavenumber) == pytest.approx(lyapunov_structure_factor(more, wavenumber), rel=worst)


def fourier_structure_factor(restitution: float, number: float, wavenumbers: tuple[float, ...]) -> list[float]:
    """S of (12) from g on velocity points, Γ from the Fourier coefficients of f_h; no Hermite function in it.

    On exp(-iξ_n v) exp(-iξ_m v') a pair of f_l, f_j with l + j = n + m changes by
    R ∫|r| [exp(i(ξ_l - (1-α)ξ_n - αξ_m)r) - exp(i(ξ_l - ξ_n)r)] dr. g has a kink where the partners meet: order 4 at small R.
    """
    grid = _discretisation(restitution, number, 5.5, 44.0)
    f, middle = grid.to_waves @ grid.f, grid.count // 2
    alpha, unit = (1 - restitution) / 2, np.pi / grid.half
    n, m = np.meshgrid(grid.index, grid.index, indexing="ij")

    def moment(places: np.ndarray) -> np.ndarray:
        """∫_{-ϱ}^{ϱ} |r| exp(iξr) dr."""
        x = unit * grid.half * places
        with np.errstate(invalid="ignore"):
            value = 2 * grid.half**2 * (np.sin(x) / x - 2 * (np.sin(x / 2) / x) ** 2)
        return np.where(x == 0, grid.half**2, value)

    source = np.zeros((grid.count, grid.count), dtype=complex)
    for low in grid.index:
        other = n + m - low
        inside = np.abs(other) <= middle
        pairs = np.where(inside, f[np.where(inside, other, 0) + middle], 0) * f[low + middle]
        source += pairs * (moment(low - (1 - alpha) * n - alpha * m) - moment(low - n))
    source *= number / (2 * grid.half)
    on_points = (grid.to_points @ ((source + source.T) / 2) @ grid.to_points.T).real.astype(complex)
    correlations = [solve_continuous_lyapunov(grid.generator(k), -on_points) for k in wavenumbers]
    return [1 + float(g.sum().real) * grid.dv**2 for g in correlations]


@pytest.mark.parametrize(("restitution", "number"), [(0.5, 10.0), (0.7, 30.0), (0.9, 100.0), (0.5, 300.0)])
def test_inelastic_pair_correlations(restitution: float, number: float) -> None:
    """Against another discretisation of g and of its source, where collisions are many enough for that one to converge."""
    wavenumbers = (0.25, 1.0, 4.0)
    flow = inelastic_flow(restitution, number)
    expected = fourier_structure_factor(restitution, number, wavenumbers)
    assert [flow.structure_factor(k) for k in wavenumbers] == pytest.approx(expected, rel=2e-7)


def test_arguments_and_units(make_scene: MakeScene) -> None:
    """Modes as a number, a list or a range; S depends on k* and R* alone; 1 without collisions."""
    scene = make_scene(collisions=FOLLOW)
    several = structure_factor(scene, range(1, 4))
    assert several.dims == ("mode",)
    assert list(several["mode"].values) == [1, 2, 3]
    assert float(structure_factor(scene, 2)[0]) == float(structure_factor(scene, [2])[0]) == float(several.sel(mode=2))
    groups = scene.groups
    assert float(several.sel(mode=2)) == FollowLeaderFlow(groups.collision_number).structure_factor(2 * groups.wavenumber)
    assert structure_factor(make_scene()).values == pytest.approx(np.ones(8), rel=1e-12)
    assert (structure_factor(make_scene(collisions=INELASTIC)).values > 1).all()


def test_apparent_critical_density(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=FOLLOW, pipe={"length": 900.0})
    for count, level in ((10_000, 1.0), (10**6, 0.1)):
        density = apparent_critical_density(scene, count, level=level)
        there = scene.model_copy(update={"initial": scene.initial.model_copy(update={"density": density})})
        assert float(structure_factor(there, 1)[0]) == pytest.approx(level * count, rel=1e-6)
        assert there.groups.collision_number == pytest.approx(math.sqrt(math.log(level * count / 2)), rel=1e-2)
    assert apparent_critical_density(make_scene(collisions=INELASTIC), 10**6) == math.inf
    assert apparent_critical_density(make_scene(), 10**6) == math.inf
