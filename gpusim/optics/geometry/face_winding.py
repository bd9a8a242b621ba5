"""Closed bodies whose faces are wound the wrong way: seen from outside they show their inside."""

from __future__ import annotations

from collections.abc import Sequence

from gpusim.optics.camera.pinhole import Camera
from gpusim.surface.surface import Surface

__all__ = ["wound_inwards"]


def wound_inwards(surfaces: Sequence[Surface], camera: Camera) -> tuple[str, ...]:
    """A warning for each closed surface that is wound inwards around no camera.

    A room that holds the camera is wound inwards rightly: its walls face it.
    """
    result = []
    for surface in surfaces:
        if not surface.inside_out:
            continue
        low, high = surface.points.min(axis=0), surface.points.max(axis=0)
        if not ((low <= camera.eye) & (camera.eye <= high)).all():
            result.append(
                f"surface {surface.name!r} is closed and its faces are wound inwards: the camera "
                "outside sees the far walls' inside, unlit; expected vertices counter-clockwise "
                "seen from outside: turn the faces round (faces[:, ::-1] for triangles)"
            )
    return tuple(dict.fromkeys(result))
