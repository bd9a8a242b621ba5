"""Every pattern of a scene file, as the paint that it becomes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import SceneError
from gpusim.pipeline.scene_objects.surfaces import build_body, build_prop
from gpusim.scene import Scene
from gpusim.scene.cost import describe
from gpusim.scene.description.paint import Paint, PaintTable

HEAD = """
schema = 1
name = "paints"
[[camera]]
name = "left"
sensor_mm = [24.0, 16.0]
resolution_px = [90, 60]
focal_mm = 20.0
position_mm = [0.0, -400.0, 0.0]
target_mm = [0.0, 0.0, 0.0]
"""


def plate(paint: str) -> str:
    return f"""
[[prop]]
name = "plate"
center_mm = [10.0, 0.0, 5.0]
normal = [0.0, -1.0, 0.0]
size_mm = [200.0, 120.0]
[[prop.paint]]
name = "paint"
albedo = 0.8
{paint}
"""


def load(tmp_path: Path, text: str) -> Scene:
    path = tmp_path / "scene.toml"
    path.write_text(HEAD + text, encoding="utf-8")
    return gs.load_scene(path)


def paint_of(tmp_path: Path, text: str) -> Any:
    scene = load(tmp_path, plate(text))
    (paint,) = build_prop(scene.props[0]).paints.values()
    return paint


def test_targets_lie_where_the_scene_says(tmp_path: Path) -> None:
    """The plate's lower left corner is at (-90, 0, -55) mm."""
    place = "positions_mm = [[-40.0, 0.0, -15.0], [60.0, 0.0, 25.0]]"
    centres = [[0.05, 0.04], [0.15, 0.08]]
    circles = paint_of(tmp_path, f'type = "circles"\ndiameters_mm = [20.0, 10.0]\n{place}')
    assert isinstance(circles, gs.paint.Circles) and circles.diameters == (0.02, 0.01)
    np.testing.assert_allclose(circles.centres, centres)
    star = paint_of(tmp_path, f'type = "star"\ndiameter_mm = 30.0\nspokes = 24\n{place}')
    assert isinstance(star, gs.paint.Star) and (star.spokes, star.diameter) == (24, 0.03)
    np.testing.assert_allclose(star.centres, centres)
    tags = paint_of(tmp_path, f'type = "aruco"\nsize_mm = 25.0\nids = [7, 3]\n{place}')
    assert isinstance(tags, gs.paint.Aruco) and tags.ids == (7, 3) and tags.ground == 0.8
    corner = "origin_mm = [-70.0, 0.0, -45.0]\ncolumns = 5\nrows = 4"
    board = paint_of(tmp_path, f'type = "charuco"\nsquare_mm = 20.0\nmarker_mm = 14.0\n{corner}')
    assert isinstance(board, gs.paint.Charuco) and (board.columns, board.marker) == (5, 0.014)
    np.testing.assert_allclose(board.origin, [0.02, 0.01])
    lines = paint_of(
        tmp_path, f'type = "lines"\npitch_mm = 20.0\nwidth_mm = 2.0\nalong = "up"\n{corner}'
    )
    assert isinstance(lines, gs.paint.Lines) and (lines.along, lines.rows) == ("t", 4)


def test_ring_codes_lie_where_the_scene_says(tmp_path: Path) -> None:
    place = "positions_mm = [[-40.0, 0.0, -15.0], [60.0, 0.0, 25.0]]"
    ring_codes = 'type = "ring_codes"\ndiameter_mm = 8.0\ncodes = [5, 177]\nbits = 10\n' + place
    paint = paint_of(tmp_path, ring_codes)
    assert isinstance(paint, gs.paint.RingCodes)
    assert (paint.codes, paint.bits, paint.diameter) == ((5, 177), 10, 0.008)
    assert (paint.dot, paint.ground) == (0.9, 0.8)
    np.testing.assert_allclose(paint.centres, [[0.05, 0.04], [0.15, 0.08]])
    for text, words in (
        (ring_codes.replace("[5, 177]", "[5]"), "codes: not one per position"),
        (ring_codes.replace("bits = 10", "bits = 7"), "codes: more than 7 bits"),
        (ring_codes.replace("bits = 10", "bits = 21"), "bits: out of range"),
    ):
        with pytest.raises(SceneError) as caught:
            load(tmp_path, plate(text))
        assert f"prop.plate.paint.paint.{words}" in str(caught.value)


PLACED = "positions_mm = [[0.0, 0.0, 0.0]]"
BOARD = "origin_mm = [-70.0, 0.0, -45.0]\ncolumns = 5\nrows = 4"
EVERY = {
    "plain": "",
    "checker": f"cell_mm = 12.0\n{BOARD}",
    "dots": f"diameter_mm = 6.0\npitch_mm = 12.0\n{BOARD}",
    "lines": f"pitch_mm = 20.0\nwidth_mm = 2.0\n{BOARD}",
    "markers": f"size_mm = 25.0\n{PLACED}",
    "circles": f"diameters_mm = [20.0, 10.0]\n{PLACED}",
    "star": f"diameter_mm = 30.0\n{PLACED}",
    "aruco": f"size_mm = 25.0\nids = [7]\n{PLACED}",
    "charuco": f"square_mm = 20.0\nmarker_mm = 14.0\n{BOARD}",
    "ring_codes": f"diameter_mm = 8.0\ncodes = [5]\n{PLACED}",
    "speckle": "diameter_mm = 3.0",
    "image": 'file = "p.png"\ntexel_mm = 2.0\norigin_mm = [-90.0, 0.0, -55.0]',
}
"""Keys of every paint of a scene."""


def test_every_paint_of_the_schema_is_among_these() -> None:
    tables = get_args(get_args(PaintTable)[0])
    assert set(EVERY) == {get_args(v.model_fields["type"].annotation)[0] for v in tables}
    assert all(issubclass(table, get_args(Paint)) for table in tables)


@pytest.mark.parametrize("name", EVERY)
def test_every_paint_is_built_and_may_be_glossy(tmp_path: Path, name: str) -> None:
    cv2.imwrite(str(tmp_path / "p.png"), np.full((8, 15), 90, np.uint8))
    kind = f'type = "{name}"\n{EVERY[name]}'
    plain, shiny = (
        paint_of(tmp_path, kind + more) for more in ("", "\nroughness = 0.35\nmetallic = 1.0")
    )
    assert type(plain).__name__ == name.title().replace("_", "")
    assert (plain.roughness, plain.metallic) == (1.0, 0.0)
    assert (shiny.roughness, shiny.metallic) == (0.35, 1.0)
    assert plain.bump is None
    brushed = "\nbump_um = 3.0\nbump_length_mm = 0.25\nbump_seed = 5"
    brushed += "\nbump_along = [1.0, 0.0, 2.0]\nbump_stretch = 12.0"
    bump = paint_of(tmp_path, kind + brushed).bump
    assert bump == gs.paint.Bump(3e-6, 2.5e-4, (1.0, 0.0, 2.0), 12.0, 5)


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ("bump_um = 200.0", "too steep for a fine relief"),
        ("bump_um = -1.0", "out of range"),
        ("bump_um = 1.0\nbump_stretch = 4.0", "goes with bump_stretch"),
        ("bump_um = 1.0\nbump_along = [1.0, 0.0, 0.0]", "goes with bump_stretch"),
        ("bump_um = 1.0\nbump_along = [0, 0, 0]\nbump_stretch = 2.0", "has no direction"),
        ("bumb_um = 1.0", "did you mean bump_um"),
    ],
)
def test_a_relief_that_is_none_is_refused(tmp_path: Path, keys: str, text: str) -> None:
    with pytest.raises(SceneError, match=text):
        load(tmp_path, plate(f'type = "plain"\n{keys}'))


def test_plan_says_that_there_is_a_relief(tmp_path: Path) -> None:
    lamp = '[[light]]\nname = "lamp"\ntype = "point"\nposition_mm = [0, -300, 0]\npower_W = 5\n'
    for more, there in (("", False), ("bump_um = 1.0\n", True)):
        scene = load(tmp_path, plate(f'type = "plain"\n{more}') + lamp)
        assert ("fine relief" in describe(scene)["render"]) == there


def test_a_picture_comes_from_beside_the_scene(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "p.png"), np.arange(120, dtype=np.uint16).reshape(8, 15) * 500)
    text = 'type = "image"\nfile = "p.png"\ntexel_mm = 2.0\norigin_mm = [-90.0, 0.0, -55.0]'
    image = paint_of(tmp_path, text)
    assert isinstance(image, gs.paint.Image)
    assert image.pixels.dtype == np.uint16 and image.size == pytest.approx((0.03, 0.016))
    np.testing.assert_allclose(image.origin, [0.0, 0.0], atol=1e-12)
    with pytest.raises(gs.SceneError, match="not found"):
        paint_of(tmp_path, text.replace("p.png", "q.png"))
    (tmp_path / "text.png").write_text("no picture", encoding="utf-8")
    with pytest.raises(gs.InputError, match=r"plate.*no picture"):
        paint_of(tmp_path, text.replace("p.png", "text.png"))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('type = "circles"\ndiameters_mm = [1.0, 2.0]\npositions_mm = [[0, 0, 0]]', "the largest"),
        ('type = "aruco"\nsize_mm = 9.0\nids = [1]\npositions_mm = [[0,0,0],[30,0,0]]', "as many"),
        ('type = "speckle"\ndiameter_mm = 2.0\nmapping = "cylinder"', "axis"),
        ('type = "speckle"\ndiameter_mm = 2.0\naxis = [0.0, 0.0, 1.0]', "axis"),
        (
            'type = "dots"\ndiameter_mm = 2.0\npitch_mm = 4.0\ncolumns = 2\nrows = 2\n'
            'origin_mm = [0, 0, 0]\nmapping = "unfold"',
            "plane or cylinder",
        ),
    ],
)
def test_wrong_patterns_are_refused(tmp_path: Path, text: str, match: str) -> None:
    with pytest.raises(gs.SceneError, match=match):
        paint_of(tmp_path, text)


def body(paint: str) -> str:
    return f"""
[[material]]
name = "steel"
type = "isotropic"
youngs_modulus_GPa = 200.0
poissons_ratio = 0.3
[[body]]
name = "plate"
material = "steel"
[body.mesh]
builder = "plate_with_hole"
length_mm = 80.0
width_mm = 60.0
thickness_mm = 10.0
hole_diameter_mm = 20.0
around = 32
radial = 4
through = 2
[[body.support]]
name = "clamp"
where = {{ set = "x_min" }}
fix = ["x", "y", "z"]
[[body.paint]]
name = "paint"
albedo = 0.8
type = "speckle"
diameter_mm = 1.0
softness_mm = 0.2
{paint}
"""


def test_speckle_unfolds_over_a_whole_body(tmp_path: Path) -> None:
    scene = load(tmp_path, body('mapping = "unfold"'))
    surface = build_body(scene.bodies[0]).surface
    frame = surface.frames["paint"]
    assert isinstance(frame, gs.Atlas) and np.isfinite(frame.st).all()
    corners = surface.rest[surface.topology.triangles]
    sides = [
        np.linalg.norm(np.roll(p, -1, axis=1) - p, axis=2) for p in (frame.st, corners)
    ]  # fmt: skip
    np.testing.assert_allclose(sides[0], sides[1], rtol=0.05)
    with pytest.raises(gs.InputError, match="plane region"):
        build_body(load(tmp_path, body("")).bodies[0])
