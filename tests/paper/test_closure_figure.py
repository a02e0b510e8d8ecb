"""One scene by every description: the scene, the dataset against each description by itself, the picture, the command."""

from __future__ import annotations

import functools
import subprocess
from collections.abc import Callable
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, exact, stability
from kinetic_solver.analysis import closure_figure as figure
from kinetic_solver.analysis.closure_figure import closure_figure, closure_scene, closure_summary, contrast, descriptions
from kinetic_solver.stability.closure import SHORTEST, critical_collision_number

Command = Callable[..., subprocess.CompletedProcess[str]]
SCENE = Path(__file__).parents[2] / "scenes" / "closure.toml"
FEW = (500, 4000)


@pytest.fixture
def _few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figure, "COUNTS", FEW)
    monkeypatch.setattr(figure, "closure_scene", short)


def short(seed: int = 1, end: float = 1.0) -> Scene:
    data = closure_scene(seed).model_dump(by_alias=True, exclude_none=True)
    return Scene.model_validate({**data, "run": {"end_time": end, "output_every": 0.25}})


@functools.cache
def found(end: float = 1.0) -> xr.Dataset:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figure, "COUNTS", FEW)
        return descriptions(short(end=end))


def test_the_scene_is_that_of_its_file() -> None:
    assert Scene.from_toml(SCENE) == closure_scene()


def test_the_scene_lies_where_the_picture_says() -> None:
    """Above the closure's critical density in every mode but the longest, below that of the moments at every wavelength."""
    scene = closure_scene()
    assert scene.groups.collision_number > SHORTEST
    assert all(scene.initial.density > stability.critical_density(scene, mode) for mode in (3, 5))
    assert scene.groups.collision_number < critical_collision_number(float("inf"), figure.MOMENTS)
    assert (scene.model.gravity - 2 * scene.cross_section * scene.initial.density) / scene.model.friction == 1


def test_dimensions() -> None:
    dataset = found()
    assert dataset["closure"].dims == dataset["moments"].dims == dataset["kinetic"].dims == ("time", "x")
    assert dataset["particles"].dims == ("time", "count", "point")
    assert dataset["count"].values.tolist() == list(FEW)
    assert dataset["time"].values.tolist() == [0, 0.25, 0.5, 0.75, 1]
    assert dataset.attrs["closure_stops"] == 1
    for values in dataset.values():
        assert values.mean(values.dims[-1]).values == pytest.approx(1, abs=1e-12)
    assert Scene.model_validate_json(dataset.attrs["scene"]).initial == short().initial


def test_moments_and_equation_are_the_closed_form() -> None:
    """To rtol = 1e-3; the closure is away from it by more, and the particles by their noise."""
    dataset = found()
    truth = exact.solve(short(), x=dataset["x"])["density"].values
    for name in ("moments", "kinetic"):
        assert np.abs(dataset[name].values - truth).max() < 1e-3 * truth.max()
    assert np.abs(dataset["closure"].values[-1] - truth[-1]).max() > 3e-3
    for count, density in zip(FEW, dataset["particles"].values[-1], strict=True):
        noise = density - np.interp(dataset["point"], dataset["x"], truth[-1], period=short().pipe.length)
        ideal = np.sqrt(2 * 31 / count)  # that many waves are kept
        assert 0.6 * ideal < noise.std() < 3 * ideal


def test_the_closure_runs_away() -> None:
    """Its frames end there, and are NaN from then on; those before are whole."""
    dataset = found(8.0)
    stops = dataset.attrs["closure_stops"]
    assert 5 < stops < 7
    whole = dataset["time"].values <= stops
    assert np.isfinite(dataset["closure"].values[whole]).all()
    assert np.isnan(dataset["closure"].values[~whole]).all()
    last = dataset["closure"].values[whole][-1]
    assert contrast(last) > 1.5 * contrast(dataset["closure"].values[0])
    decayed = contrast(dataset["kinetic"].values)
    assert (np.diff(decayed) < 0).all()
    assert contrast(dataset["moments"].values)[-1] == pytest.approx(decayed[-1], abs=1e-3)
    assert f"runs away after t = {stops:.3g}" in closure_summary(dataset)[1]
    panels = closure_figure(dataset).axes
    assert "runs away" in panels[0].texts[0].get_text()
    assert panels[0].images[0].get_extent()[3] == pytest.approx(stops + 0.125)


def test_the_picture(tmp_path: Path) -> None:
    """Five panels of one colour scale, one colour bar, and the contrasts."""
    drawn = closure_figure(found())
    maps = [axes.images[0] for axes in drawn.axes if axes.images]
    assert len(maps) == 5
    assert {image.get_clim() for image in maps} == {(figure.LIGHT, figure.DARK)}
    assert len(drawn.axes) == 7
    assert len(drawn.axes[5].lines) == 5
    figure.save_closure_figure(found(), tmp_path / "closure.png")
    picture = matplotlib.image.imread(tmp_path / "closure.png")
    assert picture.shape[1] > 1.5 * picture.shape[0]
    with pytest.raises(SceneError, match=r"nowhere/closure\.png: cannot be written"):
        figure.save_closure_figure(found(), tmp_path / "nowhere" / "closure.png")


@pytest.mark.usefixtures("_few")
def test_the_command(tmp_path: Path, command: Command) -> None:
    done = command("figure", "closure", "--seed", "3", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "wrote figure_closure.nc and figure_closure.png"
    with xr.open_dataset(tmp_path / "figure_closure.nc") as dataset:
        assert dataset["count"].values.tolist() == list(FEW)
        assert "\n".join(closure_summary(dataset)) in done.stdout
        assert Scene.model_validate_json(dataset.attrs["scene"]).particles.seed == 3
    assert (tmp_path / "figure_closure.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--operator", "inelastic"), "error: figure closure: operator = 'inelastic'; "),
        (("--count", "100"), "error: figure closure: count = 100; "),
        (("--seed", "-1"), "error: particles.seed = -1: "),
        (("-o", "there.nc"), "error: there.nc: exists already; "),
    ],
    ids=["operator", "count", "seed", "exists"],
)
def test_the_command_refuses(tmp_path: Path, command: Command, arguments: tuple[str, ...], message: str) -> None:
    (tmp_path / "there.nc").write_text("kept")
    done = command("figure", "closure", *arguments, folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(message)
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["there.nc"]
