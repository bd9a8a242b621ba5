"""Files of faces without solids: STL, PLY, OBJ, OFF, through meshio."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.input_file import InputFile
from gpusim.mesh.read_meshio import read_content

__all__ = ["read_surface"]

_FORMATS = {".stl": "stl", ".ply": "ply", ".obj": "obj", ".off": "off"}


def read_surface(
    path: str | os.PathLike[str] | InputFile,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    """Points (P, 3) and faces (F, 4), the last column -1 for triangles; any unit of length.

    Points at the same place (an STL repeats them for every triangle) become one; faces that are
    no faces then are left out. Raises InputError, naming the file.
    """
    file = path.path if isinstance(path, InputFile) else Path(path)
    kind = _FORMATS.get(file.suffix.lower())
    if kind is None or not file.is_file():
        what = "no such file" if kind else f"got {file.suffix!r}"
        raise InputError(f"{file}: {what}; expected one of {', '.join(_FORMATS)}")
    content = read_content(file, kind)
    parts = []
    for block in content.cells:
        if block.type == "triangle":
            data = np.asarray(block.data, np.int64).reshape(-1, 3)
            parts.append(np.concatenate([data, np.full((len(data), 1), -1)], axis=1))
        elif block.type == "quad":
            parts.append(np.asarray(block.data, np.int64).reshape(-1, 4))
    points = np.asarray(content.points, np.float64)
    if not parts or points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{file}: no triangles or quadrilaterals in space; expected some")
    if not np.isfinite(points).all():
        raise InputError(f"{file}: a coordinate isn't finite; expected numbers")
    points, merged = np.unique(points, axis=0, return_inverse=True)
    faces = np.concatenate(parts)
    if faces.max() >= len(merged):
        raise InputError(f"{file}: a face names point {faces.max()}; got {len(merged)} points")
    faces = np.where(faces < 0, -1, merged.reshape(-1)[np.maximum(faces, 0)])
    last = np.where(faces[:, 3] < 0, faces[:, 2], faces[:, 3])
    a, b, c, d = (points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]], points[last])
    flat = ~(np.linalg.norm(np.cross(c - a, np.where((faces[:, 3] < 0)[:, None], b - a, d - b)),
                            axis=1) > 0.0)  # fmt: skip
    return points, faces[~flat].astype(np.int32)
