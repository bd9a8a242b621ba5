"""Whether an image must be the same as one before, from what has moved between the two."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.surface.surface import Surface

MARGIN = 2.0
"""px around the image in which a change still counts as seen."""
_BORDER = 65  # points on each side of the image whose rays bound what it shows


def same_surfaces(before: Sequence[Surface], after: Sequence[Surface]) -> bool:
    """Whether nothing at all has moved."""
    return len(before) == len(after) and all(
        a is b or (_alike(a, b) and np.array_equal(a.points, b.points))
        for a, b in zip(before, after, strict=True)
    )


def unseen_change(before: Sequence[Surface], after: Sequence[Surface], camera: Camera) -> bool:
    """Whether every face that has moved lies outside of the image, before and after.

    Then a pinhole's image without lights is the same to the last bit. With lights it needn't be:
    what moves outside may throw its shadow inside.
    """
    if len(before) != len(after):
        return False
    return all(
        a is b or (_alike(a, b) and _moves_outside(a, b, camera))
        for a, b in zip(before, after, strict=True)
    )


def _alike(a: Surface, b: Surface) -> bool:
    """The same faces and paint, wherever they are."""
    return (
        a.points.shape == b.points.shape
        and (a.faces is b.faces or np.array_equal(a.faces, b.faces))
        and (a.rest is b.rest or np.array_equal(a.rest, b.rest))
        and (a.regions is b.regions or np.array_equal(a.regions, b.regions))
        and list(a.paints) == list(b.paints)
        and all(p is q for p, q in zip(a.paints.values(), b.paints.values(), strict=True))
    )


def _moves_outside(a: Surface, b: Surface, camera: Camera) -> bool:
    moved = (a.points != b.points).any(axis=1)
    faces = a.faces
    touched = (moved[np.maximum(faces, 0)] & (faces >= 0)).any(axis=1)
    if not touched.any():
        return True
    nodes = np.where(faces[touched] >= 0, faces[touched], faces[touched][:, :1])
    low, high = _bounds(camera)
    outside = np.ones((len(nodes), 5), bool)
    for surface in (a, b):
        x, y, z = np.moveaxis(camera.to_camera(surface.points[nodes]), -1, 0)
        beyond = np.stack(
            [x < low[0] * z, x > high[0] * z, y < low[1] * z, y > high[1] * z, z <= 0.0], axis=-1
        )
        # a face is outside where all its corners lie beyond one plane; it moves on the same side
        outside &= beyond.all(axis=1)
    return bool(outside.any(axis=1).all())


def _bounds(camera: Camera) -> tuple[Float, Float]:
    """Least and greatest x / z and y / z that the image shows, with a margin."""
    u = np.linspace(-0.5, camera.width - 0.5, _BORDER)
    v = np.linspace(-0.5, camera.height - 0.5, _BORDER)
    border = np.concatenate(
        [np.stack([u, np.full(_BORDER, edge)], axis=1) for edge in (v[0], v[-1])]
        + [np.stack([np.full(_BORDER, edge), v], axis=1) for edge in (u[0], u[-1])]
    )
    ideal = camera.undistort(border)
    rays = np.concatenate([ideal, np.ones((len(ideal), 1))], axis=1) @ camera.ray_matrix().T
    margin = MARGIN / np.array([camera.K[0, 0], camera.K[1, 1]])
    return rays[:, :2].min(axis=0) - margin, rays[:, :2].max(axis=0) + margin
