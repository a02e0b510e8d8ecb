"""Linear theory of one pipe at many densities: each row is that of its density; and the worked example of docs/."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kinetic_solver import Scene, SceneError
from kinetic_solver.stability import critical_density, growth_rates, over_densities, structure_factor
from kinetic_solver.stability.amplification import largest_density_gain

MakeScene = Callable[..., Scene]
LAW = {"operator": "follow-the-leader", "cross_section": 1.7}
EXAMPLE = Path(__file__).parents[2] / "docs" / "critical_density_map.py"


def test_each_density_is_that_of_its_scene(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=LAW)
    densities, modes = [0.3, 0.9, 2.1], [1, 3]
    found = over_densities(scene, densities, modes)
    assert found["structure_factor"].dims == ("density", "mode")
    assert found["critical_density"].values.tolist() == [critical_density(scene, n) for n in modes]
    for density in densities:
        at, row = scene.replace(**{"initial.density": density}), found.sel(density=density)
        expected = growth_rates(at, modes)
        for name in ("closure_growth_rate", "kinetic_growth_rate"):
            np.testing.assert_array_equal(row[name], expected[name])
        np.testing.assert_array_equal(row["structure_factor"], structure_factor(at, modes))
        np.testing.assert_array_equal(row["largest_growth"], [largest_density_gain(at, n)[0] ** 0.5 for n in modes])
        assert float(row["collision_number"]) == at.groups.collision_number


def test_the_closure_turns_unstable_at_its_critical_density_and_the_equation_nowhere(make_scene: MakeScene) -> None:
    scene, modes = make_scene(collisions=LAW), [1, 2, 5]
    critical = [critical_density(scene, n) for n in modes]
    for factor in (0.999, 1.001):
        found = over_densities(scene, [factor * rho for rho in critical], modes)
        for place in range(len(modes)):
            assert (float(found["closure_growth_rate"][place, place]) > 0) == (factor > 1)
        assert (found["kinetic_growth_rate"] < 0).all()


def test_what_is_refused(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=LAW)
    with pytest.raises(SceneError, match=r"initial\.density = -1"):
        over_densities(scene, [-1.0])
    for densities, modes in (([], [1]), ([1.0], [])):
        with pytest.raises(SceneError, match="densities, modes: one of them is empty"):
            over_densities(scene, densities, modes)
    with pytest.raises(SceneError, match=r"model\.friction = 0"):
        over_densities(make_scene(collisions=LAW, model={"friction": 0.0}), [1.0])


def test_the_worked_example(tmp_path: Path) -> None:
    """With few densities and modes: four panels, each over (mode, density)."""
    names = runpy.run_path(str(EXAMPLE))
    found = names["dataset"](np.linspace(0.1, 2.0, 7), (1, 2, 4, 8, 16, 40))
    assert found["closure_growth_rate"].dims == ("density", "mode")
    assert float(found["closure_growth_rate"].max()) > 2
    picture = names["figure"](found)
    titles = [axes.get_title(loc="left") for axes in picture.axes]
    assert [title[:3] for title in titles if title] == ["(a)", "(b)", "(c)", "(d)"]
    picture.savefig(tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 20_000
