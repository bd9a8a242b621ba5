"""Open sheets among other surfaces that hide nothing of themselves: left out where their own
pixels look for what hides a lamp, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import Light
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shadow.lamp_visibility import VisibleShares
from gpusim.optics.shadow.light_space import LightSpace, light_spaces
from gpusim.optics.shadow.occluders import SHEETS, Occluders, relative_points, single_sheets
from gpusim.optics.shadow.receivers import PixelReceivers
from gpusim.optics.shadow.sample_mask import SAMPLES
from gpusim.optics.shadow.single_layer import wound_once
from gpusim.optics.visibility_buffer import visibility_twin
from tests.optics.shadow.test_single_layer import CAMERA, LAMP, MATTE, ribbon, wavy
from tests.support.shadow_rays import box

EYE = CAMERA.eye
SOFT = gs.AreaLight((-0.6, -1.3, 0.5), (0.0, 0.0, 0.0), (0.2, 0.1), 50.0)
WALL = gs.Surface(
    np.array([[-1.0, 0.5, -1.0], [1.0, 0.5, -1.0], [1.0, 0.5, 1.0], [-1.0, 0.5, 1.0]]),
    np.array([[0, 1, 2, 3]]),
    MATTE,
)


def space_of(surfaces: list[gs.Surface], light: Light) -> LightSpace:
    points = relative_points(surfaces, EYE)
    (space,) = light_spaces(lamps_of([light]), points, EYE)
    return replace(space, sheets=wound_once(space, surfaces, EYE))


def found(
    device: Device, surfaces: list[gs.Surface], spaces: list[LightSpace]
) -> tuple[list[np.ndarray], list[int]]:
    """Shares of pixels by each of ``spaces``, and how many entries have to be sifted."""
    occluders = Occluders.of(surfaces)
    view = look(surfaces, CAMERA, lit=True)
    pixels = PixelReceivers.of(view, visibility_twin(view), occluders)
    points, shares, sifted = relative_points(surfaces, EYE), [], []
    for space in spaces:
        own = VisibleShares(device, occluders, pixels)
        shares.append(own.find(points, [space])[:, 0])
        own.enlarged()
        sifted.append(own.counts[0]["sifted"])
    return shares, sifted


@pytest.mark.parametrize("light", [LAMP, SOFT, gs.SunLight((0.3, 1.0, -0.2), 5.0, 0.05)])
def test_a_bent_sheet_before_a_wall(device: Device, light: Light) -> None:
    surfaces = [wavy(), WALL, box((-0.2, -0.35, -0.1), (0.1, 0.1, 0.1))]
    space = space_of(surfaces, light)
    assert space.sheets == 3
    (with_it, without), (few, many) = found(device, surfaces, [space, replace(space, sheets=0)])
    assert few < 0.5 * many
    # what sifting lets through of a sheet's own triangles hides single samples of pixels at most
    assert np.abs(with_it - without).max() <= 4.0 / SAMPLES
    # the box hides the lamp from the sheet nevertheless, and the sheet from the wall
    assert (with_it < 0.5).sum() > 100


def test_a_ribbon_that_lies_over_itself(device: Device) -> None:
    """All of it is turned to the lamp, and it hides parts of itself: its border tells."""
    surfaces = [ribbon(1.6, 0.15), WALL]
    light = gs.SunLight((0.25, 1.0, 0.1), 5.0)
    space = space_of(surfaces, light)
    corners = relative_points(surfaces, EYE).astype(np.float64)
    occluders = Occluders.of(surfaces)
    forced = replace(space, sheets=3)
    single = single_sheets(forced, occluders, corners[occluders.triangles])
    assert space.sheets == 2 and set(single) == {1, 2}
    (right, wrong), _ = found(device, surfaces, [space, forced])
    assert np.abs(right - wrong).max() > 0.5


def test_a_sheet_that_turns_both_sides_to_the_lamp(device: Device) -> None:
    """Its border alone doesn't tell, as what is turned away hides what lies behind."""
    surfaces = [wavy(0.08, 25.0), WALL]
    light = gs.PointLight((-1.5, -0.3, 0.3), 50.0)
    space = replace(space_of(surfaces, light), sheets=3)
    corners = relative_points(surfaces, EYE).astype(np.float64)
    occluders = Occluders.of(surfaces)
    assert 1 not in single_sheets(space, occluders, corners[occluders.triangles])
    (with_it, without), _ = found(device, surfaces, [space, replace(space, sheets=0)])
    assert np.array_equal(with_it, without)


def test_more_sheets_than_have_numbers(device: Device) -> None:
    """Those beyond are searched like any other."""
    small = [
        gs.Surface(
            WALL.points * 0.03 + np.array([0.09 * (k % 10) - 0.4, -0.2, 0.12 * (k // 10) - 0.2]),
            WALL.faces,
            MATTE,
        )
        for k in range(SHEETS + 5)
    ]
    surfaces = [*small, WALL]
    space = space_of(surfaces, SOFT)
    assert space.sheets == (1 << SHEETS) - 1
    (with_it, without), _ = found(device, surfaces, [space, replace(space, sheets=0)])
    assert np.array_equal(with_it, without)
