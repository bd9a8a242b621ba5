"""Pixel values against 64 x 64 rays a pixel in float64."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device, compare
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.edge_pixels.resolve import edges_twin
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.shading_pass import shade_twin
from gpusim.optics.visibility_buffer import visibility_twin
from tests.support.optics_reference import (
    Array,
    Plate,
    difference,
    flat,
    pattern,
    reference,
    shift_between,
)

QUAD = np.array([[0, 1, 2, 3]])
BACKGROUND = 0.3


def camera(width: int = 193, height: int = 113) -> gs.Camera:
    """A camera that looks at the board from the side, from above, and rolled."""
    return gs.Camera.from_lens(
        (36.0, 36.0 * height / width),
        30.0,
        (width, height),
        eye=(0.13, -0.78, 0.21),
        target=(0.03, 0.0, 0.02),
        up=(0.1, 0.0, 1.0),
    )


def board(paint: gs.paint.Checker | gs.paint.Dots, turn: float = 0.15) -> tuple[gs.Surface, Plate]:
    """A tilted board with two of its edges in view, for gpusim and for the reference."""
    s_axis = np.array([np.cos(turn), np.sin(turn), 0.0])
    t_axis = np.array([0.0, 0.0, 1.0])
    plate = Plate(np.array([-0.32, 0.01, -0.24]), s_axis, t_axis, (0.73, 0.47), pattern(paint))
    return gs.Surface(plate.corners(), QUAD, paint=paint), plate


CHECKER = gs.paint.Checker(0.041, origin=(0.013, 0.007))
PATCH = gs.paint.Checker(0.047, columns=9, rows=7, origin=(0.113, 0.057), ground=0.5)
DOTS = gs.paint.Dots(0.021, 0.043, origin=(0.017, 0.009))


ROWS = slice(8, 56)
"""Of the board's picture, that rays are sent through: its upper end and both sides."""


@pytest.fixture(scope="module")
def references() -> dict[str, Array]:
    return {
        name: reference(camera(), [board(paint)[1]], BACKGROUND, (ROWS.start, ROWS.stop))
        for name, paint in (("checker", CHECKER), ("patch", PATCH), ("dots", DOTS))
    }


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
@pytest.mark.parametrize(
    ("name", "paint"), [("checker", CHECKER), ("patch", PATCH), ("dots", DOTS)]
)
def test_board_against_sampling(
    device: Device,
    references: dict[str, Array],
    name: str,
    paint: gs.paint.Checker | gs.paint.Dots,
    backend: str,
) -> None:
    surface, _ = board(paint)
    image = gs.render([surface], camera(), background=BACKGROUND, device=device, backend=backend)
    found = difference(image.radiance[ROWS], references[name])
    print(f"{name} {backend}: {found}")
    assert found.blocks == 4
    assert found.rms < 3e-4
    assert found.worst < 6e-3
    assert found.shift_rms < 5e-4
    assert np.abs(found.bias).max() < 2e-4


def test_the_comparison_sees_a_small_shift(device: Device, references: dict[str, Array]) -> None:
    """A board moved by a hundredth of a pixel fails every limit above."""
    surface, plate = board(CHECKER)
    pixel = 0.83 * 36.0 / 30.0 / 193
    frame = gs.render(
        [surface.moved(surface.points + 0.01 * pixel * plate.s_axis)], camera(),
        background=BACKGROUND, device=device,
    )  # fmt: skip
    found = difference(frame.radiance[ROWS], references["checker"])
    assert found.rms > 3e-4 and found.shift_rms > 5e-3 and abs(found.bias[0]) > 5e-3


@pytest.mark.parametrize(
    ("paint", "limit"),
    [
        (gs.paint.Checker(0.0031, origin=(0.013, 0.007)), 1e-3),
        # more than eight squares a pixel are taken as grey
        (gs.paint.Checker(0.0007, origin=(0.013, 0.007)), 2e-3),
        (gs.paint.Dots(0.0032, 0.0059, origin=(0.013, 0.007)), 1e-3),
    ],
    ids=["2 squares a pixel", "9 squares a pixel", "small dots"],
)
def test_patterns_finer_than_a_pixel(
    device: Device, paint: gs.paint.Checker | gs.paint.Dots, limit: float
) -> None:
    """No moire: each pixel is still the mean of what lies in it."""
    surface, plate = board(paint)
    view = camera(61, 37)
    want = reference(view, [plate], BACKGROUND)
    got = gs.render([surface], view, background=BACKGROUND, device=device).radiance
    error = got - want
    print(f"rms {np.sqrt(np.mean(error**2)):.2e} worst {np.abs(error).max():.2e}")
    assert np.sqrt(np.mean(error**2)) < limit
    assert np.abs(error).max() < 1.2e-2
    twin = gs.render([surface], view, background=BACKGROUND, backend="numpy").radiance
    assert np.abs(got - twin).max() < 1e-4


def test_turned_markers_up_to_a_square_a_pixel(device: Device) -> None:
    """Markers at 45 degrees whose squares are hardly larger than a pixel's diagonal."""
    centres = np.array([[0.1, 0.1], [0.23, 0.17], [0.35, 0.3], [0.5, 0.12], [0.61, 0.37]])
    markers = gs.paint.Markers(centres, 0.046, angle=np.pi / 4)

    def albedo(s: Array, t: Array) -> Array:
        value = np.full(np.shape(s), markers.ground)
        c = np.sqrt(0.5)
        for x, y in centres:
            u, v = c * (s - x) + c * (t - y), c * (t - y) - c * (s - x)
            inside = np.maximum(np.abs(u), np.abs(v)) < 0.5 * markers.size
            value = np.where(
                inside, np.where((u > 0) == (v > 0), markers.dark, markers.light), value
            )
        return value

    plate = Plate(
        np.array([-0.32, 0.01, -0.24]), np.array([1.0, 0, 0]), np.array([0, 0, 1.0]),
        (0.73, 0.47), albedo,
    )  # fmt: skip
    surface = gs.Surface(plate.corners(), QUAD, paint=markers)
    for width, height in ((53, 31), (43, 27), (31, 19)):
        view = camera(width, height)
        got = gs.render([surface], view, background=BACKGROUND, device=device).radiance
        twin = gs.render([surface], view, background=BACKGROUND, backend="numpy").radiance
        want = reference(view, [plate], BACKGROUND)
        assert np.abs(twin - want).max() < 5e-3
        assert np.abs(got - want).max() < 5e-3


@pytest.mark.parametrize("pixels", [0.1, 0.25, 0.5])
def test_a_rigid_shift_is_measured_within_a_thousandth(device: Device, pixels: float) -> None:
    """The board moves in its plane before a camera that faces it: the same shift everywhere."""
    view = gs.Camera.from_lens((24.1, 14.1), 20.0, (241, 141), (0.0, -0.8, 0.0), (0.0, 0.0, 0.0))
    scale = view.K[0, 0] / 0.8
    paint = gs.paint.Dots(0.021, 0.043, origin=(0.017, 0.009))
    plate = Plate(
        np.array([-0.6, 0.0, -0.4]), np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), (1.2, 0.8),
        pattern(paint),
    )  # fmt: skip
    surface = gs.Surface(plate.corners(), QUAD, paint=paint)
    moved = surface.moved(surface.points + np.array([pixels, 0.0, 0.4 * pixels]) / scale)
    images = [gs.render([s], view, device=device).radiance for s in (surface, moved)]
    want = np.array([pixels, -0.4 * pixels])
    result = gs.measure.dic(
        255 * images[0], 255 * images[1], subset=41, step=20, roi=(8, 12, 232, 128),
        guess=(0.0, 0.0), blur_px=1.0, shape="translation",
    )  # fmt: skip
    good = result.status == gs.measure.Status.OK
    assert good.all() and good.sum() >= 40
    error = result.displacement - want
    print(f"{pixels} px: dic bias {error.mean(0)}, rms {np.sqrt(np.mean(error**2)):.1e}")
    assert np.abs(error.mean(axis=0)).max() < 6e-4
    assert np.sqrt(np.mean(error**2)) < 1e-3
    # against the image of a board that didn't move but was looked at a pixel fraction aside
    K = view.K.copy()
    K[:2, 2] += want
    aside = gs.Camera(view.width, view.height, K, None, view.camera_from_world)
    other = gs.render([surface], aside, device=device).radiance
    assert np.abs(shift_between(other, images[1])).max() < 1e-4


def bar_scene() -> tuple[list[gs.Surface], list[Plate]]:
    """A thin turned bar before a wall; a second, wider bar butts on it (T-junction)."""
    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    turn = 0.37
    along = np.cos(turn) * x + np.sin(turn) * z
    across = np.cos(turn) * z - np.sin(turn) * x
    plates = [
        Plate(np.array([-1.0, 0.3, -1.0]), x, z, (2.0, 2.0), flat(0.8)),
        Plate(np.array([-0.21, 0.02, -0.11]), along, across, (0.44, 0.0034), flat(0.1)),
        Plate(np.array([0.02, 0.05, -0.16]), x, z, (0.061, 0.31), flat(0.35)),
        Plate(np.array([0.031, 0.0, -0.2]), -x * 0.96 + z * 0.28, x * 0.28 + z * 0.96,
              (0.03, 0.4), flat(0.55)),
    ]  # fmt: skip
    surfaces = [
        gs.Surface(plate.corners(), QUAD, paint=gs.paint.Plain(albedo))
        for plate, albedo in zip(plates, (0.8, 0.1, 0.35, 0.55), strict=True)
    ]
    return surfaces, plates


@pytest.fixture(scope="module")
def bars_by_rays() -> Array:
    return reference(camera(127, 71), bar_scene()[1])


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_silhouettes_of_overlapping_bars(device: Device, bars_by_rays: Array, backend: str) -> None:
    surfaces, _ = bar_scene()
    view, want = camera(127, 71), bars_by_rays
    got = gs.render(surfaces, view, device=device, backend=backend).radiance
    error = got - want
    print(f"bars {backend}: rms {np.sqrt(np.mean(error**2)):.2e} worst {np.abs(error).max():.2e}")
    assert np.sqrt(np.mean(error**2)) < 5e-4
    assert np.abs(error).max() < 0.02
    # where one silhouette crosses a pixel the area is exact: most edge pixels
    edge = (want != want[0, 0]) & (np.abs(error) >= 0)
    assert np.median(np.abs(error[edge])) < 1e-4


def box(size: tuple[float, float, float], centre: tuple[float, float, float]) -> gs.Surface:
    """A closed box of six quadrilaterals."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    points = 0.5 * corners * size + centre
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return gs.Surface(points, np.array(faces), paint=gs.paint.Plain(0.7))


def test_crease_between_two_lit_faces(device: Device) -> None:
    """A far lamp lights each face of a box evenly: the crease is a sharp edge of two radiances."""
    surface = box((0.4, 0.3, 0.25), (0.05, 0.2, 0.0))
    lamp = np.array([-300.0, -800.0, 550.0])
    lights = [gs.PointLight(tuple(lamp), 4.0 * np.pi**2 * float(lamp @ lamp))]
    view = camera(97, 57)
    frame = gs.render([surface], view, lights, background=0.1, device=device)
    toward = lamp / np.linalg.norm(lamp)
    x, y, z = np.eye(3)
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    sizes = high - low

    def face(origin: Array, s: Array, t: Array, n: Array) -> Plate:
        shown = flat(0.7 * max(float(toward @ n), 0.0))
        return Plate(origin, s, t, (float(sizes @ s), float(sizes @ t)), shown)

    top = low + z * sizes[2]
    plates = [face(low, x, z, -y), face(top, x, y, z), face(low, y, z, -x),
              face(low + x * sizes[0], y, z, x)]  # fmt: skip
    want = reference(view, plates, 0.1)
    error = frame.radiance - want
    print(f"crease: rms {np.sqrt(np.mean(error**2)):.2e} worst {np.abs(error).max():.2e}")
    # the lamp isn't at infinity: 3e-4 of radiance
    assert np.abs(error).max() < 3e-3
    assert np.sqrt(np.mean(error**2)) < 5e-4
    assert len(np.unique(np.round(want, 2))) > 10


def test_edges_twin_agrees_on_bars(device: Device) -> None:
    surfaces, _ = bar_scene()
    view = camera(127, 71)
    frame = gs.render(surfaces, view, device=device)
    setup = Setup.build(frame.view, None, 0.0)
    edges = find_edge_pixels(frame.view)
    assert len(edges.pixel) > 250
    twin = edges_twin(setup, edges, shade_twin(setup, visibility_twin(frame.view)))
    pixels: npt.NDArray[np.int64] = edges.pixel
    compare("bars", frame.radiance.reshape(-1)[pixels], twin[0].reshape(-1)[pixels], "pixel")


@pytest.mark.parametrize("covered", [0.96, 0.975, 0.99])
@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_strips_between_samples(covered: float, backend: str) -> None:
    """A level edge leaves a strip that no sample hits to what lies behind it."""
    view = gs.Camera(9, 8, np.array([[100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 1.0]]))

    def plate(y: float, z: float, albedo: float) -> gs.Surface:
        corners = np.array([[-50, -50], [-50, y], [50, y], [50, -50]]) / 100.0
        points = z * np.column_stack([corners, np.ones(4)])
        return gs.Surface(points, QUAD, gs.paint.Plain(albedo))

    front, back = plate(3.5 + covered, 1.0, 0.8), plate(50.0, 2.0, 0.3)
    for surfaces, behind in (([front], 0.1), ([front, back], 0.3)):
        image = gs.render(surfaces, view, background=0.1, backend=backend).radiance
        np.testing.assert_allclose(image[4], behind + covered * (0.8 - behind), atol=5e-5)
