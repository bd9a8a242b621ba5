"""Which triangle pixels see, found by the compute program, against the rasteriser's answer."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import View, look
from gpusim.optics.raster.compute_raster import compute_raster_twin
from gpusim.optics.raster.id_buffer import visibility_twin
from gpusim.optics.raster.visibility_buffer import MAX_BOX, VisibilityBuffer
from gpusim.surface.surface import Surface
from gpusim.twin_checks.images import near_an_edge
from gpusim.twin_checks.scenes import crumpled_view


def seen(device: Device, view: View, rows: int) -> npt.NDArray[np.uint32]:
    """The numbers + 1 of the triangles that pixels see, band by band."""
    visibility, found = VisibilityBuffer(device, view, rows), []
    out = device.empty(visibility.ids.stride * rows, "test.out")
    for row0 in range(0, view.camera.height, rows):
        with device.recording("test") as recording:
            visibility.record(recording, row0, rows)
            visibility.number(recording, row0, rows)
            recording.copy_texture(visibility.ids, out, rows)
        found.append(
            out.read(np.uint32, (rows, visibility.ids.stride // 4))[:, : view.camera.width]
        )
    return np.concatenate(found)[: view.camera.height]


def test_it_sees_what_the_exact_twin_sees(device: Device) -> None:
    view = crumpled_view()
    if not device.atomics64:
        pytest.skip("no 64-bit atomics")
    assert view.extent <= MAX_BOX
    found, exact = seen(device, view, 14), visibility_twin(view)
    np.testing.assert_array_equal(found, compute_raster_twin(view, 0, view.camera.height))
    # off by less than half a step of 1/256 px in either direction
    wrong = (found != exact) & ~near_an_edge(view, 1.0 / 256.0)
    assert not wrong.any() and 0.8 < np.mean(found > 0) < 1.0
    hidden = np.setdiff1d(np.arange(1, view.count + 1), found)
    assert len(hidden) > 100, "one sheet hides another one"


def test_devices_without_64_bit_atomics_take_the_rasteriser(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = crumpled_view()
    found = seen(device, view, 20)
    monkeypatch.setattr(Device, "atomics64", False)
    assert VisibilityBuffer(device, view, 20).depth is not None
    wrong = (seen(device, view, 20) != found) & ~near_an_edge(view, 1.0 / 128.0)
    assert not wrong.any()


def test_large_triangles_are_left_to_the_rasteriser(device: Device) -> None:
    square = np.array([[-1.0, -1.0, 4.0], [1.0, -1.0, 4.0], [1.0, 1.0, 4.0], [-1.0, 1.0, 4.0]])
    surface = Surface(square, np.array([[0, 1, 2, 3]], np.int32))
    for width, rasterised in ((60, False), (100, True)):
        K = np.array([[2.0 * width, 0.0, 0.5 * width], [0.0, 2.0 * width, 20.0], [0.0, 0.0, 1.0]])
        view = look([surface], Camera(width, 40, K), lit=False)
        visibility = VisibilityBuffer(device, view, 40)
        assert (visibility.depth is not None) == (rasterised or not device.atomics64)
        assert set(np.unique(seen(device, view, 40))) <= {0, 1, 2}


def test_of_triangles_in_one_place_the_first_is_seen(device: Device) -> None:
    square = np.array([[-1.0, -1.0, 4.0], [1.0, -1.0, 4.0], [1.0, 1.0, 4.0], [-1.0, 1.0, 4.0]])
    surface = Surface(square, np.array([[0, 1, 2, 3]], np.int32))
    camera = Camera(40, 40, np.array([[80.0, 0.0, 19.3], [0.0, 80.0, 20.1], [0.0, 0.0, 1.0]]))
    view = look([surface, surface, surface], camera, lit=False)
    assert view.count == 6
    assert set(np.unique(seen(device, view, 40))) - {0} == {1, 2}
