"""docs/extending.md: its code runs, and laws of one's own give what is known."""

from __future__ import annotations

import math
import re
import sys
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import root

from kinetic_solver import CollisionLaw, PairLaw, Scene, SceneError, exact, hydrodynamics, run_to_file, solve
from kinetic_solver.compare import compare
from kinetic_solver.errors import RunUnfinished
from kinetic_solver.laws import Inelastic
from kinetic_solver.scene import Accuracy
from particles import simulate

MakeScene = Callable[..., Scene]
STILL = {"gravity": 0.0, "friction": 0.0, "noise": 0.0}
PAGE = Path(__file__).parents[2] / "docs" / "extending.md"


@pytest.fixture(scope="module")
def page() -> Iterator[dict[str, Any]]:
    """The names that the page's code leaves behind."""
    module = types.ModuleType("page")  # dataclasses look their module up
    monkey = pytest.MonkeyPatch()
    monkey.setitem(sys.modules, "page", module)
    names = vars(module)
    code = "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))
    exec(compile(code, str(PAGE), "exec"), names)
    yield names
    monkey.undo()


def test_the_page(page: dict[str, Any]) -> None:
    """The runs end, name their law, keep mass, close their budgets, and grid and particles agree."""
    for run, name in ((page["run"], "BGK"), (page["on_grid"], "Softening"), (page["ensemble"], "Softening")):
        assert int(run["status"]) == 1
        assert name in run.attrs["law"]
    for run in (page["run"], page["on_grid"]):
        assert abs(run["mass"] / run["mass"][0] - 1).max() < 1e-13
        moved = sum(float(abs(run[name]).max()) for name in run if str(name).startswith("energy_from_"))
        assert abs(run["energy_residual"]).max() < 1e-5 * moved
    for run, law in ((page["run"], page["BGK"](2.5)), (page["on_grid"], page["law"])):
        fine = solve(page["scene"].model_copy(update={"accuracy": Accuracy(rtol=1e-7)}), operator=law)
        assert abs(run["energy"] - fine["energy"]).max() < 1e-4 * fine["energy"].max()
        coarse, finer = (np.fft.rfft(d["density"].values, axis=1) / d.sizes["x"] for d in (run, fine))
        shared = min(coarse.shape[1], finer.shape[1])
        assert 2 * np.abs(coarse[:, :shared] - finer[:, :shared]).sum(axis=1).max() < 1e-4 * float(fine["density"].max())
    assert abs(page["run"]["energy_from_collisions"]).max() < 1e-5 * float(page["run"]["energy"].max())
    grid, ensemble = page["on_grid"].isel(time=-1), page["ensemble"].isel(time=-1)
    for name in ("momentum", "energy"):
        assert abs(float(grid[name] - ensemble[name])) < 4 * float(ensemble[f"{name}_stderr"]), name


def test_bgk_relaxes_a_homogeneous_state_in_closed_form(page: dict[str, Any], make_scene: MakeScene) -> None:
    """f = M + (f0 - M) exp(-νt), M the Maxwellian of f0's moments, which stay: from two beams."""
    bgk = page["BGK"](0.8)
    v = np.linspace(-12, 14, 401)
    f0 = np.exp(-((v - 2) ** 2)) + 0.5 * np.exp(-((v + 1) ** 2) / 0.8)
    rate = bgk.rate(f0[None], v)[0]
    m = rate / 0.8 + f0
    for power in range(3):
        assert ((m - f0) * v**power).sum() == pytest.approx(0, abs=1e-12 * (f0 * abs(v) ** power).sum())
    later = f0
    for _ in range(400):  # Runge's midpoint rule over 2/ν
        later = later + 0.00625 * bgk.rate((later + 0.003125 * bgk.rate(later[None], v)[0])[None], v)[0]
    assert later == pytest.approx(m + (f0 - m) * math.exp(-0.8 * 2.5), abs=1e-6 * f0.max())


def bgk_roots(k: float, nu: float, theta: float, guesses: list[complex]) -> list[complex]:
    """s of waves exp(ikx + st) under BGK: det(1 - νG) = 0, G_mn = ∫φ_m φ_n M/(s + ν + ikv) dv over what is conserved."""
    w = np.linspace(-11, 11, 4001)
    weight = np.exp(-(w**2) / 2) / math.sqrt(2 * math.pi) * (w[1] - w[0])
    phi = np.array([np.ones_like(w), w, (w**2 - 1) / math.sqrt(2)])

    def determinant(s: complex) -> complex:
        g = np.einsum("mv,nv,v->mn", phi, phi, weight / (s + nu + 1j * k * math.sqrt(theta) * w))
        return complex(np.linalg.det(np.eye(3) - nu * g))

    def parts(z: np.ndarray) -> list[float]:
        value = determinant(complex(z[0], z[1]))
        return [value.real, value.imag]

    return [complex(*root(parts, [guess.real, guess.imag], tol=1e-13).x) for guess in guesses]


def exponents(c: np.ndarray, dt: float, count: int) -> np.ndarray:
    """s of Σ a_j exp(s_j t) sampled at equal times: Prony's method by least squares."""
    rows = np.array([c[n : n + count] for n in range(c.size - count)])
    polynomial = np.linalg.lstsq(rows, -c[count:], rcond=None)[0]
    return np.log(np.roots(np.append(1.0, polynomial[::-1]))) / dt


def test_bgk_waves_decay_as_its_dispersion_relation_says(page: dict[str, Any]) -> None:
    """Two sound waves and the mode of heat, once the rest has died out as exp(-νt): |Δs|/|s| < 1e-6."""
    nu, theta, length = 4.0, 0.8, 16.0
    scene = Scene.model_validate(
        {
            "model": STILL,
            "pipe": {"length": length},
            "initial": {"density": 1.3, "modes": [{"mode": 1, "cos": 1e-4}], "mean_velocity": 0.0, "temperature": theta},
            "run": {"end_time": 12.0, "output_every": 0.25},
            "accuracy": {"rtol": 1e-10},
            "output": {"f": False, "budgets": False},
        }
    )
    run = solve(scene, operator=page["BGK"](nu))
    c = np.fft.rfft(run["density"].values, axis=1)[:, 1] / run.sizes["x"]
    late = c[16:]  # exp(-16) of the continuum
    k, sound = 2 * math.pi / length, math.sqrt(3 * theta)
    expected = bgk_roots(k, nu, theta, [1j * k * sound - 0.03, -1j * k * sound - 0.03, -0.03 + 0j])
    found = exponents(late, 0.25, 3)
    for s in expected:
        assert np.abs(found - s).min() < 1e-6 * abs(s), (s, found)


@dataclass(frozen=True)
class Twelve(PairLaw):
    """Operator (12) written anew."""

    cross_section: float
    restitution: float
    conserves = ("mass", "momentum")

    @staticmethod
    def after(r: float, *numbers: float) -> tuple[float, float]:
        return 0.5 * (1 - numbers[1]) * r, 0.5 * (1 + numbers[1]) * r


def test_operator_12_through_the_public_door(make_scene: MakeScene) -> None:
    """On the grid to round-off of the scheme; as particles to the last bit."""
    given = {"initial": {"mean_velocity": -0.4, "temperature": 0.9}, "particles": {"count": 2000, "replicas": 2}}
    inside = make_scene(collisions={"operator": "inelastic", "cross_section": 0.9, "restitution": 0.6}, **given)
    outside, law = make_scene(**given), Twelve(0.9, 0.6)
    grid = {"nx": 35, "nv": 64, "velocity_window": (-5.5, 7.0), "stepping": "extrapolated"}
    gridded = [scene.model_copy(update={"grid": type(scene.grid)(**grid)}) for scene in (inside, outside)]
    ours, theirs = solve(gridded[0]), solve(gridded[1], operator=law)
    assert abs(ours["f"] - theirs["f"]).max() < 1e-12 * ours["f"].max()
    assert xr.Dataset.equals(simulate(inside), simulate(outside, operator=law))
    found = solve(outside, operator=law)
    fine = solve(inside.model_copy(update={"accuracy": type(inside.accuracy)(rtol=1e-6)}))
    assert float(found["energy"][-1]) == pytest.approx(float(fine["energy"][-1]), rel=1e-4)


@dataclass(frozen=True)
class Six(PairLaw):
    """Operator (6) written anew."""

    cross_section: float
    conserves = ("mass",)

    @staticmethod
    def after(r: float, *numbers: float) -> tuple[float, float]:
        return 0.0, 0.0


class SixBackwards(Six):
    """The slower particle takes the velocity of the faster one."""

    @staticmethod
    def after(r: float, *numbers: float) -> tuple[float, float]:
        return r, r


AMPLIFIED_SCENE = {
    "model": {"gravity": 0.6, "friction": 0.7, "noise": 1.3},
    "pipe": {"length": 6.0},
    "initial": {"density": 1.2, "modes": [{"mode": 1, "cos": 0.5}], "mean_velocity": 0.4, "temperature": 0.9},
    "run": {"end_time": 2.0, "output_every": 0.5},
}
FREE = {"gravity": 0.6, "friction": 0.0, "noise": 0.0}


@pytest.mark.parametrize(
    ("cross_section", "rtol", "changes"),
    [
        (3.0, 1e-2, {}),
        (3.0, 1e-3, {}),
        (3.0, 1e-4, {}),
        (1.8, 1e-5, {}),
        (3.0, 1e-5, {"model": FREE, "run": {"end_time": 0.8}}),
        (3.0, 1e-4, {"initial": {"density": 1.2, "mean_velocity": 0.4, "temperature": 0.9}}),
    ],
)
def test_operator_6_through_the_public_door(cross_section: float, rtol: float, changes: dict[str, Any]) -> None:
    """Such a law amplifies what is in the slow tail, by exp(22) at S = 3: the run knows it by the law's record, and meets rtol;
    its estimate is no less than half of the error."""
    scene = Scene.model_validate({**AMPLIFIED_SCENE, "accuracy": {"rtol": rtol}, **changes})
    run = solve(scene, operator=Six(cross_section))
    known = scene.replace(collisions={"operator": "follow-the-leader", "cross_section": cross_section})
    truth = exact.solve(known, x=run["x"].values, v=run["v"].values)["f"]
    error = float(abs(run["f"].values - truth.values).max() / truth.max())
    assert error < rtol
    assert error / 2 < float(run["error_estimate"][-1]) < rtol


def test_pairs_that_become_faster_amplify_the_fast_tail() -> None:
    """The mirror image, velocity by velocity: of a law that slows pairs down."""
    scene = Scene.model_validate({**AMPLIFIED_SCENE, "accuracy": {"rtol": 1e-3}})
    mirrored = scene.replace(**{"model.gravity": -0.6, "initial.mean_velocity": -0.4})
    run, mirror = solve(scene, operator=Six(3.0)), solve(mirrored, operator=SixBackwards(3.0))
    assert mirror["v"].values == pytest.approx(-run["v"].values[::-1], abs=1e-12)
    density = mirror["density"].values[:, -np.arange(run.sizes["x"])]
    assert abs(density - run["density"].values).max() < 1e-9 * density.max()


def test_the_record_says_by_how_much_pairs_slow_down(page: dict[str, Any]) -> None:
    for law, share in ((Six(2.0), 1.0), (SixBackwards(2.0), -1.0), (Twelve(2.0, 0.6), 0.0), (page["BGK"](2.0), 0.0)):
        assert law.slows(1.7) == share
    assert Outside(1.0).slows(0.6) == pytest.approx(0.75)


@pytest.mark.parametrize("method", ["grid", "particles"])
def test_a_run_goes_on_with_its_own_law_only(make_scene: MakeScene, tmp_path: Path, method: str) -> None:
    """Name and parameters are compared, of a run that was stopped and of one that has ended."""
    scene = make_scene(
        grid={"nx": 9, "nv": 32}, accuracy={"rtol": 1e-2}, particles={"count": 200}, run={"end_time": 1.0, "output_every": 0.5}
    )
    law, path = Twelve(0.9, 0.6), tmp_path / "a.nc"
    with pytest.raises(RunUnfinished):
        run_to_file(scene, path, method, max_walltime=0, operator=law)
    for other, name in ((Twelve(0.9, 0.7), r".*Twelve.*0\.7"), (None, "what the scene says")):
        with pytest.raises(SceneError, match=rf"is of law = .*0\.6.*, this run of {name}"):
            run_to_file(scene, path, method, resume=True, operator=other)
    run_to_file(scene, path, method, resume=True, operator=law)
    with pytest.raises(SceneError, match=r"is of law = .*0\.6"):
        run_to_file(scene, path, method, resume=True, operator=Twelve(0.9, 0.7))
    run_to_file(scene, tmp_path / "b.nc", method, operator=law)
    with xr.open_dataset(path) as found, xr.open_dataset(tmp_path / "b.nc") as expected:
        assert found.drop_attrs().identical(expected.drop_attrs())


class Leaky(CollisionLaw):
    conserves = ("mass", "momentum")

    def rate(self, f: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -0.1 * f * v


class Ragged(CollisionLaw):
    def rate(self, f: np.ndarray, v: np.ndarray) -> np.ndarray:
        return f[:, :-1]


class Silent(CollisionLaw):
    pass


@dataclass(frozen=True)
class Outside(PairLaw):
    cross_section: float = 1.0

    @staticmethod
    def after(r: float, *numbers: float) -> tuple[float, float]:
        return -0.25 * r, 0.5 * r


@dataclass(frozen=True)
class Liar(PairLaw):
    cross_section: float = 1.0
    conserves = ("mass", "momentum", "energy")

    @staticmethod
    def after(r: float, *numbers: float) -> tuple[float, float]:
        return 0.25 * r, 0.75 * r


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (Leaky(), r"Leaky: says that it conserves mass, but its rate makes 1 of what it moves"),
        (Ragged(), r"Ragged: rate\(f, v\) of an f of shape \(\d+, 240\) is \(\d+, 239\)"),
        (Silent(), r"Silent: has no rate"),
        (Outside(), r"Outside: after\(r, …\) leaves velocities 0\.25 r outside"),
        (Liar(), r"Liar: says that it conserves energy, but after\(r, …\) misses it by 0\.38"),
    ],
)
def test_laws_that_are_not_what_they_say(make_scene: MakeScene, law: CollisionLaw, message: str) -> None:
    with pytest.raises(SceneError, match=message) as caught:
        solve(make_scene(), operator=law)
    assert "\n" not in str(caught.value)


def test_what_goes_with_what(page: dict[str, Any], make_scene: MakeScene, tmp_path: Path) -> None:
    bgk, both = page["BGK"](1.0), make_scene(collisions={"operator": "follow-the-leader", "cross_section": 0.5})
    for call in (solve, simulate):
        with pytest.raises(SceneError, match="collisions: the scene has a table, and operator = "):
            call(both, operator=bgk)
    with pytest.raises(SceneError, match="BGK: says nothing of pairs; particles need a PairLaw"):
        simulate(make_scene(), operator=bgk)
    with pytest.raises(SceneError, match="BGK: has no closed form"):
        run_to_file(make_scene(), tmp_path / "x.nc", "exact", operator=bgk)
    with pytest.raises(SceneError, match=r"grid\.velocity = 'hermite': operator BGK has no rate in Hermite functions"):
        solve(make_scene(grid={"velocity": "hermite"}, initial={"temperature": 0.5}), operator=bgk)
    with pytest.raises(SceneError, match=r"grid\.stepping = 'strang': operator BGK has no substep"):
        solve(make_scene(grid={"stepping": "strang"}), operator=bgk)


def test_the_file_names_the_law_and_theory_has_none_of_it(page: dict[str, Any], make_scene: MakeScene, tmp_path: Path) -> None:
    from kinetic_solver.analysis.measured_rates import measured_rates

    scene, law = make_scene(run={"end_time": 0.4, "output_every": 0.1}), page["Softening"](0.7, 1.5)
    run_to_file(scene, tmp_path / "grid.nc", operator=law)
    few = scene.model_copy(update={"particles": type(scene.particles)(count=5000, replicas=8)})
    run_to_file(few, tmp_path / "particles.nc", "particles", operator=law)
    with xr.open_dataset(tmp_path / "grid.nc") as run:
        assert run.attrs["law"] == '{"name": "Softening", "parameters": {"cross_section": 0.7, "scale": 1.5}}'
        with pytest.raises(SceneError, match="law 'Softening': there is no linear theory of it here"):
            measured_rates(run)
    found = compare(tmp_path / "grid.nc", tmp_path / "particles.nc")
    assert any("law 'Softening'" in note for note in found.notes)


def test_the_papers_laws_by_their_records() -> None:
    law = Inelastic(0.9, 0.6)
    assert law.frequency(1.3, 4.0) == pytest.approx(0.9 * 1.3 * 2.0)
    # The estimate that an unknown law gets is of the order of what is known.
    unknown = CollisionLaw.frequency(RateOfTwelve(), 1.3, 4.0)
    assert 0.3 < unknown / law.frequency(1.3, 4.0) < 10


class RateOfTwelve(CollisionLaw):
    def rate(self, f: np.ndarray, v: np.ndarray) -> np.ndarray:
        from kinetic_solver.operators.collisions import Inelastic as OnPoints

        return OnPoints(v, 0.9, 0.6, "quintic").rate(f)


class Failing(CollisionLaw):
    def rate(self, f: np.ndarray, v: np.ndarray) -> np.ndarray:
        return f.foo  # type: ignore[attr-defined,no-any-return]


class Backwards(CollisionLaw):
    def rate(self, f: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.zeros_like(f)

    def frequency(self, density: float, temperature: float) -> float:
        return -1.0


class Unsized(PairLaw):
    @staticmethod
    def after(r: float, *numbers: float) -> tuple[float, float]:
        return 0.0, 0.0


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("bgk", "operator: str is of another type; allowed: an instance of"),
        (Failing, "operator: Failing is the class itself; allowed: an instance of"),
        (Failing(), r"operator Failing: rate\(f, v\) fails: AttributeError"),
        (Backwards(), r"operator Backwards: frequency\(.*\) is -1\.0; allowed: a finite number"),
        (Unsized(), "operator Unsized: has no cross_section; allowed: a number"),
    ],
)
def test_what_is_no_law(make_scene: MakeScene, tmp_path: Path, law: Any, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        solve(make_scene(), operator=law)
    with pytest.raises(SceneError, match=message):
        run_to_file(make_scene(), tmp_path / "a.nc", operator=law)
    if not isinstance(law, CollisionLaw) or isinstance(law, PairLaw):
        with pytest.raises(SceneError, match=message):
            simulate(make_scene(), operator=law)


@pytest.mark.parametrize("scene", ["scene.toml", {"model": {"gravity": 1.0}}])
def test_what_is_no_scene(tmp_path: Path, scene: Any) -> None:
    """In one line, by whatever door."""
    for call in (solve, simulate, exact.solve, hydrodynamics.solve, lambda one: run_to_file(one, tmp_path / "a.nc")):
        with pytest.raises(SceneError, match=rf"^scene: is of type {type(scene).__name__}; allowed: a Scene;"):
            call(scene)
