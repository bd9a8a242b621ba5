"""The scene of a displacement file alone: a camera before its largest side, a speckle on it."""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.field import read_field
from gpusim.mesh import Faces, boundary_faces
from gpusim.optics.calibration.formats import read_calibration
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.camera.standpoint import Side, rig_before
from gpusim.scene import Scene
from gpusim.scene.tables.table import FileUnit, metres
from gpusim.validation import checked, positive, require_one_of

PIXELS, PIXEL_UM, FOCAL_MM = (2448, 2048), 3.45, 35.0
"""A camera and a lens of which laboratories have many."""
_FILLED = 0.92
"""Share of the image that the body takes, in the direction in which it takes more."""
_SPECKLE_PX = 4.0
_FLAT = 0.1
"""Share of the skin that faces one way, for a side to be one."""
_AXIAL, _PLANE = np.cos(np.radians([30.0, 0.5]))
"""Up to which angles a face is of the side along an axis, and such a side is a plane."""
_PREFERRED = np.array([1.0, -2.0, 3.0])
"""Of equal sides the upper one is looked at, else the front, else the right one."""
_TRUTH = ["reference", "displacement", "depth", "flow", "region", "element", "visibility", "normal"]


@checked
def field_scene(
    path: str | PathLike[str],
    *,
    unit: FileUnit = "mm",
    displacement: str | None = None,
    camera: str | PathLike[str] | None = None,
    resolution: tuple[int, int] | None = None,
    speckle_mm: Annotated[float, positive("a diameter > 0")] | None = None,
    step: Literal["last", "all"] = "last",
) -> Scene:
    """A scene that shows what a displacement file holds; nothing is solved.

    Parameters
    ----------
    path : what ``gs.read_field`` takes: CalculiX's .frd, .vtu, .pvd, Exodus, .npz.
    unit : "m", "cm", "mm", "um" or "in", of the file's lengths.
    displacement : name of its nodal variable, where it has no usual one.
    camera : a calibration file (``gs.read_calibration``), of which all cameras are taken. Where the
        first one has no pose there, as in MatchID's and Kalibr's, the rig is placed before the
        body, as its cameras stand to each other. None: a camera that the body fills.
    resolution : (columns, rows) px, of a calibration file that doesn't say so, or of the camera.
    speckle_mm : mean diameter; None: four pixels.
    step : "last": undeformed and the last state; "all": every state of the file.

    Raises
    ------
    InputError
        A file that can't be read, or has no solids or no displacements.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(8, 2, 1), divisions=(4, 1, 1))
    >>> saved = gs.export.write_vtu("bent.vtu", bar.points, bar.cells, point_data={"u": bar.points})
    >>> scene = gs.field_scene("bent.vtu")
    >>> scene.analysis.times, scene.cameras()["front"].camera_from_world[2, :3].round(6) + 0.0
    ((0.0, 1.0), array([ 0.,  0., -1.]))
    """
    require_one_of("field_scene: unit", unit, get_args(FileUnit))
    require_one_of("field_scene: step", step, ("last", "all"))
    field = read_field(path, name=displacement, scale=metres(unit))
    times = sorted({field.start, *(field.times[-1:] if step == "last" else field.times).tolist()})
    faces = boundary_faces(field.mesh)
    normal, nodes = _largest_side(faces), faces.node_numbers()
    up = np.eye(3)[1 if abs(normal[2]) > 0.9 else 2]
    side = Side.of((field.mesh.points[nodes] + field.at(t)[nodes] for t in times), normal, up)
    cameras, tables = _lenses(camera, resolution, side.size)
    if np.array_equal(cameras[0].camera_from_world, np.eye(4)):  # its frame isn't the body's
        cameras = rig_before(side, cameras, _FILLED)
        for table, one in zip(tables, cameras, strict=True):
            _, down, forward = one.camera_from_world[:3, :3]
            target = one.eye + one.to_camera(side.middle)[2] * forward
            table |= {"position_mm": _millimetres(one.eye), "target_mm": _millimetres(target),
                      "up": (np.round(-down, 12) + 0.0).tolist()}  # fmt: skip
    first = cameras[0]
    depth = float(first.to_camera(side.middle)[2])
    pixel = 1e3 * depth / float(first.K[0, 0])
    speckle = float(f"{speckle_mm or _SPECKLE_PX * pixel:.4g}")
    # edges a pixel soft: sharper ones fall between pixels, which correlation takes for noise
    softness = float(f"{min(pixel, speckle / _SPECKLE_PX):.4g}")
    paint = {"name": "speckle", "type": "speckle", "albedo": 0.9, "diameter_mm": speckle,
             "softness_mm": softness, **_where(normal, faces)}  # fmt: skip
    given = {"file": str(Path(path).absolute()), "unit": unit}
    if displacement is not None:
        given["displacement"] = displacement
    name = _name(Path(path).stem, "body")
    return Scene.from_document({
        "schema": 1, "name": name, "description": f"Displacements of {Path(path).name}",
        "body": [{"name": name, "field": given, "paint": [paint]}], "camera": tables,
        "analysis": {"type": "field", "times": times}, "output": {"truth": _TRUTH},
    })  # fmt: skip


def _largest_side(faces: Faces) -> Float:
    """The direction (3,) that most of the skin faces; where it is curved, the middle of its box's
    largest side does."""
    normals, points = faces.area_vectors, faces.points[faces.node_numbers()]
    areas = np.linalg.norm(normals, axis=1)
    ways = np.round(normals / np.maximum(areas, 1e-300)[:, None], 2) + 0.0
    group = np.unique(ways, axis=0, return_inverse=True)[1].ravel()
    sides = np.stack([np.bincount(group, column) for column in normals.T], axis=1)
    if np.linalg.norm(sides, axis=1).max() < _FLAT * areas.sum():
        sides = np.diag(1.0 / np.ptp(points, axis=0))
    large = np.linalg.norm(sides, axis=1)
    alike = sides[large >= 0.999 * large.max()] / large[large >= 0.999 * large.max(), None]
    best: Float = alike[np.argmax(alike @ _PREFERRED)]
    return best


def _where(normal: Float, faces: Faces) -> dict[str, Any]:
    """Of a paint on the side that faces this way, if it is a plane along an axis, else on all
    faces."""
    axis, normals = int(np.argmax(np.abs(normal))), faces.area_vectors
    areas, sign = np.linalg.norm(normals, axis=1), np.sign(normal[axis])
    facing = sign * normals[:, axis] >= _AXIAL * areas
    if facing.any() and (normals[facing] @ normal >= _PLANE * areas[facing]).all():
        return {"where": {"normal": ("+" if sign > 0 else "-") + "xyz"[axis]}}
    return {"mapping": "unfold"}


def _lenses(
    path: str | PathLike[str] | None, resolution: tuple[int, int] | None, sides: Float
) -> tuple[list[Camera], list[dict[str, Any]]]:
    """Cameras, and their tables without poses: of a calibration file, else one that stands upright
    if what it is to see does, whose ``sides`` (3,) are known."""
    if path is None:
        columns, rows = resolution or (PIXELS if sides[0] >= sides[1] else PIXELS[::-1])
        focal = 1e3 * FOCAL_MM / PIXEL_UM
        K = [[focal, 0, 0.5 * (columns - 1)], [0, focal, 0.5 * (rows - 1)], [0, 0, 1]]
        cameras = [Camera(columns, rows, np.array(K), name="front")]
        lenses: list[dict[str, Any]] = [{"pixel_um": PIXEL_UM, "focal_mm": FOCAL_MM}]
    else:
        cameras, file = read_calibration(path, resolution), str(Path(path).absolute())
        lenses = [{"calibration": file, "calibration_camera": k} for k in range(len(cameras))]
    return cameras, [
        {"name": _name(one.name, f"camera-{number}"), "resolution_px": [one.width, one.height],
         **lenses[number]} for number, one in enumerate(cameras)
    ]  # fmt: skip


def _millimetres(point: Float) -> list[float]:
    """As somebody would write them."""
    return [round(1e3 * float(value), 6) + 0.0 for value in point]


def _name(text: str, otherwise: str) -> str:
    """A name that a scene takes."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", text).strip("-")
    return name if re.match(r"[A-Za-z].{0,63}$", name) else otherwise
