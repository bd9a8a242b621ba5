"""Bitmap paint against dense sampling of SciPy's spline, from magnified to 40 texels a pixel."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.paint.bitmap import mean_over_pixels, mean_over_polygons
from gpusim.surface.bitmap import MARGIN
from tests.support.bitmap_reference import Array, mean_of_pixels, speckle, surface
from tests.support.optics_reference import Plate, difference, reference

NOISE = np.random.default_rng(5).random((173, 131))
SPECKLE = speckle(173, 131, 5.0, 0.5)


def footprints(scale: float, turn: float, n: int = 40) -> tuple[Array, Array, Array, Array]:
    """Places and sides of slightly sheared footprints of ``scale`` texels, all on the bitmap."""
    rng = np.random.default_rng(int(100 * scale))
    room = 0.75 * scale + 1.0
    at = rng.uniform([room, room], [131.0 - room, 173.0 - room], (n, 2))
    ex = np.tile(scale * np.array([np.cos(turn), np.sin(turn)]), (n, 1))
    ey = np.tile(scale * np.array([0.05 - 1.1 * np.sin(turn), 1.1 * np.cos(turn)]), (n, 1))
    return at, ex, ey, np.tile([3e-4, -2e-4], (n, 1))


@pytest.mark.parametrize("turn", [0.0, 0.11, np.pi / 4])
@pytest.mark.parametrize(
    ("scale", "limit"),
    [(0.04, 1e-6), (0.3, 1e-5), (1.0, 2e-4), (1.7, 1e-4), (2.7, 1e-3), (6.0, 1e-3), (40.0, 1e-3)],
)
def test_footprints_of_any_size_and_turn(scale: float, turn: float, limit: float) -> None:
    """Speckles to 1e-3 (RMS), around a texel a pixel to 2e-4."""
    at, ex, ey, q = footprints(scale, turn)
    image = gs.paint.Image(SPECKLE, 1.0)
    cell = np.floor(at).astype(np.int64)
    got = mean_over_pixels(image, 0.5, cell, at - cell, ex, ey, q)
    want = mean_of_pixels(SPECKLE, at, ex, ey, q, 40 if scale < 20 else 90)
    rms = np.sqrt(np.mean((got - want) ** 2))
    print(f"{scale} texels, {turn:.2f} rad: rms {rms:.1e}")
    assert rms <= limit
    assert np.ptp(want) > 10 * limit


@pytest.mark.parametrize(("scale", "limit"), [(1.0, 5e-4), (4.0, 1e-3), (10.0, 5e-4)])
def test_white_noise_is_not_aliased(scale: float, limit: float) -> None:
    at, ex, ey, q = footprints(scale, 0.0)
    cell = np.floor(at).astype(np.int64)
    got = mean_over_pixels(gs.paint.Image(NOISE, 1.0), 0.5, cell, at - cell, ex, ey, q)
    want = np.clip(mean_of_pixels(NOISE, at, ex, ey, q, 40), 0.0, 1.0)  # noise swings over
    assert np.sqrt(np.mean((got - want) ** 2)) <= limit


@pytest.mark.parametrize(("scale", "limit"), [(0.3, 1e-4), (1.0, 2e-3), (5.0, 3e-3), (14.0, 1e-2)])
def test_parts_of_pixels(scale: float, limit: float) -> None:
    """Triangles, as silhouettes cut them."""
    at, ex, ey, _ = footprints(scale, 0.2)
    polygon = np.stack([-0.4 * ex - 0.5 * ey, 0.5 * ex - 0.1 * ey, 0.1 * ex + 0.5 * ey], axis=1)
    cell = np.floor(at).astype(np.int64)
    image = gs.paint.Image(SPECKLE, 1.0)
    got = mean_over_polygons(image, 0.5, cell, at - cell, polygon, np.ones((len(at), 3)))
    n = 60
    u, v = (a.ravel() for a in np.meshgrid(*2 * [(np.arange(n) + 0.5) / n]))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    sides = polygon[:, 1:] - polygon[:, :1]
    place = (at + polygon[:, 0])[:, None] + u[:, None] * sides[:, :1] + v[:, None] * sides[:, 1:]
    want = surface(SPECKLE, place[..., 0], place[..., 1]).mean(axis=1)
    assert np.sqrt(np.mean((got - want) ** 2)) <= limit


def test_levels_keep_the_means_of_their_cells() -> None:
    image = gs.paint.Image(NOISE, 1.0)
    assert [(v.rows, v.columns) for v in image.levels[:3]] == [(173, 131), (87, 66), (44, 33)]
    assert (image.levels[-1].rows, image.levels[-1].columns) == (1, 1)
    for number, size in ((1, 2), (2, 4)):
        level = image.levels[number].coefficients
        for row, column in ((7, 5), (0, 11)):
            grid = (np.arange(64) + 0.5) / 64 * size
            want = surface(
                NOISE, *np.meshgrid(column * size + grid, row * size + grid)
            ).mean()  # fmt: skip
            near = level[MARGIN + row - 3 : MARGIN + row + 4, MARGIN + column - 3 :][:, :7]
            taps = np.array([1, 722, 10543, 23548, 10543, 722, 1]) / 46080
            assert abs(taps @ near @ taps - want) < 1e-4


def board(image: gs.paint.Image) -> tuple[gs.Surface, Plate]:
    """A tilted plate whose bitmap ends on it at the left and below, and reaches over it."""
    turn = 0.15
    s_axis, t_axis = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([0.0, 0.0, 1.0])
    rows, columns = image.pixels.shape
    values = image.albedo()

    def albedo(s: Array, t: Array) -> Array:
        x = (s - image.origin[0]) / image.texel
        y = rows - (t - image.origin[1]) / image.texel
        on = (x >= 0) & (x <= columns) & (y >= 0) & (y <= rows)
        return np.where(on, surface(values, x, y), image.ground)

    plate = Plate(np.array([-0.32, 0.01, -0.24]), s_axis, t_axis, (0.73, 0.47), albedo)
    faces = np.array([[0, 1, 2, 3]])
    return gs.Surface(plate.corners(), faces, paint=image), plate


def camera(width: int, height: int) -> gs.Camera:
    return gs.Camera.from_lens(
        (36.0, 36.0 * height / width), 30.0, (width, height), eye=(0.13, -0.78, 0.21),
        target=(0.03, 0.0, 0.02), up=(0.1, 0.0, 1.0),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("size", "texel", "rms", "worst"),
    [
        ((61, 37), 0.0161, 2e-4, 5e-3),
        ((61, 37), 0.047, 2e-4, 5e-3),
        ((43, 27), 0.0053, 1.5e-3, 3e-2),
    ],
    ids=["a texel a pixel", "magnified", "4 texels a pixel"],
)
def test_board_against_sampling(
    device: Device, size: tuple[int, int], texel: float, rms: float, worst: float
) -> None:
    image = gs.paint.Image(SPECKLE[: int(0.6 / texel), : int(0.8 / texel)], texel, (0.07, 0.04))
    surface_, plate = board(image)
    view = camera(*size)
    half = size[1] // 2
    want = reference(view, [plate], 0.3, (half // 2, half // 2 + half))
    for backend in ("gpu", "numpy"):
        frame = gs.render([surface_], view, background=0.3, device=device, backend=backend)
        found = difference(frame.radiance[half // 2 : half // 2 + half], want, block=half)
        print(f"{backend}: {found}")
        assert found.rms < rms and found.worst < worst
        assert np.abs(found.bias).max() < 2e-3


def test_rileys_accuracy_test(device: Device) -> None:
    """A flat plate at a texel a pixel, moved and strained; quintic IC-GN, subsets of 31 px, 8 bit.

    The original has 800 x 800 px: docs/paint.md quotes what comes out there.
    """
    width, height, z = 301, 241, 1000.0
    pixels = np.round(255 * speckle(height + 24, width + 24, 7.0, 1.0)).astype(np.uint8)
    image = gs.paint.Image(pixels, 1.0, (-12.0, -12.0))
    K = np.array([[z, 0, 0.5 * (width - 1)], [0, z, 0.5 * (height - 1)], [0, 0, 1.0]])
    view = gs.Camera(width, height, K)
    x, y = np.meshgrid(np.linspace(-160, 160, 9), np.linspace(-130, 130, 7))
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1)
    i = np.arange(63).reshape(7, 9)
    faces = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=-1).reshape(-1, 4)
    axes = np.eye(3)
    frame = gs.PaintFrame(np.array([-0.5 * width, -0.5 * height, z]), axes[0], axes[1])
    plate = gs.Surface(points, faces, paint=image, frames={"surface": frame})

    def picture(u: Array) -> np.ndarray:
        radiance = gs.render([plate.moved(points + u)], view, device=device).radiance
        return np.round(255 * np.clip(radiance, 0, 1)).astype(np.uint8)

    still = picture(np.zeros((63, 3)))
    assert still.std() > 60
    gradient = np.zeros((3, 3))
    for move, strain in ((0.1, 0.0), (0.25, 0.0), (0.5, 0.0), (0.0, 0.01)):
        gradient[0, 0] = strain
        shift = np.array([move, 0.6 * move, 0.0])
        result = gs.measure.dic(
            still, picture(shift + points @ gradient.T), subset=31, step=13,
            roi=(18, 18, width - 19, height - 19), guess=shift[:2], tolerance=1e-6,
        )  # fmt: skip
        assert (result.status == gs.measure.Status.OK).all() and len(result.points) > 250
        place = result.points - K[:2, 2]
        want = shift[:2] + place @ gradient[:2, :2].T
        error = result.displacement - want
        print(f"{move} px, {strain}: bias {error.mean(axis=0)}, deviation {error.std(axis=0)}")
        assert np.abs(error.mean(axis=0)).max() <= 2e-4
        assert error.std(axis=0).max() <= 8e-4


@pytest.mark.usefixtures("device")
def test_what_swings_over_is_black_or_white() -> None:
    """Without light, and in the penumbra on gloss: in grey and in colour, by device and twin."""
    squares = np.kron(np.indices((9, 14)).sum(axis=0) % 2, np.ones((4, 4)))
    colored = np.dstack([squares, squares, 1.0 - squares])
    corners = np.array([[-0.45, 0.0, -0.3], [0.45, 0.0, -0.3], [0.45, 0.0, 0.3], [-0.45, 0.0, 0.3]])
    screen = gs.Surface(0.2 * corners + [0.05, -0.2, 0.03], [[0, 1, 2, 3]], gs.paint.Plain(0.5))
    lamp = gs.AreaLight((-0.7, -1.6, 0.9), (0.0, 0.0, 0.0), (0.5, 0.4), 50.0)
    camera = gs.Camera.from_lens((36, 24), 34, (57, 38), (0.02, -0.9, 0.03), (0.0, 0.0, 0.0))
    seen = []
    for pixels, backend in ((squares, "numpy"), (squares, "gpu"), (colored, "gpu")):
        paint = gs.paint.Image(pixels, 0.017, roughness=0.4)
        sheet = gs.Surface(corners, [[0, 1, 2, 3]], paint)
        albedo = gs.render([sheet], camera, backend=backend).radiance
        assert albedo.min() == 0.0 and albedo.max() == 1.0
        seen.append(gs.render([sheet, screen], camera, [lamp], backend=backend).radiance)
    twin, grey, red = seen[0], seen[1], seen[2][..., 0]
    # a sample of a penumbra may fall to the other side: 1 of 512
    np.testing.assert_allclose(grey, twin, atol=2e-3 * twin.max())
    np.testing.assert_allclose(grey, red, atol=1e-4 * twin.max())


def test_wrong_bitmaps_are_refused(tmp_path: object) -> None:
    good = np.full((5, 7), 9, np.uint8)
    assert gs.paint.Image(good, 2.0).size == (14.0, 10.0)
    with pytest.raises(gs.InputError, match="one grey picture"):
        gs.paint.Image(np.zeros((3, 4, 2), np.uint8), 1.0)
    with pytest.raises(gs.InputError, match="0 to 1"):
        gs.paint.Image(good.astype(float), 1.0)
    with pytest.raises(gs.InputError, match="0 to 1"):
        gs.paint.Image(np.full((3, 4), np.nan), 1.0)
    with pytest.raises(gs.InputError, match="texel"):
        gs.paint.Image(good, 0.0)
    with pytest.raises(gs.InputError, match="gamma"):
        gs.paint.Image(good, 1.0, gamma="2.2")
    with pytest.raises(gs.InputError, match=r"none\.png: not found"):
        gs.paint.Image.read(f"{tmp_path}/none.png", 1.0)
    srgb = gs.paint.Image(np.array([[188, 255]], np.uint8), 1.0, gamma="srgb").albedo()
    np.testing.assert_allclose(srgb, [[0.5029, 1.0]], atol=1e-4)
