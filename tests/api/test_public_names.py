"""What completion offers: public names and nothing else."""

from __future__ import annotations

import importlib
import subprocess
import sys

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
    with pytest.raises(AttributeError, match=f"{name}.* has no attribute 'nothing'"):
        getattr(module, "nothing")  # noqa: B009


def test_what_takes_time_is_imported_when_it_is_asked_for() -> None:
    code = (
        "import sys, gpusim.mesh\n"
        "assert 'read_mesh' in dir(gpusim.mesh)\n"
        "assert 'gpusim.mesh.formats.reader' not in sys.modules\n"
        "assert callable(gpusim.mesh.read_mesh) and 'gpusim.mesh.formats.reader' in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
