"""What completion offers: public names and nothing else."""

from __future__ import annotations

import importlib

import pytest

PUBLIC = (
    "gpusim",
    "gpusim.applications",
    "gpusim.deck",
    "gpusim.errors",
    "gpusim.export",
    "gpusim.fem",
    "gpusim.field",
    "gpusim.gpu",
    "gpusim.measure",
    "gpusim.mesh",
    "gpusim.optics",
    "gpusim.optics.lens.psf",
    "gpusim.pipeline",
    "gpusim.report",
    "gpusim.scene",
    "gpusim.surface",
    "gpusim.surface.paint",
)


@pytest.mark.parametrize("name", PUBLIC)
def test_dir_shows_public_names(name: str) -> None:
    module = importlib.import_module(name)
    assert dir(module) == sorted(module.__all__)
    assert [public for public in module.__all__ if not hasattr(module, public)] == []
