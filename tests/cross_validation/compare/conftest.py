"""Fixtures of the comparisons' tests."""

from __future__ import annotations

import pytest
import xarray as xr

from tests.cross_validation.compare.laid_over import GRID, MakeScene, ensemble


@pytest.fixture
def run(make_scene: MakeScene) -> xr.Dataset:
    return ensemble(make_scene(particles={"count": 3000, "replicas": 8}, grid=GRID, output={"particles": True}))
