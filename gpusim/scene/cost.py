"""Rough cost of a run, from the scene's numbers alone: what ``gpusim plan`` prints.

The rates are those of two CPU cores with a software Vulkan device; a GPU needs less.
"""

from __future__ import annotations

from .counts import element_counts, mesh_words
from .model import Camera, Markers
from .scene import Scene

__all__ = ["describe", "effects", "estimate"]

_SOLVER = {
    "auto": "direct or multigrid, whichever is quicker for the matrix",
    "direct": "direct",
    "multigrid": "multigrid",
    "block_jacobi": "conjugate gradients without multigrid",
}
Cost = dict[str, tuple[int, float]]


def describe(scene: Scene) -> dict[str, str]:
    """Stage kind -> how much of it there is, in a few words."""
    counts = [element_counts(body.mesh) for body in scene.bodies]
    nodes = sum(count[0] for count in counts)
    size = f"{3 * nodes:,} unknowns, " if all(count[0] for count in counts) else ""
    lights = len(scene.lights)
    lit = f"{lights} light{'s' if lights > 1 else ''}" if lights else "no light: albedo"
    casting = sum(getattr(light, "shadows", False) for light in scene.lights)
    lit += f", shadows of {casting}" if casting else ", no shadows" if lights else ""
    wanted = [name for name in ("vtu", "stl") if getattr(scene.output, name)]
    return {
        "mesh": "; ".join(mesh_words(body.mesh) for body in scene.bodies),
        "solve": f"{size}{_SOLVER[scene.solver.method]}",
        "render": lit,
        "truth": f"{len(scene.output.truth)} layers",
        "measure": f"{_markers(scene)} markers",
        "export": ", ".join(wanted),
    }


def effects(scene: Scene, camera: Camera) -> str:
    """What lens, shutter and sensor do to a camera's images, in words."""
    words = [] if camera.lens is None else camera.lens.words()
    words = words or ["pinhole"]
    if camera.shutter is not None:
        words += camera.shutter.words()
    return ", ".join([*words, *scene.sensor_of(camera.name).words()])


def _renderings(camera: Camera) -> float:
    """Roughly how many plain renderings one photograph takes."""
    count, lens, shutter = 1.0, camera.lens, camera.shutter
    if lens is not None:
        count *= 24.0 if lens.f_number is not None else 1.0
        count *= 10.0 if lens.psf is not None or lens.fill_factor != 1.0 else 1.0
    if shutter is not None:
        count *= 8.0 if shutter.exposure else 1.0
    return count


def _markers(scene: Scene) -> int:
    paints = [paint for body in scene.bodies for paint in body.paints]
    paints += [paint for prop in scene.props for paint in prop.paints]
    return sum(len(paint.markers) for paint in paints if isinstance(paint, Markers))


def estimate(scene: Scene) -> Cost:
    """Stage kind -> (memory in bytes, seconds) of one such stage."""
    counts = [element_counts(body.mesh) for body in scene.bodies]
    nodes = sum(count[0] for count in counts)
    elements = sum(count[1] for count in counts)
    pixels = max((c.resolution[0] * c.resolution[1] for c in scene.cameras), default=0)
    most = max((_renderings(c) for c in scene.cameras), default=1.0)
    frames = len(scene.cameras) * len(scene.analysis.load_factors)
    markers = _markers(scene)
    layers = len(scene.output.truth)
    steps = len(scene.analysis.load_factors)
    return {
        "mesh": (200 * nodes, 0.05 + 2e-6 * nodes),
        "model": (100 * nodes, 0.02 + 1e-6 * nodes),
        "solve": (4_500 * nodes, 1.0 + 8e-5 * nodes),
        "surface": (200 * nodes, 0.05 + 2e-6 * elements),
        "render": (16 * pixels, 0.3 + 5e-8 * pixels * most),
        "truth": (40 * pixels, frames * (0.2 + 1e-8 * layers * pixels)),
        "measure": (12 * pixels, 0.3 + 0.01 * markers + 1e-7 * pixels * len(scene.measures)),
        "stress": (600 * elements, 0.1 + steps * 2e-5 * elements),
        "export": (300 * nodes, steps * (0.1 + 4e-6 * elements)),
        "report": (6 * pixels, 2.0 + 1e-7 * pixels),
    }
