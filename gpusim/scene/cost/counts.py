"""How many nodes and elements a mesh recipe makes, without making it: for ``gpusim plan``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import ceil, log
from pathlib import Path

from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.scene.description.mesh_recipe import (
    BeamMesh,
    BoxMesh,
    BracketMesh,
    CraneMesh,
    FieldMesh,
    FileMesh,
    MeshRecipe,
    NotchRecipe,
    PlateMesh,
)
from gpusim.scene.schema.mesh import CAD_SUFFIXES

__all__ = ["element_counts", "mesh_words"]

_GROWTH = 0.25  # of the element size with the distance from a notch, as the builder has it
_BYTES_PER_NODE = 150  # of a mesh file, roughly
# Per cell type: elements of each brick, and which of a grid's edges, faces (all, or only those
# across the layers) and cells get a node of their own.
_KINDS = {
    "hex8": (1, 0, 0, 0, 0), "hex20": (1, 1, 0, 0, 0), "hex27": (1, 1, 1, 1, 1),
    "tet4": (6, 0, 0, 0, 0), "tet10": (6, 1, 1, 1, 1), "wedge6": (2, 0, 0, 0, 0),
    "wedge15": (2, 1, 1, 0, 0),
}  # fmt: skip


@dataclass(frozen=True)
class _Plane:
    """A plane mesh of quadrilaterals: nodes, elements, and the holes in it."""

    nodes: int
    cells: int
    holes: int = 0

    @property
    def edges(self) -> int:
        """By Euler's formula."""
        return self.nodes + self.cells - 1 + self.holes


def element_counts(recipe: MeshRecipe) -> tuple[int, int]:
    """Nodes and elements that a recipe makes: to within rounding for builders, not less what
    notches cut away; a guess from the size for files whose head doesn't say, 0 for CAD files."""
    if isinstance(recipe, FileMesh):
        return _file_counts(Path(recipe.path), recipe.order)
    if isinstance(recipe, FieldMesh):
        return _file_counts(Path(recipe.path), 1)
    plane, layers = _plane(recipe)
    across = plane.cells * (layers + 1)  # faces that layers lie on
    per_cell, on_edges, on_layers, on_sides, inside = _KINDS[recipe.cells]
    nodes = (
        plane.nodes * (layers + 1)
        + on_edges * (plane.edges * (layers + 1) + plane.nodes * layers)
        + on_layers * across
        + on_sides * plane.edges * layers
        + inside * plane.cells * layers
    )
    return nodes, per_cell * plane.cells * layers


def mesh_words(recipe: MeshRecipe) -> str:
    """What is known of a mesh, in a few words."""
    nodes, elements = element_counts(recipe)
    if not isinstance(recipe, FileMesh | FieldMesh):
        return f"{nodes:,} nodes, {elements:,} elements"
    name = Path(recipe.path).name
    if isinstance(recipe, FileMesh) and recipe.size is not None:
        return f"{name}, to be meshed with elements up to {recipe.size * 1e3:g} mm"
    return f"{name}, about {nodes:,} nodes"


def _plane(recipe: MeshRecipe) -> tuple[_Plane, int]:
    """The plane mesh that is extruded, and the number of layers."""
    if isinstance(recipe, BoxMesh | BeamMesh):
        nx, ny, nz = _divisions(recipe)
        return _Plane((nx + 1) * (ny + 1), nx * ny), nz
    if isinstance(recipe, CraneMesh):
        along = sum(
            max(1, round(length / recipe.element))
            for length in (
                recipe.foot,
                recipe.height,
                recipe.length - recipe.load_length - recipe.column_thickness,
                recipe.load_length,
            )
        )
        # the joint, through x through, belongs to both members
        rows = along + recipe.through
        return _Plane((rows + 1) * (recipe.through + 1), rows * recipe.through), recipe.across
    assert isinstance(recipe, PlateMesh | BracketMesh)
    sides = recipe.around // 4
    ring = _Plane(recipe.around * (recipe.radial + 1), recipe.around * recipe.radial, 1)
    if isinstance(recipe, PlateMesh):
        square = min(recipe.length, recipe.width)
        rest = 0.5 * (max(recipe.length, recipe.width) - square)
        columns = 2 * _columns(rest, square, sides)
        return _Plane(
            ring.nodes + columns * (sides + 1), ring.cells + columns * sides, 1
        ), recipe.through
    turn = recipe.fillet_radius + recipe.thickness + recipe.width
    columns = recipe.bend + sum(
        _columns(leg - turn, recipe.width, sides)
        for leg in (recipe.base_length, recipe.wall_height)
    )
    nodes = 2 * ring.nodes + (columns - 1) * (sides + 1)
    return _Plane(nodes, 2 * ring.cells + columns * sides, 2), recipe.through


def _columns(rest: float, square: float, sides: int) -> int:
    """Columns of elements between a square around a hole and the next border."""
    return max(1, round(rest * sides / square)) if rest > 1e-9 * square else 0


def _divisions(recipe: BoxMesh | BeamMesh) -> tuple[int, int, int]:
    if not recipe.notches:
        return recipe.divisions
    if isinstance(recipe, BoxMesh):
        low, size = recipe.origin, recipe.size
    else:
        low = (0.0, -0.5 * recipe.width, -0.5 * recipe.height)
        size = (recipe.length, recipe.width, recipe.height)
    counts = [
        _graded(low[k], size[k], recipe.divisions[k], "xyz"[k], recipe.notches) for k in range(3)
    ]
    return counts[0], counts[1], counts[2]


def _graded(
    low: float, length: float, divisions: int, axis: str, notches: tuple[NotchRecipe, ...]
) -> int:
    """Steps of an axis that gets finer towards the notches."""
    size = length / divisions
    fine = {low: size, low + length: size}
    for notch in notches:
        step = min(size, notch.width / notch.cells)
        places = []
        if notch.axis == axis:
            places = [notch.position - 0.5 * notch.width, notch.position + 0.5 * notch.width]
        elif notch.side[1] == axis:
            places = [low + length - notch.depth if notch.side[0] == "+" else low + notch.depth]
        for place in places:
            fine[place] = min(step, fine.get(place, size))
    total = 0
    for start, end in pairwise(sorted(fine)):
        # sizes grow from both ends until they meet, or are that of the whole
        first, last = fine[start], fine[end]
        top = min(size, 0.5 * (first + last + _GROWTH * (end - start)))
        grown = log(top / first) + log(top / last)
        flat = (end - start) - (2.0 * top - first - last) / _GROWTH
        total += max(1, ceil(grown / _GROWTH + max(0.0, flat) / top - 1e-9))
    return total


@lru_cache(maxsize=32)
def _beginning(path: Path, stamp: tuple[int, int, int]) -> tuple[bytes, int]:
    """The first 64 kB of a file, and its size; a plan asks for them several times."""
    content = read_input(path).data
    return content[: 1 << 16], len(content)


def _file_counts(path: Path, order: int) -> tuple[int, int]:
    if path.suffix.lower() in CAD_SUFFIXES:
        return 0, 0
    try:
        now = path.stat()
        head, size = _beginning(path, (now.st_ino, now.st_size, now.st_mtime_ns))
    except (OSError, InputError):
        return 0, 0
    nodes = size // _BYTES_PER_NODE
    # Gmsh 4.1, Gmsh 2.2, VTU, FRD: the counts stand near the beginning of most files
    for pattern in (
        rb"\$Nodes\r?\n\d+ (\d+) \d+ \d+",
        rb"\$Nodes\r?\n(\d+)\r?\n",
        rb"NumberOfPoints=\"(\d+)\"",
        rb"\n    2C +(\d+)",
    ):
        if found := re.search(pattern, head):
            nodes = int(found.group(1))
            break
    factor = 5 if order == 2 else 1  # between bricks (4) and tetrahedra (6)
    return factor * nodes, nodes
