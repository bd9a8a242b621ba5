"""Finishes by name, and the studio that metal mirrors."""

from __future__ import annotations

from typing import Any, get_args

import pytest

import gpusim as gs
from gpusim.errors import SceneError
from gpusim.optics.light.studio import studio
from gpusim.pipeline.scene_objects.lights import build_lights
from gpusim.scene import Scene
from gpusim.scene.tables.finishes import FINISHES, FinishName


def scene(paint: dict[str, Any] | None = None, light: dict[str, Any] | None = None) -> Scene:
    prop = {"name": "p", "center_mm": [0, 0, 0], "normal": [0, -1, 0], "size_mm": [10, 10],
            "paint": [{"name": "c", "type": "plain", **(paint or {"albedo": 0.5})}]}  # fmt: skip
    lights = [{"name": "room", "type": "environment", **light}] if light else []
    camera = {"name": "left", "sensor_mm": [6.0, 4.0], "resolution_px": [30, 20], "focal_mm": 9.0,
              "position_mm": [0, -90, 0], "target_mm": [0, 0, 0]}  # fmt: skip
    tables = {"camera": [camera], "prop": [prop], "light": lights}
    return Scene.from_document({"schema": 1, "name": "f", **tables})


def test_a_finish_fills_what_the_paint_leaves_open() -> None:
    (prop,) = scene({"finish": "mill-finished steel"}).props
    paint = prop.paints[0]
    # luminance of iron's published reflectance
    assert abs(paint.albedo - (0.2126 * 0.562 + 0.7152 * 0.565 + 0.0722 * 0.578)) < 1e-4
    assert (paint.roughness, paint.metallic) == (0.5, 1.0)
    assert paint.bump == 0.0  # it would cost time, and no pixel resolves it
    (prop,) = scene({"finish": "painted steel", "albedo": 0.2, "bump_um": 0.0}).props
    assert prop.paints[0].albedo == 0.2 and prop.paints[0].bump == 0.0
    along = {"bump_along": [1.0, 0.0, 0.0]}
    for more, stretch in (({}, 1.0), (along, 40.0), ({**along, "bump_stretch": 9.0}, 9.0)):
        (paint,) = scene({"finish": "brushed steel", **more}).props[0].paints
        assert paint.bump > 0.0 and paint.bump_stretch == stretch


def test_another_finish_replaces_what_the_one_before_filled_in() -> None:
    before = scene({"finish": "mill-finished steel", "roughness": 0.65})
    (paint,) = before.replace("prop.p.paint.c.finish", "painted steel").props[0].paints
    assert paint.albedo == 0.35 and paint.metallic == 0.0 and paint.bump > 0.0
    assert paint.roughness == 0.65  # said, not filled in
    (paint,) = scene().replace("prop.p.paint.c.finish", "brushed steel").props[0].paints
    assert (paint.albedo, paint.roughness, paint.metallic) == (0.5, 0.35, 1.0)
    (paint,) = before.replace("prop.p.paint.c.color", "#ff0000").props[0].paints
    assert paint.albedo == "#ff0000"


def test_every_finish_makes_a_paint_with_and_without_a_direction() -> None:
    assert set(get_args(FinishName)) == set(FINISHES)
    for name, finish in FINISHES.items():
        assert scene({"finish": name}).props[0].paints[0].albedo == finish.albedo
        if finish.stretch > 1.0:
            scene({"finish": name, "bump_along": [0.0, 0.0, 1.0]})
    with pytest.raises(SceneError, match="finish"):
        scene({"finish": "gold"})
    with pytest.raises(SceneError, match="albedo"):
        scene({"roughness": 0.5})


def test_a_studio_is_an_environment_of_its_mean_radiance() -> None:
    lights = build_lights(scene(light={"studio_W_m2_sr": 1.5, "forward": [1.0, 0.0, 0.0]}))
    assert lights is not None
    (light,) = lights
    assert isinstance(light, gs.EnvironmentLight) and light.image is not None
    assert (light.image == 1.5 * studio()).all() and light.forward == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("light", "parts"),
    [
        ({"studio_W_m2_sr": 1.0, "sky_W_m2_sr": 1.0}, ("sky_W_m2_sr", "beside studio_W_m2_sr")),
        ({"studio_W_m2_sr": 0.0}, ("studio_W_m2_sr",)),
        ({"studio_W_m2_sr": 1.0, "forward": [0.0, 0.0, 1.0]}, ("forward", "along up")),
        ({"forward": [0.0, 1.0, 0.0]}, ("sky_W_m2_sr", "missing")),
    ],
)
def test_faults_of_a_studio(light: dict[str, Any], parts: tuple[str, ...]) -> None:
    with pytest.raises(SceneError) as caught:
        scene(light=light)
    for part in parts:
        assert part in str(caught.value)
