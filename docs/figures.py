"""What the gallery shows: every matplotlib figure that an example holds in a variable, whether pyplot knows it or not."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

_shown: set[int] = set()


def held(block: Any, variables: dict[str, Any], conf: dict[str, Any], **options: Any) -> str:
    """Scraper of sphinx-gallery: saves figures that are new since the block before, and returns the text that shows them."""
    paths = variables["image_path_iterator"]
    files = []
    for found in list(variables["example_globals"].values()):
        if isinstance(found, Figure) and id(found) not in _shown:
            _shown.add(id(found))
            file = next(paths)
            found.savefig(file, dpi=110)
            files.append(file)
    return str(figure_rst(files, conf["src_dir"]))
