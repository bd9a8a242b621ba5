"""The list shows where one is among the fields, and takes clicks."""

from __future__ import annotations

import pytest

from gpusim.view.content.field_values import field_names
from gpusim.view.screenshot import screenshot
from gpusim.view.viewer import Viewer


def test_forward_and_back(run_viewer: Viewer) -> None:
    viewer = run_viewer
    names = field_names(viewer.content)
    seen = []
    for _ in range(4):
        viewer.key("f")
        seen.append(viewer.field)
    assert seen == names[:4]
    viewer.key("d")
    viewer.key("ArrowUp")
    assert viewer.field == names[1]
    for _ in range(3):
        viewer.key("d")
    assert viewer.field == names[-1]  # paint is one of them, and they go round
    viewer.key("ArrowDown")
    assert viewer.field is None


@pytest.mark.parametrize("size", [(480, 320), (900, 800), (200, 90)])
def test_a_click_chooses(run_viewer: Viewer, size: tuple[int, int]) -> None:
    """The chosen one is in sight, however long the list is."""
    viewer = run_viewer
    viewer.key("t")
    for name in (None, "strain_xy", "truth_reference_z"):
        viewer.show_field(name)
        before = screenshot(viewer, size)
        rows = viewer.listed
        assert rows is not None and name in rows.names
    viewer.show_field("von_mises")
    screenshot(viewer, size)
    rows = viewer.listed
    assert rows is not None
    for number in range(len(rows.names)):
        x, y = rows.left + 5.0, rows.top + (number + 0.5) * 1.35 * 14
        assert rows.at(x, y) == number and rows.at(x - 10.0, y) is None
    view, x, y = viewer.view, rows.left + 9.0, rows.top + 4.0
    viewer.press(x, y, 1)
    viewer.move(x + 60.0, y + 60.0)
    viewer.release(x + 60.0, y + 60.0)
    assert viewer.field == rows.names[0] and viewer.view == view  # nothing was turned
    viewer.key("t")
    assert (screenshot(viewer, size) != before).mean() > 0.01
    viewer.press(x, y, 1)
    assert viewer.field == rows.names[0]
    viewer.release(x, y)
