"""The ``[[camera]]`` tables of a scene, and the cameras that they describe."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from gpusim.files.input_file import Reader
from gpusim.scene.description.model import CameraTable


class CameraTables(tuple[CameraTable, ...]):
    """A scene's tables, in their order; called, its cameras.

    Examples
    --------
    >>> scene = gs.load_scene("bar.toml")
    >>> scene.cameras[0].focal_mm, scene.cameras()["side"].width
    (50.0, 450)
    """

    read: Reader
    """How calibration files that they name are read."""

    def __call__(self) -> dict[str, Any]:
        """The cameras (`gs.Camera`) by name, m. Raises InputError for a calibration file that
        doesn't fit, or a lens that folds in the image."""
        # what reads scenes knows no numerics
        build = import_module("gpusim.pipeline.scene_objects.cameras").build_camera
        return {table.name: build(table, self.read) for table in self}
