"""What the paper's hydrodynamic equations do beyond the linear stage: the closure (3)-(5), and M moments of (2) with (6).

    python -m benchmarks.hydrodynamics [rates] [moments] [waves] [pipe] [inelastic]

All sections by default: rates 10 s, moments 40, waves 120, pipe 70, inelastic 20, on one core. Prints the tables of
docs/hydrodynamics_measured.md and asserts what they say. Units γ = σ = ρ̄ = 1, and g = R*, so that the homogeneous state is at
rest."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from benchmarks.sections import run_sections
from kinetic_solver import Scene, exact, hydrodynamics
from kinetic_solver.arrays import Array
from kinetic_solver.errors import SolverStopped
from kinetic_solver.hydrodynamics.closure import conserved, primitive
from kinetic_solver.hydrodynamics.gas import Gas
from kinetic_solver.hydrodynamics.lawson import ClosureSteps
from kinetic_solver.hydrodynamics.spectral import SpectralRun
from kinetic_solver.scene import FOLLOW_LEADER, INELASTIC
from kinetic_solver.stability import closure_rates, critical_density
from kinetic_solver.stability.closure import SHORTEST, closure_generator, closure_temperature, critical_collision_number

LENGTH = 8 * math.pi
AMPLITUDE = 1e-5
"""Of waves whose rates are measured, over ρ̄: what they drive nonlinearly is 1e-10 of themselves."""


def scene_of(number: float, operator: str = FOLLOW_LEADER, length: float = LENGTH, **changes: Any) -> Scene:
    collisions: dict[str, Any] = {"operator": operator, "cross_section": number}
    if operator == INELASTIC:
        collisions["restitution"] = 0.5
    data = {"model": {"gravity": number}, "collisions": collisions, "pipe": {"length": length}, "run": {"end_time": 1.0}}
    return Scene.model_validate({**data, **changes})


def table(*heads: str) -> None:
    print("\n| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")


def row(*cells: str) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


def closure_wave(scene: Scene, mode: int) -> tuple[complex, Array]:
    """(s, (δρ/ρ̄, δu, δθ/θ)) of the wave that grows fastest: (3)-(5) linearised as printed, by a matrix and not by the cubic."""
    g, gamma, sigma, s = scene.model.gravity, scene.model.friction, scene.model.noise, scene.cross_section
    rho, k = scene.initial.density, 2 * math.pi * mode / scene.pipe.length
    if scene.operator == INELASTIC:
        c = s * (1 - scene.restitution**2) / math.sqrt(math.pi)
        theta, u, drag = closure_temperature(gamma, sigma, c * rho), g / gamma, 0.0
    else:
        theta, u, drag, c = sigma, (g - s * rho * sigma) / gamma, s, 0.0
    rates = np.array(
        [
            [-1j * k * u, -1j * k * rho, 0],
            [-1j * k * theta / rho - drag * theta, -1j * k * u - gamma, -1j * k - drag * rho],
            [-2 * c * theta**1.5, -2j * k * theta, -1j * k * u - 2 * gamma - 3 * c * rho * math.sqrt(theta)],
        ]
    )
    values, vectors = np.linalg.eig(rates)
    fastest = int(values.real.argmax())
    vector = vectors[:, fastest] / vectors[0, fastest]
    return complex(values[fastest]), np.array([1.0, rho * vector[1], rho * vector[2] / theta])


def started(scene: Scene, mode: int, points: int) -> tuple[Scene, complex]:
    """The scene with its mode's fastest wave, on so many points a wavelength, in steps of a fifth of what is stable and at most
    0.003/γ."""
    s, (_, u, theta) = closure_wave(scene, mode)

    def wave(z: complex) -> list[dict[str, Any]]:
        return [{"mode": mode, "cos": AMPLITUDE * z.real, "sin": -AMPLITUDE * z.imag}]

    state = {"density": scene.initial.density, "modes": wave(1.0), "velocity_modes": wave(u), "temperature_modes": wave(theta)}
    if scene.operator == INELASTIC:
        c = scene.cross_section * (1 - scene.restitution**2) / math.sqrt(math.pi) * scene.initial.density
        state["temperature"] = closure_temperature(scene.model.friction, scene.model.noise, c)
    nx = points * mode + 1
    step = min(0.1 * scene.pipe.length / nx / math.sqrt(2 * scene.model.noise), 0.003 / scene.model.friction)
    data = scene.model_dump(by_alias=True, exclude_none=True)
    return Scene.model_validate({**data, "initial": state, "grid": {"nx": nx, "time_step": step}}), s


def measured(times: Array, density: Array, mode: int, guess: complex) -> complex:
    """s from the first frame to the last; the guess tells how often the wave went round."""
    c = np.fft.rfft(density, axis=1)[:, mode]
    elapsed = float(times[-1] - times[0])
    return guess + complex(np.log(c[-1] / c[0] * np.exp(-guess * elapsed))) / elapsed


def hierarchy_rate(scene: Scene, mode: int) -> tuple[complex, complex]:
    """(measured, of the spectrum) s of the wave of M moments that grows fastest, begun as itself: a hundredth as large, since at
    R* = 8 what it drives grows faster than it."""
    gamma, sigma = scene.model.friction, scene.model.noise
    rho, k = scene.initial.density, 2 * math.pi * mode / scene.pipe.length
    plan = hydrodynamics.make_plan(scene)
    assert plan.moments is not None
    generator = closure_generator(k * math.sqrt(sigma) / gamma, scene.groups.collision_number, plan.moments)
    values, vectors = np.linalg.eig(generator)
    fastest = int(values.real.argmax())
    u_h = (scene.model.gravity - scene.cross_section * rho * sigma) / gamma
    s = complex(gamma * values[fastest] - 1j * k * u_h)
    run = SpectralRun(plan)
    run.state[:] = 0
    run.state[mode] = 0.01 * AMPLITUDE * rho * vectors[:, fastest] / vectors[0, fastest]
    densities = np.array([values["moments"]["density"] for _, values in run.frames()])
    return measured(plan.schedule.times, densities, mode, s), s


def rates() -> None:
    print("\nGrowth rates, k* = n/4, begun as the wave itself: Re s of the spectrum, and |Δs|/|Re s| of the run")
    for factor in (0.9, 1.1):
        print(f"\nAt {factor:g} times each mode's critical density")
        table("mode", "R*, closure", "Re s", "|Δs|/Re s", *(f"R*, M = {m}; Re s; |Δs|/Re s" for m in (4, 8)))
        for mode in range(1, 9):
            number = factor * critical_density(scene_of(1.0), mode)
            scene, s = started(scene_of(number, run={"end_time": 0.3}), mode, 160)
            assert abs(s - closure_rates(scene, mode)[0]) < 1e-11 * abs(s)
            run = hydrodynamics.solve(scene)
            found = measured(run["time"].values, run["density"].values, mode, s)
            cells = [f"{number:.4f}", f"{s.real:+.6f}", f"{abs(found - s) / abs(s.real):.1e}"]
            assert abs(found - s) < 1e-6 * abs(s.real), (mode, found, s)
            for moments in (4, 8):
                number = factor * critical_density(scene_of(1.0), mode, moments)
                start = {"modes": [{"mode": mode, "cos": AMPLITUDE}]}
                more = {"hydrodynamics": {"moments": moments}, "accuracy": {"rtol": 1e-8}, "initial": start}
                found, s = hierarchy_rate(scene_of(number, run={"end_time": 0.3}, **more), mode)
                cells.append(f"{number:.4f}; {s.real:+.6f}; {abs(found - s) / abs(s.real):.1e}")
                assert abs(found - s) < 1e-6 * abs(s.real), (mode, moments, found, s)
                assert s.real * (factor - 1) > 0
            row(str(mode), *cells)


def moments() -> None:
    print("\nError of the density over its maximum against the closed form, from waves of 50 % and 20 %, L* = 8π")
    start = {"modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]}
    counts = (3, 4, 6, 8, 12, 16, 24, 32, 48)
    table("R*", "γt", "closure", *(f"M = {m}" for m in counts))
    for number in (0.5, 1.2, 2.0):
        for end in (2.0, 10.0):
            cells, errors = [], []
            truth: Array | None = None
            for m in (None, *counts):
                more: dict[str, Any] = {"hydrodynamics": {} if m is None else {"moments": m}, "accuracy": {"rtol": 1e-6}}
                scene = scene_of(number, initial=start, run={"end_time": end}, **more)
                try:
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore")
                        run = hydrodynamics.solve(scene)
                except SolverStopped as stop:
                    cells.append(f"stops, {str(stop).split(':')[0]}")
                    continue
                if truth is None:
                    truth = exact.Solution(scene, end).moments(run["x"].values)[0]
                errors.append(float(np.abs(run["density"].values[-1] - truth).max() / truth.max()))
                cells.append(f"{errors[-1]:.1e}")
            row(f"{number:g}", f"{end:g}", *cells)
            assert errors[-1] < 3e-6, errors
    print("\nR*_c of the shortest waves and at k* = 1 for M = 3, 8, 24, 48:")
    print(
        [(round(critical_collision_number(math.inf, m), 3), round(critical_collision_number(1.0, m), 3)) for m in (3, 8, 24, 48)]
    )


class Pipe:
    """A state of the closure on a period, from small waves, watched as it goes."""

    def __init__(self, number: float, length: float, nx: int, waves: dict[int, complex]) -> None:
        self.dx = length / nx
        self.x = self.dx * np.arange(nx)
        self.steps = ClosureSteps(Gas.of(scene_of(number, length=length)), self.dx, 0.2)
        rho = 1 + sum((z * np.exp(2j * math.pi * n / length * self.x)).real for n, z in waves.items())
        self.state = conserved(rho, np.zeros(nx), np.ones(nx))
        self.time = 0.0

    def advance(self, time: float) -> None:
        self.state = self.steps.advance(self.state, self.time, self.time + time)
        self.time += time

    def density(self) -> Array:
        return primitive(self.state)[0]

    def fronts(self) -> int:
        """Shocks, and steep rises that will be: places where the density rises along x by more than a tenth of its range within
        1 % of the pipe."""
        rho = self.density()
        reach = max(1, rho.size // 100)
        steep = np.roll(rho, -reach) - rho > 0.1 * np.ptp(rho)
        return int((steep & ~np.roll(steep, 1)).sum())

    def speed(self, mode: int = 1) -> float:
        """Of the density's wave over a short time."""
        before, began = np.fft.rfft(self.density())[mode], self.time
        k = 2 * math.pi * mode / (self.dx * self.x.size)
        self.advance(0.1 / k)
        turned = np.angle(np.fft.rfft(self.density())[mode] / before)
        return -float(turned) / k / (self.time - began)


def saturated(number: float, wavenumber: float, nx: int) -> tuple[str, float]:
    """What a wave of 5 % in a pipe of its own length becomes: as text, and its amplitude (0 where it decays, inf where it runs
    away)."""
    pipe = Pipe(number, 2 * math.pi / wavenumber, nx, {1: 0.05})
    before = math.inf
    try:
        while pipe.time < 200:
            pipe.advance(10.0)
            range_ = float(np.ptp(pipe.density()))
            if range_ < 1e-4:
                return "decays", 0.0
            if abs(range_ - before) < 2e-4 * range_ * (1 if range_ > 0.02 else 0.05):
                break
            before = range_
        return f"{range_:.4f}; {pipe.speed():+.4f}; {pipe.state[1].mean():+.4f}", range_
    except SolverStopped as stop:
        return f"runs away, {str(stop).split(':')[0]}", math.inf


def waves() -> None:
    print("\nA wave of 5 % in a pipe of its own length: largest less least density; its speed; mean of ρu")
    ks = (0.5, 1.0, 2.0, 4.0)
    print("R*_c(k*):", {k: round(critical_collision_number(k), 4) for k in ks})
    table("R*", "nx", *(f"k* = {k:g}" for k in ks))
    for number in (1.3, 1.4, 1.5, 1.6, 2.0):
        results = []
        for nx in (64, 128, 256):
            found = [saturated(number, k, nx) if nx < 256 or k <= 2 else ("", math.nan) for k in ks]
            results.append([amplitude for _, amplitude in found])
            row(f"{number:g}", str(nx), *(text for text, _ in found))
        # Shorter waves are in these pipes too, so that any of them is unstable above R*_c of the shortest
        assert all((amplitude > 0) == (number > SHORTEST) for amplitude in results[-1] if not math.isnan(amplitude)), results

    large = Pipe(1.3, LENGTH, 256, {1: 0.95})
    large.advance(60.0)
    print(f"\nR* = 1.3, L* = 8π, from a wave of 95 %: range of the density at t = 60: {np.ptp(large.density()):.4f}")
    assert np.ptp(large.density()) < 0.02


def pipe() -> None:
    print("\nL* = 8π, waves of 1 % in modes 1 to 8: fronts and range of the density at times γt")
    times = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0)
    table("R*", "nx", *(f"{t:g}" for t in times), "end")
    for number in (1.3, 1.4, 1.5, 1.75, 2.0, 3.0):
        for nx in (256, 512, 1024) if number > 1.4 else (256, 512):
            run = Pipe(number, LENGTH, nx, {n: 0.01 * np.exp(1j * n * n) for n in range(1, 9)})
            cells, end = [], "goes on"
            for t in times:
                try:
                    run.advance(t - run.time)
                    cells.append(f"{run.fronts()}; {np.ptp(run.density()):.3f}")
                except SolverStopped as stop:
                    end = f"runs away, {str(stop).split(':')[0]}"
                    break
            row(f"{number:g}", str(nx), *cells, *("–" for _ in times[len(cells) :]), end)


def inelastic() -> None:
    print("\n(12), ε = 0.5: Re s of the slowest wave, |Δs|/|Re s|, and the density's range from waves of 50 % and 20 %")
    table("R*", "mode 1", "", "mode 8", "", "t = 0", "t = 20/γ", "t = 60/γ")
    for number in (1.0, 10.0, 100.0):
        cells = []
        for mode in (1, 8):
            scene, s = started(scene_of(number, INELASTIC, run={"end_time": 0.3}), mode, 160)
            run = hydrodynamics.solve(scene)
            found = measured(run["time"].values, run["density"].values, mode, s)
            assert s.real < 0
            assert abs(found - s) < 1e-6 * abs(s.real), (number, mode, found, s)
            cells += [f"{s.real:.6f}", f"{abs(found - s) / abs(s.real):.1e}"]
        start = {"modes": [{"mode": 1, "cos": 0.5}, {"mode": 3, "sin": 0.2}]}
        large = scene_of(number, INELASTIC, initial=start, run={"end_time": 60.0, "output_every": 20.0}, accuracy={"rtol": 1e-2})
        density = hydrodynamics.solve(large)["density"].values
        ranges = np.ptp(density, axis=1)
        assert (np.diff(ranges) < 0).all()
        row(f"{number:g}", *cells, *(f"{ranges[n]:.4f}" for n in (0, 1, 3)))


SECTIONS = {"rates": rates, "moments": moments, "waves": waves, "pipe": pipe, "inelastic": inelastic}


def main() -> None:
    run_sections(SECTIONS)


if __name__ == "__main__":
    main()
