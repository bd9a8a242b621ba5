"""From a scene's paints to the paints and paint coordinates of a surface."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.input_file import Reader, read_input
from gpusim.scene.description import model as m
from gpusim.surface import Atlas, CylinderFrame, PaintFrame
from gpusim.surface import paint as paints
from gpusim.surface.surface import plane_frame

__all__ = ["Frame", "build_frame", "build_pattern", "finish_of"]

Array = npt.NDArray[np.float64]
Frame = PaintFrame | CylinderFrame | Atlas
MIDDLES = {"circles": paints.Circles, "aruco": paints.Aruco, "ring_codes": paints.RingCodes}
FINISH = ("roughness", "metallic", "bump")
CORNERS = {"charuco": paints.Charuco, "lines": paints.Lines}


def build_frame(
    paint: m.Pattern,
    points: Array,
    faces: npt.NDArray[np.int32],
    own: npt.NDArray[np.bool_],
    where: str,
) -> Frame:
    """Paint coordinates of the faces that are a paint's ``own`` (F,); ``where`` names it."""
    if paint.wrap is None:
        return plane_frame(points, faces[own], where, paint.up)
    if paint.wrap.axis is None or paint.wrap.axis_point is None:
        return Atlas.unfold(points, faces, own, paint.up)
    return CylinderFrame.fit(points, faces[own], paint.wrap.axis_point, paint.wrap.axis, where)


def finish_of(paint: m.Paint) -> tuple[float, float, paints.Bump | None]:
    """Roughness, metallic share and relief of any paint."""
    roughness, metallic, bump = paint.finish
    if bump is None:
        return roughness, metallic, None
    relief = paints.Bump(bump.height, bump.length, bump.along, bump.stretch, bump.seed)
    return roughness, metallic, relief


def build_pattern(
    paint: m.Pattern, frame: Frame, where: str, read: Reader = read_input
) -> paints.Paint:
    """The paint of a region; ``where`` names it in errors, ``read`` reads its picture."""
    try:
        return _pattern(paint, frame, where, read)
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(where) else f"{where}: {text}") from None


def _pattern(paint: m.Pattern, frame: Frame, where: str, read: Reader) -> paints.Paint:
    if isinstance(paint, m.Speckle):
        return paints.Speckle(
            paint.diameter, paint.coverage, paint.softness, paint.size_law, paint.spread,
            paint.arrangement, paint.seed, paint.dot, paint.albedo, *finish_of(paint),
        )  # fmt: skip
    finish: dict[str, Any] = dict(zip(FINISH, finish_of(paint), strict=True))
    if isinstance(frame, Atlas):
        raise InputError(f"{where}; got mapping 'unfold'; expected it for speckle only")
    if isinstance(paint, m.Markers):
        positions = np.array([marker.position for marker in paint.markers])
        off = _distance(frame, positions)
        bad = np.flatnonzero(~(off <= 1e-3 * paint.size))
        if len(bad):
            marker = paint.markers[bad[0]]
            raise InputError(
                f"{where}: marker {marker.name!r}; got position {list(marker.position)} m, "
                f"{off[bad[0]] * 1e3:.3g} mm off the painted plane; expected a point on it"
            )
        return paints.Markers(
            frame.coordinates(positions), paint.size, paint.dark, paint.light, paint.albedo,
            **finish,
        )  # fmt: skip
    if isinstance(paint, m.Target):
        return _target(paint, frame.coordinates(np.array(paint.places)))
    s, t = (float(value) for value in frame.coordinates(np.array(paint.origin)))
    if isinstance(paint, m.Picture):
        return paints.Image.read(
            read(paint.path), paint.texel, origin=(s, t), dark=paint.dark, light=paint.light,
            ground=paint.albedo, gamma=paint.gamma, **finish,
        )  # fmt: skip
    if isinstance(paint, m.Checker):
        return paints.Checker(
            paint.cell, paint.columns, paint.rows, (s, t), paint.dark, paint.light, paint.albedo,
            *finish_of(paint),
        )  # fmt: skip
    return paints.Dots(
        paint.diameter, paint.pitch, paint.columns, paint.rows, (s, t), paint.dot, paint.albedo,
        *finish_of(paint),
    )  # fmt: skip


def _target(paint: m.Target, places: Array) -> paints.Paint:
    values: dict[str, Any] = dict(paint.values)
    values |= zip(FINISH, finish_of(paint), strict=True)
    result: paints.Paint
    if paint.kind in CORNERS:
        s, t = (float(value) for value in places[0])
        result = CORNERS[paint.kind](origin=(s, t), **values)
    elif paint.kind == "star":
        result = paints.Star(places, **values)
    else:
        result = MIDDLES[paint.kind](places, **values)
    return result


def _distance(frame: PaintFrame | CylinderFrame, points: Array) -> Array:
    """How far points (n, 3) lie off the surface that a frame is for."""
    relative = points - frame.origin
    if isinstance(frame, CylinderFrame):
        across = relative - np.outer(relative @ frame.axis, frame.axis)
        off: Array = np.linalg.norm(across, axis=1) - frame.radius
    else:
        off = relative @ np.cross(frame.s_axis, frame.t_axis)
    return np.abs(off)
