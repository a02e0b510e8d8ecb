"""A scene in words and numbers, before anything runs."""

from __future__ import annotations

import math

from kinetic_solver.initial import file_notes, start_state
from kinetic_solver.plan import Plan, cost, make_plan
from kinetic_solver.scene import FOLLOW_LEADER, INELASTIC, Scene
from kinetic_solver.stability import critical_density, kinetic_rates
from kinetic_solver.stability.homogeneous import homogeneous_state
from kinetic_solver.stability.verdict import closure_in_words

Row = tuple[str, str]


def describe(scene: Scene, on_the_grid: bool = True) -> list[tuple[str, list[Row]]]:
    """Sections of (label, text): equation, groups, homogeneous state, closure, start, and the run that `solve` would make."""
    run = [("Run on the grid", _run(make_plan(scene)))] if on_the_grid else []
    return [
        ("Equation", _equation(scene)),
        ("Dimensionless groups", _groups(scene)),
        ("Homogeneous state", _homogeneous(scene)),
        ("Three-moment closure of the paper", _closure(scene)),
        ("Start", _start(scene, on_the_grid)),
        *run,
    ]


def expected_seconds(scene: Scene) -> float:
    """What `solve` will take for the scene on one core of this machine, within a factor of three (plan/cost.py).

    Raises SceneError where there is no plan.
    """
    return cost(make_plan(scene)).seconds


def _equation(scene: Scene) -> list[Row]:
    m = scene.model
    rows = [
        ("(2)", "∂f/∂t + v ∂f/∂x + ∂/∂v[(g - γv) f] = σγ ∂²f/∂v² + C[f]"),
        ("coefficients", f"g = {m.gravity:g}, γ = {m.friction:g}, σ = {m.noise:g}, L = {scene.pipe.length:g}"),
    ]
    s = scene.cross_section
    if scene.operator == FOLLOW_LEADER:
        rows.append(("collisions (6)", f"C[f] = S f ρ (u - v), follow-the-leader, S = {s:g}"))
    elif scene.operator == INELASTIC:
        rows.append(
            (
                "collisions (12)",
                f"C[f] = S [gain - ∫f f' |v - v'| dv'], inelastic, S = {s:g}, ε = {scene.restitution:g}",
            )
        )
    else:
        why = (
            "elastic collisions of equal particles exchange labels only"
            if scene.collisions is not None and scene.collisions.cross_section
            else "none in the scene"
        )
        rows.append(("C[f] = 0", why))
    return rows


def _groups(scene: Scene) -> list[Row]:
    g = scene.groups
    if scene.model.friction * scene.model.noise == 0:
        return [("none", "without both friction and noise there is no thermal velocity, or no relaxation time, to compare with")]
    rows = [
        ("R* = S ρ √σ/γ", f"{g.collision_number:.6g}", "collisions per relaxation time of a thermal particle"),
        ("k* = (2π/L) √σ/γ", f"{g.wavenumber:.6g}", "thermal free path against the longest wave"),
        ("L* = L γ/√σ", f"{g.length:.6g}", "length of the pipe in thermal free paths"),
    ]
    width = max(len(value) for _, value, _ in rows)
    return [(label, f"{value:<{width}}   {meaning}") for label, value, meaning in rows]


def _homogeneous(scene: Scene) -> list[Row]:
    state = homogeneous_state(scene)
    if state is None:
        return [("none", "without both friction and noise the temperature decays for ever, or not at all")]
    rows = [
        ("mean velocity u_h", f"{state.mean_velocity:.10g}"),
        ("temperature θ_h", f"{state.temperature:.10g}"),
    ]
    if scene.operator == INELASTIC:
        rows.append(
            (
                "kurtosis excess a2",
                f"{state.kurtosis_excess:.6g}   ⟨w⁴⟩/(3θ²) - 1; 0 for a Gaussian (solved, not assumed)",
            )
        )
    else:
        rows.append(("velocity distribution", "exactly a Gaussian"))
    if scene.operator is not None:
        rows.append(("collision rate", f"{state.collision_rate:.6g} per particle and unit of time"))
    return rows


def _closure(scene: Scene) -> list[Row]:
    if scene.operator is not None and scene.model.friction * scene.model.noise == 0:
        return [("critical density", "not defined: there is no homogeneous state to be stable or not")]
    if not math.isfinite(critical_density(scene)):
        return [("critical density", "none: the closure of this scene is stable at every density")]
    rho = scene.initial.density
    rows = []
    for mode in (1, 2, 4, 8):
        rho_c = critical_density(scene, mode)
        fate = "above: this wave grows" if rho > rho_c else "below: this wave decays"
        rows.append((f"ρ_c of mode {mode}", f"{rho_c:.6g}   the scene's ρ = {rho:g} is {fate}"))
    rows += zip(("is it unstable?", "which waves grow"), closure_in_words(scene), strict=False)
    rows.append(("what it means", "a property of the closure (3)-(5); equation (2) itself is linearly stable at every density"))
    return rows


def _start(scene: Scene, on_the_grid: bool) -> list[Row]:
    if scene.initial.file is not None:
        said = file_notes(scene) if on_the_grid else []
        return [("file", scene.initial.file), *(("of it", text) for text in said)]
    if scene.initial.eigenmodes:
        return [
            (
                f"eigenmode {m.mode}, branch {m.branch}",
                f"relative density {math.hypot(m.cos, m.sin):.4g}, s = {kinetic_rates(scene, m.mode, m.branch + 1)[0][-1]:.6g}",
            )
            for m in scene.initial.eigenmodes
        ]
    u0, theta0 = start_state(scene)
    rows = [("mean velocity, temperature", f"{u0:.6g}, {theta0:.6g}")]
    for b in scene.initial.beams:
        rows.append((f"beam, {b.share:.4g} of all", f"mean velocity {b.mean_velocity:.6g}, temperature {b.temperature:.6g}"))
    if (pulse := scene.initial.pulse) is not None:
        text = f"at {pulse.at:g} L, standard deviation {pulse.width:g} L, height {pulse.height:g} times the background"
        rows.append(("pulse", text))
    return rows


def _run(plan: Plan) -> list[Row]:
    g, reasons = plan.grid, plan.reasons

    def row(label: str, text: str, key: str) -> Row:
        return label, f"{text}   {reasons.get(key, 'as given')}"

    rows = [
        ("frame", _frame(plan)),
        row("nx", f"{g.nx}", "nx"),
        row("nv", f"{g.nv}", "nv"),
        row("velocity window", f"[{g.low:.5g}, {g.high:.5g}]", "velocity_window"),
        ("velocities", _VELOCITIES[_how(plan)]),
    ]
    if (plan.output.nx, plan.output.nv) != (g.nx, g.nv):
        rows.append(("fields given at", f"{plan.output.nx} places and {plan.output.nv} velocities   output.nx, output.nv"))
    if plan.deposit is not None and plan.velocity != "hermite":
        rows.append(row("deposit", plan.deposit, "deposit"))
    frames = len(plan.times)
    rows.append(("in time", _stepping(plan)))
    if plan.time_step is not None:
        rows.append(row("longest step", f"{plan.time_step:.4g}", "time_step"))
    rows += [
        ("steps", f"{'about ' if plan.controlled else ''}{plan.expected_steps} in {frames} frames"),
        ("memory", f"{plan.memory / 2**20:.3g} MiB"),
        ("time", f"{cost(plan)} on one core of this machine, within a factor of three"),
    ]
    return rows


def _frame(plan: Plan) -> str:
    if not plan.reference_frame.moving:
        return "at rest"
    out, frame = plan.output, plan.reference_frame
    if frame.cooling > 0:
        begins, ends = (frame.unit * frame.place(float(clock)).scale for clock in (0.0, plan.times[-1]))
        over = "over scaled velocities (v - u)/s" if out.scaled else "over velocities"
        where = f"written {over}, {out.nv} on [{out.low:.5g}, {out.high:.5g}], s from {begins:.4g} to {ends:.4g}"
        return f"{where}   {plan.reasons['reference_frame']}"
    what = "gravity and friction are" if plan.reference_frame.noiseless else "gravity is"
    return f"moving: {what} a change of coordinates; written for {out.nv} velocities on [{out.low:.5g}, {out.high:.5g}]"


def _how(plan: Plan) -> str:
    if plan.reference_frame.cooling > 0:
        return "cooling"
    if plan.stepping == "homogeneous":
        return "homogeneous"
    return plan.velocity if plan.velocity == "hermite" else plan.drift_diffusion


_VELOCITIES = {
    "cooling": "points, which the frame spreads exactly",
    "hermite": "Hermite functions about the homogeneous state",
    "homogeneous": "waves over (v - u)/s, which follow mean and width; seen at points",
    "kernel": "points, the exact Ornstein-Uhlenbeck kernel between them",
    "finite-volume-8": "points, finite volumes of order 8",
    "finite-volume": "points, positive finite volumes of order 2",
}


def _stepping(plan: Plan) -> str:
    if plan.scene.operator is None:
        return "one exact step from time 0 to each frame"
    if plan.stepping == "exact":
        return "exact steps: with follow-the-leader collisions a transformation makes (2) linear"
    if plan.stepping == "homogeneous":
        return "nothing depends on x: an ordinary differential equation in velocities that follow mean and width"
    if plan.stepping == "strang":
        return "Strang splitting, order 2"
    if plan.symmetric:
        return "extrapolated Strang splitting, order 8"
    exponential = plan.stepping == "exponential"
    name = "exponential method about the homogeneous state, order 4" if exponential else "Lawson-Runge-Kutta method, order 4"
    return f"{name}, extrapolated   {plan.reasons.get('stepping', 'as given')}"
