"""The plan of a frame: what it chooses and why, and that no shortcut of it changes the picture."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.geometry.view import look
from gpusim.optics.rendering.frame_plan import SHORTCUTS, FramePlan, plan_frame

Scene = tuple[list[gs.Surface], gs.Camera, list[Any] | None]

QUAD = np.array([[0, 1, 2, 3]])
EYE, TARGET = (0.12, -1.0, 0.28), (0.02, 0.0, 0.0)
LAMP = gs.AreaLight((-0.4, -1.2, 0.7), (0.0, 0.0, 0.0), (0.2, 0.1), 20.0)
BULB = gs.PointLight((-2.4, -3.2, 3.7), 60.0, shadows=False)
BOARD = gs.paint.Checker(0.037, dark=0.2, light=0.8)


def camera(width: int = 333, distortion: list[float] | None = None) -> gs.Camera:
    size = (width, round(width / 1.5))
    return gs.Camera.from_lens((36.0, 24.0), 30.0, size, EYE, TARGET, distortion=distortion)


def sheet(rows: int, columns: int, paint: gs.paint.Paint, bumps: float = 0.01) -> gs.Surface:
    """A sheet of 0.6 x 0.3 in the x-z plane, with bumps along x."""
    x, z = np.meshgrid(np.linspace(-0.3, 0.3, columns + 1), np.linspace(-0.15, 0.15, rows + 1))
    flat = np.stack([x, 0.0 * x, z], axis=-1).reshape(-1, 3)
    points = flat + bumps * np.sin(9.0 * flat[:, :1]) * np.array([0.0, 1.0, 0.0])
    node = np.arange(len(flat)).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    return gs.Surface(points, faces.reshape(-1, 4), paint, reference=flat)


def wall(paint: gs.paint.Paint | None = None) -> gs.Surface:
    points = np.array([[-0.9, 0.06, -0.1], [0.9, 0.06, -0.3], [0.9, 0.3, 0.9], [-0.9, 0.3, 0.9]])
    return gs.Surface(points, QUAD, paint or gs.paint.Plain(0.7))


def plate() -> Scene:
    board = gs.paint.Checker(0.051, 9, 4, (0.07, 0.05), 0.1, 0.8, 0.5)
    return [sheet(1, 2, board, 0.0)], camera(), None


def plate_lit() -> Scene:
    return [sheet(1, 1, BOARD, 0.0)], camera(), [BULB]


def fine() -> Scene:
    return [sheet(30, 40, BOARD), wall()], camera(), None


def fine_shadows() -> Scene:
    return [sheet(30, 40, BOARD), wall()], camera(), [LAMP, gs.AmbientLight(0.2)]


def fine_speckle() -> Scene:
    paint = gs.paint.Speckle(0.013, 0.4, 0.002, seed=3)
    return [sheet(30, 40, paint), wall()], camera(distortion=[-0.1, 0.03, 1e-3, -2e-3]), [BULB]


def room() -> Scene:
    glossy = gs.paint.Plain(0.5, roughness=0.3, metallic=0.6)
    return [wall(), sheet(4, 6, glossy), sheet(1, 1, BOARD, 0.0)], camera(), [LAMP, BULB]


def environment() -> Scene:
    sky = gs.EnvironmentLight(1.6, 0.6, occlusion=True)
    return [sheet(30, 40, BOARD), wall(BOARD)], camera(181), [sky]


CASES: list[tuple[Callable[[], Scene], str, float]] = [
    (plate, "checker_lines", 5e-5),
    # what is left open by less than this counts as a seam
    (plate, "plate_border", 5.1e-4),
    (plate_lit, "tile_light", 5e-5),
    # the device makes coefficients from places in 1/65536 px
    (fine, "deferred", 5e-5),
    (fine_shadows, "deferred", 5e-5),
    (fine_speckle, "deferred", 5e-5),
    (room, "checker_lines", 5e-5),
    (room, "tile_light", 5e-5),
]


def picture(
    scene: Scene, device: Device, plan: Callable[..., FramePlan] = plan_frame, **options: Any
) -> npt.NDArray[np.float32]:
    surfaces, whence, lights = scene
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("gpusim.optics.rendering.renderer"), "plan_frame", plan)
        frame = gs.render(surfaces, whence, lights, background=0.25, device=device, **options)
    return frame.radiance


@cache
def as_planned(make: Callable[[], Scene], device: Device) -> npt.NDArray[np.float32]:
    return picture(make(), device)


@pytest.mark.parametrize(
    ("make", "option", "tolerance"), CASES, ids=[f"{m.__name__}-{o}" for m, o, _ in CASES]
)
def test_a_shortcut_leaves_the_picture_as_it_is(
    make: Callable[[], Scene], option: str, tolerance: float, device: Device
) -> None:
    scene, plans = make(), []

    def without(*values: Any) -> FramePlan:
        plans.append(plan_frame(*values))
        return plans[-1].replace(**{option: False})

    got, want = as_planned(make, device), picture(scene, device, without)
    assert all(getattr(plan, option) for plan in plans)
    assert np.ptp(want) > 0.2 * want.max()
    off = np.abs(got - want) / want.max()
    print(f"worst {off.max():.1e}")
    assert off.max() <= tolerance


@pytest.mark.parametrize(
    "make", [plate, plate_lit, fine, fine_shadows, fine_speckle, room, environment]
)
def test_without_any_shortcut_the_picture_is_the_same(
    make: Callable[[], Scene], device: Device
) -> None:
    planned = as_planned(make, device)
    off = np.abs(planned - picture(make(), device, shortcuts=False))
    scale = float(planned.max())
    assert off.max() <= 5.1e-4 * scale and np.sqrt((off**2).mean()) <= 2e-5 * scale


def test_photographs_go_without_shortcuts_too(device: Device) -> None:
    surfaces, whence, lights = plate()
    options: dict[str, Any] = {"background": 0.25, "device": device, "shortcuts": False}
    got = gs.optics.photograph(surfaces, whence, lights, **options).radiance
    np.testing.assert_array_equal(got, gs.render(surfaces, whence, lights, **options).radiance)


def test_a_plan_says_what_it_chose_and_why() -> None:
    surfaces, whence, lights = fine_shadows()
    plan = plan_frame(look(surfaces, whence, True), lights)
    assert plan.lit and plan.shadowed and plan.deferred and not plan.plate_border
    text = str(plan)
    assert "deferred" in text and "triangles of" in text
    assert len(text.splitlines()) == len(plan.reasons)
    other = plan.replace(deferred=False)
    assert not other.deferred and other.reasons["deferred"] == "asked for" and plan.deferred
    bare = plan.without_shortcuts()
    assert not any(getattr(bare, name) for name in SHORTCUTS)
    assert (bare.rows, bare.lit, bare.shadowed) == (plan.rows, True, True)


def test_bands_are_whole_tiles_under_shadows() -> None:
    surfaces, _, _ = fine_shadows()
    view = look(surfaces, camera(3000), True)
    many = [gs.PointLight((0.1 * k, -1.0, 1.0), 1.0) for k in range(16)]
    few = plan_frame(view, [BULB])
    assert few.rows == 2000
    plan = plan_frame(view, many)
    assert plan.rows % 32 == 0 and plan.rows < 2000 // 2
    assert plan_frame(view, many, 100).rows == 100
