"""States of (12) whose shape depends on ε alone: free cooling and white noise. Known digits, limits, a second discretisation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kinetic_solver.errors import SceneError
from kinetic_solver.operators.collisions import Inelastic
from kinetic_solver.stability import ScalingState, cooling_state, white_noise_state
from kinetic_solver.stability.homogeneous import _inelastic

# ε: a2 and the rate of cooling over Haff's, to as many digits as are known.
COOLING = {
    0.0: (0.318313, 1.056542, 6),
    0.3: (0.265054, 1.047619, 6),
    0.5: (0.161018, 1.029364, 6),
    0.7: (-0.02207, 0.99505, 5),
    0.8: (-0.15670, 0.96864, 5),
    0.9: (-0.33683, 0.93321, 5),
    0.98: (-0.5529, 0.89624, 4),
}
# ε: a2 at R* = 1000.
STRONG = {0.0: (0.11846, 5), 0.2: (0.10831, 5), 0.5: (0.05632, 5), 0.7: (-0.00005, 5), 0.9: (-0.0690, 4)}


@pytest.mark.parametrize("restitution", COOLING)
def test_free_cooling(restitution: float) -> None:
    a2, rate, digits = COOLING[restitution]
    state = cooling_state(restitution)
    unit = 10.0**-digits  # known numbers may have been cut or rounded
    assert state.kurtosis_excess == pytest.approx(a2, abs=unit)
    assert state.rate_over_haff == pytest.approx(rate, abs=10.0 ** -min(5, digits + 1))


@pytest.mark.parametrize("restitution", STRONG)
def test_strong_collisions_approach_white_noise(restitution: float) -> None:
    """As θ_h/σ: the difference of a2 falls by 100^(2/3) from R* = 10³ to 10⁵."""
    a2, digits = STRONG[restitution]
    near, far = _inelastic(restitution, 1e3), _inelastic(restitution, 1e5)
    limit = white_noise_state(restitution).kurtosis_excess
    assert near[1] == pytest.approx(a2, abs=10.0**-digits)
    assert (near[1] - limit) / (far[1] - limit) == pytest.approx(near[0] / far[0], rel=0.03)
    state, number = white_noise_state(restitution), 1e9
    assert _inelastic(restitution, number)[0] == pytest.approx((state.cooling_rate * number) ** (-2 / 3), rel=1e-5)


def test_nearly_elastic_white_noise() -> None:
    assert white_noise_state(0.9999).kurtosis_excess == pytest.approx(-0.110888, abs=5e-5)


def test_nearly_elastic_cooling_ends_in_two_peaks() -> None:
    """a2 = -2/3 for two delta peaks, from which it differs by their variance, as (1 - ε)^(2/3); κ/(1 - ε) → 1."""
    differences = [cooling_state(restitution).kurtosis_excess + 2 / 3 for restitution in (0.9992, 0.9999)]
    assert differences[0] / differences[1] == pytest.approx(8 ** (2 / 3), rel=0.05)
    assert cooling_state(0.9999).rate_over_haff == pytest.approx(math.sqrt(math.pi) / 2, rel=1e-4)


def second_discretisation(restitution: float, half: float, nv: int, cooling: bool) -> tuple[float, float]:
    """(a2, κ) by relaxation in time of f on velocity points: pairs of cells (the solver's quintic deposit), driven by differences
    of order 8 that end at walls, the strength such that ⟨w²⟩ stays. It shares nothing with the Fourier-Galerkin method."""
    dv = 2 * half / nv
    w = dv * (np.arange(nv) + 0.5) - half
    operator = Inelastic(w, 1.0, restitution, "quintic")
    weights = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
    slope = sum(c / dv * (np.eye(nv, k=m) - np.eye(nv, k=-m)) for m, c in enumerate(weights, 1))
    driving = -slope * w if cooling else slope @ slope
    f = np.exp(-(w**2) / 2) / math.sqrt(2 * math.pi)

    def change(f: np.ndarray) -> np.ndarray:
        driven, collided = driving @ f, operator.rate(f[None])[0]
        return np.asarray(collided - (w**2 @ collided) / (w**2 @ driven) * driven)

    h = 2.5 / (half + math.pi * half / dv * 0.2) if cooling else 2.5 / (half + 2.0 / dv**2)
    for _ in range(20000):
        k1 = change(f)
        k2 = change(f + h / 2 * k1)
        k3 = change(f + h / 2 * k2)
        f = f + h / 6 * (k1 + 2 * k2 + 2 * k3 + change(f + h * k3))
        f = (f + f[::-1]) / 2  # a momentum of rounding errors, which nothing takes away, would grow as the gas cools
        moved = float(np.abs(k1).max())
        if moved < 1e-9:
            break
    assert moved < 1e-9
    collided = operator.rate(f[None])[0]
    return float(w**4 @ f) * dv / 3 - 1, -float(w**2 @ collided) / (w**2 @ (driving @ f))


@pytest.mark.parametrize(
    ("state", "half", "nv"),
    [(cooling_state(0.3), 15.0, 220), (cooling_state(0.8), 10.0, 260), (white_noise_state(0.4), 9.0, 130)],
    ids=["cooling, 0.3", "cooling, 0.8", "white noise, 0.4"],
)
def test_by_a_second_discretisation(state: ScalingState, half: float, nv: int) -> None:
    a2, rate = second_discretisation(state.restitution, half, nv, cooling=state == cooling_state(state.restitution))
    assert state.kurtosis_excess == pytest.approx(a2, abs=2e-6)
    assert state.cooling_rate == pytest.approx(rate, rel=2e-6)


@pytest.mark.parametrize("state", [cooling_state(0.6), white_noise_state(0.6)], ids=["cooling", "white noise"])
def test_the_moments_that_a_shape_has_by_definition(state: ScalingState) -> None:
    w, f = state.w, state.f
    dw = float(w[1] - w[0])
    assert f.sum() * dw == pytest.approx(1.0, rel=1e-13)
    assert w**2 @ f * dw == pytest.approx(1.0, rel=1e-12)
    assert abs(w @ f * dw) < 1e-12
    assert f.min() > -1e-13 * f.max()
    assert abs(f[np.abs(w) > state.reach]).max() < 1e-13 * f.max()
    assert float(f @ np.abs(w[:, None] - w) @ f) * dw**2 + dw**2 / 6 * float(f @ f) * dw == pytest.approx(
        state.collision_rate, rel=1e-4
    )


@pytest.mark.parametrize("restitution", [-0.1, 0.99995, 1.0, math.nan])
def test_what_has_no_such_state(restitution: float) -> None:
    for state in (cooling_state, white_noise_state):
        with pytest.raises(SceneError, match=r"collisions\.restitution = .*allowed: 0 to 0\.9999"):
            state(restitution)
