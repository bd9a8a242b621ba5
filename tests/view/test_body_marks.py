"""Marks lie where they belong: the largest value, the undeformed shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpusim.arrays.array_types import Bool
from gpusim.view.screenshot import screenshot
from gpusim.view.viewer import Viewer
from gpusim.visualization.color_scale import value_text
from gpusim.visualization.symbols import Symbols


def changed_by(viewer: Viewer, key: str) -> Bool:
    """Pixels (H, W) that a key changes, everything seen from the front."""
    viewer.key("1")
    viewer.key("Home")
    before = screenshot(viewer)
    viewer.key(key)
    viewer.message = ""
    return np.asarray((screenshot(viewer) != before).any(axis=2))


@pytest.mark.parametrize("name", ["displacement_z", "element_von_mises"])
def test_rings_lie_at_the_smallest_and_the_largest_value(run_viewer: Viewer, name: str) -> None:
    viewer = run_viewer
    viewer.show_field(name)
    changed = changed_by(viewer, "x")
    content = viewer.content
    assert content is not None and viewer.field_values is not None
    mesh, values = content.skins[0].mesh, viewer.field_values.values[0]
    at = mesh.points + content.displacement(0, 1)
    if name.startswith("element"):  # somewhere on the element's outside
        at = at[mesh.cells["hex8"]].mean(axis=1)
    camera, left, top = viewer.camera()
    for extreme in (values.min(), values.max()):
        alike = at[np.abs(values - extreme) <= 1e-4 * np.ptp(values)]  # others by symmetry
        pixels = camera.project(alike) + 0.5 + [left, top]
        row, column = np.indices(changed.shape)
        near = [
            changed[np.hypot(column - x, row - y) < (30 if len(at) == 24 else 13)].sum()
            for x, y in pixels
        ]
        assert max(near) > 60, extreme
    assert 100 < changed.sum() < 0.25 * changed.size


def test_values_that_arent_known_are_not_marked(
    run_viewer: Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer = run_viewer
    viewer.show_field("displacement_z")
    marked: list[str] = []
    monkeypatch.setattr(
        Symbols, "rings", lambda self, marks, *_: marked.extend(text for text, _ in marks)
    )
    viewer.key("x")
    found = viewer.field_values
    assert found is not None
    (height,) = found.values
    low, high = np.sort(height)[[1, 8]]
    some = (height >= low) & (height <= high)
    marks = [f"{word} {value_text(float(value), found.field.unit)}"
             for word, value in (("min", low), ("max", high))]  # fmt: skip
    for known, expected in ((some, marks), (np.zeros_like(some), [])):
        viewer.field_values = replace(found, values=[np.where(known, height, np.nan)])
        viewer.changed()
        marked.clear()
        screenshot(viewer)
        assert marked == expected


def test_the_undeformed_shape(run_viewer: Viewer) -> None:
    """Its lower edge at the free end is drawn where it was, also where the bar has left."""
    viewer = run_viewer
    viewer.deform(16.0)
    changed = changed_by(viewer, "g")
    camera, left, top = viewer.camera()
    edge = np.stack([np.linspace(0.2, 0.24, 40), np.zeros(40), np.full(40, 0.01)], axis=1)
    column, row = (np.floor(camera.project(edge) + 0.5 + [left, top]).astype(int)).T
    near = [changed[r - 1 : r + 2, c].any() for r, c in zip(row, column, strict=True)]
    assert np.mean(near) > 0.95
    moved = edge + np.array([0.0, 0.0, -0.02])
    column, row = (np.floor(camera.project(moved) + 0.5 + [left, top]).astype(int)).T
    assert not changed[row, column].any()


def test_play_goes_round(run_viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    viewer, now = run_viewer, [100.0]
    monkeypatch.setattr("gpusim.view.view_state.time.monotonic", lambda: now[0])
    viewer.show_field("displacement")
    viewer.key(" ")
    frames = []
    for _ in range(40):
        now[0] += 0.05
        viewer.tick()
        frames.append(viewer.frame)
    # two frames: each stands half a second
    assert 3 <= np.count_nonzero(np.diff(frames)) <= 4 and set(frames) == {0, 1}
    assert viewer.field_values is not None
    assert (viewer.field_values.values[0].max() > 0.0) == (viewer.frame == 1)
    viewer.key(" ")
    frame = viewer.frame
    for _ in range(20):
        now[0] += 0.05
        assert not viewer.tick()
    assert viewer.frame == frame
