"""What a run will use, decided before it starts: grid, window, step, schemes, memory. Rules: docs/accuracy.md.

Each rule bounds one error by a share of rtol and says so in `Plan.reasons`; constants marked "measured" come from the sweeps
in benchmarks/accuracy_rules.py against the exact solution, with a safety factor.
"""

from __future__ import annotations

import math
import os
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.homogeneous import homogeneous_state, start_state
from kinetic_solver.scene import FOLLOW_LEADER, INELASTIC, Scene, SceneError
from kinetic_solver.velocity.kernel import resolved_spacing
from kinetic_solver.velocity.ornstein_uhlenbeck import half_transport_time, transition

DEPOSIT_ERROR = {"linear": (0.05, 2), "cubic": (0.03, 4), "quintic": (0.02, 6)}
"""Measured, times a safety factor of 1.3 to 3: max f error / max f <= coefficient·(dv/√θ)^order·max(1, Sρ√θ/γ)."""
STRANG_ERROR = {FOLLOW_LEADER: 0.015, INELASTIC: 0.06}
"""Measured, times a safety factor of 2: max f error / max f <= coefficient·(rate·h)², times exp(0.3 R_t) for (6), (1 - ε²)² for
(12); R_t and rate below."""
FINITE_VOLUME_ERROR = 0.05
"""Measured with (6), times a safety factor: max f error / max f <= 0.05 (1 + R_t² + R_t³) dv²/σ."""
STATE_ARRAYS = 8
"""Arrays of the size of f alive at once: the state, its transform, collision stages, diagnostics."""


@dataclass(frozen=True)
class Plan:
    """The discretisation of one run."""

    scene: Scene
    grid: PhaseSpaceGrid
    time_step: float | None
    """Largest step between two frames; None without collisions: one exact step from frame to frame."""
    drift_diffusion: str
    deposit: str | None
    reasons: dict[str, str] = field(default_factory=dict)

    def steps(self, interval: float) -> int:
        """Equal steps that fill an interval between frames."""
        return 1 if self.time_step is None else _steps(interval, self.time_step)

    @property
    def total_steps(self) -> int:
        return sum(self.steps(float(gap)) for gap in np.diff(frame_times(self.scene)))

    @property
    def memory(self) -> int:
        """Bytes: the arrays of f's size, the kernels and phases of two step lengths."""
        state = self.grid.nx * self.grid.nv
        return 8 * (STATE_ARRAYS * state + 2 * (self.grid.nv**2 + 2 * state)) + 8 * 3 * self.grid.nv**2


def frame_times(scene: Scene) -> Array:
    """All times at which anything is written, merged."""
    o = scene.output
    cadences = (True, o.f, o.moments, o.scalars, o.budgets, o.moment_equations)
    merged = np.unique(np.concatenate([scene.times(c) for c in cadences]))
    close = np.diff(merged) > 1e-9 * scene.run.end_time
    return merged[np.append(True, close)]


def make_plan(scene: Scene) -> Plan:
    """Choose what the scene leaves open. Raises SceneError where no grid in this machine's memory can do it."""
    reasons: dict[str, str] = {}
    if scene.initial.file is not None:
        scene = _on_the_files_grid(scene, reasons)
    rules = _Rules(scene, reasons)
    window = scene.grid.velocity_window or rules.window()
    deposit = rules.deposit()
    time_step = rules.time_step()
    nv = scene.grid.nv or rules.nv(window, time_step, deposit)
    nx = scene.grid.nx or rules.nx()
    grid = PhaseSpaceGrid(nx, nv, scene.pipe.length, *window)
    plan = Plan(scene, grid, time_step, rules.drift_diffusion(grid, time_step), deposit, reasons)
    _check_memory(plan)
    return plan


def _on_the_files_grid(scene: Scene, reasons: dict[str, str]) -> Scene:
    """The rules below are for Maxwellian starts; a start from a file keeps the file's grid where [grid] names no other."""
    nx, nv, low, high = initial.file_grid(scene)
    of_file: dict[str, Any] = {"nx": nx}
    if scene.grid.velocity_window is None:
        of_file |= {"nv": nv, "velocity_window": (low, high)}
    missing = {name: value for name, value in of_file.items() if getattr(scene.grid, name) is None}
    reasons.update(dict.fromkeys(missing, "as in initial.file"))
    return scene.model_copy(update={"grid": scene.grid.model_copy(update=missing)})


class _Rules:
    def __init__(self, scene: Scene, reasons: dict[str, str]) -> None:
        self.scene, self.reasons = scene, reasons
        self.rtol = scene.accuracy.rtol
        self.tail = math.sqrt(2 * math.log(10 / self.rtol))
        """Standard deviations at which a Gaussian is rtol/10 of its maximum."""
        self.u0, self.theta0 = start_state(scene)
        x = scene.pipe.length * np.arange(4096) / 4096
        self.rho = initial.density(scene, x)
        self.u = initial.mean_velocity(scene, x, self.u0)
        self.theta = initial.temperature(scene, x, self.theta0)
        self.rho_max = float(self.rho.max())
        self.end = scene.run.end_time
        self.whole = transition(scene.model, self.end)
        theta_end = float(self.theta.max()) * self.whole.decay**2 + self.whole.velocity_variance
        self.theta_max = max(float(self.theta.max()), theta_end)
        theta_least = float(self.theta.min())
        self.theta_min = min(theta_least, theta_least * self.whole.decay**2 + self.whole.velocity_variance)
        if scene.operator == INELASTIC and (state := homogeneous_state(_at_density(scene, self.rho_max))) is not None:
            self.theta_min = min(self.theta_min, state.temperature)

    def window(self) -> tuple[float, float]:
        """Mean ± tail of every Maxwellian that the flow passes through.

        For (6) the slow side reaches further by twice R_t√θ, R_t = S ρ_max √θ (1 - exp(-γt))/γ: once since dense places
        move that much slower, once since a disturbance there is amplified by up to exp(R_t w) (docs/theory.md, amplification).
        """
        decay, shift = self.whole.decay, self.whole.velocity_shift
        means = [float(self.u.min()), float(self.u.max())]
        means += [shift + mean * decay for mean in means]
        reach = self.tail * math.sqrt(self.theta_max)
        low, high = min(means) - reach, max(means) + reach
        if self.scene.operator == FOLLOW_LEADER:
            low -= 2 * self.amplification() * math.sqrt(self.theta_max)
        self.reasons["velocity_window"] = (
            f"{self.tail:.1f} standard deviations about the means from {min(means):.3g} to {max(means):.3g}"
            + (", and the amplified slow tail of (6)" if self.scene.operator == FOLLOW_LEADER else "")
        )
        return low, high

    def amplification(self) -> float:
        """R_t = S ρ_max √θ_max (1 - exp(-γt))/γ: a slow disturbance w√θ from the mean grows by up to exp(R_t w) under (6)."""
        return self.scene.cross_section * self.rho_max * math.sqrt(self.theta_max) * self.whole.drift_time

    def deposit(self) -> str | None:
        if self.scene.operator != INELASTIC:
            return None
        if self.scene.grid.deposit:
            return self.scene.grid.deposit
        name = "linear" if self.rtol >= 1e-3 else "cubic" if self.rtol >= 1e-6 else "quintic"
        self.reasons["deposit"] = f"cheapest at rtol = {self.rtol:g}"
        return name

    def rate(self) -> float:
        """The fastest rate at which the split parts of (2) fail to commute: γ, collisions, transport across a wave."""
        thermal = math.sqrt(self.theta_max)
        collisions = self.scene.cross_section * self.rho_max * thermal
        k = 2 * math.pi / self.scene.pipe.length * self.initial_modes()
        return self.scene.model.friction + collisions + k * thermal

    def time_step(self) -> float | None:
        operator = self.scene.operator
        if operator is None:
            return None
        if self.scene.grid.time_step:
            return self.scene.grid.time_step
        coefficient = STRANG_ERROR[operator]
        if operator == FOLLOW_LEADER:
            coefficient *= math.exp(0.3 * self.amplification())
        else:
            coefficient *= (1 - self.scene.restitution**2) ** 2
        h = min(1.0, math.sqrt(self.rtol / coefficient)) / self.rate()
        self.reasons["time_step"] = f"splitting error {coefficient:.2g} (rate h)² = rtol, rate = {self.rate():.3g}"
        return min(h, self.end)

    def nv(self, window: tuple[float, float], time_step: float | None, deposit: str | None) -> int:
        """The coarsest dv that meets every bound."""
        scene, digits = self.scene, math.log(10 / self.rtol)
        # A Gaussian of variance θ has the spectrum exp(-θq²/2): cut where it is rtol/10. The linear step moves waves
        # exp(ikx) by τ before noise damps them (linear.py), which shifts their spectrum by kτ.
        gaps = np.diff(frame_times(scene))
        longest = float(gaps.max()) if time_step is None else min(float(gaps.max()), time_step)
        k_max = 2 * math.pi / scene.pipe.length * self.initial_modes()
        shift = k_max * half_transport_time(scene.model.friction, longest)
        narrowest = math.sqrt(self.theta_min)
        bounds = {
            "the narrowest velocity distribution": min(math.pi / (math.sqrt(2 * digits) / narrowest + shift), narrowest / 2)
        }
        if (q := self._phase_mixing()) > 0:
            bounds["phase mixing of the initial waves"] = math.pi / q
        if time_step is not None and scene.model.friction * scene.model.noise > 0:
            if scene.grid.drift_diffusion == "finite-volume":
                bounds["the finite volumes' second-order error"] = math.sqrt(self.rtol / self.finite_volume_error())
            else:
                shortest = _shortest_step(scene, time_step)
                bounds["the Ornstein-Uhlenbeck kernel of one step"] = resolved_spacing(scene.model, shortest)
        if deposit is not None:
            coefficient, order = DEPOSIT_ERROR[deposit]
            relax = min(self.end, 1 / scene.model.friction if scene.model.friction > 0 else math.inf)
            gain = max(1.0, scene.cross_section * self.rho_max * math.sqrt(self.theta_max) * relax)
            bounds[f"the {deposit} deposit of collision products"] = math.sqrt(self.theta_min) * (
                self.rtol / (coefficient * gain)
            ) ** (1 / order)
        name, dv = min(bounds.items(), key=lambda item: item[1])
        self.reasons["nv"] = f"dv = {dv:.3g} resolves {name}"
        return max(8, math.ceil((window[1] - window[0]) / dv))

    def initial_modes(self) -> int:
        """The highest Fourier mode of the initial f above rtol/10 of its mean, over a few velocities."""
        if self.scene.homogeneous:
            return 0
        reach = self.tail * math.sqrt(float(self.theta.max()))
        v = np.linspace(float(self.u.min()) - reach, float(self.u.max()) + reach, 33)
        f = self.rho[:, None] / np.sqrt(self.theta[:, None])
        f = f * np.exp(-((v - self.u[:, None]) ** 2) / (2 * self.theta[:, None]))
        amplitude = np.abs(np.fft.rfft(f, axis=0)).max(axis=1)
        above = np.flatnonzero(amplitude > self.rtol / 10 * amplitude.max())
        return int(above[-1])

    def nx(self) -> int:
        if self.scene.homogeneous:
            self.reasons["nx"] = "nothing depends on x"
            return 1
        n = self.initial_modes()
        reason = f"{n} modes of the initial state"
        if self.scene.operator is not None:
            # Collisions steepen density fronts to tanh profiles of width 2/(S Δρ), whose spectrum falls as exp(-πk/(SΔρ)).
            contrast = self.scene.cross_section * float(self.rho.max() - self.rho.min())
            fronts = contrast * math.log(10 / self.rtol) / math.pi * self.scene.pipe.length / (2 * math.pi)
            n = math.ceil(8 / 7 * (2 * n + fronts + 4))  # the highest eighth stays empty: the monitor watches it
            reason += f", their products, and {math.ceil(fronts)} for the fronts that collisions can make"
        self.reasons["nx"] = reason
        return fast_odd(2 * n + 1)

    def _phase_mixing(self) -> float:
        """The largest v-wavenumber at which free motion still leaves an amplitude of rtol/10 of the initial waves.

        f's joint characteristic function is Gaussian: at x-wavenumber k it has its peak at q = -kC/V with amplitude
        exp(-k²(D - C²/V)/2) and width V^(-1/2), where V, C, D are the (co)variances of velocity and displacement.
        """
        k = 2 * math.pi / self.scene.pipe.length * np.arange(self.initial_modes() + 1)
        worst, theta = 0.0, float(self.theta.min())
        for t in np.linspace(0, self.end, 65)[1:]:
            step = transition(self.scene.model, float(t))
            e, b = step.decay, step.drift_time
            variance = theta * e * e + step.velocity_variance
            if variance == 0:
                continue
            covariance = theta * b * e + step.covariance
            rest = theta * b * b + step.displacement_variance - covariance**2 / variance
            room = 2 * (math.log(10 / self.rtol) - k**2 * rest / 2)
            alive = room > 0
            q = k[alive] * covariance / variance + np.sqrt(room[alive] / variance)
            worst = max(worst, float(q.max(initial=0.0)))
        return worst

    def drift_diffusion(self, grid: PhaseSpaceGrid, time_step: float | None) -> str:
        """The exact kernel where the grid resolves it (and where there is nothing else: no collisions, no noise)."""
        scene = self.scene
        if scene.model.friction * scene.model.noise == 0:
            if scene.grid.drift_diffusion == "finite-volume":
                raise SceneError(
                    "grid.drift_diffusion = 'finite-volume': needs friction > 0 and noise > 0; allowed here: 'kernel'"
                )
            return "kernel"
        if scene.grid.drift_diffusion:
            return scene.grid.drift_diffusion
        if time_step is None:
            return "kernel"
        h = _shortest_step(scene, time_step)
        resolved = resolved_spacing(scene.model, h)
        if grid.dv <= resolved:
            return "kernel"
        reason = f"dv = {grid.dv:.3g} is too coarse for the kernel of a step of {h:.3g}"
        self.reasons["drift_diffusion"] = reason
        error = self.finite_volume_error() * grid.dv**2
        if error > self.rtol:
            enough = math.ceil((grid.high - grid.low) / resolved)
            warnings.warn(
                f"{reason}: finite volumes are used, whose error is about {error:.1g} (accuracy.rtol = {self.rtol:g}); "
                f"raise grid.nv to {enough} or lengthen grid.time_step for the exact kernel",
                stacklevel=2,
            )
        return "finite-volume"

    def finite_volume_error(self) -> float:
        """max f error / max f, over dv²."""
        r = self.amplification() if self.scene.operator == FOLLOW_LEADER else 1.0
        return FINITE_VOLUME_ERROR * (1 + r**2 + r**3) / self.scene.model.noise


def _steps(interval: float, time_step: float) -> int:
    return max(1, math.ceil(interval / time_step * (1 - 1e-12)))


def _shortest_step(scene: Scene, time_step: float) -> float:
    """The shortest step that fills some interval between frames."""
    return min(float(gap) / _steps(float(gap), time_step) for gap in np.diff(frame_times(scene)))


def _at_density(scene: Scene, density: float) -> Scene:
    start = scene.initial.model_copy(update={"density": density})
    return scene.model_copy(update={"initial": start})


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


def _check_memory(plan: Plan) -> None:
    available = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if plan.memory > 0.9 * available:
        g = plan.grid
        raise SceneError(
            f"grid: nx = {g.nx}, nv = {g.nv} need {plan.memory / 2**30:.3g} GiB, this machine has {available / 2**30:.3g} GiB; "
            "reduce nx or nv, or raise accuracy.rtol"
        )
