"""Files that change while they are shown: what is read again, and what is wrong with it."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest

from gpusim.scene import load_scene
from gpusim.view.content.background_solver import BackgroundSolver
from gpusim.view.screenshot import screenshot
from gpusim.view.viewer import Viewer
from tests.support.viewing import wait_for


def test_reload_and_faults(viewer: Viewer, scene_path: Path) -> None:
    first = screenshot(viewer)
    text = scene_path.read_text(encoding="utf-8")
    scene_path.write_text(text.replace("focal_mm = 50.0", "focal_mm = 60.0"), encoding="utf-8")
    wait_for(viewer, "a focal length")
    assert viewer.content is not None and viewer.fault == ""
    assert viewer.content.cameras[0].K[0, 0] == pytest.approx(60 / 15 * 450)
    np.testing.assert_array_equal(screenshot(viewer), first)  # the view stays
    content = viewer.content
    scene_path.write_text(text.replace("focal_mm", "focal_m"), encoding="utf-8")
    wait_for(viewer, "a fault")
    assert "focal_m" in viewer.fault and viewer.content is content
    assert (screenshot(viewer) != first).any()  # it is said over the last good view
    scene_path.write_text(text, encoding="utf-8")
    wait_for(viewer, "mended")
    assert viewer.fault == ""
    np.testing.assert_array_equal(screenshot(viewer), first)


def test_a_mesh_too_large_for_the_machine(
    viewer: Viewer, scene_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Said as `gpusim run` says it, before anything is built."""
    monkeypatch.setattr("gpusim.pipeline.checks.resources.host_memory", lambda: 8_000_000_000)
    monkeypatch.setattr("gpusim.view.content.loading.build_body", None)
    text = scene_path.read_text(encoding="utf-8")
    scene_path.write_text(text.replace("[12, 2, 1]", "[3000, 1000, 100]"), encoding="utf-8")
    wait_for(viewer, "a fault")
    assert "mesh: needs about 60.6 GB of memory" in viewer.fault


@pytest.mark.parametrize("of_a_file", [False, True])
def test_a_solution_too_large_for_any_machine(
    scene_path: Path, checkout: Path, of_a_file: bool
) -> None:
    """Said by the process that would solve; where the mesh has room it is shown all the same."""
    text = scene_path.read_text(encoding="utf-8")
    scene_path.write_text(text.replace("[12, 2, 1]", "[3000, 1000, 100]"), encoding="utf-8")
    scene = load_scene(checkout / "examples" / "lug.toml" if of_a_file else scene_path)
    # a file's mesh is as large as it was found to be
    made = {scene.bodies[0].mesh: (300_000_000, 300_000_000)} if of_a_file else None
    solver = BackgroundSolver(scene, made)
    try:
        end = time.monotonic() + 60.0
        while solver.running and time.monotonic() < end:
            time.sleep(0.05)
        assert re.match(r"(model|solve): needs about [\d.e+]+ GB of memory", solver.fault)
    finally:
        solver.stop()


def test_whatever_a_reload_raises_is_shown(
    viewer: Viewer, scene_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def damaged(*_: object) -> None:
        raise UnicodeDecodeError("utf-8", b"\xff\xfe", 0, 1, "invalid start byte")

    text = scene_path.read_text(encoding="utf-8")
    with monkeypatch.context() as patch:
        patch.setattr("gpusim.view.view_state.load_content", damaged)
        scene_path.write_text(text + "\n", encoding="utf-8")
        wait_for(viewer, "a fault")
        assert viewer.fault.startswith("UnicodeDecodeError: 'utf-8' codec")
        assert screenshot(viewer).std() > 10.0
    scene_path.write_text(text, encoding="utf-8")
    wait_for(viewer, "mended")
    assert viewer.fault == ""


def test_a_support_of_nothing_is_a_fault_beside_the_picture(
    viewer: Viewer, scene_path: Path
) -> None:
    viewer.key("u")
    text = scene_path.read_text(encoding="utf-8")
    assert 'set = "x_min"' in text
    scene_path.write_text(text.replace('set = "x_min"', "x_min_mm = 900.0"), encoding="utf-8")
    wait_for(viewer, "another set")
    picture = screenshot(viewer)
    assert "support 'clamp'" in viewer.fault and picture[60:150].std() > 20.0
