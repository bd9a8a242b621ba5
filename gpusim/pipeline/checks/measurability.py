"""Whether speckle can be measured in pictures: how large its discs are there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.pictures.visibility import spread_points, unseen
from gpusim.surface import Surface
from gpusim.surface.paint import Speckle

LEAST, MOST = 2.0, 15.0
"""Pixels per disc: below, a disc is aliased to a dot that changes with its place on the grid;
above, a subset has to be large to hold three of them."""
DISCS = 3  # a subset should hold in a row
AIM = "aim at 3 to 5"
LOOKED_AT = 64  # points of a region, at least, to see whether all of it is hidden


def disc_warnings(surfaces: Sequence[Surface], cameras: Sequence[Camera]) -> list[str]:
    """A sentence for each speckle that a camera sees with too few or too many pixels per disc."""
    found = []
    for camera in cameras:
        for surface in surfaces:
            for region, (name, paint) in enumerate(surface.paints.items()):
                if not isinstance(paint, Speckle):
                    continue
                scale = pixels_per_metre(surface, region, camera)
                size = paint.diameter * scale
                if LEAST <= size <= MOST or _hidden(surface, region, camera, surfaces):
                    continue
                what = f"camera {camera.name!r}: the discs of speckle {name!r} on {surface.name!r}"
                if size < LEAST:
                    found.append(
                        f"{what} are {size:.2g} px wide ({1e3 * paint.diameter:.3g} mm); below "
                        f"{LEAST:g} px they alias, and correlation is biased: {AIM} px"
                    )
                elif size > MOST:
                    found.append(
                        f"{what} are {size:.3g} px wide ({1e3 * paint.diameter:.3g} mm); above "
                        f"{MOST:g} px a subset needs {DISCS * size:.0f} px to hold {DISCS} of "
                        f"them: {AIM} px"
                    )
    return found


def pixels_per_metre(surface: Surface, region: int, camera: Camera) -> float:
    """Mean scale at which a camera sees a region: the root of pixels over square metres.

    Of triangles in its image that face it (whichever side of an open surface); NaN if none does.
    """
    topology = surface.topology
    corners = _corners(surface, region)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = corners.mean(axis=1)
    seen = (camera.to_camera(corners)[..., 2] > 0.0).all(axis=1)
    if topology.closed:
        seen &= np.einsum("ti,ti->t", normal, camera.eye - middle) > 0.0
    flat = camera.without_distortion()
    pixels, normal = flat.project(corners[seen]), normal[seen]
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    size = np.array([camera.width, camera.height])
    inside = ((high >= -0.5) & (low <= size - 0.5)).all(axis=1)
    pixels, normal = pixels[inside], normal[inside]
    one, two = pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]
    shown = float(np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]).sum())
    real = float(np.linalg.norm(normal, axis=1).sum())
    return float(np.sqrt(shown / real)) if real > 0.0 else float("nan")


def _corners(surface: Surface, region: int) -> Float:
    """The triangles (T, 3, 3) of a region."""
    topology = surface.topology
    own = topology.triangles[surface.regions[topology.source] == region]
    corners: Float = surface.points[own]
    return corners


def _hidden(surface: Surface, region: int, camera: Camera, surfaces: Sequence[Surface]) -> bool:
    """Whether the camera sees none of points that are spread over a region."""
    corners = _corners(surface, region)
    corners = corners[:: max(1, len(corners) // LOOKED_AT)]
    points = spread_points(corners, LOOKED_AT)
    size = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).repeat(points.shape[1])
    return all(unseen(camera, points.reshape(-1, 3), size, surfaces))
