"""The paper's hydrodynamic equations into a file."""

from __future__ import annotations

from kinetic_solver import hydrodynamics
from kinetic_solver.dataset import recording
from kinetic_solver.errors import SceneError
from kinetic_solver.methods.job import Job


def run(job: Job) -> list[str]:
    """Without checkpoints: all frames are known only when the integration is over."""
    if job.operator is not None:
        raise SceneError(f"operator {job.operator.label}: has no closure; allowed with method 'hydrodynamics': the scene's own")
    plan = hydrodynamics.make_plan(job.scene)
    recorder = job.recorder(plan.output, plan.schedule, hydrodynamics.variables(plan))
    with recording(recorder):
        report = hydrodynamics.integrate(plan, recorder, job.progress)
    recorder.close(report=report)
    rtol = job.scene.accuracy.rtol
    said = [f"{value:.2g}" if isinstance(value, float) else f"{value}" for value in report.values()]
    return [
        *(f"{name.replace('_', ' ')}: {value}" for name, value in zip(report, said, strict=True)),
        f"accuracy.rtol = {rtol:g}",
    ]
