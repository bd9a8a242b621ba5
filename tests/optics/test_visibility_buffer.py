"""Which triangle pixels see, band by band, against the exact twin."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import View, look
from gpusim.optics.visibility_buffer import VisibilityBuffer, visibility_twin
from gpusim.surface.surface import Surface
from gpusim.twin_checks.images import near_an_edge
from gpusim.twin_checks.scenes import sheet


def crumpled_view() -> View:
    """Small triangles over and through each other, and beyond the borders of the image."""
    camera = Camera(59, 39, np.array([[111.0, 0.3, 28.7], [0.0, 110.0, 20.2], [0.0, 0.0, 1.0]]))
    return look([sheet(0.95, 1.3, 0.0), sheet(0.6, 0.6, 0.4)], camera, lit=False)


def seen(device: Device, view: View, rows: int) -> npt.NDArray[np.uint32]:
    """The numbers + 1 of the triangles that pixels see, band by band."""
    visibility, found = VisibilityBuffer.of(device, view, rows), []
    out = device.empty(visibility.ids.stride * rows, "test.out")
    for row0 in range(0, view.camera.height, rows):
        with device.recording("test") as recording:
            visibility.record(recording, row0, rows)
            recording.copy_texture(visibility.ids, out, rows)
        found.append(
            out.read(np.uint32, (rows, visibility.ids.stride // 4))[:, : view.camera.width]
        )
    return np.concatenate(found)[: view.camera.height]


def test_it_sees_what_the_exact_twin_sees(device: Device) -> None:
    view = crumpled_view()
    found, exact = seen(device, view, 14), visibility_twin(view)
    # off by less than half a step of 1/256 px in either direction
    wrong = (found != exact) & ~near_an_edge(view, 1.0 / 256.0)
    assert not wrong.any() and 0.8 < np.mean(found > 0) < 1.0
    hidden = np.setdiff1d(np.arange(1, view.count + 1), found)
    assert len(hidden) > 100, "one sheet hides another one"


def test_of_triangles_in_one_place_the_first_is_seen(device: Device) -> None:
    square = np.array([[-1.0, -1.0, 4.0], [1.0, -1.0, 4.0], [1.0, 1.0, 4.0], [-1.0, 1.0, 4.0]])
    surface = Surface(square, np.array([[0, 1, 2, 3]], np.int32))
    camera = Camera(40, 40, np.array([[80.0, 0.0, 19.3], [0.0, 80.0, 20.1], [0.0, 0.0, 1.0]]))
    view = look([surface, surface, surface], camera, lit=False)
    assert view.count == 6
    assert set(np.unique(seen(device, view, 40))) - {0} == {1, 2}
