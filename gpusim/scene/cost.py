"""Cost of a run, from the scene's numbers alone: what ``gpusim plan`` prints.

How many nodes and elements a mesh recipe makes is counted without making it; of a CAD file only a
mesh that was made knows, so that these counts are handed in. The rates are those of
two CPU cores with a software Vulkan device; `gpusim.plan.machine_speed` knows how this machine
compares. Shaders are compiled when they are first used, which takes longer than most images; the
driver keeps them for later runs, at a quarter of the time.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, log
from pathlib import Path
from typing import NamedTuple

from gpusim.errors import InputError
from gpusim.files.input_file import open_input

from .colored import in_color
from .description.mesh import (
    CAD_SUFFIXES,
    BeamMeshTable,
    BoxMeshTable,
    BracketMeshTable,
    CraneMeshTable,
    FieldMeshTable,
    FileMeshTable,
    MeshRecipe,
    NotchRecipeTable,
    PlateMeshTable,
)
from .description.model import CameraTable, MarkersTable, Paint, Vec3
from .scene import Scene

KEPT = 0.25
"""Share of the time to compile a shader that it takes to load one that the driver has kept."""

_SOLVER = {
    "auto": "direct or multigrid, whichever is quicker for the matrix",
    "direct": "direct",
    "multigrid": "multigrid",
}
# Seconds to compile what an image with this in it needs for the first time
_COMPILE = {"drawing": 5.0, "light": 1.0, "shadows": 2.5, "gloss": 5.0, "bump": 0.5, "lens": 0.5,
            "occlusion": 0.5}  # fmt: skip
Cost = dict[str, tuple[int, float]]
Counts = dict[MeshRecipe, tuple[int, int]]
"""Nodes and elements of meshes that were made of files."""


def describe(scene: Scene, made: Counts | None = None) -> dict[str, str]:
    """Stage kind -> how much of it there is, in a few words."""
    counts = [element_counts(body.mesh, made) for body in scene.bodies]
    nodes = sum(count[0] for count in counts)
    size = f"{3 * nodes:,} unknowns, " if all(count[0] for count in counts) else ""
    lights = len(scene.lights)
    lit = f"{lights} light{'s' if lights > 1 else ''}" if lights else "no light: albedo"
    casting = sum(getattr(light, "shadows", False) for light in scene.lights)
    lit += f", shadows of {casting}" if casting else ", no shadows" if lights else ""
    if any(getattr(light, "occlusion", False) for light in scene.lights):
        lit += ", surroundings hidden by surfaces"
    if lights and any(paint.bump for paint in _paints(scene)):
        lit += ", fine relief"
    if in_color(scene):
        lit += ", light and paint in colour"
    wanted = [name for name in ("vtu", "stl", "calibration") if getattr(scene.output, name)]
    return {
        "mesh": "; ".join(mesh_words(body.mesh, made) for body in scene.bodies),
        "solve": f"{size}{_SOLVER[scene.solver.method]}{_solutions(scene)[0]}",
        "render": lit,
        "truth": f"{len(scene.output.truth)} layers",
        "truth file": "mesh, nodes, and what cameras see",
        "measure": " and ".join(
            [f"{_markers(scene)} markers"] * any(not one.correlates for one in scene.measures)
            + ["image correlation"] * any(one.correlates for one in scene.measures)
        ),
        "export": ", ".join(wanted),
    }


def effects(scene: Scene, camera: CameraTable) -> str:
    """What lens, shutter and sensor do to a camera's images, in words."""
    words = [] if camera.lens is None else camera.lens.words()
    words = words or ["pinhole"]
    if camera.shutter is not None:
        words += camera.shutter.words()
    return ", ".join([*words, *scene.sensor_of(camera.name).words(), *camera.color_words()])


def compiled_for(scene: Scene, camera: CameraTable) -> dict[str, float]:
    """What the images of a camera need compiled, and the seconds that each takes the first time."""
    paints = _paints(scene)
    has = {
        "drawing": True,
        "light": bool(scene.lights),
        "shadows": any(getattr(light, "shadows", False) for light in scene.lights),
        "gloss": bool(scene.lights) and any(paint.roughness < 1.0 for paint in paints),
        "bump": bool(scene.lights) and any(paint.bump for paint in paints),
        "lens": camera.lens is not None,
        "occlusion": any(getattr(light, "occlusion", False) for light in scene.lights),
    }
    return {name: _COMPILE[name] for name, there in has.items() if there}


def _per_image(scene: Scene) -> tuple[float, float]:
    """Seconds of one rendering: for any, and per pixel."""
    if any(getattr(light, "occlusion", False) for light in scene.lights):
        return 0.6, 1.7e-7
    return (0.2, 7e-8) if scene.lights else (0.1, 4e-8)


def target_seconds(camera: CameraTable) -> float:
    """Seconds of a calibration target's picture, and of what is found in it while others are
    taken: nothing is drawn but where the target is."""
    pixels = camera.resolution[0] * camera.resolution[1]
    return (0.08 + 7e-9 * pixels) * _renderings(camera)


def _renderings(camera: CameraTable) -> float:
    """Roughly how many plain renderings one photograph takes."""
    count, lens, shutter = 1.0, camera.lens, camera.shutter
    if lens is not None:
        count *= 24.0 if lens.f_number is not None else 1.0
        count *= 10.0 if lens.psf is not None else 1.0
    if shutter is not None:
        count *= 8.0 if shutter.exposure else 1.0
    return count


def _paints(scene: Scene) -> list[Paint]:
    return [paint for thing in (*scene.bodies, *scene.props) for paint in thing.paints]


def _markers(scene: Scene) -> int:
    return sum(len(paint.markers) for paint in _paints(scene) if isinstance(paint, MarkersTable))


def estimate(scene: Scene, made: Counts | None = None) -> Cost:
    """Stage kind -> (memory in bytes, seconds) of one such stage."""
    counts = [element_counts(body.mesh, made) for body in scene.bodies]
    nodes = sum(count[0] for count in counts)
    elements = sum(count[1] for count in counts)
    pixels = max((c.resolution[0] * c.resolution[1] for c in scene.cameras), default=0)
    most = max((_renderings(c) for c in scene.cameras), default=1.0)
    frames = len(scene.cameras) * len(scene.analysis.frame_values)
    fixed, per_pixel = _per_image(scene)
    bands, slower = (3, 1.25) if in_color(scene) else (1, 1.0)  # `python -m benchmarks.color`
    markers = _markers(scene)
    layers = len(scene.output.truth)
    together = len(scene.cameras) if "cameras" in scene.output.truth else 1
    steps = len(scene.analysis.frame_values)
    measuring = sum(one.seconds(markers, pixels, steps) for one in scene.measures)
    # what every pixel sees, its spline and its subsets
    of_pixel = 300 if any(one.correlates for one in scene.measures) else 12
    return {
        "mesh": (200 * nodes, 0.05 + 2e-6 * nodes),
        "model": (100 * nodes, 0.5 + 1e-6 * nodes),
        "solve": (4_500 * nodes, (0.2 + 2e-5 * nodes) * _solutions(scene)[1]),
        "surface": (200 * nodes, 0.05 + 2e-6 * elements),
        "render": (16 * bands * pixels, (fixed + slower * per_pixel * pixels) * most),
        "truth": (40 * pixels, together * steps * (0.2 + 1e-8 * layers * pixels)),
        "truth file": (40 * nodes, 0.1 + frames * (0.01 + 1e-9 * layers * pixels)),
        "measure": (of_pixel * pixels, 0.3 + measuring),
        "stress": (600 * elements, 0.1 + steps * 2e-5 * elements),
        "export": (300 * nodes, steps * (0.1 + 4e-6 * elements)),
        "report": (6 * pixels, 1.0 + 2e-8 * pixels),
    }


def _solutions(scene: Scene) -> tuple[str, float]:
    """How bodies are solved, as far as it is known, and how many linear solutions take as long."""
    geometry = getattr(scene.analysis, "geometry", "auto")
    known = any(body.large_displacements(geometry) for body in scene.bodies)
    return scene.analysis.solutions(nonlinear=known)


_GROWTH = 0.25  # of the element size with the distance from a notch, as the builder has it
_BYTES_PER_NODE = 150  # of a mesh file, roughly


class _Nodes(NamedTuple):
    """Of a cell type: ``elements`` of each brick, and which edges, faces across the layers
    (``layers``) and along them (``sides``) and cells of a grid get a node of their own."""

    elements: int
    edges: int = 0
    layers: int = 0
    sides: int = 0
    inside: int = 0


_BUILT_NODES = {
    "hex8": _Nodes(1), "hex20": _Nodes(1, edges=1), "hex27": _Nodes(1, 1, 1, 1, 1),
    "tet4": _Nodes(6), "tet10": _Nodes(6, 1, 1, 1, 1), "wedge6": _Nodes(2),
    "wedge15": _Nodes(2, edges=1, layers=1),
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


def element_counts(recipe: MeshRecipe, made: Counts | None = None) -> tuple[int, int]:
    """Nodes and elements that a recipe makes: to within rounding for builders, not less what
    notches cut away; of a file that isn't ``made``, a guess from the size where its head doesn't
    say, and 0 for CAD."""
    if made and recipe in made:
        return made[recipe]
    if isinstance(recipe, FileMeshTable):
        return _file_counts(Path(recipe.path), recipe.order)
    if isinstance(recipe, FieldMeshTable):
        return _file_counts(Path(recipe.path), 1)
    plane, layers = _plane(recipe)
    across = plane.cells * (layers + 1)  # faces that layers lie on
    kind = _BUILT_NODES[recipe.cells]
    nodes = (
        plane.nodes * (layers + 1)
        + kind.edges * (plane.edges * (layers + 1) + plane.nodes * layers)
        + kind.layers * across
        + kind.sides * plane.edges * layers
        + kind.inside * plane.cells * layers
    )
    return nodes, kind.elements * plane.cells * layers


def mesh_words(recipe: MeshRecipe, made: Counts | None = None) -> str:
    """What is known of a mesh, in a few words."""
    nodes, elements = element_counts(recipe, made)
    counted = f"{nodes:,} nodes, {elements:,} elements"
    if not isinstance(recipe, FileMeshTable | FieldMeshTable):
        return counted
    name = Path(recipe.path).name
    if made and recipe in made:
        return f"{name}, {counted}"
    if isinstance(recipe, FileMeshTable) and recipe.size is not None:
        return f"{name}, to be meshed with elements up to {recipe.size * 1e3:g} mm"
    return f"{name}, about {nodes:,} nodes"


def _plane(recipe: MeshRecipe) -> tuple[_Plane, int]:
    """The plane mesh that is extruded, and the number of layers."""
    if isinstance(recipe, BoxMeshTable | BeamMeshTable):
        nx, ny, nz = _divisions(recipe)
        return _Plane((nx + 1) * (ny + 1), nx * ny), nz
    if isinstance(recipe, CraneMeshTable):
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
    assert isinstance(recipe, PlateMeshTable | BracketMeshTable)
    sides = recipe.around // 4
    ring = _Plane(recipe.around * (recipe.radial + 1), recipe.around * recipe.radial, 1)
    if isinstance(recipe, PlateMeshTable):
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


def _divisions(recipe: BoxMeshTable | BeamMeshTable) -> tuple[int, int, int]:
    if not recipe.notches:
        return recipe.divisions
    if isinstance(recipe, BoxMeshTable):
        low, size = recipe.origin, recipe.size
    else:
        low = (0.0, -0.5 * recipe.width, -0.5 * recipe.height)
        size = (recipe.length, recipe.width, recipe.height)
    counts = [
        _graded(low[k], size[k], recipe.divisions[k], "xyz"[k], recipe.notches) for k in range(3)
    ]
    return counts[0], counts[1], counts[2]


def _graded(
    low: float, length: float, divisions: int, axis: str, notches: tuple[NotchRecipeTable, ...]
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


def _file_counts(path: Path, order: int) -> tuple[int, int]:
    if path.suffix.lower() in CAD_SUFFIXES:
        return 0, 0
    try:
        with open_input(path) as stream:
            head, size = stream.read(1 << 16), path.stat().st_size
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


def extent(recipe: MeshRecipe) -> Vec3 | None:
    """Lengths along x, y, z (m); the members' sides for crane and bracket. None for files."""
    if isinstance(recipe, FileMeshTable | FieldMeshTable):
        return None
    if isinstance(recipe, BoxMeshTable):
        return recipe.size
    if isinstance(recipe, BeamMeshTable):
        width = min(recipe.width, recipe.end_width)
        return recipe.length, width, min(recipe.height, recipe.end_height)
    if isinstance(recipe, CraneMeshTable):
        reach = recipe.length + recipe.height + recipe.foot
        return reach, recipe.width, min(recipe.column_thickness, recipe.beam_thickness)
    if isinstance(recipe, BracketMeshTable):
        return recipe.base_length + recipe.wall_height, recipe.width, recipe.thickness
    return recipe.length, recipe.width, recipe.thickness


def element_sizes(recipe: MeshRecipe) -> tuple[float, ...]:
    """Sides (m) of the elements of a box or a beam, away from notches; () for others."""
    if not isinstance(recipe, BoxMeshTable | BeamMeshTable):
        return ()
    size = extent(recipe)
    assert size is not None
    return tuple(side / count for side, count in zip(size, recipe.divisions, strict=True))
