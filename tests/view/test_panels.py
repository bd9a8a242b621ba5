"""What is written over the picture leaves the body free, and says what a user expects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpusim.gpu import Device
from gpusim.view.content.loading import load_content
from gpusim.view.screenshot import screenshot
from gpusim.view.viewer import Viewer


def test_frames_are_counted_from_one(run_folder: Path) -> None:
    """Beside their number, which is what --frame and files have."""
    content = load_content(run_folder)
    assert content.frame_text(0) == "frame 0 (1 of 2): load factor 0"
    assert content.frame_text(1) == "frame 1 (2 of 2): load factor 1"


def test_stress_of_a_run_that_has_written_none(device: Device, run_folder: Path) -> None:
    viewer = Viewer(device, run_folder, (320, 200))
    viewer.show_field("von_mises")
    (wanted,) = viewer.field_values.values
    viewer.show_field(None)
    seen = []
    while viewer.field is not None or not seen:
        viewer.key("f")
        seen.append(viewer.field)
        if viewer.field == "von_mises":
            np.testing.assert_array_equal(viewer.field_values.values[0], wanted)
            assert wanted.max() > 1.0
    assert {"displacement", "von_mises", "stress_xx", "principal_stress_1"} <= set(seen)
    viewer.close()


@pytest.mark.parametrize("size", [(500, 320), (1280, 800), (400, 900)])
def test_bodies_lie_beside_the_slider_and_the_legend(
    device: Device, run_folder: Path, size: tuple[int, int]
) -> None:
    """As soon as these are there, and until the view is moved."""
    viewer = Viewer(device, run_folder, (640, 480))
    screenshot(viewer, size)  # a window of another size

    def extent() -> np.ndarray:
        camera, left, top = viewer.camera()
        assert viewer.content is not None
        seen = camera.project(viewer.content.outline(viewer.frame, viewer.scale)) + 0.5
        return np.array([seen.min(axis=0), seen.max(axis=0)]) + np.array([left, top])

    def free(picture: np.ndarray) -> np.ndarray:
        """First column of the legend, and first row of the slider's text: panels are pale."""
        pale = (picture > 200).all(axis=2)
        legend = np.flatnonzero(pale[16:24].all(axis=0) & (np.arange(size[0]) > 0.4 * size[0]))
        text = np.flatnonzero(pale[:, size[0] // 2 - 60] & (np.arange(size[1]) > 0.7 * size[1]))
        return np.array([legend.min() if len(legend) else size[0], text.min()])

    width = free(screenshot(viewer, size))
    assert (extent()[0] >= 0.0).all() and (extent()[1] < width).all()
    viewer.show_field("von_mises")
    beside = free(screenshot(viewer, size))
    assert beside[0] < width[0] - 100 and (extent()[1] < beside).all()
    assert np.ptp(extent(), axis=0)[0] > 0.8 * beside[0]  # as large as fits
    viewer.look_through(0)
    screenshot(viewer, size)
    camera, left, top = viewer.camera()
    assert left + camera.width < beside[0] and top + camera.height < beside[1]
    viewer.look_through(None)
    viewer.show_field(None)
    screenshot(viewer, size)
    assert extent()[1, 0] > beside[0]
    viewer.wheel(-1.0, 100, 100)  # moved by hand: it stays where it is
    moved = viewer.view
    viewer.show_field("von_mises")
    screenshot(viewer, size)
    assert viewer.view == moved
    viewer.close()
