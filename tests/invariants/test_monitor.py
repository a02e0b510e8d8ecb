"""What the monitor makes of numbers that are far from one another: no NaN that nobody has asked for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from kinetic_solver.plan import make_plan
from kinetic_solver.scene import Scene
from kinetic_solver.solver.monitor import amplified, amplified_waves
from kinetic_solver.solver.observation import Observation
from kinetic_solver.solver.scheme import assemble

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.5}
PULSE = {
    "density": 1.4,
    "modes": [],
    "pulse": {"at": 0.43, "width": 0.02, "height": 20.0},
    "velocity_modes": [{"mode": 1, "cos": 1.5}],
}
VACUUM = {"density": 1.4, "modes": [], "step": {"from": 0.2, "to": 0.5, "ratio": 0.0}}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("rounding", [0.0, 1e-140, 1e-16])
def test_rounding_that_operator_6_amplifies_beyond_doubles(make_scene: MakeScene, rounding: float) -> None:
    """R_t = 90 in the pulse, and velocities 200 below the mean: exp(18000). Waves are given relative to the strongest, and all
    are numbers."""
    scene = make_scene(collisions=FOLLOW, initial=PULSE, run={"end_time": 6.0}, accuracy={"rtol": 1e-3})
    scheme = assemble(make_plan(scene))
    start = scheme.representation.start()
    seen = Observation.of(scheme, 0.0, start + rounding * start.max())
    waves = amplified_waves(seen)
    assert waves.max() == 1
    assert np.isfinite(waves).all()
    assert not np.isnan(amplified(seen)).any()


@pytest.mark.filterwarnings("error")
def test_where_there_is_no_density_nothing_is_amplified(make_scene: MakeScene) -> None:
    """An empty place has no mean velocity; the waves of f elsewhere are amplified all the same."""
    scene = make_scene(collisions=FOLLOW, initial=VACUUM, run={"end_time": 1.0}, accuracy={"rtol": 1e-3})
    scheme = assemble(make_plan(scene))
    start = scheme.representation.start()
    start[: start.shape[0] // 8] = 0.0
    seen = Observation.of(scheme, 0.0, start)
    assert np.isnan(seen.moments.mean_velocity).any()
    waves = amplified_waves(seen)
    assert waves.max() == 1
    assert np.isfinite(waves).all()
    assert (amplified(seen) >= (1 - 1e-12) * np.abs(start).max(axis=0)).all()
