"""Rough cost of a run, from the scene's numbers alone: what ``gpusim plan`` prints.

The rates are those of two CPU cores with a software Vulkan device; `gpusim.plan.machine_speed`
knows how this machine compares. Shaders are compiled when they are first used, which takes longer
than most images; the driver keeps them for later runs, at a quarter of the time.
"""

from __future__ import annotations

from gpusim.scene.description.model import Camera, Markers, Paint
from gpusim.scene.scene import Scene

from .counts import element_counts, mesh_words

__all__ = ["KEPT", "compiled_for", "describe", "effects", "estimate", "target_seconds"]

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


def describe(scene: Scene) -> dict[str, str]:
    """Stage kind -> how much of it there is, in a few words."""
    counts = [element_counts(body.mesh) for body in scene.bodies]
    nodes = sum(count[0] for count in counts)
    size = f"{3 * nodes:,} unknowns, " if all(count[0] for count in counts) else ""
    lights = len(scene.lights)
    lit = f"{lights} light{'s' if lights > 1 else ''}" if lights else "no light: albedo"
    casting = sum(getattr(light, "shadows", False) for light in scene.lights)
    lit += f", shadows of {casting}" if casting else ", no shadows" if lights else ""
    if any(getattr(light, "occlusion", False) for light in scene.lights):
        lit += ", surroundings hidden by surfaces"
    if lights and any(paint.finish.bump for paint in _paints(scene)):
        lit += ", fine relief"
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


def compiled_for(scene: Scene, camera: Camera) -> dict[str, float]:
    """What the images of a camera need compiled, and the seconds that each takes the first time."""
    paints = _paints(scene)
    has = {
        "drawing": True,
        "light": bool(scene.lights),
        "shadows": any(getattr(light, "shadows", False) for light in scene.lights),
        "gloss": bool(scene.lights) and any(paint.finish.roughness < 1.0 for paint in paints),
        "bump": bool(scene.lights) and any(paint.finish.bump for paint in paints),
        "lens": camera.lens is not None,
        "occlusion": any(getattr(light, "occlusion", False) for light in scene.lights),
    }
    return {name: _COMPILE[name] for name, there in has.items() if there}


def _per_image(scene: Scene) -> tuple[float, float]:
    """Seconds of one rendering: for any, and per pixel."""
    if any(getattr(light, "occlusion", False) for light in scene.lights):
        return 0.6, 1.7e-7
    return (0.2, 7e-8) if scene.lights else (0.1, 4e-8)


def target_seconds(camera: Camera) -> float:
    """Seconds of a calibration target's picture, and of what is found in it while others are
    taken: nothing is drawn but where the target is."""
    pixels = camera.resolution[0] * camera.resolution[1]
    return (0.08 + 7e-9 * pixels) * _renderings(camera)


def _renderings(camera: Camera) -> float:
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
    return sum(len(paint.markers) for paint in _paints(scene) if isinstance(paint, Markers))


def estimate(scene: Scene) -> Cost:
    """Stage kind -> (memory in bytes, seconds) of one such stage."""
    counts = [element_counts(body.mesh) for body in scene.bodies]
    nodes = sum(count[0] for count in counts)
    elements = sum(count[1] for count in counts)
    pixels = max((c.resolution[0] * c.resolution[1] for c in scene.cameras), default=0)
    most = max((_renderings(c) for c in scene.cameras), default=1.0)
    frames = len(scene.cameras) * len(scene.analysis.load_factors)
    fixed, per_pixel = _per_image(scene)
    markers = _markers(scene)
    layers = len(scene.output.truth)
    steps = len(scene.analysis.load_factors)
    return {
        "mesh": (200 * nodes, 0.05 + 2e-6 * nodes),
        "model": (100 * nodes, 0.5 + 1e-6 * nodes),
        "solve": (4_500 * nodes, 0.2 + 2e-5 * nodes),
        "surface": (200 * nodes, 0.05 + 2e-6 * elements),
        "render": (16 * pixels, (fixed + per_pixel * pixels) * most),
        "truth": (40 * pixels, frames * (0.2 + 1e-8 * layers * pixels)),
        "measure": (12 * pixels, 0.3 + 0.01 * markers + 2e-8 * pixels * len(scene.measures)),
        "stress": (600 * elements, 0.1 + steps * 2e-5 * elements),
        "export": (300 * nodes, steps * (0.1 + 4e-6 * elements)),
        "report": (6 * pixels, 1.0 + 2e-8 * pixels),
    }
