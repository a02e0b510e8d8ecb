"""The linearised step on velocity points against the closed form; errors of f are max|Δf|/max f.

tolerance = 1 makes the step take its global gauge, tolerance = 0 the local one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.errors import LostAccuracy
from kinetic_solver.exact import Solution
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import start_state
from kinetic_solver.operators.linearised.grid import GridLinearisedStep
from kinetic_solver.operators.moments import velocity_moments
from kinetic_solver.operators.velocity import OrnsteinUhlenbeckKernel
from kinetic_solver.scene import Model, Scene
from kinetic_solver.theory.ornstein_uhlenbeck import transition, transport_times

MakeScene = Callable[..., Scene]
GLOBAL, LOCAL = 1.0, 0.0
GAUGES = pytest.mark.parametrize("tolerance", [GLOBAL, LOCAL], ids=["global", "local"])
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.9}
# Neither the homogeneous state nor at the temperature σ, and f is not a product
OFF_EQUILIBRIUM = {
    "collisions": FOLLOW,
    "initial": {
        "mean_velocity": 0.9,
        "temperature": 0.35,
        "velocity_modes": [{"mode": 1, "sin": 0.3}],
        "temperature_modes": [{"mode": 2, "cos": 0.2}],
    },
}


def start(scene: Scene, nx: int, nv: int, window: tuple[float, float], tolerance: float) -> tuple[GridLinearisedStep, Array]:
    """The step with the exact kernel, and the scene's start."""
    grid = PhaseSpaceGrid(nx, nv, scene.pipe.length, *window)
    u0, theta0 = start_state(scene)
    rho, u = initial.density(scene, grid.x), initial.mean_velocity(scene, grid.x, u0)
    f = initial.maxwellian(rho, u, initial.temperature(scene, grid.x, theta0), grid.v)
    kernel = OrnsteinUhlenbeckKernel(grid, scene.model)
    return GridLinearisedStep(grid, scene.model, scene.cross_section, kernel, tolerance), f


def advance(step: GridLinearisedStep, f: Array, time: float, steps: int) -> Array:
    for _ in range(steps):
        f = step(f, time / steps)
    return f


def error(scene: Scene, step: GridLinearisedStep, f: Array, time: float) -> float:
    truth = Solution(scene, time).distribution(step.grid.x, step.grid.v)
    return float(np.abs(f - truth).max() / truth.max())


@pytest.mark.parametrize(
    ("number", "nx", "nv", "window", "steps", "tolerance", "allowed"),
    [
        (0.3, 95, 128, (-9.0, 9.0), 1, GLOBAL, 1e-13),
        (0.3, 96, 128, (-9.0, 9.0), 1, GLOBAL, 1e-13),
        (0.3, 95, 128, (-9.0, 9.0), 1, LOCAL, 1e-13),
        (2.0, 147, 128, (-16.0, 8.0), 1, GLOBAL, 2e-11),
        (2.0, 147, 128, (-16.0, 8.0), 1, LOCAL, 2e-12),
        (5.0, 315, 128, (-20.0, 4.0), 4, LOCAL, 2e-9),
    ],
)
def test_standing_scene(
    standing_scene: MakeScene,
    number: float,
    nx: int,
    nv: int,
    window: tuple[float, float],
    steps: int,
    tolerance: float,
    allowed: float,
) -> None:
    """t = 2/γ in one step, in four at R* = 5, at a resolution where round-off is all there is."""
    scene = standing_scene(number)
    step, f = start(scene, nx, nv, window, tolerance)
    assert error(scene, step, advance(step, f, 2.0, steps), 2.0) < allowed


@pytest.mark.parametrize(
    ("number", "length", "wave", "nx", "nv", "window", "h", "allowed"),
    [
        (5.0, 25.0, 0.9, 875, 96, (-19.0, 6.0), 0.42, 3e-13),  # 1e-10 with a matrix solve for η
        (2.0, 1000.0, 0.5, 4375, 64, (-12.0, 7.0), 1.0, 3e-13),  # 14 s with a matrix solve
        (2.0, 200.0, 1 - 1e-10, 1701, 64, (-12.0, 7.0), 1.0, 1e-12),  # nearly a void
    ],
)
def test_small_ratios_and_long_pipes(
    standing_scene: MakeScene,
    number: float,
    length: float,
    wave: float,
    nx: int,
    nv: int,
    window: tuple[float, float],
    h: float,
    allowed: float,
) -> None:
    scene = standing_scene(number, pipe={"length": length}, initial={"modes": [{"mode": 1, "cos": wave}]})
    step, f = start(scene, nx, nv, window, LOCAL)
    assert error(scene, step, step(f, h), h) < allowed


@GAUGES
def test_unequal_parameters(make_scene: MakeScene, tolerance: float) -> None:
    """One step, three equal ones, unequal ones, and those without a look at f between are the same: the closed form."""
    scene = make_scene(**OFF_EQUILIBRIUM)
    step, first = start(scene, 81, 128, (-8.0, 7.0), tolerance)
    f = first
    for h in (0.15, 0.25, 0.5):
        f = step(f, h)
    lifted = step.lift(first)
    for h in (0.3, 0.6):
        lifted = step.propagate(lifted, h)
    for result in (step(first, 0.9), advance(step, first, 0.9, 3), f, step.lower(lifted)):
        assert error(scene, step, result, 0.9) < 2e-13


@GAUGES
@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("missing", [{"friction": 0.0}, {"noise": 0.0}, {"friction": 0.0, "noise": 0.0}], ids=str)
def test_without_friction_or_noise(make_scene: MakeScene, missing: dict[str, float], steps: int, tolerance: float) -> None:
    """The kernel is then the band-limited one, whose round-off in f's tails collisions amplify."""
    scene = make_scene(model=missing, **OFF_EQUILIBRIUM)
    step, f = start(scene, 81, 128, (-8.0, 7.0), tolerance)
    assert error(scene, step, advance(step, f, 0.5, steps), 0.5) < 1e-11


@pytest.mark.parametrize(
    ("number", "nx", "nv", "window", "tolerance", "steps", "h", "allowed"),
    [
        (2.0, 147, 192, (-16.0, 8.0), GLOBAL, 100, 0.02, 2e-11),
        (2.0, 147, 192, (-16.0, 8.0), LOCAL, 50, 0.04, 5e-12),
        (5.0, 315, 128, (-20.0, 4.0), LOCAL, 60, 0.075, 2e-9),
    ],
)
def test_many_short_steps(
    standing_scene: MakeScene,
    number: float,
    nx: int,
    nv: int,
    window: tuple[float, float],
    tolerance: float,
    steps: int,
    h: float,
    allowed: float,
) -> None:
    """Where dv resolves the kernel of a step nothing grows, whether f is looked at between or not; f stays positive."""
    scene = standing_scene(number)
    step, f = start(scene, nx, nv, window, tolerance)
    assert OrnsteinUhlenbeckKernel(step.grid, scene.model).positive(h if tolerance == GLOBAL else h / 2)
    truth = Solution(scene, steps * h).distribution(step.grid.x, step.grid.v)
    lifted = step.lift(f)
    for _ in range(steps):
        lifted = step.propagate(lifted, h)
    assert np.abs(step.lower(lifted) - truth).max() < allowed * truth.max()
    for _ in range(steps):
        mass = f.sum()
        f = step(f, h)
        assert abs(f.sum() / mass - 1) < 1e-14
        assert f.min() > -1e-12 * f.max()
    assert np.abs(f - truth).max() < allowed * truth.max()


@pytest.mark.parametrize(
    ("number", "tolerance", "counts"),
    [
        (0.3, GLOBAL, (11, 15, 21, 31, 41)),
        (0.3, LOCAL, (11, 15, 21, 31, 41)),
        (2.0, GLOBAL, (41, 53, 75, 105)),
        (2.0, LOCAL, (15, 21, 31, 53, 95)),
        (5.0, LOCAL, (105, 147, 189, 255)),
    ],
)
def test_density_defect_is_the_order_of_the_error(
    standing_scene: MakeScene, number: float, tolerance: float, counts: tuple[int, ...]
) -> None:
    """Over five decades or more, as points in x are added; mass stays however few they are."""
    scene, errors = standing_scene(number), []
    for nx in counts:
        step, f = start(scene, nx, 128, {0.3: (-9.0, 9.0), 2.0: (-16.0, 8.0), 5.0: (-20.0, 4.0)}[number], tolerance)
        after = advance(step, f, 2.0, 4)
        errors.append(error(scene, step, after, 2.0))
        assert 0.01 < step.density_defect / errors[-1] < 100, (nx, errors[-1], step.density_defect)
        assert abs(after.sum() / f.sum() - 1) < 4e-14
    assert errors[-1] < 1e-5 * errors[0]


@GAUGES
@pytest.mark.parametrize("nx", [1, 2, 9])
def test_homogeneous(make_scene: MakeScene, nx: int, tolerance: float) -> None:
    """A Gaussian, however many points carry it; the homogeneous state itself does not move."""
    moving = make_scene(collisions=FOLLOW, initial={"modes": [], "mean_velocity": 0.9, "temperature": 0.35})
    step, f = start(moving, nx, 128, (-9.0, 8.0), tolerance)
    assert error(moving, step, advance(step, f, 1.2, 3), 1.2) < 1e-14
    standing = make_scene(collisions=FOLLOW, initial={"modes": []})
    step, f = start(standing, nx, 128, (-9.0, 8.0), tolerance)
    assert np.abs(step(f, 0.4) - f).max() < 5e-15 * f.max()
    assert np.abs(advance(step, f, 20.0, 50) - f).max() < 2e-14 * f.max()


@pytest.mark.parametrize(
    ("number", "nx", "window", "tolerance"),
    [(2.0, 147, (-16.0, 8.0), GLOBAL), (2.0, 147, (-16.0, 8.0), LOCAL), (5.0, 315, (-20.0, 4.0), LOCAL)],
)
def test_maximum_principle(
    standing_scene: MakeScene, number: float, nx: int, window: tuple[float, float], tolerance: float
) -> None:
    """The density never leaves [min ρ0, max ρ0], and f is positive: also while collisions steepen the front."""
    scene = standing_scene(number)
    step, f = start(scene, nx, 160, window, tolerance)
    rho0 = initial.density(scene, np.linspace(0, scene.pipe.length, 2001))
    lifted = step.lift(f)
    for _ in range(20):
        lifted = step.propagate(lifted, 0.1)
        f = step.lower(lifted)
        rho = f.sum(axis=1) * step.grid.dv
        assert rho.max() < rho0.max() + 1e-9
        assert rho.min() > rho0.min() - 1e-9
        assert f.min() > -1e-12 * f.max()


@GAUGES
def test_rubbish_is_refused(make_scene: MakeScene, tolerance: float) -> None:
    step, f = start(make_scene(collisions=FOLLOW), 27, 64, (-8.0, 7.0), tolerance)
    place = np.arange(27)[:, None] == 3
    noise = np.random.default_rng(5).normal(size=f.shape)
    for rubbish in (np.where(place, np.nan, f), np.where(place, np.inf, f), 1e200 * f, -f, 0 * f, noise):
        with pytest.raises(LostAccuracy):
            step(rubbish, 0.3)
    assert np.isfinite(step(f, 0.3)).all()


@pytest.mark.parametrize("gamma_h", [0.0, 1e-8, 1e-4, 0.02, 0.3, 0.49, 0.51, 1.3, 4.0, 11.0, 30.0])
def test_transport_times(gamma_h: float) -> None:
    """Transport a, kernel of h/2, transport b, kernel of h/2, transport a: composed, they have the law of the whole step."""
    h = 0.6
    model = Model(gravity=1.3, friction=gamma_h / h, noise=0.5)
    half, whole = transition(model, h / 2), transition(model, h)
    a, b = transport_times(model.friction, h)
    assert a > 0
    assert b > 0
    noise = np.diag([0.0, half.velocity_variance])
    outer, inner = np.array([[1.0, a], [0.0, 1.0]]), np.array([[1.0, b], [0.0, 1.0]])
    kernel = np.diag([1.0, half.decay])
    mean, covariance = np.eye(2), np.zeros((2, 2))
    for part, added in ((outer, 0.0), (kernel, noise), (inner, 0.0), (kernel, noise), (outer, 0.0)):
        mean, covariance = part @ mean, part @ covariance @ part.T + added
    expected = [[whole.displacement_variance, whole.covariance], [whole.covariance, whole.velocity_variance]]
    assert mean == pytest.approx(np.array([[1.0, whole.drift_time], [0.0, whole.decay]]), rel=1e-14, abs=0)
    assert covariance == pytest.approx(np.array(expected), rel=1e-14, abs=0)


class Nothing:
    """Drift-diffusion that does nothing."""

    name = "nothing"

    def __init__(self, nv: int) -> None:
        self.nv = nv

    def matrix(self, h: float) -> Array:
        return np.eye(self.nv)


def waves(values: Array, length: float) -> tuple[Array, Array]:
    """(k, amplitudes) of exp(ikx) in periodic values on an odd number of points, by explicit sums."""
    n = np.arange(values.size) - values.size // 2
    return 2 * np.pi * n / length, np.exp(-2j * np.pi * np.outer(n, np.arange(values.size)) / values.size) @ values / values.size


def transported(f: Array, grid: PhaseSpaceGrid, s: float, time: float) -> Array:
    """f' = F(x - vt)/E', F = f exp(SΦ), E'_x = S∫F(x - vt) dv: all by explicit sums, and a quadrature along x."""
    k, rho = waves(f.sum(axis=1) * grid.dv, grid.length)
    integral = np.divide(rho, 1j * k, where=k != 0, out=np.zeros_like(rho))

    def free(x: Array, j: int) -> Array:
        origin = x - grid.v[j] * time
        forward = np.exp(1j * np.multiply.outer(origin, k))
        phi = rho[k == 0].real * origin + (forward @ integral).real
        return (forward @ waves(f[:, j], grid.length)[1]).real * np.exp(s * phi)

    # E'(x) = S∫_{-∞}^x ∫F dv dx': three periods behind x, in Gauss-Legendre panels
    nodes, weights = np.polynomial.legendre.leggauss(10)
    panels, depth = 60, 3 * grid.length
    edge = depth / panels
    behind = (edge * (np.arange(panels)[:, None] + (nodes + 1) / 2)).ravel()
    weight = np.tile(edge / 2 * weights, panels)
    result = np.empty_like(f)
    for i, x in enumerate(grid.x):
        later = s * grid.dv * weight @ sum(free(x - behind, j) for j in range(grid.nv))
        for j in range(grid.nv):
            result[i, j] = free(np.array([x]), j)[0] / later
    return result


def test_local_transport_against_its_slow_twin(make_scene: MakeScene) -> None:
    """γ = 0 and no kernel: the step's three transports are one."""
    scene = make_scene(model={"gravity": 0.0, "friction": 0.0}, **OFF_EQUILIBRIUM)
    grid = PhaseSpaceGrid(63, 12, scene.pipe.length, -5.0, 6.0)
    _, f = start(scene, grid.nx, grid.nv, (grid.low, grid.high), LOCAL)
    step = GridLinearisedStep(grid, scene.model, scene.cross_section, Nothing(grid.nv), LOCAL)
    slow = transported(f, grid, scene.cross_section, 0.4)
    assert np.abs(step(f, 0.4) - slow).max() < 1e-12 * slow.max()


@GAUGES
def test_moments_are_those_of_the_states(make_scene: MakeScene, tolerance: float) -> None:
    """At long and short times, the shortest far below what the kernel takes on these points; blurred and not."""
    scene = make_scene(**OFF_EQUILIBRIUM)
    step, f = start(scene, 95, 128, (-14.0, 10.0), tolerance)
    lifted = GridLinearisedStep(step.grid, scene.model, scene.cross_section, step.drift_diffusion, GLOBAL).lift(f)
    times, blurs = [0.4, 1.3, 1.3], [0.0, 0.0, 0.07]
    found = step.moments(lifted, times, blurs)
    assert found is not None
    for h, blur, moments in zip(times, blurs, found, strict=True):
        expected = velocity_moments(step.grid, step.lower(step.propagate(lifted, h), blur))
        assert np.abs(moments - expected).max(axis=1) == pytest.approx(0.0, abs=2e-11 * float(np.abs(expected).max()))
    at_once = step.moments(lifted, [1e-9], [0.0])
    assert at_once is not None
    assert at_once[0] == pytest.approx(velocity_moments(step.grid, f), abs=1e-7)


def test_moments_in_the_local_gauge(make_scene: MakeScene) -> None:
    """Up to twenty times the round-off of the global gauge that steps may have; else there are none."""
    scene = make_scene(**OFF_EQUILIBRIUM)
    step, f = start(scene, 95, 128, (-14.0, 10.0), LOCAL)
    round_off = np.finfo(float).eps * np.exp(step.gauge_range(f))
    for share, there in ((18.0, True), (22.0, False)):
        step, f = start(scene, 95, 128, (-14.0, 10.0), round_off / share)
        lifted = step.lift(f)
        assert lifted.mean_density is None
        found = step.moments(lifted, [0.9], [0.0])
        assert (found is not None) is there
        if found is not None:
            expected = velocity_moments(step.grid, step.lower(step.propagate(lifted, 0.9)))
            assert np.abs(found[0] - expected).max() < 1e-10 * np.abs(expected).max()
