"""Whether a run's folders can be made where they belong: asked before any work."""

from __future__ import annotations

from pathlib import Path

from gpusim.errors import InputError
from gpusim.files.output_folder import check_below, inside
from gpusim.plan.state import variant_folder
from gpusim.scene import Scene

__all__ = ["check_folders"]

_FILES = ("report.html", "report.json", "scene.toml", "state.json", "truth.h5")
_FOLDERS = ("budget", "figures", "images", "measure", "solution", "stl", "variants")


def check_folders(scene: Scene, out: Path) -> None:
    """Raises InputError naming the first thing in ``out`` that has the name of a folder or file
    that the run writes, but is something else, leads elsewhere or can't be written."""
    check_below(out, *_FOLDERS)
    for root in (out, *(variant_folder(out, variant.name) for variant in scene.variants)):
        check_below(root, *(f"images/{camera.name}" for camera in scene.cameras), *_FOLDERS)
        for name in _FILES:
            if inside(root, name).is_dir():
                raise InputError(f"{root / name}: is a folder; expected a file, or nothing")
