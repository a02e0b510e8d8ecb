"""How the documentation site is built: `make docs`. Warnings are errors, and every example of the gallery runs."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path
from typing import Any

import kinetic_solver

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # figures.py

project = "kinetic-solver"
author = "The kinetic-solver authors"
copyright = f"2026, {author}"  # the name that Sphinx reads
version = release = kinetic_solver.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["gallery", "sg_execution_times.rst"]
html_theme = "furo"
html_title = "kinetic-solver"
html_show_sphinx = False

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3  # headings down to ### can be linked to
myst_dmath_allow_labels = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
default_role = "code"  # docstrings mark code with single backticks

os.environ.setdefault("MPLBACKEND", "agg")
warnings.filterwarnings("ignore", category=DeprecationWarning, module="sphinx_gallery")

sphinx_gallery_conf: dict[str, Any] = {
    "examples_dirs": str(HERE / "gallery"),
    "gallery_dirs": "examples",
    "image_scrapers": ("figures.held",),
    "reset_modules": (),
    "filename_pattern": r"/plot_",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "within_subsection_order": "FileNameSortKey",
}


def plain(app: Any, what: str, name: str, thing: object, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with code between backticks: |u| and f* stand for themselves."""
    for number, line in enumerate(lines):
        parts = line.split("`")
        parts[::2] = [part.replace("|", r"\|").replace("*", r"\*") for part in parts[::2]]
        lines[number] = "`".join(parts)


def setup(app: Any) -> None:
    app.connect("autodoc-process-docstring", plain)
