"""A whole scene somewhere else: every place that its file names, and the meshes of its bodies.

Meshes of boxes are moved by their key; builders without one and files are moved as they are made.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpusim.field import Field
from gpusim.files.input_file import Reader, read_input
from gpusim.mesh import Mesh
from gpusim.pipeline.scene_objects import surfaces
from gpusim.scene.description import model
from gpusim.scene.scene import Scene

PLACES = {
    "position_mm", "positions_mm", "target_mm", "center_mm", "origin_mm", "start_mm", "end_mm",
    "axis_point_mm",
}  # fmt: skip
"""Keys of world coordinates, wherever they stand; a notch's position is along its body."""

LIMITS = tuple(f"{axis}_{end}_mm" for axis in "xyz" for end in ("min", "max"))


def moved(value: Any, offset: np.ndarray, key: str = "") -> Any:
    """A document, or a part of it, with its places moved by ``offset`` (3,) m."""
    if key.endswith("notch"):
        return value
    if isinstance(value, Mapping):
        result = {name: moved(part, offset, name) for name, part in value.items()}
        if value.get("builder") == "box":
            result["origin_mm"] = moved(
                value.get("origin_mm", [0.0, 0.0, 0.0]), offset, "origin_mm"
            )
        if "translation_mm" in value:
            raise NotImplementedError("a camera by rotation and translation")
        return result
    if key in PLACES:
        return (np.array(value) + 1e3 * offset).tolist()
    if key in LIMITS:
        return value + 1e3 * float(offset["xyz".index(key[0])])
    if isinstance(value, list):
        return [moved(part, offset) if isinstance(part, Mapping) else part for part in value]
    return value


def moved_scene(path: Path, offset: np.ndarray, overrides: Mapping[str, Any]) -> Scene:
    """The scene of a file with its places moved by ``offset`` (3,) m."""
    document = moved(tomllib.loads(path.read_text()), offset)
    return Scene.from_document(document, overrides=overrides, folder=path.parent)


def move_meshes(monkeypatch: pytest.MonkeyPatch, offset: np.ndarray) -> None:
    """From now on the meshes of bodies are made elsewhere, by ``offset`` (3,) m."""
    made, read = surfaces.build_mesh, surfaces.read_given_field

    def elsewhere(grid: Mesh) -> Mesh:
        return grid.moved(np.broadcast_to(offset, grid.points.shape))

    def build_mesh(recipe: model.MeshRecipe, reader: Reader = read_input) -> Mesh:
        mesh = made(recipe, reader)
        return mesh if isinstance(recipe, model.BoxMeshTable) else elsewhere(mesh)

    def read_field(recipe: model.FieldMeshTable, reader: Reader = read_input) -> Field:
        found = read(recipe, reader)
        found.mesh = elsewhere(found.mesh)
        return found

    monkeypatch.setattr(surfaces, "build_mesh", build_mesh)
    monkeypatch.setattr(surfaces, "read_given_field", read_field)
