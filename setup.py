"""What pyproject.toml cannot say: the scenes, which lie beside the packages, are installed with them (scene/shipped.py)."""

from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).parent


class BuildWithScenes(build_py):
    def run(self) -> None:
        super().run()
        if self.editable_mode:
            return
        target = Path(self.build_lib) / "kinetic_solver" / "scenes"
        self.mkpath(str(target))
        for scene in sorted((ROOT / "scenes").glob("*.toml")):
            self.copy_file(str(scene), str(target / scene.name))


setup(cmdclass={"build_py": BuildWithScenes})
