"""Cost of a run, from the scene's numbers alone: what ``gpusim plan`` prints.

How many nodes and elements a mesh recipe makes is guessed without making it, for the memory that it
takes; counts of meshes that were made are handed in. The rates are those of
two CPU cores with a software Vulkan device; `gpusim.plan.machine_speed` knows how this machine
compares. All is meant to be right within a factor of two. Shaders are compiled when they are first
used, which takes longer than most images; the driver keeps them for later runs.
"""

from __future__ import annotations

from math import log, prod
from pathlib import Path

from gpusim.files.input_file import file_stamp

from .colored import in_color
from .description.mesh import (
    BeamMeshTable,
    BoxMeshTable,
    BracketMeshTable,
    CraneMeshTable,
    FieldMeshTable,
    FileMeshTable,
    MeshRecipe,
    PlateMeshTable,
)
from .description.model import CameraTable, MarkersTable, Paint, Vec3
from .description.vibration_measures import ModesTable
from .description.video import filming
from .scene import Scene

_SOLVER = {
    "auto": "direct or multigrid, whichever is quicker for the matrix",
    "direct": "direct",
    "multigrid": "multigrid",
}
Cost = dict[str, tuple[int, float]]
Counts = dict[MeshRecipe, tuple[int, int]]
"""Nodes and elements of meshes that were made."""


def describe(scene: Scene, made: Counts | None = None) -> dict[str, str]:
    """Stage kind -> how much of it there is, in a few words."""
    counts = [element_counts(body.mesh, made) for body in scene.bodies]
    nodes = sum(count[0] for count in counts)
    known = made is not None and all(body.mesh in made for body in scene.bodies)
    size = f"{3 * nodes:,} unknowns, " if known else ""
    lights = len(scene.lights)
    lit = f"{lights} light{'s' if lights > 1 else ''}" if lights else "no light: albedo"
    casting = sum(getattr(light, "shadows", False) for light in scene.lights)
    lit += ", flickering" if any(light.flicker for light in scene.lights) else ""
    lit += f", shadows of {casting}" if casting else ", no shadows" if lights else ""
    if any(getattr(light, "occlusion", False) for light in scene.lights):
        lit += ", surroundings hidden by surfaces"
    if lights and any(paint.bump for paint in _paints(scene)):
        lit += ", fine relief"
    if in_color(scene):
        lit += ", light and paint in colour"
    wanted = [name for name in ("vtu", "stl", "calibration") if getattr(scene.output, name)]
    wanted += [f"film of {name}, up to {1e-6 * size:,.1f} MB" for name, size in _films(scene)]
    return {
        "mesh": "; ".join(mesh_words(body.mesh, made) for body in scene.bodies),
        "solve": f"{size}{_SOLVER[scene.solver.method]}{_solutions(scene)[0]}",
        "render": lit,
        "truth": f"{len(scene.output.truth)} layers",
        "truth file": "mesh, nodes, and what cameras see",
        "measure": " and ".join(_measured(scene)),
        "export": ", ".join(wanted),
    }


def effects(scene: Scene, camera: CameraTable) -> str:
    """What lens, shutter and sensor do to a camera's images, in words."""
    words = [] if camera.lens is None else camera.lens.words()
    words = words or ["pinhole"]
    words += [] if camera.shutter is None else camera.shutter.words()
    words += [] if camera.trigger is None else ["triggered late"]
    return ", ".join([*words, *scene.sensor_of(camera.name).words(), *camera.color_words()])


def compiling_seconds(scene: Scene, kept: bool) -> float:
    """Of the shaders of the first picture; a quarter of it if the driver has ``kept`` them."""
    first = 12.0 if scene.lights else 5.5
    return 0.25 * first if kept else first


def exposing_seconds(camera: CameraTable) -> float:
    """Seconds of a picture whose radiance is there."""
    return 0.05 + 5e-8 * prod(camera.resolution)


def _per_image(scene: Scene) -> tuple[float, float]:
    """Seconds of one rendering: for any, and per pixel."""
    if any(getattr(light, "occlusion", False) for light in scene.lights):
        return 0.6, 1.7e-7
    return (0.2, 7e-8) if scene.lights else (0.1, 4e-8)


def _films(scene: Scene) -> list[tuple[str, int]]:
    """Cameras that film, and the bytes of their films if nothing could be left out."""
    filmed, frames = filming(scene.video, scene.cameras), len(scene.analysis.frame_values)
    return [
        (one.name, frames * prod(one.resolution) * (1 + (scene.sensor_of(one.name).bits > 8))
         * (3 if one.channels == "rgb" else 1))
        for one in scene.cameras if one.name in filmed
    ]  # fmt: skip


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


def _measured(scene: Scene) -> list[str]:
    """What measures look at, in words."""
    followed = [one.count for one in scene.measures if isinstance(one, ModesTable)]
    correlated = [one for one in scene.measures if one.correlates]
    words = [f"{sum(followed)} points"] if followed else []
    words += ["image correlation"] if correlated else []
    if len(followed) + len(correlated) < len(scene.measures):
        words.insert(0, f"{_markers(scene)} markers")
    return words


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
    written = 0.1 + 4e-6 * elements if scene.output.vtu or scene.output.stl else 0.0
    filming_seconds = sum(0.01 * steps + 6e-8 * size for _, size in _films(scene))
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
        "export": (300 * nodes, 0.1 + steps * written + filming_seconds),
        "report": (6 * pixels, 1.0 + 2e-8 * pixels),
    }


def _solutions(scene: Scene) -> tuple[str, float]:
    """How bodies are solved, as far as it is known, and how many linear solutions take as long."""
    geometry = getattr(scene.analysis, "geometry", "auto")
    known = any(body.large_displacements(geometry) for body in scene.bodies)
    return scene.analysis.solutions(nonlinear=known)


_BYTES_PER_NODE = 100  # of a mesh file with its elements, roughly
_CUT = {"tet4": 6, "tet10": 6, "wedge6": 2, "wedge15": 2}
"""Elements that a brick is cut into."""
_NODES = {"hex20": 4, "hex27": 8, "tet10": 8, "wedge15": 5}
"""Nodes of all kinds for each corner, where some are added to these."""


def element_counts(recipe: MeshRecipe, made: Counts | None = None) -> tuple[int, int]:
    """Nodes and elements: of a mesh that was ``made`` exactly, else roughly, of a file by its size;
    0 of a CAD file."""
    if made and recipe in made:
        return made[recipe]
    if isinstance(recipe, FileMeshTable | FieldMeshTable):
        cad = isinstance(recipe, FileMeshTable) and recipe.is_cad
        nodes = 0 if cad else _file_bytes(recipe) // _BYTES_PER_NODE
        return nodes, nodes
    area, layers = _bricks(recipe)
    cells = recipe.cells
    return _NODES.get(cells, 1) * area * (layers + 1), _CUT.get(cells, 1) * area * layers


def mesh_words(recipe: MeshRecipe, made: Counts | None = None) -> str:
    """What is known of a mesh, in a few words."""
    nodes, elements = element_counts(recipe, made)
    known = made is not None and recipe in made
    words = f"{nodes:,} nodes, {elements:,} elements" if known else f"about {elements:,} elements"
    if not isinstance(recipe, FileMeshTable | FieldMeshTable):
        return words
    if not known:
        words = f"{_file_bytes(recipe) / 1e6:.2g} MB"
        if isinstance(recipe, FileMeshTable) and recipe.size is not None:
            words = f"to be meshed with elements up to {recipe.size * 1e3:g} mm"
    return f"{Path(recipe.path).name}, {words}"


def _file_bytes(recipe: FileMeshTable | FieldMeshTable) -> int:
    """0 for a file that isn't there, which is told elsewhere."""
    stamp = file_stamp(recipe.path)
    return stamp[1] if stamp else 0


def _bricks(recipe: MeshRecipe) -> tuple[int, int]:
    """About how many the plane mesh has that is extruded, and the number of layers."""
    if isinstance(recipe, BoxMeshTable | BeamMeshTable):
        nx, ny, nz = _divisions(recipe)
        return nx * ny, nz
    if isinstance(recipe, CraneMeshTable):
        beam = recipe.length - recipe.column_thickness
        along = (recipe.foot + recipe.height + beam) / recipe.element + recipe.through
        return round(along) * recipe.through, recipe.across
    assert isinstance(recipe, PlateMeshTable | BracketMeshTable)
    sides, ring = recipe.around // 4, recipe.around * recipe.radial
    if isinstance(recipe, PlateMeshTable):
        short, long = sorted((recipe.length, recipe.width))
        return ring + round((long / short - 1.0) * sides**2), recipe.through
    turn = recipe.fillet_radius + recipe.thickness + recipe.width
    legs = (recipe.base_length + recipe.wall_height - 2.0 * turn) / recipe.width
    return 2 * ring + (recipe.bend + round(legs * sides)) * sides, recipe.through


def _divisions(recipe: BoxMeshTable | BeamMeshTable) -> list[int]:
    """Along x, y and z; more where elements get finer towards the borders of notches, by a quarter
    of the distance from there."""
    counts, sizes = list(recipe.divisions), element_sizes(recipe)
    borders = {
        (side, place): one
        for one in recipe.notches
        for side, place in ((one.axis, one.position), (one.side, one.depth))
    }
    for (side, _), notch in borders.items():
        k = "xyz".index(side[-1])
        ratio = max(sizes[k] * notch.cells / notch.width, 1.0)
        counts[k] += round(8.0 * (log(ratio) - 1.0 + 1.0 / ratio))
        counts[k] += notch.cells if side == notch.axis else 0
    return counts


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
