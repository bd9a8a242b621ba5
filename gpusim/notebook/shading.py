"""Small shaded pictures of surfaces: what a notebook shows of a mesh, a solution, a scene.

Which triangle a pixel sees, and the normal there, come from the renderer's float64 twin; the light
is a lamp beside the camera and a bright sky. No device is opened and no shader compiled for it, so
that a picture is there at once, also where there is no adapter.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays import srgb
from gpusim.arrays.array_types import Bool, Float, Real, Single
from gpusim.gpu.device import device_if_open
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.rendering.local_origin import local_view
from gpusim.optics.rendering.renderer import render
from gpusim.optics.truth import Truth, truth_of
from gpusim.optics.visibility_buffer import visibility_twin
from gpusim.report.html import fitting
from gpusim.surface.paint import Plain
from gpusim.surface.surface import Surface
from gpusim.visualization.turntable import Turntable

Pixels = npt.NDArray[np.uint8]
Colouring = Callable[[Truth], Float]
"""Linear colours (n, 3), 0 to 1, of the n pixels of a truth."""

WIDTH, MOST_HEIGHT, LEAST_HEIGHT = 520, 380, 100
"""px, of a picture."""
DIRECTION = (0.45, 0.8, -0.4)
"""Where a fitted camera looks: from the right in front, and from above."""
_NARROW = 0.26
"""Half a fitted camera's diagonal, over the focal length."""
_FINER = 2
"""Samples along a pixel's side."""
_LAMP = np.array([-0.45, -0.65, -0.62]) / np.linalg.norm([-0.45, -0.65, -0.62])
"""Towards the lamp, in camera axes: on the left, above, behind the camera."""
_FINENESS = (0.25, 0.5, 1.0)
_SECONDS = 0.8
"""That the picture of a pattern may take."""
_EDGE_SHADE = 0.55
_LEAST_FACE = 5.0
"""px along a face's side, below which edges would hide what they are of."""


def fitted_camera(points: Float, direction: Sequence[float] = DIRECTION) -> Camera:
    """A camera that looks along ``direction`` and whose picture ``points`` (P, 3) just fill, z up.

    Its height follows what it shows, within limits.
    """
    x, y, z = np.asarray(direction, np.float64) / np.linalg.norm(direction)
    view = Turntable(azimuth=float(np.arctan2(-x, y)), elevation=float(-np.arcsin(z)))
    wide, tall, _ = np.maximum(np.ptp(view.axes @ points.T, axis=1), 1e-9)
    height = int(np.clip(round(WIDTH * tall / wide), LEAST_HEIGHT, MOST_HEIGHT))
    field_of_view = 2.0 * float(np.arctan(_NARROW * height / np.hypot(WIDTH, height)))
    view = replace(view, field_of_view=field_of_view).fit(points, WIDTH, height)
    return view.camera(WIDTH, height, "fitted")


def resized_camera(camera: Camera, most_width: int = WIDTH, most_height: int = 480) -> Camera:
    """The same view in a smaller picture; itself where it fits."""
    size = fitting((camera.height, camera.width), most_width, most_height)
    return camera if size == (camera.width, camera.height) else _scaled(camera, *size)


def _scaled(camera: Camera, width: int, height: int) -> Camera:
    return camera.reframed(width, height, scale=(width / camera.width, height / camera.height))


def shaded(
    surfaces: Sequence[Surface],
    camera: Camera,
    colouring: Colouring,
    element_of_face: npt.NDArray[np.integer] | None = None,
) -> Pixels:
    """(H, W, 4) sRGB and opacity; transparent where nothing is, for pages of any colour.

    ``element_of_face`` (F,): which faces of all surfaces are parts of one; edges between others
    are drawn where they are far enough apart to be told.
    """
    fine = _scaled(camera, _FINER * camera.width, _FINER * camera.height)
    view = local_view(surfaces, fine, lit=True)
    ids = visibility_twin(view)
    truth = truth_of(view, ids)
    inner = truth.normal @ camera.camera_from_world[:3, :3].T
    light = 0.34 + 0.22 * (0.5 - 0.5 * inner[:, 1]) + 0.5 * np.maximum(inner @ _LAMP, 0.0)
    values = np.clip(colouring(truth) * light[:, None], 0.0, 1.0)
    if element_of_face is not None and len(truth.row):
        values[_edges(truth, element_of_face)] *= _EDGE_SHADE
    picture = np.zeros((fine.height, fine.width, 4))
    picture[truth.row, truth.column] = np.column_stack([values, np.ones(len(values))])
    shape = camera.height, _FINER, camera.width, _FINER, 4
    mean: Float = picture.reshape(shape).mean(axis=(1, 3))
    seen = np.maximum(mean[..., 3:], 1e-9)
    colours = encoded(mean[..., :3] / seen)
    return np.concatenate([colours, np.rint(255.0 * mean[..., 3:]).astype(np.uint8)], axis=2)


def _edges(truth: Truth, element_of_face: npt.NDArray[np.integer]) -> Bool:
    """(n,) bool: pixels whose neighbour on the right or below sees another element."""
    element = np.full((truth.shape[0] + 1, truth.shape[1] + 1), -1, np.int64)
    element[truth.row, truth.column] = element_of_face[truth.face]
    own = element[:-1, :-1]
    shown = len(np.unique(own[own >= 0]))
    if shown and len(truth.row) / shown < (_FINER * _LEAST_FACE) ** 2:
        return np.zeros(len(truth.row), bool)
    other = (own != element[:-1, 1:]) | (own != element[1:, :-1])
    result: Bool = other[truth.row, truth.column]
    return result


def painted(surfaces: Sequence[Surface], camera: Camera) -> Colouring:
    """Colours as the surfaces are painted; patterns as the renderer integrates them."""
    paints = [paint for surface in surfaces for paint in surface.paints.values()]
    if all(isinstance(paint, Plain) for paint in paints):
        table = np.array([np.broadcast_to(paint.ground, 3) for paint in paints], np.float64)
        return lambda truth: table[truth.region]
    albedo = _patterns(surfaces, camera)
    picture = albedo if albedo.ndim == 3 else np.repeat(albedo[..., None], 3, axis=2)

    def colours(truth: Truth) -> Float:
        found: Float = picture[truth.row // _FINER, truth.column // _FINER].astype(np.float64)
        return found

    return colours


def _patterns(surfaces: Sequence[Surface], camera: Camera) -> Single:
    """(H, W) or (H, W, 3) albedo: by the device if one is open, else as fine as time allows, as
    the twin is slow where there are many dots."""
    device = device_if_open()
    if device is not None:
        return render(surfaces, camera, background=0.5, device=device).radiance
    albedo = np.zeros((1, 1), np.float32)
    for factor in _FINENESS:
        begin = time.perf_counter()
        seen = resized_camera(camera, round(factor * camera.width), round(factor * camera.height))
        albedo = render(surfaces, seen, background=0.5, backend="numpy").radiance
        # the next has four times as many pixels
        if 4.0 * (time.perf_counter() - begin) > _SECONDS:
            break
    size = camera.width, camera.height
    return np.asarray(cv2.resize(albedo, size, interpolation=cv2.INTER_LINEAR), np.float32)


def encoded(linear: Real) -> Pixels:
    """Linear values, 0 to 1, by the curve of sRGB (IEC 61966-2-1) as 8 bit."""
    return np.asarray(np.rint(255.0 * srgb.encoded(np.clip(linear, 0.0, 1.0))), np.uint8)
