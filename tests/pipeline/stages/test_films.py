"""Films of a run: what the pictures are, when they were taken, what is made again."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator

import gpusim as gs
from gpusim.errors import SceneError
from gpusim.export.images import read_image
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene
from gpusim.scene.description.video import filming
from tests.support.small_scene import DOCUMENT, small_scene

CAMERA = DOCUMENT["camera"][0]
LOADS = {"type": "static", "load_factors": [0.0, 0.4, 1.0]}
MODES = {"name": "modes", "type": "modes", "camera": "side", "start_px": [9.0, 60.0],
         "end_px": [400.0, 60.0]}  # fmt: skip
TRUTH = ["reference", "displacement", "element"]
LEAN: dict[str, Any] = {"measure": [], "output": {"fields": False}}


def filmed(folder: Path | str = ".", camera: Any = CAMERA, bits: int = 8, **video: Any) -> Scene:
    video = {"frame_rate_Hz": 200.0, **video}
    sensor = {"bits": bits, "upper_bits": bits > 8}
    return small_scene(folder, analysis=LOADS, camera=[camera], video=video, sensor=sensor, **LEAN)


def test_the_film_is_the_pictures(tmp_path: Path) -> None:
    """Bit for bit, with their times, and made again alone when its format changes."""
    gs.run(filmed(bits=12), tmp_path, backend="numpy")
    pictures = [read_image(path) for path in sorted(tmp_path.glob("images/side/*.png"))]
    assert len(pictures) == 3 and not np.array_equal(pictures[0], pictures[2])
    film = gs.read_video(tmp_path / "video/side.mkv")
    assert film.times.tolist() == [0.0, 0.005, 0.01]
    for picture, frame in zip(pictures, film, strict=True):
        assert np.array_equal(frame << 4, picture), "12 of 16 bits"
    assert gs.read_video(tmp_path / "video/preview/side.mp4")[2].shape == (120, 450, 3)
    page = (tmp_path / "report.html").read_text()
    assert "<video" in page and "video/side.mkv" in page and "filmed at 200 a second" in page

    again = filmed(bits=12, format="mraw")
    running = [one.name for one in make_plan(again, tmp_path, backend="numpy").stages if one.runs]
    assert running == ["export", "report"]
    gs.run(again, tmp_path, backend="numpy")
    assert not (tmp_path / "video/side.mkv").exists()
    film = gs.read_video(tmp_path / "video/side.cih")
    assert np.array_equal(film[2] << 4, pictures[2])


def test_rows_of_a_rolling_shutter_have_their_times(tmp_path: Path) -> None:
    """A frame is where its middle row is; the table tells of the first."""
    camera = {**CAMERA, "shutter": {"line_time_us": -4.0}}
    gs.run(filmed(camera=camera, format="tiff"), tmp_path, backend="numpy")
    first, _, last = np.loadtxt(tmp_path / "video/side/times.csv", delimiter=",", skiprows=1)
    middle = first[1] + 0.5 * (CAMERA["resolution_px"][1] - 1) * first[2]
    assert first[2] == -4e-6 and abs(middle) < 1e-18
    assert last[1] - first[1] == pytest.approx(0.01, abs=1e-15)


def test_truth_has_the_time_of_each_row(tmp_path: Path) -> None:
    """Of a bar in its first mode, each row where the sine of its time has it."""
    shutter = {"line_time_us": 40.0, "exposure_ms": 0.2, "samples": 1}
    camera = {**CAMERA, "resolution_px": [360, 96], "shutter": shutter}
    body = [{**DOCUMENT["body"][0], "load": []}]
    modal = {"type": "modal", "count": 1, "duration_s": 0.003, "amplitude_mm": 2.0}
    scene = small_scene(analysis=modal, body=body, camera=[camera], video={"frame_rate_Hz": 700.0},
                        **{**LEAN, "output": {"fields": False, "truth": TRUTH}})  # fmt: skip
    report = gs.run(scene, tmp_path, backend="numpy")
    rate = report.modes[0]["frequency_Hz"]
    bar = scene.solution()["bar"]
    points = bar.mesh.points
    far = bar.displacement(1)[:, 2] / np.sin(2.0 * np.pi * rate / 700.0)
    front = np.isclose(points[:, 1], points[:, 1].min())
    shape = LinearNDInterpolator(points[front][:, [0, 2]], far[front])
    with h5py.File(tmp_path / "truth.h5") as file:
        side = file["camera/side"]
        assert (side.attrs["line_time_s"], side.attrs["exposure_time_s"]) == (4e-5, 2e-4)
        times = [frame.attrs["time_s"] for frame in side["frame"].values()]
        assert times == [k / 700.0 for k in range(3)]
        assert file["mesh/displacement/0002"].attrs["time_s"] == times[2]
        for number, time in enumerate(times):
            frame = side[f"frame/{number:04d}"]
            place, moved = frame["reference"][()], frame["displacement"][()]
            row, column = np.nonzero(place[..., 1] <= points[:, 1].min() + 1e-9)
            cells = bar.mesh.cells["hex8"][frame["element"][()][row, column]]
            inside = points[cells][..., 0]
            assert (np.ptp(inside, axis=1) < 0.0201).all()
            x = place[row, column][:, 0]
            assert ((inside.min(axis=1) <= x + 1e-9) & (x <= inside.max(axis=1) + 1e-9)).all()
            known = shape(place[row, column][:, [0, 2]])
            when = time + (row - 47.5) * 4e-5
            off = moved[row, column, 2] - known * np.sin(2.0 * np.pi * rate * when)
            assert len(row) > 1500 and np.nanmax(np.abs(off)) < 5e-6, "a row is 72"
            assert np.ptp(when) > 2e-4


def test_one_rate_and_one_exposure_for_all() -> None:
    """[video] says them for what doesn't say its own; the document stays as it was written."""
    slow = {**CAMERA, "name": "slow", "shutter": {"exposure_ms": 2.0}}
    same = {**CAMERA, "name": "same", "shutter": {"exposure_ms": 0.5}}
    scene = small_scene(
        analysis=LOADS, camera=[CAMERA, slow, same], **LEAN,
        video={"frame_rate_Hz": 200.0, "exposure_us": 500.0, "cameras": ["slow"]},
    )  # fmt: skip
    assert scene.analysis.frame_rate == 200.0 and filming(scene.video, scene.cameras) == ("slow",)
    shutters = [camera.shutter for camera in scene.cameras]
    assert [one and one.exposure for one in shutters] == [5e-4, 2e-3, 5e-4]
    assert "shutter" not in scene.document["camera"][0]
    assert "frame_rate_Hz" not in scene.document["analysis"]
    assert Scene.from_document(tomllib.loads(scene.to_toml())) == scene
    assert [one.shutter for one in scene.with_effects(no="motion").cameras] == [None] * 3
    fast = {"video.exposure_us": 100.0, "video.frame_rate_Hz": 400.0}
    for other in (
        small_scene(**{**scene.document, "variant": [{"name": "fast", "set": fast}]}).variant(
            "fast"
        ),
        Scene.from_document(scene.document, overrides=fast),
    ):
        assert other.analysis.frame_rate == 400.0
        assert [one.shutter and one.shutter.exposure for one in other.cameras] == [1e-4, 2e-3, 5e-4]
    body = [{**DOCUMENT["body"][0], "load": []}]
    modal = {"type": "modal", "count": 1, "phases": 2}
    shapes = small_scene(analysis=modal, body=body, video={"frame_rate_Hz": 25.0}, **LEAN)
    assert shapes.analysis.frame_rate is None and "film of side" in str(make_plan(shapes)["export"])


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"video": {}}, r"video\.frame_rate_Hz: missing; got no frame_rate_Hz; expected frames"),
        ({"analysis": {**LOADS, "frame_rate_Hz": 50.0}},
         r"video\.frame_rate_Hz: said twice; got 200\.0; expected 50\.0, which analysis"),
        ({"video": {"frame_rate_hz": 200.0, "exposure_us": 9.0},
          "camera": [{**CAMERA, "shutter": {"exposure_ms": 1.0}}], "measure": [MODES],
          "analysis": {"type": "transient", "duration_s": 1.0}},
         r"^scene: 1 fault\n  video\.frame_rate_hz: unknown key \(did you mean frame_rate_Hz\?\)$"),
        ({"analysis": {"type": "transient", "duration_s": 1.0}, "video": {"format": "png"}},
         r"^scene: 1 fault\n  video\.frame_rate_Hz: missing"),
        ({"analysis": {"type": "transient", "duration_s": 1e6}},
         r"analysis\.duration_s: too many frames; got 2e\+08 frames"),
        ({"camera": []}, r"video: needs a camera; got no camera"),
        ({"video": {"frame_rate_Hz": 9.0, "cameras": ["top"]}}, r"video\.cameras.*'?top.*side"),
        ({"video": {"frame_rate_Hz": 9.0, "exposure_us": "long"}}, r"video\.exposure_us.*long"),
        ({"video": {"frame_rate_Hz": 9.0, "format": "avi"}}, r"video\.format.*avi.*ffv1"),
        ({"video": {"frame_rate_Hz": 200.0, "exposure_us": 6000.0}},
         r"^scene: 1 fault\n  video\.exposure_us: longer than a frame; got 6000\.0; expected "),
    ],
)  # fmt: skip
def test_what_cannot_be_filmed_is_told(changes: dict[str, Any], text: str) -> None:
    changes = {"analysis": LOADS, "video": {"frame_rate_Hz": 200.0}, **LEAN, **changes}
    with pytest.raises(SceneError, match=text):
        small_scene(**changes)
