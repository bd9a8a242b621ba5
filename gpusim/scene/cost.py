"""Rough cost of a run, from the scene's numbers alone: what ``gpusim plan`` prints.

The rates are those of two CPU cores with a software Vulkan device; a GPU needs less.
"""

from __future__ import annotations

from .model import BoxMesh, Markers, MeshRecipe
from .scene import Scene

__all__ = ["describe", "element_counts", "estimate"]

Cost = dict[str, tuple[int, float]]


def element_counts(recipe: MeshRecipe) -> tuple[int, int]:
    """Nodes and elements that a builder makes, to within the rounding of its divisions."""
    if isinstance(recipe, BoxMesh):
        nx, ny, nz = recipe.divisions
        return (nx + 1) * (ny + 1) * (nz + 1), nx * ny * nz
    along = [
        max(1, round(length / recipe.element))
        for length in (
            recipe.foot,
            recipe.height,
            recipe.length - recipe.load_length - recipe.column_thickness,
            recipe.load_length,
        )
    ]
    section, lines = recipe.through * recipe.across, (recipe.through + 1) * (recipe.across + 1)
    # the joint, through x through, belongs to both members
    elements = (sum(along) + recipe.through) * section
    return (sum(along) + recipe.through + 1) * lines, elements


def describe(scene: Scene) -> dict[str, str]:
    """Stage kind -> how much of it there is, in a few words."""
    counts = [element_counts(body.mesh) for body in scene.bodies]
    nodes = sum(count[0] for count in counts)
    lights = len(scene.lights)
    lit = f"{lights} light{'s' if lights > 1 else ''}" if lights else "no light: albedo"
    wanted = [name for name in ("vtu", "stl") if getattr(scene.output, name)]
    return {
        "mesh": f"{nodes:,} nodes, {sum(count[1] for count in counts):,} elements",
        "solve": f"{3 * nodes:,} unknowns",
        "render": lit,
        "truth": f"{len(scene.output.truth)} layers",
        "measure": f"{_markers(scene)} markers",
        "export": ", ".join(wanted),
    }


def _markers(scene: Scene) -> int:
    paints = [paint for body in scene.bodies for paint in body.paints]
    paints += [prop.paint for prop in scene.props]
    return sum(len(paint.markers) for paint in paints if isinstance(paint, Markers))


def estimate(scene: Scene) -> Cost:
    """Stage kind -> (memory in bytes, seconds) of one such stage."""
    counts = [element_counts(body.mesh) for body in scene.bodies]
    nodes = sum(count[0] for count in counts)
    elements = sum(count[1] for count in counts)
    pixels = max((c.resolution[0] * c.resolution[1] for c in scene.cameras), default=0)
    frames = len(scene.cameras) * len(scene.analysis.load_factors)
    markers = _markers(scene)
    layers = len(scene.output.truth)
    steps = len(scene.analysis.load_factors)
    return {
        "mesh": (200 * nodes, 0.05 + 2e-6 * nodes),
        "model": (100 * nodes, 0.02 + 1e-6 * nodes),
        "solve": (3_000 * nodes, 1.0 + 4e-4 * nodes),
        "surface": (200 * nodes, 0.05 + 2e-6 * elements),
        "render": (16 * pixels, 0.3 + 5e-8 * pixels),
        "truth": (40 * pixels, frames * (0.2 + 1e-8 * layers * pixels)),
        "measure": (12 * pixels, 0.3 + 0.01 * markers + 1e-7 * pixels * len(scene.measures)),
        "export": (300 * nodes, steps * (0.1 + 4e-6 * elements)),
        "report": (6 * pixels, 2.0 + 1e-7 * pixels),
    }
