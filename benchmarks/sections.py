"""A benchmark of several sections: those named on the command line, or all."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping


def run_sections(sections: Mapping[str, Callable[[], None]]) -> None:
    """Each under a heading, with the seconds it took. A name that is none of them ends the run with exit code 2."""
    asked = sys.argv[1:] or list(sections)
    if unknown := [name for name in asked if name not in sections]:
        print(f"sections: {', '.join(unknown)}: unknown; allowed: {', '.join(sections)}", file=sys.stderr)
        raise SystemExit(2)
    for name in asked:
        began = time.perf_counter()
        print(f"\n## {name}", flush=True)
        sections[name]()
        print(f"\n{name}: {time.perf_counter() - began:.0f} s", flush=True)
