"""A full disk: one line, exit code 1, and what was written can be read and gone on from. A limit on file sizes stands for it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from kinetic_solver import Scene, run_to_file
from kinetic_solver.dataset import open_run
from kinetic_solver.methods import METHODS

SCENE = """
[pipe]
length = 9.0
[collisions]
operator = "follow-the-leader"
cross_section = 0.9
[initial]
modes = [{ mode = 1, cos = 0.4 }]
[run]
end_time = 1.5
output_every = 0.05
[grid]
nx = 15
nv = 64
[accuracy]
rtol = 1e-2
[particles]
count = 1000
replicas = 2
"""
LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
sys.argv = ["kinetic-solver", *sys.argv[2:]]
from kinetic_solver.cli import main
main()
"""


def limited(size: int, *arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", LIMITED, str(size), *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize("method", METHODS)
def test_a_run_that_fills_the_disk(tmp_path: Path, method: str) -> None:
    """Hydrodynamics keeps frames that may still be refined in a file of their own, which is full first."""
    full, limit, points = ("out.nc", 160_000, 15) if method != "hydrodynamics" else ("out.nc.frames", 90_000, 96)
    (tmp_path / "scene.toml").write_text(SCENE.replace("nx = 15", f"nx = {points}"))
    scene = Scene.from_toml(tmp_path / "scene.toml")
    run_to_file(scene, tmp_path / "straight.nc", method)  # first: what it compiles is kept in files, too
    done = limited(limit, "run", "scene.toml", "-o", "out.nc", "--method", method, folder=tmp_path)
    line = f"{full}: cannot be written (File too large); make room, and resume the run"
    said = [line for line in done.stderr.splitlines() if not line.startswith(("t = ", "starting"))]
    assert (done.returncode, done.stdout, said) == (1, "", [f"error: {line}"])
    path = tmp_path / "out.nc"
    with open_run(path) as left:
        frames = left.sizes["time"]
        assert (int(left["status"]), left.attrs["stopped"]) == (2, line)
    assert 1 <= frames < 31  # what came within the last second is lost
    assert not list(tmp_path.glob("*.part"))
    run_to_file(scene, path, method, resume=True)
    with open_run(path) as found, open_run(tmp_path / "straight.nc") as expected:
        assert found.drop_attrs().identical(expected.drop_attrs())


def test_no_room_for_a_first_frame(tmp_path: Path) -> None:
    """Nothing is left, and no crash."""
    (tmp_path / "scene.toml").write_text(SCENE)
    done = limited(3000, "run", "scene.toml", "-o", "out.nc", "--method", "exact", folder=tmp_path)
    assert done.returncode == 1
    assert done.stderr == "error: out.nc: cannot be written (no room for its header); make room, and resume the run\n"
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]
