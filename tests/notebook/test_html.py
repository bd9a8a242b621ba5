"""What a notebook shows of each object: its numbers and a picture, and nothing that fails."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim import display
from gpusim.measure import StrainResult
from gpusim.notebook import view
from gpusim.report.model import FramePair, Measurement, Report, Series
from tests.support.measure_images import speckles
from tests.support.small_scene import small_scene


@pytest.fixture(scope="module")
def solution() -> gs.Solution:
    """A bar of 1 x 0.2 x 0.1 without lateral contraction, pulled: u = 2e-3 x, stress 2e-3 E."""
    bar = gs.mesh.box(size=(1.0, 0.2, 0.1), divisions=(8, 2, 1))
    fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    forces = gs.fem.face_force(bar, gs.mesh.select_faces(bar, name="x_max"), total=(4e3, 0, 0))
    return gs.solve(gs.Model(bar, gs.Isotropic(1e8, 0.0), fixed=fixed, forces=forces))


@pytest.fixture(scope="module")
def frame() -> gs.Frame:
    wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    camera = gs.Camera.from_lens((24, 14), 50, (57, 33), (0, 0, 2), (1.1, 0, 0), up=(0, 1, 0))
    return gs.render([wall], camera, backend="numpy")


@pytest.fixture(scope="module")
def moved() -> Any:
    images = [speckles(120, 90, shift=shift) for shift in ((0.0, 0.0), (0.3, -0.2))]
    return gs.measure.dic(*images, subset=21, step=12, backend="numpy")


def html_of(thing: Any) -> str:
    html = thing._repr_html_()
    assert isinstance(html, str)
    return html


def cells(html: str) -> dict[str, str]:
    """The table: name of a row to its value."""
    rows = re.findall(r"<th[^>]*>(.*?)</th>\s*<td[^>]*>(.*?)</td>", html, re.S)
    return dict(rows)


def pictures(html: str) -> list[npt.NDArray[np.uint8]]:
    found = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
    decoded = [
        cv2.imdecode(np.frombuffer(base64.b64decode(text), np.uint8), cv2.IMREAD_UNCHANGED)
        for text in found
    ]
    return [np.asarray(one, np.uint8) for one in decoded]


def test_a_mesh() -> None:
    mesh = gs.mesh.box(size=(0.3, 0.2, 0.1), divisions=(3, 2, 1))
    html = html_of(mesh)
    table = cells(html)
    assert table["nodes"] == "24" and table["cells"] == "6 hex8"
    assert table["size along x, y, z"] == "0.3 x 0.2 x 0.1"
    assert table["face sets"].startswith("x_min (2), x_max (2)")
    (picture,) = pictures(html)
    assert picture.shape[1] <= 640 and picture.shape[2] == 4
    opaque = picture[..., 3] > 0
    # the bar fills its picture, which is transparent elsewhere, and has edges darker than its faces
    assert opaque.any(axis=0).mean() > 0.9 and 0.2 < opaque.mean() < 0.9
    inside = picture[..., 1][picture[..., 3] == 255]
    assert len(np.unique(inside)) > 3 and inside.min() < 0.8 * inside.max()


def test_a_solution(solution: gs.Solution) -> None:
    html = html_of(solution)
    table = cells(html)
    assert table["converged"] == "yes"
    assert table["largest displacement"].startswith("0.002 (node ")
    assert table["largest von Mises stress"].split(" (")[0] == "200000"
    assert table["sum of reactions"] == "−4000, 0, 0"  # noqa: RUF001
    assert "linear-gradient" in html and "Displacements drawn 20 times." in html
    assert len(pictures(html)) == 1


def test_a_surface_and_its_pattern() -> None:
    corners = 0.1 * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    board = gs.Surface(corners, [[0, 1, 2, 3]], gs.paint.Checker(0.05), name="board")
    html = html_of(board)
    assert cells(html)["paint of surface"] == "Checker (1 face)"
    (picture,) = pictures(html)
    inside = picture[..., 1][picture[..., 3] == 255]
    assert inside.min() < 90 and inside.max() > 200


def test_a_camera() -> None:
    camera = gs.Camera.from_lens(
        (36, 24), 50, (600, 400), (1, -2, 3), (1, 0, 3), distortion=(-0.2, 0.1, 0, 0)
    )
    html = html_of(camera)
    table = cells(html)
    assert table["position"] == "1, −2, 3" and table["looks along"] == "0, 1, 0"  # noqa: RUF001
    assert table["field of view"] == "39.60° x 26.99°"
    assert table["distortion"] == "−0.2, 0.1"  # noqa: RUF001
    assert html.count("<polyline") == 18 and "currentColor" in html


def test_a_frame(frame: gs.Frame) -> None:
    html = html_of(frame)
    assert cells(html)["size"] == "57 x 33 px, grey" and cells(html)["rendered by"] == "NumPy"
    (shown,) = pictures(html)
    assert shown.shape == (33 * 5, 57 * 5)  # squares that can be seen
    png = frame._repr_png_()
    assert png is not None
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (33, 57)
    # white where the wall is, black beside it; half of a pixel between by sRGB's curve
    wall = frame.radiance == 0.5
    assert (picture[wall] == 255).all() and (picture[frame.radiance == 0.0] == 0).all()
    share = frame.radiance / 0.5
    curve = 1.055 * np.maximum(share, 0.0031308) ** (1 / 2.4) - 0.055
    assert np.abs(picture - 255.0 * np.where(share > 0.0031308, curve, 12.92 * share)).max() <= 0.51


def test_a_coloured_frame(frame: gs.Frame) -> None:
    red, other = (gs.Frame(frame.view, None, radiance=k * frame.radiance) for k in (1.0, 0.5))
    coloured = gs.Frame.of_planes([red, other, other])
    (picture,) = pictures(html_of(coloured))
    assert "colour" in cells(html_of(coloured))["size"]
    assert tuple(picture[60, 20]) == (188, 188, 255)  # blue, green, red as OpenCV has them


def test_a_released_frame(frame: gs.Frame) -> None:
    gone = gs.Frame(frame.view, None)
    assert gone.released and not frame.released
    assert "released" in html_of(gone) and pictures(html_of(gone)) == []
    assert gone._repr_png_() is None


def test_what_was_measured(moved: Any) -> None:
    html = html_of(moved)
    table = cells(html)
    assert re.fullmatch(r"\d+ of \d+", table["points measured"])
    low, high = (float(v) for v in table["u (px, to the right)"].split(" to "))
    assert 0.28 < low < 0.3 + 0.02 and low <= high < 0.32
    assert len(pictures(html)) == 1
    strain = gs.measure.strain(moved, window=3)
    assert cells(html_of(strain))["strain"] == "green-lagrange"


def test_other_results(moved: Any) -> None:
    mapped = gs.measure.mapped(moved, lambda pixels: 0.1 * pixels)
    low, high = cells(html_of(mapped))["displacement along x (unit of the mapping)"].split(" to ")
    assert 0.028 < float(low) <= float(high) < 0.032
    count = len(moved.points)
    space = gs.measure.StereoResult(
        moved.points, moved.points, moved.points, np.ones((count, 3)),
        np.tile([1.0, 2.0, -3.0], (count, 1)), np.ones((count, 3)), np.ones(count), moved.status,
        21,
    )  # fmt: skip
    table = cells(html_of(space))
    assert table["W (unit of the rig, away)"] == "−3 to −3"  # noqa: RUF001
    assert pictures(html_of(space))


def test_names_are_shown_as_they_are() -> None:
    camera = gs.Camera(20, 10, [[9, 0, 9], [0, 9, 4], [0, 0, 1]], name="<b>$\\frac$\x1b[31m")
    html = html_of(camera)
    assert "&lt;b&gt;$\\frac$\\u001b[31m" in html and "\x1b" not in html


def test_nothing_measured(moved: Any) -> None:
    flat = np.full((64, 64), 128, np.uint8)
    nothing = gs.measure.dic(flat, flat, points=[[32, 32]], backend="numpy")
    table = cells(html_of(nothing))
    assert table["points measured"] == "0 of 1" and table["not measured"] == "1 no texture"
    none = gs.measure.dic(flat, flat, points=np.zeros((1, 2)) + 32, backend="numpy")
    empty = type(none)(**{
        name: value[:0] if isinstance(value, np.ndarray) else value
        for name, value in vars(none).items()
    })  # fmt: skip
    assert cells(html_of(empty))["points measured"] == "0 of 0"
    assert isinstance(gs.measure.strain(moved, window=3), StrainResult)


def test_a_report() -> None:
    x = np.linspace(0.0, 300.0, 5)
    series = Series("beam", x, 1e-3 * x, 1.001e-3 * x, "position (mm)", "deflection", "mm")
    report = Report(
        "bar <b>", "llvmpipe", "done",
        measurements=(Measurement.compare("tip", "mm", 1.001, 1.0, tolerance_relative=0.01),),
        warnings=("too dark",), series=(series,),
    )  # fmt: skip
    html = html_of(report)
    assert "Report of bar &lt;b&gt;" in html and "Warning: too dark" in html
    row = re.findall(r"<td[^>]*>(.*?)</td>", html, re.S)
    assert row == ["1.001000", "1.000000", "0.001000", "+0.10\N{NARROW NO-BREAK SPACE}%", "✓"]
    assert len(pictures(html)) == 1
    failed = Report("bar", "llvmpipe", "failed", failure="no adapter")
    assert "Failed: no adapter" in html_of(failed)


def test_a_report_in_colour(tmp_path: Path) -> None:
    pixels = np.random.default_rng(3).integers(0, 256, (33, 57, 3)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "one.png"), pixels[..., ::-1])
    pair = FramePair("left", tmp_path / "one.png", tmp_path / "one.png", "")
    (picture,) = pictures(html_of(Report("bar", "llvmpipe", "done", frames=(pair,))))
    np.testing.assert_array_equal(picture[..., ::-1], pixels)


def test_a_scene() -> None:
    scene = small_scene()
    html = html_of(scene)
    table = cells(html)
    assert table["body"] == "bar: box, steel"
    assert table["camera"] == "side: 450 x 120 px, 50 mm"
    assert len(pictures(html)) == 2
    wide = pictures(html)[1]
    assert wide.shape[:2] == (120, 450)  # of the camera itself, as it is small
    dark = wide[..., 1][wide[..., 3] > 0] < 90
    assert 0 < dark.sum() < 0.1 * dark.size  # its markers


def test_a_scene_without_its_file(tmp_path: Path) -> None:
    mesh = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    gs.export.write_vtu(tmp_path / "part.vtu", mesh.points, mesh.cells)
    body = small_scene().document["body"][0]
    body |= {"mesh": {"builder": "file", "file": "part.vtu"}, "support": [], "load": []}
    body["paint"] = body["paint"][:1]
    scene = small_scene(tmp_path, body=[body], measure=[])
    (tmp_path / "part.vtu").unlink()
    html = html_of(scene)
    assert "No picture:" in html and "part.vtu" in html


def test_without_an_adapter(solution: gs.Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures come from the twins: no device is looked for."""

    def refused(*_: object, **__: object) -> None:
        raise gs.NoAdapter("none")

    monkeypatch.setattr("gpusim.gpu.context.DeviceContext.__init__", refused)
    monkeypatch.setattr("gpusim.gpu.adapter.find_adapter", refused)
    for thing in (solution, small_scene()):
        assert pictures(html_of(thing))


def test_what_fails_shows_its_text(
    frame: gs.Frame, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(thing: object) -> str:
        raise RuntimeError(thing)

    monkeypatch.setattr(display, "_module", lambda kind: SimpleNamespace(html=fail, png=fail))
    assert frame._repr_html_() is None and frame._repr_png_() is None
    assert capsys.readouterr() == ("", "")


def test_a_picture_that_fails_leaves_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise gs.InputError("surface: none")

    monkeypatch.setattr("gpusim.notebook.mesh.shaded", fail)
    html = html_of(gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1)))
    assert cells(html)["nodes"] == "8" and "No picture: surface: none" in html


def test_a_large_mesh_is_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gpusim.notebook.mesh.MOST_CELLS", 5)
    html = html_of(gs.mesh.box(size=(3, 2, 1), divisions=(3, 2, 1)))
    assert "plot() draws it" in html and pictures(html) == []


def test_a_still_view(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = small_scene()
    still = scene.view()
    assert "needs a notebook" in repr(still) and len(pictures(html_of(still))) == 1
    monkeypatch.setattr(view, "in_notebook", lambda: True)
    monkeypatch.setitem(__import__("sys").modules, "anywidget", None)
    seen = scene.view(camera="side", size=(225, 60))
    assert seen.pixels.shape[:2] == (60, 225)
    assert "gpusim[notebook]" in html_of(seen) and seen._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(gs.InputError, match=r"camera; got 'top'; expected one of \['side'\]"):
        scene.view(camera="top")
    with pytest.raises(gs.InputError, match="size; got"):
        scene.view(size=(0, 5))
