"""VTU and MED files, through meshio."""

from __future__ import annotations

import contextlib
import io
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.input_file import InputFile
from gpusim.mesh.cells import CELL_TYPES
from gpusim.mesh.mirror import turned_wedges, turned_whole
from gpusim.mesh.raw import RawBlock, RawMesh

__all__ = ["raw_of", "read_content", "read_with_meshio"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

_KINDS = {
    "vertex": "point1", "line": "line2", "line3": "line3", "triangle": "tri3",
    "triangle6": "tri6", "triangle7": "tri7", "quad": "quad4", "quad8": "quad8", "quad9": "quad9",
    "tetra": "tet4", "tetra10": "tet10", "hexahedron": "hex8", "hexahedron20": "hex20",
    "hexahedron27": "hex27", "wedge": "wedge6", "wedge15": "wedge15", "pyramid": "pyramid5",
    "pyramid13": "pyramid13",
}  # fmt: skip
_FORMATS = {".vtu": "vtu", ".med": "med"}


def read_with_meshio(path: Path) -> RawMesh:
    """Read a file of one of these formats.

    Raises InputError, naming the file, for whatever meshio stumbles over or leaves out.
    """
    kind = _FORMATS[path.suffix.lower()]
    return raw_of(read_content(path, kind), path, kind)


def raw_of(content: Any, path: Path, kind: str) -> RawMesh:
    """What meshio has read, in our names and node orders."""
    points = np.asarray(content.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{path}: points of shape {points.shape}; expected (N, 3)")
    groups = _groups(content, kind)
    blocks = []
    for index, block in enumerate(content.cells):
        name = _KINDS.get(block.type, block.type)
        if block.type not in _KINDS or not len(block.data):
            nodes = np.zeros((len(block.data), 0), dtype=np.int64)
        else:
            nodes = np.asarray(block.data, dtype=np.int64)
            if nodes.size and nodes.min() >= 0 and nodes.max() < len(points):
                turn = turned_whole if kind == "med" else turned_wedges
                nodes = turn(name, points, nodes)
        blocks.append(RawBlock(name, nodes, groups[index]))
    return RawMesh(points, tuple(blocks), _node_groups(content))


def read_content(source: Path | InputFile, kind: str) -> Any:
    """The file as meshio has it, which prints, warns and raises all sorts of errors.

    Raises InputError, naming the file.
    """
    from gpusim.mesh.meshio_types import meshio

    said = io.StringIO()
    path = source.path if isinstance(source, InputFile) else source
    try:
        with (
            (
                source.on_disk() if isinstance(source, InputFile) else contextlib.nullcontext(path)
            ) as place,
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
            np.errstate(all="ignore"),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")
            content = meshio.read(place, file_format=kind)
    except (Exception, SystemExit) as error:
        words = " ".join(f"{type(error).__name__} {error} {said.getvalue()}".split())
        raise InputError(
            f"{path}: can't be read as {kind}: the file is cut off, damaged, or of another "
            f"version or format; got {words[:200]}"
        ) from None
    lost = re.search(r"cells that meshio cannot handle \(type (\d+)\)", " ".join(
        said.getvalue().split()
    ))  # fmt: skip
    if lost:
        raise InputError(
            f"{path}: got cells of VTK type {lost.group(1)}; expected {', '.join(CELL_TYPES)}"
        )
    return content


def _groups(content: Any, kind: str) -> list[dict[str, Long]]:
    """For each block, group name -> rows."""
    found: list[dict[str, Long]] = [{} for _ in content.cells]
    if kind == "med":
        families: dict[int, list[str]] = getattr(content, "cell_tags", {})
        for index, tags in enumerate(content.cell_data.get("cell_tags", ())):
            for family, names in families.items():
                rows = np.flatnonzero(np.asarray(tags) == family)
                for name in names if len(rows) else ():
                    earlier = found[index].get(name, np.zeros(0, dtype=np.int64))
                    found[index][name] = np.union1d(earlier, rows)
    return found


def _node_groups(content: Any) -> dict[str, Long]:
    """MED's families of nodes."""
    tags = content.point_data.get("point_tags")
    families: dict[int, list[str]] = getattr(content, "point_tags", {})
    if tags is None:
        return {}
    sets: dict[str, Long] = {}
    for family, names in families.items():
        rows = np.flatnonzero(np.asarray(tags) == family)
        for name in names if len(rows) else ():
            sets[name] = np.union1d(sets.get(name, np.zeros(0, dtype=np.int64)), rows)
    return sets
