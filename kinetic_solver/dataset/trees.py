"""Trees of plain values and arrays, as JSON and a list of arrays: what a checkpoint holds, without pickles.

A tree is a number, a text, a truth value, None, an array, or a tuple, list, dict with text keys, or dataclass of trees. Floats
keep every bit, infinities and NaN included.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

KIND = "kind"
"""The key that marks what JSON has no form for."""


def pack(tree: Any, arrays: list[np.ndarray]) -> Any:
    """What json.dumps takes; arrays are appended to `arrays`, each once, however often the tree holds it.

    Raises ValueError for what is no tree: nothing is left out in silence.
    """
    if tree is None or isinstance(tree, bool | int | str):
        return tree
    if isinstance(tree, float | np.floating):
        return float(tree)
    if isinstance(tree, np.integer):
        return int(tree)
    if isinstance(tree, np.ndarray):
        number = next((n for n, known in enumerate(arrays) if known is tree), len(arrays))
        if number == len(arrays):
            arrays.append(tree)
        return {KIND: "array", "number": number}
    if isinstance(tree, list):
        return [pack(item, arrays) for item in tree]
    if isinstance(tree, tuple):
        return {KIND: "tuple", "items": [pack(item, arrays) for item in tree]}
    if isinstance(tree, dict) and KIND not in tree and all(isinstance(key, str) for key in tree):
        return {key: pack(item, arrays) for key, item in tree.items()}
    if dataclasses.is_dataclass(tree) and not isinstance(tree, type):
        fields = {field.name: pack(getattr(tree, field.name), arrays) for field in dataclasses.fields(tree)}
        return {KIND: type(tree).__name__, "fields": fields}
    # a programming error
    raise ValueError(f"a checkpoint cannot hold a {type(tree).__name__}")


def unpack(packed: Any, arrays: list[np.ndarray], types: Mapping[str, type]) -> Any:
    """The tree again. `types` names the dataclasses that it may hold. Raises KeyError, IndexError or TypeError for any other."""
    if isinstance(packed, list):
        return [unpack(item, arrays, types) for item in packed]
    if not isinstance(packed, dict):
        return packed
    kind = packed.get(KIND)
    if kind is None:
        return {key: unpack(item, arrays, types) for key, item in packed.items()}
    if kind == "array":
        return arrays[packed["number"]]
    if kind == "tuple":
        return tuple(unpack(item, arrays, types) for item in packed["items"])
    return types[kind](**{name: unpack(item, arrays, types) for name, item in packed["fields"].items()})
