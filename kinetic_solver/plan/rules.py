"""The rules by which rtol chooses grid, window, step and schemes: docs/accuracy.md.

Each bounds one error by a share of rtol. Constants marked "measured" come from the sweeps in benchmarks/accuracy_rules.py against
the exact solution, with a safety factor.
"""

from __future__ import annotations

import functools
import math
import warnings

import numpy as np

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.errors import SceneError
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.initial import start_state
from kinetic_solver.operators.velocity.hermite import HermiteBasis
from kinetic_solver.operators.velocity.kernel import resolution, resolved_spacing
from kinetic_solver.scene import FOLLOW_LEADER, INELASTIC, Scene
from kinetic_solver.stability.homogeneous import HomogeneousState, homogeneous_state
from kinetic_solver.theory.ornstein_uhlenbeck import half_transport_time, transition

DEPOSIT_ERROR = {"linear": (0.08, 2), "cubic": (0.03, 4), "quintic": (0.02, 6)}
"""Measured, times a safety factor of 1.3 to 3: max f error / max f <= coefficient·(dv/√θ)^order·max(1, Sρ√θ/γ)."""
STRANG_ERROR = {FOLLOW_LEADER: 0.015, INELASTIC: 0.06}
"""Measured, times a safety factor of 2: max f error / max f <= coefficient·(rate·h)², times exp(0.3 R_t) for (6), (1 - ε²)² for
(12); R_t and rate below."""
FINITE_VOLUME_ERROR = {"finite-volume": (0.05, 2), "finite-volume-8": (0.1, 8)}
"""Measured, times a safety factor: max f error / max f <= coefficient·weight·(dv/√σ)^order; the weight is Rules.tail_weight."""
LAWSON_ERROR = 1.2e-4
"""Measured: max f error / max f is about 1.2e-4 (rate h)^5, extrapolated Lawson method. It only estimates the number of steps."""
LEAST_RTOL_OF_A_STEP = 5e-5
"""Measured at R* = 2: benchmarks/accuracy_rules.py."""
MOST_MODES = 20_000
"""In x; more points than twice that are asked for by mistake, not by need."""
HERMITE_PAYS = 3
"""How many times fewer functions than points pay."""
MOST_HERMITE = 240
"""Hermite functions; numpy's Gauss-Laguerre nodes, of which operator (12) needs three quarters as many, overflow beyond."""


def frame_times(scene: Scene) -> Array:
    """All times at which anything is written, merged."""
    o = scene.output
    cadences = (True, o.f, o.moments, o.scalars, o.budgets, o.moment_equations)
    merged = np.unique(np.concatenate([scene.times(c) for c in cadences]))
    close = np.diff(merged) > 1e-9 * scene.run.end_time
    return merged[np.append(True, close)]


class Rules:
    """What each choice must resolve, for one scene; every answer leaves its reason in `reasons`."""

    def __init__(self, scene: Scene, reasons: dict[str, str], times: Array | None = None) -> None:
        self.scene, self.reasons = scene, reasons
        self.times = frame_times(scene) if times is None else times
        """When anything is written, by the clock of the scene's frame of reference."""
        self.lab_friction = scene.model.friction
        """That of the laboratory, which a noiseless frame takes out."""
        self.rtol = scene.accuracy.rtol
        self.tail = math.sqrt(2 * math.log(40 / self.rtol))
        """Standard deviations at which a Gaussian is rtol/40 of its maximum; a cell further in, a few times more."""
        self.u0, self.theta0 = start_state(scene)
        x = scene.pipe.length * np.arange(4096) / 4096
        self.rho = initial.density(scene, x)
        self.u = initial.mean_velocity(scene, x, self.u0)
        self.theta = initial.temperature(scene, x, self.theta0)
        self.rho_max = float(self.rho.max())
        self.end = scene.run.end_time
        self.whole = transition(scene.model, self.end)
        theta_end = float(self.theta.max()) * self.whole.decay**2 + self.whole.velocity_variance
        if scene.operator == INELASTIC and float(self.rho.min()) > 0:
            # Collisions cool: the hottest place is the thinnest one, and no hotter than its own stationary state.
            thinnest = _state_at_density(scene, float(self.rho.min()))
            theta_end = min(theta_end, thinnest.temperature if thinnest is not None else theta_end)
        self.theta_end = theta_end
        self.theta_max = max(float(self.theta.max()), theta_end)
        theta_least = float(self.theta.min())
        self.theta_min = min(theta_least, theta_least * self.whole.decay**2 + self.whole.velocity_variance)
        if scene.operator == INELASTIC:
            state = _state_at_density(scene, self.rho_max)
            # The densest place cools most: as without noise, but not below its own stationary state. The gas does not stay
            # Maxwellian, hence half of what Haff's law gives.
            self.theta_min = min(self.theta_min, max(self._haff(theta_least) / 2, 0.0 if state is None else state.temperature))

    def _haff(self, theta: float) -> float:
        """The temperature at the end of free cooling at the largest density: √θ' = -γ√θ - Cρ θ, C = S(1 - ε²)/√π (Haff 1983)."""
        c = self.scene.cross_section * (1 - self.scene.restitution**2) / math.sqrt(math.pi) * self.rho_max
        step = self.whole
        return (math.sqrt(theta) * step.decay / (1 + c * math.sqrt(theta) * step.drift_time)) ** 2

    def window(self) -> tuple[float, float]:
        """Mean ± tail of every Maxwellian that the flow passes through.

        For (6) the slow side reaches further by twice R_t√θ, R_t = S ρ_max √θ (1 - exp(-γt))/γ: once since dense places
        move that much slower, once since a disturbance there is amplified by up to exp(R_t w) (docs/theory.md, amplification).
        """
        means = self.means()
        reach = self.tail * math.sqrt(self.theta_max)
        if self.scene.operator == FOLLOW_LEADER and self.shifted():
            # The kernel is a shift then, periodic in v: what leaves above comes back in the slow tail, which (6) amplifies.
            reach = math.sqrt(self.tail**2 + 2 * self.amplification() * self.tail) * math.sqrt(self.theta_max)
        low, high = min(means) - reach, max(means) + reach
        if self.scene.operator == FOLLOW_LEADER:
            low -= 2 * self.amplification() * math.sqrt(self.theta_max)
        self.reasons["velocity_window"] = (
            f"{self.tail:.1f} standard deviations about the means from {min(means):.3g} to {max(means):.3g}"
            + (", and the amplified slow tail of (6)" if self.scene.operator == FOLLOW_LEADER else "")
        )
        return low, high

    def window_to_come(self, mean_velocity: Array, temperature: Array, left: float) -> tuple[float, float]:
        """As `window`, for the rest of a run from its present fields."""
        step = transition(self.scene.model, left)
        means = [float(mean_velocity.min()), float(mean_velocity.max())]
        means += [step.velocity_shift + mean * step.decay for mean in means]
        hottest = float(temperature.max())
        theta = max(hottest, min(hottest * step.decay**2 + step.velocity_variance, self.theta_end))
        reach = self.tail * math.sqrt(theta)
        slower = 2 * self.scene.cross_section * self.rho_max * math.sqrt(theta) * step.drift_time
        return min(means) - reach - (slower if self.scene.operator == FOLLOW_LEADER else 0.0), max(means) + reach

    def noise_hardly_acts(self) -> bool:
        """True where little of a relaxation time passes, or nothing is noisy: what free motion folds in v stays folded."""
        return self.scene.model.noise == 0 or self.scene.model.friction * self.end < 0.1

    def shifted(self) -> bool:
        """True where velocities are shifted or contracted without noise: only in a frame at rest (moving_frame.py)."""
        model = self.scene.model
        return model.friction * model.noise == 0 and (model.friction > 0 or model.gravity != 0)

    def means(self) -> list[float]:
        """Mean velocities at the start, and at the end as gravity and friction alone would have them."""
        means = [float(self.u.min()), float(self.u.max())]
        return means + [self.whole.velocity_shift + mean * self.whole.decay for mean in means]

    def check_given(self) -> None:
        """Refuses what no tolerance could excuse. Raises SceneError."""
        grid, means = self.scene.grid, self.means()
        if self.scene.initial.eigenmodes:
            initial.check_eigenmodes(self.scene, self.u0, self.theta0)
        if grid.velocity_window is not None:
            low, high = grid.velocity_window
            if not (low < min(means) and max(means) < high):
                raise SceneError(
                    f"grid.velocity_window = [{low:g}, {high:g}]: does not hold the mean velocities from {min(means):.4g} to "
                    f"{max(means):.4g} that the flow takes; allowed: a window some standard deviations wider than these"
                )
        if grid.nx is not None and not self.scene.homogeneous and self.scene.initial.file is None:
            start = self.scene.initial
            modes = (*start.density_modes, *start.velocity_modes, *start.temperature_modes)
            least = 2 * max((m.mode for m in modes), default=1) + 1
            if grid.nx < least:
                raise SceneError(f"grid.nx = {grid.nx}: cannot hold the initial state; allowed: {least} or more")

    def amplification(self) -> float:
        """R_t = S ρ_max √θ_max (1 - exp(-γt))/γ: a slow disturbance w√θ from the mean grows by up to exp(R_t w) under (6)."""
        return self.scene.cross_section * self.rho_max * math.sqrt(self.theta_max) * self.whole.drift_time

    def deposit(self) -> str | None:
        if self.scene.operator != INELASTIC:
            return None
        if self.scene.grid.deposit:
            return self.scene.grid.deposit
        name = "linear" if self.rtol >= 1e-2 else "quintic"
        self.reasons["deposit"] = "positive, and accurate enough" if name == "linear" else "fewest points in v"
        return name

    def velocity(self) -> str:
        model, name = self.scene.model, self.scene.grid.velocity or "points"
        if name == "hermite" and model.noise > 0 and float(self.theta.max()) >= 2 * model.noise:
            raise SceneError(
                f"grid.velocity = 'hermite': functions of variance noise = {model.noise:g} cannot hold a temperature of "
                f"{float(self.theta.max()):g}, twice that or more; allowed here: 'points'"
            )
        if name == "hermite":
            if model.friction * model.noise == 0:
                raise SceneError("grid.velocity = 'hermite': needs friction > 0 and noise > 0; allowed here: 'points'")
            if self.scene.grid.stepping == "strang" or self.scene.grid.drift_diffusion is not None:
                raise SceneError(
                    "grid.velocity = 'hermite': has no 'strang' stepping and no drift_diffusion scheme; remove grid.stepping or "
                    "grid.drift_diffusion, or set grid.velocity = 'points'"
                )
        return name

    def hermite_pays(self, nv: int) -> bool:
        """True where Hermite functions step (12) for less than nv points do. Measured at rtol 1e-8 with a fifth as many functions
        as points: 7 to 9 times faster; with half as many, at 1e-6, hardly."""
        scene, sigma = self.scene, self.scene.model.noise
        given = scene.grid
        if scene.operator != INELASTIC or scene.model.friction * sigma == 0 or scene.initial.file is not None:
            return False
        if any((given.nv, given.velocity_window, given.velocity, given.stepping, given.drift_diffusion, given.deposit)):
            return False
        if not (self.theta_min > 0.5 * sigma and self.theta_max < 1.5 * sigma):
            return False
        reason = self.reasons.get("nv", "")
        if HERMITE_PAYS * self.hermite_count() <= nv:
            return True
        self.reasons["nv"] = reason
        return False

    def stepping(self) -> str:
        operator = self.scene.operator
        if operator is None:
            return "exact"
        given = self.scene.grid.stepping
        if given == "exact" and operator == INELASTIC:
            raise SceneError(
                "grid.stepping = 'exact': operator (12), 'inelastic', has no exact step; allowed: 'extrapolated', 'strang'"
            )
        return given or ("exact" if operator == FOLLOW_LEADER else "extrapolated")

    def drift_diffusion(self) -> str:
        model, given = self.scene.model, self.scene.grid.drift_diffusion
        if model.friction * model.noise == 0 and given not in (None, "kernel"):
            raise SceneError(f"grid.drift_diffusion = {given!r}: needs friction > 0 and noise > 0; allowed here: 'kernel'")
        if given is None and self.scene.operator == FOLLOW_LEADER and model.friction * model.noise > 0:
            # (6) needs accuracy relative to f. The kernel has it where dv resolves its width: not for noise that hardly acts.
            kernel = self.exact_step_spacing(self.farthest_exact_step())
            return "finite-volume-8" if self._weak_noise_spacing() > 4 * kernel else "kernel"
        return given or "kernel"

    def _off_equilibrium(self) -> float:
        """Differences are taken of f/M, M the Maxwellian of variance σ: by how much more they err where f is hotter or displaced
        (measured: θ0 up to 8σ, 2.5√σ off)."""
        model, state = self.scene.model, homogeneous_state(self.scene) if self.scene.operator == FOLLOW_LEADER else None
        mean = state.mean_velocity if state is not None else model.gravity / model.friction
        displaced = max(abs(float(self.u.min()) - mean), abs(float(self.u.max()) - mean)) / math.sqrt(model.noise)
        return max(1.0, self.theta_max / model.noise) ** 3 * math.exp(min(displaced, 4.0))

    def _weak_noise_spacing(self) -> float:
        """For finite volumes in the kernel's place: of order 8 in the whole window (velocity/finite_volume.py, steep faces)."""
        model = self.scene.model
        farthest = max(abs(edge - model.gravity / model.friction) for edge in self.window())
        return min(self.finite_volume_spacing("finite-volume-8"), 2.2 * model.noise / farthest)

    def finite_volume_spacing(self, name: str) -> float:
        """The dv at which the finite volumes' error is rtol; it adds up over a quarter of a relaxation time."""
        coefficient, order = FINITE_VOLUME_ERROR[name]
        coefficient *= self.tail_weight() * min(1.0, 4 * self.scene.model.friction * self.end)
        if order == 8:
            coefficient *= self._off_equilibrium()
        return math.sqrt(self.scene.model.noise) * (self.rtol / coefficient) ** (1 / order)

    def time_step(self, stepping: str, velocity: str, window: tuple[float, float]) -> float | None:
        operator, given = self.scene.operator, self.scene.grid.time_step
        if operator is None or given:
            return min(given, self.farthest_exact_step() if stepping == "exact" else given) if operator and given else None
        if stepping == "strang":
            coefficient = self.strang_coefficient()
            h = min(1.0, math.sqrt(self.rtol / coefficient)) / self.rate()
            self.reasons["time_step"] = f"splitting error {coefficient:.2g} (rate h)² = rtol, rate = {self.rate():.3g}"
            return min(h, self.end)
        limits = {"from frame to frame": float(np.diff(self.times).max())}
        if stepping == "extrapolated" and self.scene.output.budgets is not False:
            limits["the budgets' integrals in time"] = self.budget_step()
        if operator == INELASTIC:
            limits["where the error's estimate can be believed"] = 1 / self.rate()
        if stepping == "exact":
            limits["how far collisions move the flow within a step"] = self.farthest_exact_step()
            if velocity == "points" and self.scene.grid.nv is None:
                limits["fewest points in v"] = self.cheapest_exact_step(window)
        reason, h = min(limits.items(), key=lambda item: item[1])
        self.reasons["time_step"] = ("exact; " if stepping == "exact" else "error control; at most ") + reason
        return h

    def strang_coefficient(self) -> float:
        """Strang's error of f over max f, over (rate h)²."""
        if self.scene.operator == FOLLOW_LEADER:
            return STRANG_ERROR[FOLLOW_LEADER] * math.exp(0.3 * self.amplification())
        return STRANG_ERROR[INELASTIC] * (1 - self.scene.restitution**2) ** 2

    def warn_of_a_long_strang_step(self) -> None:
        """A given step is kept as given."""
        h = self.scene.grid.time_step
        if h is None:
            return
        error = self.strang_coefficient() * (self.rate() * h) ** 2
        if error > self.rtol:
            warnings.warn(
                f"grid.time_step = {h:g}: Strang's splitting errs by about {error:.2g} of max f (accuracy.rtol = {self.rtol:g}); "
                "reduce it, or leave it out",
                stacklevel=3,
            )

    def budget_step(self) -> float:
        """At which the budgets' integrals in time, quintic splines, are good to about 1e-6 of what the terms bring."""
        return 0.25 / max(self.lab_friction + self.collision_rate(), 0.25 / self.end)

    def farthest_exact_step(self) -> float:
        """Within an exact step are states that friction has not yet acted on: collisions may move them by a few √θ."""
        friction = self.scene.model.friction
        return min(4 / self.collision_rate(), 2 / friction if friction > 0 else math.inf, self.end)

    def cheapest_exact_step(self, window: tuple[float, float]) -> float:
        """Shorter steps shear less, so dv may be coarser, until the kernel of a step asks for a finer one."""
        width, best = window[1] - window[0], (math.inf, 0.0)
        for n in (1, 1.5, 2, 3, 4, 6, 8, 12, 16):
            h = self.farthest_exact_step() / n
            points = width / min(self._bounds("exact", h, None, "kernel").values())
            best = min(best, (n * points * (200 + points), h))  # transforms and exponentials, and the product with the kernel
        return best[1]

    def shortest_exact_step(self, grid: PhaseSpaceGrid) -> float:
        """The time after which dv resolves the kernel, twice that in the local gauge; where none does, the farthest step."""
        gamma, sigma = self.scene.model.friction, self.scene.model.noise
        if gamma * sigma == 0 or self.scene.operator is None:
            return 0.0
        spread = (resolution(self.rtol) * grid.dv) ** 2 / sigma
        longest = self.farthest_exact_step()
        if spread >= 1:
            return longest
        return min(longest, -math.log1p(-spread) / (2 * gamma) * (2 if self.local_gauge() else 1))

    def exact_step_spacing(self, h: float) -> float:
        """The largest dv that resolves the kernels of an exact step h."""
        return resolved_spacing(self.scene.model, h / 2 if self.local_gauge() else h, resolution(self.rtol))

    def mixing_times(self) -> Array:
        """Within the time in which free motion mixes the initial waves away: a few per mean free flight across the shortest."""
        if self.scene.homogeneous:
            return np.empty(0)
        k, thermal = 2 * math.pi / self.scene.pipe.length, math.sqrt(self.theta_min)
        count = min(12, math.ceil(4 * self.initial_modes()))
        return 6 / (k * thermal) * (np.arange(count) + 1) / count

    def collision_rate(self) -> float:
        """Sρ√θ at the largest density and temperature."""
        return self.scene.cross_section * self.rho_max * math.sqrt(self.theta_max)

    def rate(self) -> float:
        """The fastest rate at which the split parts of (2) fail to commute: γ, collisions, transport across a wave."""
        k = 2 * math.pi / self.scene.pipe.length * self.initial_modes()
        return self.scene.model.friction + self.collision_rate() + k * math.sqrt(self.theta_max)

    def expected_steps(self, stepping: str, time_step: float | None) -> int:
        scene, h = self.scene, math.inf if time_step is None else time_step
        if stepping == "extrapolated" and scene.grid.time_step is None:
            by_accuracy = (self.rtol / LAWSON_ERROR) ** 0.2 / self.rate()
            fastest = self.collision_rate() * self.tail
            h = min(h, by_accuracy, 5 / fastest if fastest > 0 else math.inf)
        return sum(_steps(float(gap), h) for gap in np.diff(self.times))

    def error_share(self) -> float:
        return 0.3 * math.exp(-0.3 * self.amplification()) if self.scene.operator == FOLLOW_LEADER else 0.4

    def nv(
        self, window: tuple[float, float], stepping: str, time_step: float | None, deposit: str | None, drift_diffusion: str
    ) -> int:
        """The coarsest dv that meets every bound."""
        name, dv = min(self._bounds(stepping, time_step, deposit, drift_diffusion).items(), key=lambda item: item[1])
        self.reasons["nv"] = f"dv = {dv:.3g} resolves {name}"
        return max(8, math.ceil((window[1] - window[0]) / dv))

    def _bounds(self, stepping: str, time_step: float | None, deposit: str | None, drift_diffusion: str) -> dict[str, float]:
        scene, model = self.scene, self.scene.model
        gaps = np.diff(self.times)
        longest = float(gaps.max()) if time_step is None else min(float(gaps.max()), time_step)
        # A Gaussian of variance θ has the spectrum exp(-θq²/2). The linear step moves waves exp(ikx) by τ before noise damps them
        # (linear.py), which shifts their spectrum by kτ.
        k, digits = self._waves
        shear = k * half_transport_time(model.friction, longest)
        spectrum = float((shear + np.sqrt(2 * digits / self.theta_min)).max())
        bounds = {"the narrowest velocity distribution": min(math.pi / spectrum, math.sqrt(self.theta_min) / 2)}
        if (q := self._phase_mixing) > 0:
            bounds["phase mixing of the initial waves"] = math.pi / q
        if scene.initial.eigenmodes:
            bounds["the eigenmodes"] = self._eigenmode_spacing()
        noisy = model.friction * model.noise > 0
        if noisy and (scene.operator is not None or drift_diffusion != "kernel"):
            if drift_diffusion != "kernel" or (stepping == "extrapolated" and scene.operator == FOLLOW_LEADER):
                name = "finite-volume-8" if drift_diffusion == "kernel" else drift_diffusion
                order = FINITE_VOLUME_ERROR[name][1]
                weak = stepping == "exact" and scene.grid.drift_diffusion is None
                bounds[f"the finite volumes' error of order {order}"] = (
                    self._weak_noise_spacing() if weak else self.finite_volume_spacing(name)
                )
                if drift_diffusion == "kernel":
                    shortest = 0.15 / self.rate() * min(1.0, self.rtol / 1e-4) ** (1 / 8)  # order 8; measured
                    bounds["the Ornstein-Uhlenbeck kernel of the steps to expect"] = resolved_spacing(model, shortest)
            elif stepping == "exact":
                h = min(self.farthest_exact_step(), time_step or math.inf)
                bounds["the Ornstein-Uhlenbeck kernel of one step"] = self.exact_step_spacing(h)
            elif stepping == "strang":
                # Finite volumes of order 8 take over where dv is too coarse for the kernel: no need to be finer than they ask.
                enough = self.finite_volume_spacing("finite-volume-8")
                kernel = resolved_spacing(model, _shortest_step(self.times, float(time_step or gaps.min())))
                bounds["the Ornstein-Uhlenbeck kernel of one step"] = max(kernel, enough)
        if deposit is not None:
            coefficient, order = DEPOSIT_ERROR[deposit]
            if self.noise_hardly_acts():
                coefficient *= 3  # nothing smooths away what collects near dv
            relax = min(self.end, 1 / model.friction if model.friction > 0 else math.inf)
            gain = max(1.0, self.collision_rate() * relax)
            bounds[f"the {deposit} deposit of collision products"] = math.sqrt(self.theta_min) * (
                self.rtol / (coefficient * gain)
            ) ** (1 / order)
        return bounds

    def tail_weight(self) -> float:
        """By how much the finite volumes' error grows with what (6) amplifies."""
        r = self.amplification() if self.scene.operator == FOLLOW_LEADER else 1.0
        # Beyond R_t = 4 errors of order 8 were seen to grow as exp(1.5 R_t): the amplified tail is where f/M bends most.
        return (1 + r**2 + r**3) * math.exp(1.5 * max(0.0, r - 4.0))

    def gauge_range(self) -> float:
        """S·(max - min) of the periodic part of the initial ∫ρ dx."""
        if self.scene.homogeneous or self.scene.operator != FOLLOW_LEADER:
            return 0.0
        return self.scene.cross_section * float(np.ptp(self._potential))

    def local_gauge(self) -> bool:
        """True where the exactly linearised step will need its local gauge (linearised/grid.py)."""
        return float(np.finfo(float).eps) * math.exp(self.gauge_range()) > 0.05 * self.rtol

    @functools.cached_property
    def _potential(self) -> Array:
        """The periodic part of ∫ρ0 dx on the rules' points."""
        x = self.scene.pipe.length * np.arange(self.rho.size) / self.rho.size
        return initial.density_integral(self.scene, x) - self.scene.initial.density * x

    @functools.cached_property
    def _amplitudes(self) -> Array:
        """The largest |f_k(v)| over a few velocities, over that of all k, for k = 0, 1, … modes."""
        return self._spectrum(np.ones_like(self.rho))

    @functools.cached_property
    def _lifted_amplitudes(self) -> Array:
        """Likewise of f exp(S·periodic part of Φ), which is what evolves linearly under (6)."""
        phi = self.scene.cross_section * self._potential
        return self._spectrum(np.exp(phi - phi.max()))

    def _spectrum(self, weight: Array) -> Array:
        reach = self.tail * math.sqrt(float(self.theta.max()))
        v = np.linspace(float(self.u.min()) - reach, float(self.u.max()) + reach, 33)
        if self.scene.initial.eigenmodes:
            x = self.scene.pipe.length * np.arange(self.rho.size) / self.rho.size
            f = weight[:, None] * initial.eigenmode_state(self.scene, x, v, self.u0)
        else:
            f = (weight * self.rho)[:, None] / np.sqrt(self.theta[:, None])
            f = f * np.exp(-((v - self.u[:, None]) ** 2) / (2 * self.theta[:, None]))
        amplitude = np.abs(np.fft.rfft(f, axis=0)).max(axis=1)
        return np.asarray(amplitude / amplitude.max())

    @functools.cached_property
    def _waves(self) -> tuple[Array, Array]:
        """(k, log(10 A_k/rtol)): the initial waves exp(ikx) of relative amplitude A_k above rtol/10, k = 0 always among them.

        Those of f; for (6) those of f exp(S·periodic part of Φ), which is what evolves linearly.
        """
        amplitude = self._amplitudes
        if self.scene.initial.step is not None:
            amplitude = amplitude[: self.step_modes() + 1]
        if self.scene.operator == FOLLOW_LEADER and not self.scene.homogeneous:
            amplitude = np.maximum(amplitude, self._lifted_amplitudes[: amplitude.size])
        n = np.flatnonzero(amplitude > self.rtol / 10)
        digits = np.log(10 * amplitude[n] / self.rtol)
        if self.scene.operator == FOLLOW_LEADER and self.shifted():
            # Without a kernel's positivity what is not resolved spreads over all v, and (6) amplifies it in the slow tail.
            digits = digits + self.amplification() * self.tail
        return 2 * math.pi / self.scene.pipe.length * n, digits

    def initial_modes(self) -> int:
        """The highest Fourier mode of the initial f above rtol/10 of its mean, over a few velocities."""
        if self.scene.homogeneous:
            return 0
        if self.scene.initial.step is not None:
            return self.step_modes()
        # A density wave is held however weak it is: on fewer points it would be taken for another.
        given = max((m.mode for m in self.scene.initial.density_modes if m.cos or m.sin), default=0)
        return max(given, int(np.flatnonzero(self._amplitudes > self.rtol / 10)[-1]))

    def _eigenmode_spacing(self) -> float:
        """The dv that resolves the eigenmodes' shapes in v, which they keep: their spectra down to rtol/10 of ρ̄, and, for the
        monitor, the bends that they give to f."""
        reach = 12 * math.sqrt(self.theta0)
        v = self.u0 + reach * np.linspace(-1, 1, 1024, endpoint=False)
        dv = float(v[1] - v[0])
        q = 2 * np.pi * np.fft.fftfreq(v.size, dv)
        background = initial.maxwellian(np.ones(1), np.full(1, self.u0), np.full(1, self.theta0), v)
        shapes = np.array([shape for _, shape in initial.eigenmode_shapes(self.scene, v, self.u0)])
        spectra = np.fft.fft(np.concatenate([background, shapes]), axis=1)
        bend = np.abs(np.fft.ifft(-(q**2) * spectra, axis=1)).sum(axis=0)
        shortest = np.abs(q)[np.abs(spectra).max(axis=0) * dv > self.rtol / 10].max()
        return min(math.pi / float(shortest), math.sqrt(background.max() / bend.max()) / 2)

    def hermite_count(self) -> int:
        """Functions that hold the start, and the waves in v that free motion makes of the initial waves."""
        scene, sigma = self.scene, self.scene.model.noise
        state = homogeneous_state(scene)
        assert state is not None
        basis = HermiteBasis(state.mean_velocity, sigma, MOST_HERMITE)
        spread = np.abs(basis.maxwellian(np.ones(4096), self.u, self.theta)).max(axis=0)
        if scene.initial.eigenmodes:
            v = hermite_points(scene, basis, self.u0, self.theta0)
            background = initial.eigenmode_background(scene, v, self.u0)
            shapes = np.array([background, *(shape for _, shape in initial.eigenmode_shapes(scene, v, self.u0))])
            coefficients = np.abs(basis.coefficients(shapes.real, v) + 1j * basis.coefficients(shapes.imag, v)).max(axis=0)
            if scene.operator == INELASTIC:
                coefficients[coefficients < 1e-8] = 0.0  # rounding, as `hermite_points` says: up to 3e-9
            spread = np.maximum(spread, coefficients)
        n = int(np.flatnonzero(spread > self.rtol / 10)[-1])
        if n >= MOST_HERMITE - 20:
            low, high = math.sqrt(float(self.theta.min())), math.sqrt(float(self.theta.max()))
            raise SceneError(
                f"grid.velocity = 'hermite': temperatures from {low**2:.3g} to {high**2:.3g} need more than {MOST_HERMITE} "
                f"functions of variance noise = {sigma:g}; allowed here: 'points'"
            )
        k, digits = self._waves
        orders = np.arange(MOST_HERMITE)
        factorial = np.cumsum(np.log(np.maximum(orders, 1)))
        # After t the wave exp(ikx) of a Maxwellian has coefficients exp(-k²D/2) (k√σ b)^n/√n!; b, D as in ornstein_uhlenbeck.py
        for t in np.linspace(0, self.end, 33)[1:]:
            step = transition(scene.model, float(t))
            moved = k[1:, None] * step.drift_time * math.sqrt(sigma)
            damped = digits[1:, None] - k[1:, None] ** 2 * step.displacement_variance / 2
            above = damped + orders * np.log(moved) - factorial / 2 > 0
            n = max(n, int(np.flatnonzero(above.any(axis=0))[-1]) if above.any() else 0)
        if scene.operator is not None:
            n = math.ceil(1.3 * n + 4 + self.amplification() ** 2 / 2)
        self.reasons["nv"] = f"{n + 8} Hermite functions hold the start and the phase mixing of its waves"
        return min(MOST_HERMITE, max(8, n + 8))

    def nx(self) -> int:
        if self.scene.homogeneous:
            self.reasons["nx"] = "nothing depends on x"
            return 1
        n = self.initial_modes()
        reason = f"{n} modes of the initial state"
        if self.scene.operator is not None:
            if self.scene.operator == FOLLOW_LEADER:
                more = self._front_modes(self.rho)
                why = "the fronts that collisions can make"
            else:
                # Temperature and velocity follow the density: functions such as 1/ρ, with harmonics of their own.
                follows = np.abs(np.fft.rfft(1 / (self.rho + 0.02 * self.rho_max)))
                more = 0.0 if self.scene.initial.step else np.flatnonzero(follows > self.rtol / 10 * follows.max())[-1] / 2
                why = "the harmonics in fields that follow the density"
            n = self._with_room(2 * n + more)
            reason += f", their products, and {math.ceil(more)} for {why}"
            if self.scene.operator == FOLLOW_LEADER and self.scene.initial.step is None and not self.local_gauge():
                # The global gauge transforms f exp(SΦ), which has waves of its own.
                lifted = int(np.flatnonzero(self._lifted_amplitudes > self.rtol / 10)[-1])
                n = max(n, math.ceil(8 / 7 * lifted))
        self.reasons["nx"] = reason
        if n > MOST_MODES:
            raise SceneError(
                f"grid.nx: {n} modes would be needed; allowed: {MOST_MODES}; raise accuracy.rtol or shorten pipe.length"
            )
        return fast_odd(2 * n + 1)

    def _front_modes(self, density: Array) -> float:
        """Of the fronts that (6) can make of a density: tanh profiles of width 2/(S Δρ), with the spectrum exp(-πk/(SΔρ))."""
        contrast = self.scene.cross_section * float(np.ptp(density))
        return contrast * math.log(10 / self.rtol) / math.pi * self.scene.pipe.length / (2 * math.pi)

    def _with_room(self, modes: float) -> int:
        """The highest eighth stays empty: the monitor watches it. So does the part that the local gauge damps."""
        return math.ceil((1.25 if self.local_gauge() else 8 / 7) * (modes + 4))

    def enough_points(self, modes: int, density: Array) -> int:
        """nx for the rest of a run, from the waves that f has now and its density."""
        if self.scene.operator is None:
            return fast_odd(2 * modes + 1)
        more = self._front_modes(density) if self.scene.operator == FOLLOW_LEADER else 0.0
        return fast_odd(2 * self._with_room(2 * modes + more) + 1)

    def step_modes(self) -> int:
        """Modes of a density step that noise has not damped to rtol/10 by the first frame after the start."""
        if self.scene.operator is not None and self.rtol < LEAST_RTOL_OF_A_STEP and self.scene.grid.nx is None:
            raise SceneError(
                f"accuracy.rtol = {self.rtol:g}: with initial.step collisions are accurate to {LEAST_RTOL_OF_A_STEP:g} only "
                f"(products with a jump converge slowly in x); allowed: {LEAST_RTOL_OF_A_STEP:g} or more, smooth modes, or "
                "a given grid.nx"
            )
        first = transition(self.scene.model, float(self.times[1]))
        theta = float(self.theta.min())
        variance = theta * first.decay**2 + first.velocity_variance
        covariance = theta * first.drift_time * first.decay + first.covariance
        rest = theta * first.drift_time**2 + first.displacement_variance - covariance**2 / variance
        k = 2 * math.pi / self.scene.pipe.length * np.arange(1, MOST_MODES)
        alive = np.exp(-(k**2) * rest / 2) / np.arange(1, MOST_MODES) > self.rtol / 10
        if alive[-1] and self.scene.grid.nx is None:
            raise SceneError(
                f"initial.step: at rtol = {self.rtol:g} a jump needs more than {MOST_MODES} modes at the first frame, "
                f"t = {float(self.times[1]):g}; allowed: a later one (run.output_every), a larger accuracy.rtol, or "
                "a given grid.nx"
            )
        return int(np.flatnonzero(alive)[-1]) + 1 if alive.any() else 1

    @functools.cached_property
    def _phase_mixing(self) -> float:
        """That of the initial waves; without noise with a margin, since nothing smooths what is beyond it."""
        noisy = self.scene.model.friction * self.scene.model.noise > 0
        return self.mixing_to_come(*self._waves, float(self.theta.min()), self.end) * (1.0 if noisy else 1.1)

    def mixing_to_come(self, k: Array, digits: Array, theta: float, left: float) -> float:
        """The largest v-wavenumber at which free motion still leaves rtol/10 of waves k in x, of a gas of temperature θ, whose
        amplitudes are e^digits times that, within the time that is left.

        f's joint characteristic function is Gaussian: at x-wavenumber k it has its peak at q = -kC/V with amplitude
        exp(-k²(D - C²/V)/2) and width V^(-1/2), where V, C, D are the (co)variances of velocity and displacement.
        """
        worst = 0.0
        for t in np.linspace(0, left, 65)[1:]:
            step = transition(self.scene.model, float(t))
            e, b = step.decay, step.drift_time
            variance = theta * e * e + step.velocity_variance
            if variance == 0:
                continue
            covariance = theta * b * e + step.covariance
            rest = theta * b * b + step.displacement_variance - covariance**2 / variance
            room = 2 * (digits - k**2 * rest / 2)
            alive = room > 0
            q = k[alive] * covariance / variance + np.sqrt(room[alive] / variance)
            worst = max(worst, float(q.max(initial=0.0)))
        return worst

    def warn_of_an_unresolved_kernel(self, grid: PhaseSpaceGrid, time_step: float | None, drift_diffusion: str) -> None:
        """Where a given dv is too coarse for the kernel of a step, finite volumes of order 8 take its place."""
        model = self.scene.model
        if (
            time_step is None
            or drift_diffusion != "kernel"
            or self.scene.operator != FOLLOW_LEADER
            or model.friction * model.noise == 0
        ):
            return
        h = _shortest_step(self.times, time_step)
        resolved = resolved_spacing(model, h)
        coefficient, order = FINITE_VOLUME_ERROR["finite-volume-8"]
        error = coefficient * self.tail_weight() * (grid.dv / math.sqrt(model.noise)) ** order
        if grid.dv > resolved and error > self.rtol:
            enough = math.ceil((grid.high - grid.low) / resolved)
            warnings.warn(
                f"dv = {grid.dv:.3g} is too coarse for the Ornstein-Uhlenbeck kernel of a step of {h:.3g}, and what takes its "
                f"place errs by about {error:.1g} (accuracy.rtol = {self.rtol:g}); raise grid.nv to {enough} or lengthen "
                "grid.time_step",
                stacklevel=3,
            )


def hermite_points(scene: Scene, basis: HermiteBasis, mean_velocity: float, temperature: float) -> Array:
    """Velocities from which to take the Hermite coefficients of a state about the homogeneous one.

    He_n/√n! grows as exp(w²/4). Where the state is known in closed form, so are its tails; with (12) beyond 8.5 thermal
    velocities that would only lift its rounding.
    """
    reach = (8.5 if scene.operator == INELASTIC else 2 * math.sqrt(basis.count) + 6) * math.sqrt(temperature)
    points = math.ceil(reach / math.sqrt(basis.variance) * (8 + 2 * math.sqrt(basis.count)))
    return mean_velocity + reach * np.linspace(-1, 1, 2 * points + 1)


def _steps(interval: float, time_step: float) -> int:
    return max(1, math.ceil(interval / time_step * (1 - 1e-12)))


def _shortest_step(times: Array, time_step: float) -> float:
    """The shortest step that fills some interval between frames."""
    return min(float(gap) / _steps(float(gap), time_step) for gap in np.diff(times))


def _state_at_density(scene: Scene, density: float) -> HomogeneousState | None:
    """None where there is none, or where it lies beyond what can be solved for (R* below 1e-6 or above 1e6)."""
    start = scene.initial.model_copy(update={"density": density})
    there = scene.model_copy(update={"initial": start})
    return homogeneous_state(there) if 1e-6 < there.groups.collision_number < 1e6 else None


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
