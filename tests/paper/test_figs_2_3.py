"""The paper's Figures 2 and 3: the scenes, the snapshots, what linear theory expects of them, the command."""

from __future__ import annotations

import functools
import math
import subprocess
from collections.abc import Callable
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import xarray as xr

from kinetic_solver import Scene, SceneError, compare
from kinetic_solver.analysis import paper_figures as snapshots
from kinetic_solver.analysis.paper_figures import BINS, expected_contrast, figure_scene, save_snapshots, summary
from kinetic_solver.stability import structure_factor
from kinetic_solver.stability.homogeneous import homogeneous_state

Command = Callable[..., subprocess.CompletedProcess[str]]
SHORT = (0.0, 0.5, 2.0)
BOTH = pytest.mark.parametrize("operator", ["follow-the-leader", "inelastic"])


def short(operator: str, count: int = 2000, figure: int = 2) -> tuple[Scene, xr.Dataset]:
    """A figure's scene and its snapshots, at times up to 2."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(snapshots, "TIMES", SHORT)
        scene = figure_scene(figure, operator, count)
        return scene, snapshots.snapshots(scene)


taken = functools.cache(short)


def integral(values: xr.DataArray, coordinate: str) -> np.ndarray:
    """Over the uniform points of a coordinate, one for each time."""
    return values.sum(coordinate).values * float(values[coordinate][1] - values[coordinate][0])


# -- the scenes


@pytest.mark.parametrize(("figure", "number"), [(2, 0.5), (3, 4.0)])
@BOTH
def test_the_scenes(figure: int, number: float, operator: str) -> None:
    """R* on both sides of 7√3/9, L* = 8π, homogeneous; only (12) has a restitution."""
    scene = figure_scene(figure, operator, count=123, seed=4)
    assert scene.groups.collision_number == number
    assert (number > 7 * math.sqrt(3) / 9) == (figure == 3)
    assert scene.groups.length == pytest.approx(8 * math.pi)
    assert scene.homogeneous
    assert scene.operator == operator
    assert scene.restitution == (0.5 if operator == "inelastic" else 1)
    assert (scene.particles.count, scene.particles.seed, scene.particles.replicas) == (123, 4, 1)
    assert (scene.model.gravity, scene.model.friction, scene.model.noise, scene.initial.density) == (1, 1, 1, 1)
    assert scene.run.end_time == 500


def test_refused_scenes() -> None:
    for figure in (1, 4):
        with pytest.raises(SceneError, match=f"figure {figure}: allowed: 2 or 3"):
            figure_scene(figure)
    with pytest.raises(SceneError, match="operator"):
        figure_scene(2, "elastic")
    with pytest.raises(SceneError, match="count"):
        figure_scene(2, count=0)


# -- the snapshots


@BOTH
def test_dimensions(operator: str) -> None:
    scene, found = taken(operator)
    assert found["position"].dims == found["velocity"].dims == ("time", "replica", "particle")
    assert found["position"].shape == (3, 1, 2000)
    assert found["time"].values.tolist() == list(SHORT)
    assert found["density_histogram"].dims == ("time", "bin")
    assert found.sizes["bin"] == BINS
    for name in ("histogram", "equation", "gaussian", "two_populations"):
        assert found[name].dims == ("time", "v_bin")
    assert ((found["position"] >= 0) & (found["position"] < scene.pipe.length)).all()
    assert Scene.model_validate_json(found.attrs["scene"]) == scene
    assert all(np.isfinite(values).all() for values in found.values())


@BOTH
def test_norms(operator: str) -> None:
    """The density's mean is 1; ∫w dv = 1 of the particles, of their Gaussian, of the equation, and of the two populations."""
    _, found = taken(operator)
    assert found["density_histogram"].mean("bin").values == pytest.approx(1, abs=1e-12)
    assert integral(found["histogram"], "v_bin") == pytest.approx(1, abs=1e-12)
    assert integral(found["gaussian"], "v_bin") == pytest.approx(1, abs=2e-3)  # the window ends 0.5 beyond the last particle
    assert integral(found["equation"], "v_bin") == pytest.approx(1, abs=2e-3)
    assert integral(found["two_populations"], "v_bin") == pytest.approx(1, abs=2e-3)


@BOTH
def test_histograms_are_of_the_particles(operator: str) -> None:
    """Counted one by one, and the Gaussian has their mean and variance."""
    _, found = taken(operator)
    v, dv = found["v_bin"].values, float(found["v_bin"][1] - found["v_bin"][0])
    for n in range(3):
        x, u = found["position"].values[n, 0], found["velocity"].values[n, 0]
        bins = np.bincount((x / (8 * math.pi) * BINS).astype(int), minlength=BINS)
        assert found["density_histogram"].values[n] == pytest.approx(bins * BINS / x.size)
        counts = np.bincount(np.floor((u - v[0]) / dv + 0.5).astype(int), minlength=v.size)
        assert found["histogram"].values[n] == pytest.approx(counts / (u.size * dv))
        gaussian = np.exp(-((v - u.mean()) ** 2) / (2 * u.var())) / math.sqrt(2 * math.pi * u.var())
        assert found["gaussian"].values[n] == pytest.approx(gaussian)


def test_the_equation_is_in_its_homogeneous_state() -> None:
    """(6): exactly Gaussian at every time. Points between the solver's are interpolated to 1 % of the largest w."""
    scene, found = taken("follow-the-leader")
    state = homogeneous_state(scene)
    assert state is not None
    v = found["v_bin"].values
    gaussian = np.exp(-((v - state.mean_velocity) ** 2) / (2 * state.temperature)) / math.sqrt(2 * math.pi * state.temperature)
    for w in found["equation"].values:
        assert np.abs(w - gaussian).max() < 0.01 * gaussian.max()


def test_the_inelastic_equation_has_the_moments_of_its_state() -> None:
    scene, found = taken("inelastic")
    state = homogeneous_state(scene)
    assert state is not None
    v = found["v_bin"]
    for w in found["equation"]:
        mean = float((w * v).sum() / w.sum())
        assert mean == pytest.approx(state.mean_velocity, abs=0.01)
        assert float((w * (v - mean) ** 2).sum() / w.sum()) == pytest.approx(state.temperature, rel=0.02)


@BOTH
def test_two_populations(operator: str) -> None:
    """Equal densities everywhere are one homogeneous state; two densities are two, each with its share of the particles."""
    scene = figure_scene(3, operator)
    v = np.linspace(-12, 6, 3001)
    dv = v[1] - v[0]
    one = snapshots.two_populations(scene, np.ones(BINS), v)
    state = homogeneous_state(scene)
    assert state is not None
    assert one.sum() * dv == pytest.approx(1, abs=1e-6)
    assert (v * one).sum() * dv == pytest.approx(state.mean_velocity, abs=1e-6)
    density = np.where(np.arange(BINS) < 10, 2.0, 0.75)
    thick, thin = (
        homogeneous_state(scene.model_copy(update={"initial": scene.initial.model_copy(update={"density": rho})}))
        for rho in (2.0, 0.75)
    )
    assert thick is not None
    assert thin is not None
    two = snapshots.two_populations(scene, density, v)
    assert two.sum() * dv == pytest.approx(1, abs=1e-6)
    assert (v * two).sum() * dv == pytest.approx(0.4 * thick.mean_velocity + 0.6 * thin.mean_velocity, abs=1e-5)
    second = 0.4 * (thick.temperature + thick.mean_velocity**2) + 0.6 * (thin.temperature + thin.mean_velocity**2)
    assert (v**2 * two).sum() * dv == pytest.approx(second, rel=1e-5)


# -- what linear theory expects


def without_correlations(count: int) -> Scene:
    scene = figure_scene(2, count=count)
    return scene.model_copy(update={"collisions": None})


@pytest.mark.parametrize("bins", [10, 50])
def test_independent_particles_have_their_own_contrast(bins: int) -> None:
    """√((bins - 1)/N), exactly, and as measured in 4000 ensembles of 1000 particles, to 2 %."""
    expected = expected_contrast(without_correlations(1000), bins)
    assert expected == pytest.approx(math.sqrt((bins - 1) / 1000), rel=1e-12)
    counts = np.random.default_rng(3).multinomial(1000, np.full(bins, 1 / bins), 4000)
    measured = math.sqrt(np.mean((counts * bins / 1000).var(axis=1)))
    assert measured == pytest.approx(expected, rel=0.02)
    assert expected_contrast(without_correlations(1000), bins, count=4000) == pytest.approx(expected / 2, rel=1e-12)


@BOTH
def test_the_contrast_is_the_sum_over_waves(operator: str) -> None:
    """Σ over 4·bins waves on both sides, and independent particles beyond; what 300 waves see beyond is less than 2 %."""
    scene, bins = figure_scene(2, operator), 12
    m = np.arange(1, 301)
    terms = 2 * structure_factor(scene, m).values * np.sinc(m / bins) ** 2
    beyond = 2 * (np.sinc(np.arange(301, 400_000) / bins) ** 2).sum()
    direct = math.sqrt((terms.sum() + beyond) / scene.particles.count)
    assert expected_contrast(scene, bins) == pytest.approx(direct, rel=0.02)
    assert direct > math.sqrt((bins - 1) / scene.particles.count)


def test_the_contrast_of_waves_of_known_size() -> None:
    """Densities of random waves with the variance S_m/N, averaged over bins: their contrast is the expected one."""
    scene, bins, trials = figure_scene(2, count=1000), 12, 2000
    m = np.arange(1, 4 * bins + 1)
    s = structure_factor(scene, m).values
    rng = np.random.default_rng(2)
    amplitude = np.sqrt(s / 2000) * (rng.normal(size=(trials, m.size)) + 1j * rng.normal(size=(trials, m.size)))
    centres = (np.arange(bins) + 0.5) / bins
    waves = np.exp(2j * np.pi * np.outer(m, centres)) * np.sinc(m / bins)[:, None]
    density = 2 * (amplitude @ waves).real
    white = bins - 1 - 2 * (np.sinc(m / bins) ** 2).sum()
    assert math.sqrt(np.mean(density**2) + white / 1000) == pytest.approx(expected_contrast(scene, bins), rel=0.02)


# -- what is written


def test_the_summary() -> None:
    scene, found = taken("follow-the-leader")
    lines = summary(found)
    u = found["velocity"].values[1, 0]
    row = dict(
        zip(
            lines[0].replace("ρ contrast", "contrast").replace("ρ max/mean", "max").replace("mean v", "u").split(),
            lines[2].split(),
            strict=True,
        )
    )
    assert float(row["time"]) == 0.5
    assert float(row["contrast"]) == pytest.approx(float(found["density_histogram"][1].std()), abs=6e-4)
    assert float(row["max"]) == pytest.approx(float(found["density_histogram"][1].max()), abs=6e-4)
    assert float(row["u"]) == pytest.approx(u.mean(), abs=6e-4)
    assert float(row["variance"]) == pytest.approx(u.var(), abs=6e-4)
    assert float(row["skewness"]) == pytest.approx(((u - u.mean()) ** 3).mean() / u.std() ** 3, abs=6e-4)
    assert float(row["a2"]) == pytest.approx(((u - u.mean()) ** 4).mean() / (3 * u.var() ** 2) - 1, abs=6e-4)
    assert "(2) stays homogeneous: mean v 0.5, variance 1" in lines
    assert f"linear theory of noise: contrast {expected_contrast(scene):.3g} (independent particles" in lines[-1]
    dense = found.assign_attrs(scene=figure_scene(3, count=scene.particles.count).model_dump_json(exclude_none=True))
    assert "noise: too large for linear theory (independent particles" in summary(dense)[-1]
    shown = snapshots.draw_snapshots(dense).get_suptitle()
    assert shown.endswith("their noise is too large for linear theory")


@BOTH
def test_the_picture(operator: str, tmp_path: Path) -> None:
    _, found = taken(operator)
    save_snapshots(found, tmp_path / "figure.png")
    picture = matplotlib.image.imread(tmp_path / "figure.png")
    assert picture.shape[1] > 1.5 * picture.shape[0]
    assert picture.std() > 0.05
    with pytest.raises(SceneError, match=r"nowhere/figure\.png: cannot be written"):
        save_snapshots(found, tmp_path / "nowhere" / "figure.png")


def test_the_snapshots_can_be_compared(tmp_path: Path) -> None:
    """They hold positions and velocities of one ensemble: like those of another seed, unlike faster ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(snapshots, "TIMES", SHORT)
        other = snapshots.snapshots(figure_scene(2, count=2000, seed=2))
    _, found = taken("follow-the-leader")
    for name, dataset in (("one", found), ("other", other), ("faster", found.assign(velocity=found["velocity"] + 0.5))):
        dataset.to_netcdf(tmp_path / f"{name}.nc")
    same = compare.compare(tmp_path / "one.nc", tmp_path / "other.nc")
    assert not same.differ
    assert {row.time for row in same.rows if math.isfinite(row.time)} == set(SHORT)
    assert "2000 particles, one ensemble" in same.sides[0]
    assert compare.compare(tmp_path / "one.nc", tmp_path / "faster.nc").differ


def test_two_fitted_populations() -> None:
    """Means and shares of two known Gaussians, to 4 standard errors or so; of one that is no wider, its own mean twice."""
    rng = np.random.default_rng(1)
    v = np.concatenate([rng.normal(-2.0, 0.5, 3000), rng.normal(1.0, 0.5, 7000)])
    means, shares = snapshots.fit_two(v, 0.25)
    assert means == pytest.approx([-2, 1], abs=4 * 0.5 / math.sqrt(3000))
    assert shares == pytest.approx([0.3, 0.7], abs=4 * math.sqrt(0.21 / 10_000))
    near = np.concatenate([rng.normal(-0.3, 0.5, 4000), rng.normal(0.5, 0.5, 2000)])
    for sample in (v, near):  # the likelihood is stationary: each mean and each share is that of the particles that belong to it
        means, shares = snapshots.fit_two(sample, 0.25)
        likelihood = shares[:, None] * np.exp(-((sample - means[:, None]) ** 2) / 0.5)
        belongs = likelihood / likelihood.sum(axis=0)
        assert belongs @ sample / belongs.sum(axis=1) == pytest.approx(means, abs=1e-6)
        assert belongs.mean(axis=1) == pytest.approx(shares, abs=1e-6)
    narrow = rng.normal(3.0, 0.4, 1000)
    assert snapshots.fit_two(narrow, 0.25)[0] == pytest.approx([narrow.mean()] * 2)


# -- the command


@pytest.fixture
def figure(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """figure("2", …): the command with its times short and its files in `tmp_path`."""
    monkeypatch.setattr(snapshots, "TIMES", SHORT)
    return functools.partial(command, "figure", folder=tmp_path)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("4",), "error: figure 4: allowed: 2, 3 or closure\n"),
        (("2", "--operator", "elastic"), "error: collisions.operator = 'elastic': "),
        (("2", "--count", "0"), "error: particles.count = 0: "),
        (("2", "--seed", "-1"), "error: particles.seed = -1: "),
        (("2", "-o", "there.nc"), "error: there.nc: exists already; use --overwrite to replace it"),
    ],
    ids=["figure", "operator", "count", "seed", "exists"],
)
def test_the_command_refuses(tmp_path: Path, figure: Command, arguments: tuple[str, ...], message: str) -> None:
    (tmp_path / "there.nc").write_text("kept")
    done = figure(*arguments)
    assert done.returncode == 2
    assert done.stderr.startswith(message)
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["there.nc"]
    assert (tmp_path / "there.nc").read_text() == "kept"


@pytest.mark.parametrize(
    ("arguments", "name"),
    [(("2",), "figure_2"), (("3", "--operator", "inelastic"), "figure_3_inelastic"), (("3", "-o", "mine.nc"), "mine")],
    ids=["2", "inelastic", "-o"],
)
def test_the_command(tmp_path: Path, figure: Command, arguments: tuple[str, ...], name: str) -> None:
    done = figure(*arguments, "--count", "200", "--seed", "3")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == f"wrote {name}.nc and {name}.png"
    with xr.open_dataset(tmp_path / f"{name}.nc") as found:
        assert found["time"].values.tolist() == list(SHORT)
        assert found["velocity"].shape == (3, 1, 200)
        assert found.attrs["seed"] == 3
        assert done.stdout.startswith("\n".join(summary(found)))
    assert (tmp_path / f"{name}.png").stat().st_size > 10_000


def test_a_dataset_with_the_name_of_a_picture(figure: Command) -> None:
    assert figure("2", "--count", "100", "-o", "figure.png").returncode == 2
