"""Colours of a scene file, up to the paints and lights that they become."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import SceneError
from gpusim.pipeline.scene_objects.lights import build_lights
from gpusim.pipeline.scene_objects.surfaces import build_prop
from gpusim.scene import Scene, json_schema
from gpusim.scene.cost import describe, estimate
from gpusim.surface.color import color
from tests.scene.description.test_paint import load, paint_of, plate

TAN = color("#c0a080")
PLACES = "positions_mm = [[0.0, 0.0, 0.0]]"
CORNER = "origin_mm = [-70.0, 0.0, -45.0]\ncolumns = 3\nrows = 2"


def rendered(tmp_path: Path, text: str) -> str:
    """What a plan says of the light of a scene with a grey plate."""
    return describe(load(tmp_path, plate('type = "plain"') + text))["render"]


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ('type = "checker"\ncell_mm = 5.0\ndark = "#c0a080"\n' + CORNER, "dark"),
        ('type = "checker"\ncell_mm = 5.0\nlight = "#c0a080"\n' + CORNER, "light"),
        ('type = "dots"\ndiameter_mm = 2.0\npitch_mm = 5.0\ndot = "#c0a080"\n' + CORNER, "albedo"),
        ('type = "markers"\nsize_mm = 9.0\nlight = "#c0a080"\n' + PLACES, "light"),
        ('type = "circles"\ndiameters_mm = [9.0]\ndark = "#c0a080"\n' + PLACES, "dark"),
        ('type = "star"\ndiameter_mm = 9.0\ndark = "#c0a080"\n' + PLACES, "dark"),
        ('type = "aruco"\nsize_mm = 9.0\nids = [3]\nlight = "#c0a080"\n' + PLACES, "light"),
        ('type = "ring_codes"\ndiameter_mm = 3.0\ncodes = [5]\ndot = "#c0a080"\n' + PLACES, "dot"),
        ('type = "charuco"\nsquare_mm = 9.0\nmarker_mm = 6.0\ndark = "#c0a080"\n' + CORNER, "dark"),
        ('type = "lines"\npitch_mm = 9.0\nwidth_mm = 1.0\nline = "#c0a080"\n' + CORNER, "albedo"),
        ('type = "speckle"\ndiameter_mm = 3.0\ndot = "#c0a080"', "dot"),
    ],
)  # fmt: skip
def test_every_albedo_may_be_a_colour(tmp_path: Path, text: str, field: str) -> None:
    paint = paint_of(tmp_path, text)
    assert getattr(paint, field) == TAN and paint.ground == 0.8 and paint.colored
    assert paint.in_band(1).ground == 0.8
    assert "in colour" in describe(load(tmp_path, plate(text)))["render"]
    triple = paint_of(tmp_path, text.replace('"#c0a080"', str(list(TAN))))
    assert getattr(triple, field) == TAN


def test_the_ground_by_either_name(tmp_path: Path) -> None:
    plain = plate('type = "plain"')
    for key in ("albedo", "color"):
        for value, want in (('"#c0a080"', TAN), ("[0.2, 0.3, 0.4]", (0.2, 0.3, 0.4)),
                            ("0.3", 0.3), ("1", 1.0), ("[0.3, 0.3, 0.3]", 0.3)):  # fmt: skip
            scene = load(tmp_path, plain.replace("albedo = 0.8", f"{key} = {value}"))
            (paint,) = build_prop(scene.props[0]).paints.values()
            assert paint.ground == want
            # it is the same scene that is read from its own document
            again = Scene.from_document(scene.document)
            assert again.props == scene.props and again.document == scene.document
    with pytest.raises(SceneError, match=r"albedo: missing .*got neither albedo nor color"):
        load(tmp_path, plain.replace("albedo = 0.8", ""))


def test_lights_have_a_temperature_or_a_colour(tmp_path: Path) -> None:
    kinds = {
        "point": "power_W = 1.0\nposition_mm = [0.0, -900.0, 0.0]",
        "spot": "power_W = 1.0\nposition_mm = [0.0, -900.0, 0.0]\ntarget_mm = [0.0, 0.0, 0.0]",
        "area": "power_W = 1.0\nposition_mm = [0.0, -900.0, 0.0]\ntarget_mm = [0.0, 0.0, 0.0]\n"
        "size_mm = [90.0, 60.0]",
        "sun": "irradiance_W_m2 = 1.0\ndirection = [0.0, 1.0, 0.0]",
        "ambient": "radiance_W_m2_sr = 0.3",
        "environment": "sky_W_m2_sr = 1.0\nground_W_m2_sr = 0.2",
    }

    def built(more: str) -> list[gs.PointLight]:
        text = "".join(f'[[light]]\nname = "{kind}"\ntype = "{kind}"\n{keys}\n{more}\n'
                       for kind, keys in kinds.items())  # fmt: skip
        lights = build_lights(load(tmp_path, plate('type = "plain"') + text)) or []
        assert len(lights) == len(kinds)
        return lights  # type: ignore[return-value]

    assert [light.color for light in built("")] == [None] * 6
    assert [light.color for light in built("color = [2.0, 2.0, 2.0]")] == [None] * 6
    for more, want in (
        ("temperature_K = 3000", gs.blackbody(3000.0)),
        ('color = "#ff0000"', (3.0, 0.0, 0.0)),
        ("color = [20.0, 40.0, 60.0]", (0.5, 1.0, 1.5)),
    ):
        for light in built(more):
            np.testing.assert_allclose(light.color, want, rtol=1e-14)
    both = '\ntemperature_K = 3000.0\ncolor = "#ff0000"'
    with pytest.raises(SceneError, match=r"light\.ambient\.color: beside temperature_K"):
        built(both)
    lamp = '[[light]]\nname = "a"\ntype = "ambient"\nradiance_W_m2_sr = 1.0\n'
    assert "in colour" not in rendered(tmp_path, lamp + "color = [2, 2, 2]")
    assert "in colour" in rendered(tmp_path, lamp + "color = [2, 2, 3]")
    assert "in colour" in rendered(tmp_path, lamp + "temperature_K = 3000")


def test_pictures_keep_their_colours_unless_told(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (6, 9, 3)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "p.png"), pixels[..., ::-1])
    text = 'type = "image"\nfile = "p.png"\ntexel_mm = 2.0\norigin_mm = [-90.0, 0.0, -55.0]\n'

    def image(more: str) -> gs.paint.Image:
        scene = load(tmp_path, plate(text + more))
        (paint,) = build_prop(scene.props[0], scene.input).paints.values()
        assert isinstance(paint, gs.paint.Image)
        assert ("in colour" in describe(scene)["render"]) == paint.colored
        return paint

    np.testing.assert_array_equal(image("").pixels, pixels)
    tinted = image('light = [1.0, 0.5, 0.25]\ndark = "#000000"')
    np.testing.assert_allclose(tinted.albedo(), pixels / 255 * [1.0, 0.5, 0.25], atol=1e-15)
    grey = image('channels = "grey"')
    np.testing.assert_allclose(grey.albedo(), pixels / 255 @ [0.299, 0.587, 0.114], atol=1e-15)
    cv2.imwrite(str(tmp_path / "p.png"), np.repeat(pixels[..., :1], 3, axis=2))
    assert not image("").colored
    with pytest.raises(SceneError, match=r'channels: unknown value .*got "mono"'):
        image('channels = "mono"')


def test_surroundings_keep_their_colours_unless_told(tmp_path: Path) -> None:
    picture = np.random.default_rng(2).random((6, 12, 3))
    np.save(tmp_path / "sky.npy", picture)
    text = '[[light]]\nname = "sky"\ntype = "environment"\nfile = "sky.npy"\nscale_W_m2_sr = 2.5\n'

    def image(more: str) -> gs.EnvironmentLight:
        scene = load(tmp_path, plate('type = "plain"') + text + more)
        (light,) = build_lights(scene) or []
        assert isinstance(light, gs.EnvironmentLight)
        assert ("in colour" in describe(scene)["render"]) == light.colored
        return light

    np.testing.assert_allclose(image("").image, 2.5 * picture)
    luminance = 2.5 * picture @ [0.2126, 0.7152, 0.0722]
    np.testing.assert_allclose(image('channels = "grey"').image, luminance)
    assert image("temperature_K = 6504").color == gs.blackbody(6504.0)


def test_a_background_may_be_a_colour(tmp_path: Path) -> None:
    for value, want in (('"#c0a080"', TAN), ("[2.0, 0.3, 0.4]", (2.0, 0.3, 0.4)), ("0.2", 0.2)):
        scene = load(tmp_path, plate('type = "plain"') + f"[render]\nbackground = {value}\n")
        assert color(scene.render.background) == want
        assert ("in colour" in describe(scene)["render"]) == isinstance(want, tuple)
        pixels = scene.cameras[0].resolution[0] * scene.cameras[0].resolution[1]
        planes = 3 if isinstance(want, tuple) else 1
        assert estimate(scene)["render"][0] == 16 * pixels * planes


def test_a_colour_has_nothing_behind_it(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"albedo: unknown value"):
        load(tmp_path, plate('type = "plain"').replace("albedo = 0.8", 'albedo = "#c0a080\\n"'))


def test_the_schema_for_editors_says_what_a_colour_is() -> None:
    tables = json_schema()["$defs"]
    for table, key, limits in (("PlainTable", "color", {"minimum": 0, "maximum": 1}),
                               ("DotsTable", "dot", {"minimum": 0, "maximum": 1}),
                               ("PointTable", "color", {"minimum": 0})):  # fmt: skip
        number, three, text = tables[table]["properties"][key]["anyOf"][:3]
        assert number == {"type": "number", **limits} == three["items"]
        assert (three["minItems"], three["maxItems"]) == (3, 3)
        assert text["pattern"] == "^#[0-9A-Fa-f]{6}$" and text["examples"] == ["#c0a080"]
