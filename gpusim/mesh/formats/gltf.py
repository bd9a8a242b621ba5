"""Meshes of glTF files, by trimesh."""

from __future__ import annotations

from typing import Any

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile

__all__ = ["gltf_meshes"]


def gltf_meshes(file: InputFile) -> list[Any]:
    """Trimesh's meshes where the file's nodes place them; a .gltf holds its buffers itself.

    Raises InputError for a file that trimesh can't read.
    """
    import trimesh  # takes a second, for one format

    kind = file.path.suffix.lower()[1:]
    try:
        scene = trimesh.load_scene(file.stream(), file_type=kind, process=False)
        return [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh)]
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, MemoryError) as error:
        said = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        raise InputError(
            f"{file.path}: damaged, no glTF, or with buffers in other files (save as .glb); got "
            f"{said}"
        ) from None
