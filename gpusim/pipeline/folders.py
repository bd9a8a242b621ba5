"""Whether a run's folders can be made where they belong: asked before any work."""

from __future__ import annotations

from pathlib import Path

from gpusim.errors import InputError
from gpusim.scene import Scene
from gpusim.state import variant_folder

__all__ = ["check_folders"]

_FOLDERS = ("figures", "images", "measure", "solution", "stl", "variants")


def check_folders(scene: Scene, out: Path) -> None:
    """Raises InputError naming the first thing in ``out`` that is no folder, but has the name of
    one that the run writes into."""
    for root in (out, *(variant_folder(out, variant.name) for variant in scene.variants)):
        cameras = (root / "images" / camera.name for camera in scene.cameras)
        for place in (root, *(root / name for name in _FOLDERS), *cameras):
            if place.exists() and not place.is_dir():
                raise InputError(
                    f"run: {place} is no folder; expected a folder, or nothing of that name"
                )
