"""From a scene file to an output folder, and again."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import gpusim as gs
from gpusim.export.images import read_image
from gpusim.pipeline import run
from tests.support.documented_tables import documented_columns, head
from tests.support.report_figures import figures_drawn

SMALL = {
    "camera.side.resolution_px": [900, 360],
    "output.truth": ["reference", "displacement", "depth", "flow", "region", "element",
                     "visibility", "normal"],
    "output.vtu": True,
    "output.stl": True,
}  # fmt: skip


@pytest.fixture(scope="module")
def scene(checkout: Path) -> gs.Scene:
    return gs.load_scene(checkout / "examples" / "cantilever.toml", SMALL)


@pytest.fixture(scope="module")
def done(scene: gs.Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[gs.Report, Path]:
    out = tmp_path_factory.mktemp("run") / "bar"
    with figures_drawn():
        return run(scene, out), out


def states(report: gs.Report) -> dict[str, str]:
    return {stage.name: stage.state for stage in report.stages}


def test_measured_deflection_is_the_true_one(done: tuple[gs.Report, Path]) -> None:
    report, _ = done
    tip = report.measurements[0]
    # beam theory at the last marker, x = 234 of 240 mm: F x^2 (3 L - x) / (6 E I)
    inertia = 20.0 * 10.0**3 / 12.0
    theory = 50.0 * 234.0**2 * (3 * 240.0 - 234.0) / (6.0 * 70e3 * inertia)
    assert abs(tip.truth - theory) <= 0.02 * theory
    assert abs(tip.error) <= 1e-3 * tip.truth
    assert report.solution is not None and report.solution.converged


def test_a_grey_scene_in_colour_is_measured_the_same(
    scene: gs.Scene, done: tuple[gs.Report, Path], tmp_path: Path
) -> None:
    """Three equal channels; the report shows them."""
    report = run(scene.replace("camera.side.channels", "rgb"), tmp_path / "out")
    image = read_image(tmp_path / "out/images/side/0001.png")
    grey = read_image(done[1] / "images/side/0001.png")
    assert np.array_equal(image, np.repeat(grey[..., None], 3, axis=2))
    assert [item.measured for item in report.measurements] == [
        item.measured for item in done[0].measurements
    ]
    assert report.warnings == ()


def test_output_folder(done: tuple[gs.Report, Path], checkout: Path) -> None:
    _, out = done
    report = json.loads((out / "report.json").read_text())
    assert report["status"] == "done" and report["warnings"] == []
    assert {s["name"] for s in report["stages"]} >= {"solve", "render/side/0001", "measure"}
    for name in (
        "report.html", "scene.toml", "truth.h5", "images/side/0000.png", "images/side/0001.png",
        "solution/bar.pvd", "solution/bar-0001.vtu", "stl/side/0001.stl",
        "measure/deflection.csv",
    ):  # fmt: skip
        assert (out / name).stat().st_size > 0, name
    assert head(out / "measure/deflection.csv") == documented_columns(
        checkout, "measure/<deflection>.csv"
    )
    # the errors of two numbers are no picture
    drawn = sorted(path.name.split("-")[0] for path in (out / "figures").glob("*.png"))
    assert drawn == ["line", "markers"]
    # two iterations of a direct solver are no curve
    assert report["solution"]["method"] == "direct"
    assert not (out / "figures" / "convergence.png").exists()
    assert not list(out.rglob("*.part"))
    image = read_image(out / "images/side/0000.png")
    assert image.shape == (360, 900) and image.dtype == np.uint8
    # brightest pixel at 95 % of full scale: nothing saturates
    assert 240 <= image.max() <= 244


def test_resolved_scene_gives_the_same_scene(done: tuple[gs.Report, Path]) -> None:
    _, out = done
    again = gs.load_scene(out / "scene.toml")
    assert again.cameras[0].resolution == (900, 360)


def test_truth_is_consistent_with_the_camera(done: tuple[gs.Report, Path], scene: gs.Scene) -> None:
    _, out = done
    with h5py.File(out / "truth.h5") as file:
        camera = file["camera/side"]
        K, pose = camera["K"][:], camera["camera_from_world"][:]
        frame = camera["frame/0001"]
        X, u = frame["reference"][:].astype(float), frame["displacement"][:].astype(float)
        flow, depth = frame["flow"][:].astype(float), frame["depth"][:]
        element = frame["element"][:]
        nodal = file["mesh/displacement/0001"][:]
        assert frame["flow"].attrs["unit"] == "px"
    seen = np.isfinite(depth)
    assert 0.05 < seen.mean() < 0.5 and (seen == (element >= 0)).all()
    row, column = np.nonzero(seen)

    def project(points: np.ndarray) -> np.ndarray:
        c = points @ pose[:3, :3].T + pose[:3, 3]
        p = c @ K.T
        return p[:, :2] / p[:, 2:]

    pixel = np.stack([column, row], axis=1)
    here = project((X + u)[seen])
    assert np.abs(here - pixel).max() <= 2e-3
    assert np.abs(project(X[seen]) - (pixel + flow[seen])).max() <= 2e-3
    assert np.abs(u[seen]).max() <= np.abs(nodal).max() * (1 + 1e-6)


def test_rerun_reuses_everything(done: tuple[gs.Report, Path], scene: gs.Scene) -> None:
    first, out = done
    before = (out / "images/side/0001.png").stat().st_mtime_ns
    again = run(scene, out)
    assert {n: s for n, s in states(again).items() if s == "run"} == {}
    assert states(again)["solve"] == "reused"
    assert again.measurements == first.measurements
    assert (out / "images/side/0001.png").stat().st_mtime_ns == before


def test_new_camera_does_not_solve_again(done: tuple[gs.Report, Path], scene: gs.Scene,
                                         tmp_path: Path) -> None:  # fmt: skip
    _, out = done
    copy = tmp_path / "copy"
    shutil.copytree(out, copy)
    report = run(scene.replace("camera.side.focal_mm", 48.0), copy)
    assert states(report)["solve"] == "reused"
    assert states(report)["render/side/0000"] == "run"
    tip = report.measurements[0]
    assert abs(tip.error) <= 1e-3 * tip.truth


def test_numpy_backend_gives_the_same(checkout: Path, tmp_path: Path) -> None:
    # less of the wall, at half of the resolution: NumPy looks for shadows pixel by pixel
    less = {**SMALL, "camera.side.resolution_px": [420, 126], "camera.side.sensor_mm": [15.0, 4.5]}
    small = gs.load_scene(checkout / "examples" / "cantilever.toml", less)
    report = run(small, tmp_path / "gpu")
    twin = run(small, tmp_path / "numpy", backend="numpy")
    for frame in ("0000", "0001"):
        a, b = (read_image(tmp_path / f"{backend}/images/side/{frame}.png").astype(int)
                for backend in ("gpu", "numpy"))  # fmt: skip
        assert np.mean(np.abs(a - b) <= 1) >= 0.9999
    scale = report.measurements[1].measured
    difference = report.measurements[0].measured - twin.measurements[0].measured
    assert abs(difference) <= 1e-3 * scale


def test_skipping_changes_nothing(done: tuple[gs.Report, Path], scene: gs.Scene,
                                  tmp_path: Path) -> None:  # fmt: skip
    report, out = done
    whole = run(scene, tmp_path / "all", skip=False)
    assert "reused" not in states(whole).values()
    for one, other in zip(report.measurements, whole.measurements, strict=True):
        assert one.name == other.name
        assert other.measured == pytest.approx(one.measured, rel=1e-9, abs=1e-9)
        assert other.truth == pytest.approx(one.truth, rel=1e-9, abs=1e-9)
    for frame in ("0000", "0001"):
        a, b = (read_image(place / f"images/side/{frame}.png").astype(int)
                for place in (out, tmp_path / "all"))  # fmt: skip
        # the renderer's shortcuts round otherwise: a grey level more or less here and there
        assert np.abs(a - b).max() <= 1 and np.count_nonzero(a != b) <= 1e-4 * a.size


def test_without_shortcuts_nothing_is_reused(done: tuple[gs.Report, Path], scene: gs.Scene,
                                             tmp_path: Path) -> None:  # fmt: skip
    copy = tmp_path / "copy"
    shutil.copytree(done[1], copy)
    assert "reused" in states(run(scene, copy)).values()
    assert "reused" not in states(run(scene, copy, skip=False)).values()


def test_overexposed_markers_are_warned_of(scene: gs.Scene, tmp_path: Path) -> None:
    plain = scene.replace("output.truth", []).replace("output.vtu", False)
    right = run(plain, tmp_path / "right")
    (chosen,) = json.loads((tmp_path / "right/images/side/exposure.json").read_text()).items()
    assert chosen[0] == "exposure"
    # copied into the scene, the number gives the same pictures; a larger one brighter ones
    run(plain.replace("sensor.exposure", chosen[1]), tmp_path / "copied")
    same = (tmp_path / place / "images/side/0001.png" for place in ("right", "copied"))
    assert len({path.read_bytes() for path in same}) == 1
    bright = plain.replace("sensor.exposure", 1.3 * chosen[1])
    with figures_drawn():
        report = run(bright, tmp_path / "bright")
    assert right.warnings == ()
    assert any("saturated pixels on side-0" in text for text in report.warnings)


def test_a_tilted_camera_is_warned_of(scene: gs.Scene, tmp_path: Path) -> None:
    plain = scene.replace("output.truth", []).replace("output.vtu", False)
    report = run(plain.replace("camera.side.position_mm", [120.0, -1000.0, 105.0]), tmp_path / "t")
    tip = report.measurements[0]
    assert -0.0065 < tip.error / tip.truth < -0.004  # cos 5.7 degrees
    assert any("5.7 degrees off" in text and "0.5 % short" in text for text in report.warnings)


def test_not_converged_says_so(scene: gs.Scene, tmp_path: Path) -> None:
    out = tmp_path / "short"
    short = scene.replace("solver.method", "multigrid").replace("solver.max_iterations", 1)
    with pytest.raises(gs.NotConverged, match="after 1 "):
        run(short, out)
    report = json.loads((out / "report.json").read_text())
    assert report["status"] == "failed"
    assert "expected 1.0e-06" in report["warnings"][0]
    assert [s["state"] for s in report["stages"] if s["name"] == "solve"] == ["failed"]
    assert not (out / "solution").exists() and not (out / "images").exists()


def test_fault_in_the_model_leaves_no_folder(scene: gs.Scene, tmp_path: Path) -> None:
    with pytest.raises(gs.InputError, match="off the painted plane"):
        run(scene.replace("body.bar.paint.side.line.start_mm", [10.0, 1.0, 5.0]), tmp_path / "no")
    assert not (tmp_path / "no").exists()


def test_free_body_is_refused_by_name(scene: gs.Scene, tmp_path: Path) -> None:
    with pytest.raises(gs.InputError, match="rotation about"):
        run(scene.replace("body.bar.support.clamp.where", {"set": "x_min", "z_max_mm": 0.0}),
            tmp_path / "free")  # fmt: skip
    assert not (tmp_path / "free").exists()


@pytest.mark.slow
def test_killed_run_leaves_no_broken_file(checkout: Path, tmp_path: Path) -> None:
    out = tmp_path / "killed"
    command = [
        sys.executable, "-m", "gpusim", "run", str(checkout / "examples/cantilever.toml"),
        "-o", str(out), "--set", "camera.side.resolution_px=[6000, 2400]", "--backend", "numpy",
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 60.0
        while not (out / "solution/displacement.npz").exists():
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.01)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    files = [p for p in out.rglob("*") if p.is_file() and not p.name.endswith(".part")]
    assert {p.name for p in files} >= {"displacement.npz", "scene.toml"}
    assert not list(out.rglob("*.png"))
    with np.load(out / "solution/displacement.npz") as stored:
        assert np.isfinite(stored["u0"]).all()
    plan: dict[str, Any] = json.loads(
        subprocess.run(
            [sys.executable, "-m", "gpusim", "plan", *command[4:5], "-o", str(out), "--json",
             *command[7:]],
            check=True, capture_output=True, text=True,
        ).stdout
    )  # fmt: skip
    assert {s["name"]: s["state"] for s in plan["stages"]}["solve"] == "reused"
