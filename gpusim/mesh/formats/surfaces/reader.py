"""Files of faces without solids: STL, PLY, OBJ, OFF, glTF."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh.formats.surfaces.formats import gltf, obj, off, stl
from gpusim.mesh.formats.surfaces.ply import ply

__all__ = ["read_surface"]

_FORMATS = {".stl": stl, ".ply": ply, ".obj": obj, ".off": off, ".glb": gltf, ".gltf": gltf}
_FARTHEST = 1e15


def read_surface(
    path: str | os.PathLike[str] | InputFile,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    """Points (P, 3) and faces (F, 4), the last column -1 for triangles; any unit of length.

    Points at the same place (an STL repeats them for every triangle) become one; faces that are
    no faces then are left out. Raises InputError, naming the file, and the line of a text: faces of
    more than four corners, and whatever else the format has that would change the surface.

    Examples
    --------
    >>> cube = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    >>> gs.export.write_stl("cube.stl", cube.points, gs.mesh.boundary_faces(cube).nodes).name
    'cube.stl'
    >>> points, faces = gs.mesh.read_surface("cube.stl")
    >>> points.shape, faces.shape
    ((8, 3), (12, 4))
    """
    name = path.path if isinstance(path, InputFile) else Path(path)
    kind = _FORMATS.get(name.suffix.lower())
    if kind is None:
        raise InputError(f"{name}: got {name.suffix!r}; expected one of {', '.join(_FORMATS)}")
    file = read_input(path, "a file of faces")
    points, faces = kind(file)
    if not len(faces):
        raise InputError(f"{name}: no triangles or quadrilaterals in space; expected some")
    if not (np.abs(points) < _FARTHEST).all():
        raise InputError(f"{name}: a coordinate isn't finite; expected numbers below {_FARTHEST:g}")
    if faces.max() >= len(points) or faces[:, :3].min() < 0 or faces.min() < -1:
        raise InputError(
            f"{name}: a face names point {faces.max()}; got {len(points)} points, from 0"
        )
    points, merged = np.unique(points, axis=0, return_inverse=True)
    faces = np.where(faces < 0, -1, merged.reshape(-1)[np.maximum(faces, 0)])
    last = np.where(faces[:, 3] < 0, faces[:, 2], faces[:, 3])
    a, b, c, d = (points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]], points[last])
    flat = ~(np.linalg.norm(np.cross(c - a, np.where((faces[:, 3] < 0)[:, None], b - a, d - b)),
                            axis=1) > 0.0)  # fmt: skip
    if flat.all():
        raise InputError(f"{name}: {len(flat)} faces without area; expected some with")
    return points, faces[~flat].astype(np.int32)
