"""Props whose files carry texture coordinates, and the pictures that lie on them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from PIL import Image as Pillow
from scipy.ndimage import map_coordinates, spline_filter

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.files.input_file import read_input
from gpusim.mesh import read_textured
from gpusim.pipeline.scene_objects.surfaces import build_prop
from gpusim.scene import Scene
from gpusim.surface.paint import Image, Plain

Array = npt.NDArray[np.float64]

# a tent of two sheets: its ridge is a seam, where the second sheet's picture begins anew, mirrored
OBJ = """mtllib tent.mtl
v -30 0 -20
v 0 -6 -20
v 0 -6 20
v -30 0 20
v 30 0 -20
v 30 0 20
vt 0.1 0.05
vt 0.9 0.1
vt 0.85 0.9
vt 0.05 0.95
vt 2.9 0.2
vt 2.1 0.1
vt 2.15 0.8
usemtl photo
f 1/1 2/2 3/3
f 1/1 3/3 4/4
usemtl {second}
f 2/5 5/6 6/7
f 2/5 6/7 3/-6
"""
MTL = "newmtl photo\nKd 1 1 1\nmap_Kd {file}\nnewmtl red paint\nKd 0.5 0.1 0.05\n"


def tent(folder: Path, second: str = "photo", picture: str = "photo.png") -> Path:
    rng = np.random.default_rng(7)
    smooth = cv2.GaussianBlur(rng.uniform(0.0, 1.0, (37, 53)), (0, 0), 1.6)
    values = 30.0 + 190.0 * (smooth - smooth.min()) / np.ptp(smooth)
    cv2.imwrite(str(folder / "photo.png"), values.astype(np.uint8))
    (folder / "tent.mtl").write_text(MTL.format(file=picture))
    path = folder / "tent.obj"
    path.write_text(OBJ.format(second=second))
    return path


def scene(path: Path, **more: Any) -> Scene:
    paint = {"name": "look", "type": "image", "mapping": "uv", "albedo": 0.4, **more}
    prop = {"name": "tent", "type": "mesh", "file": str(path), "paint": [paint]}
    camera = {
        "name": "left", "sensor_mm": [7.2, 4.8], "resolution_px": [93, 62], "focal_mm": 9.0,
        "position_mm": [4.0, -90.0, 7.0], "target_mm": [0.0, 0.0, 0.0],
    }  # fmt: skip
    return Scene.from_document({"schema": 1, "name": "t", "camera": [camera], "prop": [prop]})


def rays(picture: Array, camera: gs.Camera, n: int) -> Array:
    """The spline's values where n x n rays a pixel meet the tent, by the OBJ's text; NaN beside."""
    points = np.array([[-30, 0, -20], [0, -6, -20], [0, -6, 20], [-30, 0, 20], [30, 0, -20],
                       [30, 0, 20]]) * 1e-3  # fmt: skip
    vt = np.array([[0.1, 0.05], [0.9, 0.1], [0.85, 0.9], [0.05, 0.95], [2.9, 0.2], [2.1, 0.1],
                   [2.15, 0.8]])  # fmt: skip
    sheets = [((0, 1, 2), (0, 1, 2)), ((0, 2, 3), (0, 2, 3)), ((1, 4, 5), (4, 5, 6)),
              ((1, 5, 2), (4, 6, 1))]  # fmt: skip
    step = (np.arange(n) + 0.5) / n - 0.5
    x = (np.arange(camera.width)[:, None] + step).ravel()
    eye, (rows, columns) = camera.eye, picture.shape
    spline = spline_filter(picture, order=5, mode="reflect")
    result = np.full((camera.height, n, len(x)), np.nan)
    for row, seen in enumerate(result):  # the rays of all rows wouldn't fit the caches
        at = np.stack([*np.meshgrid(x, row + step), np.ones(seen.shape)], axis=-1)
        ways = at @ np.linalg.inv(camera.K).T @ camera.camera_from_world[:3, :3]
        for corner, uv in sheets:
            a, b, c = points[list(corner)]
            weights = ways @ np.linalg.inv(np.array([a - eye, b - eye, c - eye]))
            weights /= weights.sum(axis=2, keepdims=True)
            inside = (weights >= 0.0).all(axis=2)
            s, t = np.moveaxis(weights[inside] @ vt[list(uv)], 1, 0) % 1.0
            place = [rows - t * rows - 0.5, s * columns - 0.5]
            seen[inside] = map_coordinates(spline, place, order=5, mode="reflect", prefilter=False)
    return result.reshape(camera.height, n, camera.width, n).mean(axis=(1, 3))


def test_a_picture_lies_as_the_coordinates_say_seams_included(tmp_path: Path) -> None:
    """0.6 to 2.4 texels a pixel against 1600 rays each, through the OBJ's text alone.

    Pixels of the ridge are as right as those at any edge of a bitmap; were it none, single ones
    would be off by 0.06.
    """
    given = scene(tent(tmp_path))
    surface = build_prop(given.props[0], given.input)
    camera = gs.Camera.from_lens(
        (7.2, 4.8), 9.0, (93, 62), (4e-3, -0.09, 7e-3), (0.0, 0.0, 0.0)
    )  # fmt: skip
    picture = cv2.imread(str(tmp_path / "photo.png"), cv2.IMREAD_GRAYSCALE) / 255.0
    want = rays(picture, camera, 40)
    shows = np.isfinite(want)
    assert shows.mean() > 0.4 and np.ptp(want[shows]) > 0.5
    for backend in ("gpu", "numpy"):
        error = (gs.render([surface], camera, backend=backend).radiance - want)[shows]
        rms, worst = np.sqrt(np.mean(error**2)), np.abs(error).max()
        assert rms < 1e-3 and worst < 8e-3, f"{backend}: RMS {rms:.1e}, worst {worst:.1e}"


def test_materials_are_pictures_or_colours(tmp_path: Path) -> None:
    given = scene(tent(tmp_path, "red paint"), roughness=0.4)
    surface = build_prop(given.props[0], given.input)
    names = [list(surface.paints)[number] for number in surface.regions]
    assert names == ["look", "look", "look/red paint", "look/red paint"]
    red = surface.paints["look/red paint"]
    assert isinstance(red, Plain) and red.roughness == 0.4
    assert red.albedo == (0.5, 0.1, 0.05)
    assert isinstance(surface.paints["look"], Image)
    # one picture for all, whatever the file says
    cv2.imwrite(str(tmp_path / "other.png"), np.full((4, 5), 128, np.uint8))
    one = scene(tent(tmp_path, "red paint"), file=str(tmp_path / "other.png"))
    assert set(build_prop(one.props[0], one.input).regions) == {1}


def test_colours_multiply_pictures_and_libraries_are_there(tmp_path: Path) -> None:
    path = tent(tmp_path)
    (tmp_path / "tent.mtl").write_text("newmtl photo\nKd 0.5 0.25 0.125\nmap_Kd photo.png\n")
    paint = build_prop(scene(path).props[0], read_input).paints["look"]
    assert isinstance(paint, Image)
    np.testing.assert_allclose(paint.light, (0.5, 0.25, 0.125))
    path.write_text(path.read_text().replace("tent.mtl", "away.mtl"))
    with pytest.raises(InputError, match=r"'away\.mtl', of material 'photo', isn't there"):
        build_prop(scene(path).props[0], read_input)
    # pictures of its own need none
    cv2.imwrite(str(tmp_path / "other.png"), np.full((4, 5), 128, np.uint8))
    one = scene(path, file=str(tmp_path / "other.png"))
    assert set(build_prop(one.props[0], one.input).regions) == {1}


def test_files_that_are_named_belong_to_the_scene(tmp_path: Path) -> None:
    path = tent(tmp_path)
    given = scene(path)
    (tmp_path / "photo.png").write_bytes((tmp_path / "photo.png").read_bytes()[:-1])
    with pytest.raises(InputError, match=r"photo\.png: was changed"):
        build_prop(given.props[0], given.input)
    with pytest.raises(InputError, match=r"'away\.png', of material 'photo', isn't there"):
        build_prop(scene(tent(tmp_path, picture="away.png")).props[0], read_input)
    path.write_text(OBJ.format(second="photo").replace("vt 2.9 0.2\n", ""))
    with pytest.raises(InputError, match=r"tent\.obj:18: a face names vt 7; got 6 so far"):
        read_textured(path)
    tent(tmp_path).write_text(OBJ.format(second="photo").replace("2/5 5/6 6/7", "2 5 6"))
    with pytest.raises(InputError, match="got faces without; expected some for every corner"):
        build_prop(scene(path).props[0], read_input)


def test_a_glb_with_its_picture_inside(tmp_path: Path) -> None:
    """trimesh writes it; a quarter turn about x in its node goes with the points."""
    picture = np.zeros((8, 12, 3), np.uint8)
    picture[:3] = 255, 128, 0  # the upper rows
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    square = trimesh.Trimesh(
        [[0, 0, 0], [3, 0, 0], [3, 2, 0], [0, 2, 0]], [[0, 1, 2], [0, 2, 3]], process=False,
        visual=trimesh.visual.TextureVisuals(
            uv=uv, material=trimesh.visual.material.PBRMaterial(
                name="sign", baseColorTexture=Pillow.fromarray(picture)
            )
        ),
    )  # fmt: skip
    placed = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])
    placed.add_geometry(square, transform=turn)
    placed.export(tmp_path / "sign.glb")
    look = read_textured(tmp_path / "sign.glb")
    assert [material.name for material in look.materials] == ["sign"]
    corner = look.points[look.faces[:, :3]]
    np.testing.assert_allclose(look.uv[:, :3, 0], corner[..., 0] / 3.0, atol=1e-6)
    np.testing.assert_allclose(look.uv[:, :3, 1], corner[..., 2] / 2.0, atol=1e-6)
    given = scene(tmp_path / "sign.glb")
    paint = build_prop(given.props[0], given.input).paints["look"]
    assert isinstance(paint, Image)
    assert (paint.pixels[:3] == (255, 128, 0)).all() and not paint.pixels[3:].any()


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"texel_mm": 1.0}, ("texel_mm", "with mapping 'uv'", "none")),
        ({"mapping": "plane"}, ("texel_mm", "with mapping 'plane'", "one")),
        ({"type": "plain"}, ("mapping", "unknown key")),
        ({"type": "speckle", "diameter_mm": 1.0}, ("mapping", "no picture", "uv")),
    ],
)
def test_faults_of_the_table(tmp_path: Path, change: Any, parts: tuple[str, ...]) -> None:
    with pytest.raises(SceneError) as caught:
        scene(tent(tmp_path), **change)
    for part in parts:
        assert part in str(caught.value)


def test_only_files_with_coordinates_have_pictures_by_uv(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_text("solid a\nendsolid a\n")
    with pytest.raises(SceneError, match="only a prop's file has texture coordinates"):
        scene(tmp_path / "a.stl")
    with pytest.raises(InputError, match=r"got '\.stl'; expected one with texture coordinates"):
        read_textured(tmp_path / "a.stl")
