"""From a scene to its objects: the pictures and the solution of a run, made again by hand."""

from __future__ import annotations

import copy
import pickle
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.export.images import read_image
from gpusim.graph.runner import Runner
from gpusim.scene import Scene
from tests.support.small_scene import DOCUMENT, small_scene

CUBE = {"name": "cube", "type": "box", "center_mm": [60.0, 30.0, -9.0],
        "size_mm": [20.0, 20.0, 12.0],
        "poses": [{"position_mm": [60.0, 30.0, -9.0]},
                  {"position_mm": [75.0, 30.0, -14.0], "rotation_deg": [0.0, 20.0, 5.0]}],
        "paint": [{"name": "light", "type": "plain", "albedo": 0.7}]}  # fmt: skip


def scene() -> Scene:
    """A bar and a cube that both move; what is seen is exposed as it is."""
    camera = {**copy.deepcopy(DOCUMENT["camera"][0]), "distortion": [-0.1, 0.02, 1e-3, 0.0],
              "resolution_px": [225, 60]}  # fmt: skip
    output = {"truth": ["displacement"]}
    return small_scene(prop=[CUBE], camera=[camera], measure=[], sensor={"exposure": 1.0},
                       output=output)  # fmt: skip


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("contents") / "out"
    gs.run(scene(), out)
    return out


def test_a_frame_rendered_by_hand_has_the_pixels_of_the_run(done: Path) -> None:
    again = gs.load_scene(done / "scene.toml")
    camera, sensor = again.cameras()["side"], gs.Sensor(bits=8)
    images = [sensor.expose(gs.render(again.surfaces(frame), camera)) for frame in (0, 1)]
    for frame, image in enumerate(images):
        written = read_image(done / f"images/side/{frame:04d}.png")
        np.testing.assert_array_equal(image, written)
    assert np.mean(images[0] != images[1]) > 0.05


def test_the_solution_is_that_of_the_truth(done: Path) -> None:
    bar = scene().solution()["bar"]
    with h5py.File(done / "truth.h5") as file:
        for frame in (0, 1):
            nodal = file[f"mesh/displacement/{frame:04d}"][:]
            np.testing.assert_allclose(bar.displacement(frame), nodal, rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(bar.mesh.points, file["mesh/points"][:])
    np.testing.assert_allclose(bar.reactions(1), [[0.0, 0.0, 50.0]], atol=1e-6)
    np.testing.assert_array_equal(bar.reactions(0), np.zeros((1, 3)))
    one = gs.solve(scene())
    np.testing.assert_allclose(bar.displacement(1), np.reshape(one.u, (-1, 3)), rtol=1e-9)


def test_surfaces_of_no_frame_are_unloaded() -> None:
    made = scene()
    still, cube = made.surfaces()
    assert (still.name, cube.name) == ("bar", "cube")
    np.testing.assert_array_equal(still.points, still.rest)
    np.testing.assert_allclose(cube.points.mean(axis=0), [0.06, 0.03, -0.009], atol=1e-12)
    np.testing.assert_allclose(made.surfaces(1)[1].points.mean(axis=0), [0.075, 0.03, -0.014])
    np.testing.assert_array_equal(made.surfaces(1)[0].rest, still.rest)


def test_a_field_is_read_and_not_solved(checkout: Path) -> None:
    made = gs.load_scene(checkout / "examples" / "strip.toml")
    strip = made.solution()["strip"]
    field = gs.read_field(checkout / "examples" / "strip.frd", scale=1e-3)
    assert strip.frames == 5 and strip.reactions(3).shape == (0, 3)
    np.testing.assert_allclose(strip.displacement(3), field.at(0.6), atol=1e-15)
    assert [one.name for one in made.surfaces(4)] == ["strip", "wall"]


def test_it_is_made_once_and_not_carried_along(monkeypatch: pytest.MonkeyPatch) -> None:
    made, work = scene(), Runner.work
    calls: list[Any] = []
    monkeypatch.setattr(Runner, "work", lambda *rest: calls.append(rest) or work(*rest))
    for frame in (0, 1, 1):
        made.surfaces(frame)
    made.solution()
    assert len(calls) == 1
    other = pickle.loads(pickle.dumps(made))
    assert other == made and other.cameras().keys() == made.cameras().keys() == {"side"}
    other.surfaces(0)
    assert len(calls) == 2


def test_tables_of_cameras_stay_tables() -> None:
    made = scene()
    assert [table.name for table in made.cameras] == ["side"] and len(made.cameras) == 1
    near = made.replace("camera.side.focal_mm", 40.0)
    assert near.cameras()["side"].K[0, 0] == pytest.approx(0.8 * made.cameras()["side"].K[0, 0])


def test_refusals() -> None:
    made = scene()
    bar = made.solution()["bar"]
    for frame in (2, -1, 0.5, float("nan"), True, "1", [1], np.array([0, 1])):
        words = f"scene 'bar': frame; got {frame!r}; expected a whole number from 0 to 1"
        with pytest.raises(InputError, match=re.escape(words)):
            made.surfaces(frame)  # type: ignore[arg-type]
        for told in (bar.displacement, bar.reactions):
            with pytest.raises(InputError, match=re.escape(words)):
                told(frame)  # type: ignore[arg-type]
    for number in (np.int64(1), np.uint8(1), np.array(1)):
        assert (made.surfaces(number)[1].points == made.surfaces(1)[1].points).all()  # type: ignore[arg-type]
    several = small_scene(variant=[{"name": "a"}, {"name": "b"}])
    with pytest.raises(InputError, match=r"got variants; expected one of scene.variant\('a'\)"):
        several.surfaces(0)
    assert len(several.variant("a").surfaces(0)) == 1


def test_scenes_are_loaded_without_numerics(tmp_path: Path) -> None:
    path = tmp_path / "bar.toml"
    path.write_text(scene().to_toml())
    code = (
        f"import sys, gpusim as gs; gs.load_scene({str(path)!r}); "
        "assert not [m for m in sys.modules if m.startswith(('gpusim.pipeline', 'gpusim.optics'))]"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_true_motion_is_what_truth_says_of_the_same_pixels(done: Path) -> None:
    """A pixel of frame 1 sees a point; where that was is what ``flow`` has."""
    given = scene()
    motion = given.motion()
    with h5py.File(done / "truth.h5") as file:
        displacement = file["camera/side/frame/0001/displacement"][...]
    row, column = np.nonzero(np.isfinite(displacement[..., 0]))
    points = motion.seen_at("side", np.stack([column, row], axis=1), 1)
    apart = motion.displacement(points, 1, None) - displacement[row, column]
    assert len(row) > 100 and np.abs(apart).max() <= 1e-6 * np.abs(displacement[row, column]).max()
