"""A field of another program rendered without solving: from Python, and from the command line."""

from __future__ import annotations

import itertools
import json
import shutil
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipeinc, ellipk, ellipkinc
from typer.testing import CliRunner, Result

import gpusim as gs
from gpusim.cli import app
from gpusim.errors import SceneError
from gpusim.export.images import read_image
from gpusim.plan.plan import make_plan
from tests.support import calculix

LENS = [-0.3, 0.2, 0.002, -0.001]
SMALL = [
    "camera.above.resolution_px=[480, 320]", f"camera.above.distortion={LENS}",
    "analysis.times=[0.0, 0.6, 1.0]",
]  # fmt: skip


def test_the_elastica_ends_where_theory_says(checkout: Path) -> None:
    """Bisshopp & Drucker, "Large deflection of cantilever beams" (1945): by elliptic integrals."""
    field = gs.read_field(checkout / "examples" / "strip.frd")
    load, length = 2.0, 120.0

    def rest(k: float) -> float:
        return float(ellipk(k * k) - ellipkinc(np.arcsin(1 / (k * np.sqrt(2))), k * k))

    k = brentq(lambda k: rest(k) - np.sqrt(load), np.sqrt(0.5) + 1e-9, 0.9999)
    start = np.arcsin(1 / (k * np.sqrt(2)))
    whole = float(ellipeinc(np.pi / 2, k * k) - ellipeinc(start, k * k))
    rise = 1.0 - 2.0 * whole / np.sqrt(load)
    reach = np.sqrt(2.0 * (2 * k * k - 1)) / np.sqrt(load)
    end = np.isclose(field.mesh.points[:, 0], length)
    u = field.at(1.0)[end].mean(axis=0)
    assert abs(u[2] - rise * length) <= 1e-3 * length
    assert abs(u[0] - (reach - 1.0) * length) <= 1e-3 * length


def test_a_field_is_rendered_from_python(checkout: Path) -> None:
    field = gs.read_field(checkout / "examples" / "strip.frd", scale=1e-3)
    faces = gs.mesh.boundary_faces(field.mesh)
    skin = gs.Skin(field.mesh, faces)
    region = np.zeros(len(faces), np.int32)
    surface = skin.surface({"all": gs.paint.Plain(0.4)}, region, {}, "strip")
    camera = gs.Camera.from_lens((12, 8), 25.0, (150, 100), (0.06, -0.4, 0.02), (0.06, 0, 0.02))
    rows = []
    for time in (0.0, 0.3, 1.0):
        frame = gs.render([skin.moved(surface, field.at(time))], camera)
        rows.append(frame.truth().row[frame.truth().column >= 100].mean())
    assert rows[0] > rows[1] + 5 > rows[2] + 10  # it bends upwards in the image


def run_cli(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(one) for one in arguments])


@pytest.fixture(scope="module")
def done(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("field") / "strip"
    sets = [text for value in SMALL for text in ("--set", value)]
    result = run_cli("run", checkout / "examples" / "strip.toml", "-o", out, "--quiet", *sets)
    assert result.exit_code == 0, result.stderr
    return out


def test_the_command_line_renders_without_solving(done: Path, checkout: Path) -> None:
    report = json.loads((done / "report.json").read_text())
    stages = {stage["name"]: stage for stage in report["stages"]}
    assert (stages["solve"]["state"], stages["solve"]["reason"]) == (
        "skipped", "displacements are given",
    )  # fmt: skip
    images = [read_image(done / f"images/above/{k:04d}.png") for k in range(3)]
    assert all(np.mean(a != b) > 0.02 for a, b in itertools.pairwise(images))
    field = gs.read_field(checkout / "examples" / "strip.frd", scale=1e-3)
    with h5py.File(done / "truth.h5") as file:
        for frame, time in enumerate((0.0, 0.6, 1.0)):
            assert file[f"camera/above/frame/{frame:04d}"].attrs["time"] == time
            nodal = file[f"mesh/displacement/{frame:04d}"]
            assert nodal.attrs["time"] == time
            np.testing.assert_allclose(nodal[:], field.at(time), atol=1e-12)
        group = file["camera/above"]
        X, u = group["frame/0001/reference"][:], group["frame/0001/displacement"][:]
        K, lens, pose = (group[key][:] for key in ("K", "distortion", "camera_from_world"))
    np.testing.assert_array_equal(lens, LENS)
    row, column = np.nonzero(np.isfinite(X[..., 0]))
    assert len(row) > 3000
    seen = (X + u)[row, column].astype(float)
    turn = cv2.Rodrigues(pose[:3, :3])[0]
    pixel = cv2.projectPoints(seen, turn, pose[:3, 3], K, lens)[0].reshape(-1, 2)
    assert np.abs(pixel - np.stack([column, row], axis=1)).max() <= 2e-3


def test_a_changed_file_is_rendered_again(checkout: Path, tmp_path: Path) -> None:
    for name in ("strip.toml", "strip.frd"):
        shutil.copy(checkout / "examples" / name, tmp_path / name)

    def keys() -> list[str]:
        plan = make_plan(gs.load_scene(tmp_path / "strip.toml"))
        return [stage.key for stage in plan.stages if stage.name.startswith("render")]

    before = keys()
    assert keys() == before and len(set(before)) == 5
    path = tmp_path / "strip.frd"
    path.write_text(path.read_text().replace("2.50000E-01", "2.60000E-01", 1))
    assert not set(keys()) & set(before)


def test_times_outside_of_the_file_leave_no_folder(checkout: Path, tmp_path: Path) -> None:
    scene = checkout / "examples" / "strip.toml"
    result = run_cli("run", scene, "-o", tmp_path / "no", "--set", "analysis.times=[0.0, 1.5]")
    assert result.exit_code == 2 and "got 1.5; expected 0 to 1" in result.stderr
    assert not (tmp_path / "no").exists()


def test_a_scene_solves_or_is_given_its_displacements(checkout: Path) -> None:
    strip, bar = (checkout / "examples" / f"{name}.toml" for name in ("strip", "cantilever"))
    for path, changes, match in (
        (strip, {"analysis": {"type": "static"}}, 'type.*of a scene whose displacements are given'),
        (strip, {"analysis": {"type": "field"}}, "times.*missing"),
        (strip, {"body.strip.material": "steel"}, "beside field, which gives mesh"),
        (strip, {"body.strip.field.file": "strip.txt"}, "unknown kind of result file"),
        (strip, {"body.strip.field.file": "gone.frd"}, "not found"),
        (bar, {"analysis": {"type": "field", "times": [0.0, 1.0]}}, "field.*missing"),
        (bar, {"analysis": {"times": [0.0]}}, 'times: unknown key.*a key of "field"'),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=match):
            gs.load_scene(path, changes)


def test_calculix_itself_writes_what_we_read(tmp_path: Path) -> None:
    """Its .frd against its .dat, which holds one more digit."""
    for kind in ("hex20", "wedge15", "tet10"):
        box = gs.mesh.box((3.0, 1.0, 0.5), (3, 2, 1))
        if kind != "hex20":
            box = gs.mesh.split(box, "tet4" if kind == "tet10" else "wedge6")
        mesh = gs.mesh.quadratic(box)
        fixed = np.isclose(mesh.points[:, :1], 0.0).repeat(3, axis=1)
        forces = np.where(np.isclose(mesh.points[:, :1], 3.0), [0.0, -0.003, 0.01], 0.0)
        model = gs.Model(mesh, [gs.Isotropic(200.0, 0.3)], fixed=fixed, forces=forces)
        want = calculix.run(model, "full", tmp_path, displacements=True).u[0]
        got = gs.read_field(tmp_path / "model.frd").at(1.0)
        assert np.abs(got - want).max() <= 1e-5 * np.abs(want).max()
