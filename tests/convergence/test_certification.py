"""Error bars that hold the true error, and observed orders that are the schemes' own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, certify, exact, solve
from kinetic_solver.analysis.certification import FIELDS

MakeScene = Callable[..., Scene]
FOLLOW = {"operator": "follow-the-leader", "cross_section": 1.2}
INELASTIC = {"operator": "inelastic", "cross_section": 1.2, "restitution": 0.4}
SECOND_ORDER = {
    "nx": 27, "nv": 64, "velocity_window": (-7.0, 7.0), "time_step": 0.05, "stepping": "strang",
    "drift_diffusion": "finite-volume",
}  # fmt: skip


def certified(scene: Scene) -> tuple[xr.Dataset, xr.Dataset]:
    run = solve(scene)
    return run, certify(scene, run)


@pytest.mark.parametrize(
    "change", [{}, {"model": {"gravity": 30.0}, "initial": {"mean_velocity": 0.0}}], ids=["at rest", "moving"]
)
def test_bars_hold_the_true_error(make_scene: MakeScene, change: dict[str, Any]) -> None:
    """Of what rtol chooses: pointwise, up to the bars' own rounding, and hardly larger than need be."""
    scene = make_scene(collisions=FOLLOW, run={"end_time": 1.0, "output_every": 0.5}, **change)
    run, found = certified(scene)
    truth = exact.solve(scene, x=run["x"], v=run["v"])
    for name in FIELDS:
        true = np.abs(run[name].values - truth[name].values)[1:]
        bars, scale = found[f"{name}_error"].values[1:], np.abs(truth[name].values).max()
        assert np.all(true <= bars + 0.02 * true.max() + 1e-13 * scale), name
        assert bars.max() < 3 * true.max() + 1e-12 * scale, name
    assert "within rtol" in found.attrs["certified"]


def test_observed_orders_of_a_second_order_scheme(make_scene: MakeScene) -> None:
    """Finite volumes in v and Strang's splitting in time, each in a run that it limits."""
    in_v = make_scene(collisions=FOLLOW, grid=SECOND_ORDER, accuracy={"rtol": 0.1})
    run, found = certified(in_v)
    order = found["observed_order"].sel(direction="v", field="f").item()
    assert 1.6 < order < 2.6
    assert np.isnan(found["observed_order"].sel(direction="x", field="f"))  # x is exact here: not what limits
    truth = exact.solve(in_v, x=run["x"], v=run["v"])
    true = np.abs(run["f"].values - truth["f"].values)
    assert true.max() <= found["f_error"].values.max()  # the truth of the bars errs as well: they count that
    in_t = make_scene(
        collisions=FOLLOW, grid={**SECOND_ORDER, "drift_diffusion": "kernel", "time_step": 0.5, "nv": 96}, accuracy={"rtol": 0.1}
    )
    _, found = certified(in_t)
    assert 1.6 < found["observed_order"].sel(direction="t", field="f").item() < 2.6


def test_an_error_above_rtol_is_said(make_scene: MakeScene) -> None:
    """By the run's own estimate, which stops nothing on a given grid, and by the certificate."""
    scene = make_scene(collisions=FOLLOW, grid={**SECOND_ORDER, "nv": 40, "time_step": 0.002}, accuracy={"rtol": 1e-3})
    with pytest.warns(UserWarning, match=r"the estimated error, 0\.034 of max f, exceeds accuracy\.rtol = 0\.001"):
        _, found = certified(scene)
    assert "above rtol" in found.attrs["certified"]


def test_operator_12_and_what_is_said_on_the_way(make_scene: MakeScene) -> None:
    said: list[str] = []
    scene = make_scene(collisions=INELASTIC, run={"end_time": 0.5}, accuracy={"rtol": 1e-3}, output={"budgets": False})
    run = solve(scene)
    found = certify(scene, run, said.append)
    assert len(said) == 6
    assert 0 < float(found["certified_error"].max()) < 1e-3
    assert float(found["truth_error"].max()) < 0.3 * float(found["certified_error"].max())
    # The bars against a run of another kind: Hermite functions, a thousand times as accurate.
    fine = solve(make_scene(collisions=INELASTIC, run={"end_time": 0.5}, accuracy={"rtol": 1e-6}, grid={"velocity": "hermite"}))
    theta = np.interp(run["x"], fine["x"], fine["temperature"][-1])
    assert np.abs(run["temperature"].values[-1] - theta).max() < 2e-3  # linear interpolation between 63 points
    merged = xr.merge([run, found])
    assert {"f", "f_error", "observed_order"} <= set(merged.data_vars)


def test_fields_that_are_not_written_are_not_certified(make_scene: MakeScene) -> None:
    scene = make_scene(collisions=FOLLOW, run={"end_time": 0.5}, output={"f": False})
    _, found = certified(scene)
    assert list(found["field"].values) == ["density", "mean_velocity", "temperature"]
    assert "f_error" not in found


@pytest.mark.parametrize("collisions", [None, FOLLOW, INELASTIC], ids=["none", "(6)", "(12)"])
def test_a_density_step_can_be_certified(make_scene: MakeScene, collisions: dict[str, Any] | None) -> None:
    """Wherever the run came to its end."""
    start = {"modes": [], "step": {"from": 0.2, "to": 0.45, "ratio": 3.0}, "temperature": 0.6}
    scene = make_scene(collisions=collisions, initial=start, run={"end_time": 0.8}, accuracy={"rtol": 1e-2})
    _, found = certified(scene)
    assert "within rtol" in found.attrs["certified"]
