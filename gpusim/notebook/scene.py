"""A scene: what is in it, how it looks, and where its cameras and lamps are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.notebook.axes import flat_axes
from gpusim.notebook.camera import draw_camera, plane_axes
from gpusim.notebook.page import Picture, page
from gpusim.notebook.shading import fitted_camera, painted, resized_camera, shaded
from gpusim.pipeline.checks.resources import waits_for_cad
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.pipeline.scene_objects.surfaces import build_body, build_prop, posed
from gpusim.report.style import MUTED, named
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.surface import Surface

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST = 6
_CAMERA_WIDTH, _CAMERA_HEIGHT = 480, 320  # px
_SHOWN = 350  # px on the page
_MM = 1e3
_LAMP = "#e0a100"


@dataclass(frozen=True, eq=False)
class SceneSurfaces:
    """What stands in a scene before it is loaded: bodies, and what is around them."""

    bodies: list[Surface]
    props: list[Surface]

    @property
    def all(self) -> list[Surface]:
        return [*self.bodies, *self.props]

    @property
    def points(self) -> Float:
        """(P, 3) of the bodies, m; of the props where there are no bodies."""
        return np.concatenate([one.points for one in self.bodies or self.props])


def scene_surfaces(scene: Scene) -> SceneSurfaces:
    """Bodies and props, built. Raises InputError for a file that can't be read or meshed."""
    bodies = [build_body(body, scene.input).surface for body in scene.bodies]
    board = scene.calibration.board if scene.calibration is not None else None
    props = [
        posed(build_prop(prop, scene.input), prop) for prop in scene.props if prop.name != board
    ]
    return SceneSurfaces(bodies, props)


def html(scene: Scene) -> str:
    """Bodies, cameras, lights, measures; the bodies, and what the first camera sees."""
    rows = [
        *_listed("body", [f"{body.name}: {_mesh(body)}" for body in scene.bodies]),
        *_listed("beside it", [prop.name for prop in scene.props]),
        *_listed("camera", [_camera(one) for one in scene.cameras]),
        *_listed("light", [f"{one.name} ({one.type})" for one in scene.lights]),
        *_listed("measured", [f"{one.name} ({one.type})" for one in scene.measures]),
        *_listed("variant", [one.name for one in scene.variants]),
    ]
    notes = [" ".join(scene.description.split())] if scene.description else []
    if waits_for_cad(scene):
        return page(f"Scene {scene.name}", rows, notes=[*notes, "Not drawn: meshing takes long."])
    try:
        built = scene_surfaces(scene)
    except InputError as error:
        return page(f"Scene {scene.name}", rows, notes=[*notes, f"No picture: {error}"])
    pictures = [partial(_bodies, built)]
    if scene.cameras:
        pictures.append(partial(_through, scene, built.all))
    notes.append("Pictures show paint under plain light: not the scene's lamps and shadows.")
    return page(f"Scene {scene.name}", rows, pictures, notes)


def plot(scene: Scene, ax: Axes | None, *, plane: str = "xy", **style: Any) -> Axes:
    """Bodies, props, cameras with what they see, and lamps: from above or from a side, in mm."""
    across, up = plane_axes(plane)
    ax = flat_axes(ax)
    built = scene_surfaces(scene)
    _draw_surfaces(ax, built.props, [across, up], "none", MUTED)
    _draw_surfaces(ax, built.bodies, [across, up], style.pop("color", "#7d93a5"), "none")
    centre = 0.5 * (built.points.min(axis=0) + built.points.max(axis=0))
    for described in scene.cameras:
        camera = build_camera(described, scene.input)
        forward = camera.camera_from_world[2, :3]
        reach = max(float((centre - camera.eye) @ forward), 1e-3)
        draw_camera(ax, camera, plane, reach, _MM, **style)
    for light in scene.lights:
        place = getattr(light, "position", None)
        if place is not None:
            at = _MM * np.array(place)[[across, up]]
            ax.plot(*at, "*", color=_LAMP, markersize=11)
            ax.annotate(
                named(light.name), (at[0], at[1]), xytext=(6, 6), textcoords="offset points"
            )
    ax.set(xlabel=f"{'xyz'[across]} (mm)", ylabel=f"{'xyz'[up]} (mm)", aspect="equal")
    ax.set_title(named(scene.name))
    return ax


def _listed(name: str, values: Sequence[str]) -> list[tuple[str, ...]]:
    shown = list(values[:_MOST])
    shown += [f"and {len(values) - _MOST} more"] if len(values) > _MOST else []
    return [(name if k == 0 else "", value) for k, value in enumerate(shown)]


def _mesh(body: m.Body) -> str:
    material = f", {body.material.name}" if body.material is not None else ""
    recipe = getattr(body.mesh, "builder", None) or getattr(body.mesh, "path", "").split("/")[-1]
    return f"{recipe}{material}"


def _camera(camera: m.CameraTable) -> str:
    width, height = camera.resolution
    lens = f", {camera.focal_mm:g} mm" if camera.focal_mm else ""
    return f"{camera.name}: {width} x {height} px{lens}"


def _bodies(built: SceneSurfaces) -> Picture:
    surfaces = built.bodies or built.props
    camera = fitted_camera(built.points)
    pixels = shaded(surfaces, camera, painted(surfaces, camera))
    return Picture("the bodies", pixels, shown_width=_SHOWN)


def _through(scene: Scene, surfaces: Sequence[Surface]) -> Picture:
    """What the first camera sees under plain light, small."""
    camera = build_camera(scene.cameras[0], scene.input)
    small = resized_camera(camera, _CAMERA_WIDTH, _CAMERA_HEIGHT)
    pixels = shaded(surfaces, small, painted(surfaces, small))
    return Picture(f"camera {camera.name}", pixels, f"Camera {camera.name}.", shown_width=_SHOWN)


def _draw_surfaces(
    ax: Axes, surfaces: Sequence[Surface], axes: list[int], fill: str, line: str
) -> None:
    from matplotlib.collections import PolyCollection

    for surface in surfaces:
        corner = np.where(surface.faces < 0, surface.faces[:, [2] * 4], surface.faces)
        places = _MM * surface.points[corner][:, :, axes]
        ax.add_collection(PolyCollection(list(places), facecolor=fill, edgecolor=line))
        ax.update_datalim(places.reshape(-1, 2))
    ax.autoscale_view()
