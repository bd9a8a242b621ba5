"""Planes of the triangles of a view, from which their pixels ask for lamps.

They follow from the records by which the device shades pixels, so that a pixel lies at the same
place in both. The twin finds them from the corners, in float64.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Texels
from gpusim.optics.geometry.triangle_corners import NORMAL
from gpusim.optics.geometry.view import View
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shadow.receivers import PixelReceivers
from gpusim.optics.shadow.scene import Shadows

__all__ = ["planes_on_device", "planes_twin", "with_shadows"]

Array = npt.NDArray[np.float64]

NAME = "optics/shading/receiver_planes"


def planes_on_device(buffers: SceneBuffers, on: npt.NDArray[np.int32]) -> Texels:
    """Of each triangle n / d of its plane n x = d, and its `plane_words`; ``on`` (T,): the occluder
    that it is part of, -1 for none."""
    device, camera = buffers.device, buffers.setup.view.camera
    texels = device.pool.texels(max(len(on), 1), "rgba32uint", "shadow.planes")
    last = np.array([camera.width - 1.0, camera.height - 1.0])
    kernel = device.kernel(NAME, "main", {"distorted": float(camera.lens is not None)})
    bindings = kernel.bind_used(
        params={**buffers.rays(), "last": last, "count": len(on)},
        owners=device.buffer(on, "shadow.owners"), planes=texels,
        **buffers.vertex_buffers.outlines(), **buffers.surface(),
    )  # fmt: skip
    with device.recording("optics.shadow") as recording:
        recording.dispatch(kernel, bindings, threads=(len(on),))
    return texels


def with_shadows(buffers: SceneBuffers, shadows: Shadows | None) -> SceneBuffers:
    """The same scene with shadows, and the planes from which pixels ask for lamps."""
    if shadows is None:
        return buffers
    on = shadows.owners
    if buffers.lines is not None:
        on = np.append(on, on[buffers.lines.parent])
    planes = planes_on_device(buffers, on)
    return buffers.with_shadows(shadows, planes)


def planes_twin(view: View) -> tuple[Array, Array]:
    """(T, 3): n / d of the triangles of a view; (T,): how far normals for shading are from n."""
    planes = PixelReceivers.planes_of(view)
    own = view.corners_of(slice(None), NORMAL)
    cosine = np.abs(np.einsum("tka,ta->tk", own, planes)).min(axis=1)
    cosine /= np.linalg.norm(planes, axis=1)
    return planes, np.sqrt(np.maximum(2.0 - 2.0 * cosine, 0.0))
