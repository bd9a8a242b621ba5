"""Pixels of speckle: against brute force, against the twin, under strain, and by correlation."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
import pytest
from scipy.spatial import cKDTree

import gpusim as gs
from gpusim.errors import InputError, TwinMismatch
from gpusim.gpu import Device, twin_checks
from gpusim.gpu.texture_array import Texels
from gpusim.optics import psf
from gpusim.optics.geometry.view import look
from gpusim.optics.paint import disc_grid as tables
from gpusim.optics.paint.disc_coverage import _cuts_under
from gpusim.optics.paint.disc_grid import speckle_table
from gpusim.surface.speckle import EDGE, edge_opacity

WIDTH, HEIGHT, DISTANCE = 47, 35, 400.0
SAMPLES = 48
SOFT = gs.paint.Speckle(5.0, 0.5, 0.7, seed=1)
HARD = gs.paint.Speckle(5.0, 0.5, seed=2)
SPRAYED = gs.paint.Speckle(4.0, 0.5, spread=0.6, seed=4)
PAINTS = {
    "soft": SOFT,
    "narrow": gs.paint.Speckle(5.0, 0.5, 0.15, seed=3),
    "lognormal": gs.paint.Speckle(6.0, 0.4, 0.5, "lognormal", 0.3, seed=4),
    "grid": gs.paint.Speckle(5.0, 0.5, 0.4, "uniform", 0.1, "grid", seed=5),
    "hard": HARD,
    "hard, of many sizes": gs.paint.Speckle(6.0, 0.5, 0.0, "uniform", 0.3, seed=6),
    "hard, sprayed": SPRAYED,
}


def camera(width: int = WIDTH, height: int = HEIGHT) -> gs.Camera:
    """One unit of length at the distance of the plates is a pixel."""
    K = np.array([[DISTANCE, 0, (width - 1) / 2], [0, DISTANCE, (height - 1) / 2], [0, 0, 1.0]])
    return gs.Camera(width, height, K)


def plate(
    paint: gs.paint.Speckle, half: tuple[float, float], move: np.ndarray | None = None
) -> gs.Surface:
    """A plate that faces the camera; ``move`` (2, 3): x and y after deformation, affine."""
    x, y = half
    rest = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    moved = rest if move is None else rest @ move[:, :2].T + move[:, 2]
    depth = np.full((4, 1), DISTANCE)
    points, reference = np.hstack([moved, depth]), np.hstack([rest, depth])
    frame = gs.PaintFrame(np.array([-x, -y, DISTANCE]), np.eye(3)[0], np.eye(3)[1])
    return gs.Surface(
        points, np.array([[0, 3, 2, 1]]), {"plate": paint}, reference=reference,
        frames={"plate": frame},
    )  # fmt: skip


def brute_force(
    paint: gs.paint.Speckle, half: tuple[float, float], move: np.ndarray | None = None
) -> np.ndarray:
    """Mean albedo of each pixel from 48 x 48 points and the discs' definition."""
    centres, radii = paint.discs([-20.0, -20.0], 2.0 * np.array(half) + 20.0)
    tree, width = cKDTree(centres), EDGE * paint.softness
    reach = float(np.sqrt(radii.max() * (radii.max() + 2 * width)))
    grid = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    shift = ((np.arange(SAMPLES) * 19) % SAMPLES + 0.5) / SAMPLES
    dx = (np.arange(SAMPLES)[None, :] + shift[:, None]) / SAMPLES - 0.5
    image = np.zeros((HEIGHT, WIDTH))
    A = np.eye(2, 3) if move is None else move
    for row in range(HEIGHT):
        for column in range(WIDTH):
            x = (column + dx - (WIDTH - 1) / 2).ravel()
            y = np.repeat(row + grid - (HEIGHT - 1) / 2, SAMPLES)
            st = np.linalg.solve(A[:, :2], np.stack([x, y]) - A[:, 2:]).T + half
            own = tree.query_ball_point(st.mean(axis=0), reach + 1.2)
            square = ((st[:, None] - centres[own]) ** 2).sum(axis=2)
            r = radii[own]
            if width:
                opacity = edge_opacity((r * r - square) / (2.0 * r * width))
            else:
                opacity = (square < r * r).astype(float)
            cover = 1.0 - np.prod(1.0 - opacity, axis=1)
            image[row, column] = np.mean(paint.ground + (paint.dot - paint.ground) * cover)
    return image


@pytest.mark.parametrize("name", PAINTS)
def test_pixels_are_area_integrals(device: Device, name: str) -> None:
    """Soft edges to 2e-4 RMS; hard ones to 1.2e-3: double cover is measured in rows of 1/8 px."""
    paint, half = PAINTS[name], (32.0, 26.0)
    want = brute_force(paint, half)
    frame = gs.render([plate(paint, half)], camera(), device=device).radiance
    twin = gs.render([plate(paint, half)], camera(), backend="numpy").radiance
    error = frame - want
    print(f"{name}: RMS {np.sqrt(np.mean(error**2)):.1e}, worst {np.abs(error).max():.1e}, "
          f"mean {error.mean():+.1e}")  # fmt: skip
    assert np.ptp(want) > 0.8
    assert np.sqrt(np.mean(error**2)) < (2e-4 if paint.softness else 1.2e-3)
    assert abs(error.mean()) < (2e-5 if paint.softness else 4e-4)
    assert np.abs(frame - twin).max() < 2e-5


@pytest.mark.parametrize("paint", [SOFT, HARD, SPRAYED], ids=["soft", "hard", "sprayed"])
def test_edge_pixels_integrate_what_is_seen_of_them(
    device: Device, paint: gs.paint.Speckle
) -> None:
    """A plate that ends inside the image, turned so that its sides cross pixels at an angle."""
    half = (18.0, 13.0)
    c, s = np.cos(0.3), np.sin(0.3)
    move = np.array([[c, -s, 0.3], [s, c, -0.2]])
    want = brute_force(paint, half, move)
    x, y = np.meshgrid(np.arange(WIDTH) - (WIDTH - 1) / 2, np.arange(HEIGHT) - (HEIGHT - 1) / 2)
    st = np.linalg.solve(move[:, :2], np.stack([x.ravel(), y.ravel()]) - move[:, 2:]).T + half
    edge = np.maximum(-st, st - 2.0 * np.array(half)).max(axis=1).reshape(x.shape)
    surface = plate(paint, half, move)
    frame = gs.render([surface], camera(), background=0.3, device=device).radiance
    twin = gs.render([surface], camera(), background=0.3, backend="numpy").radiance
    assert np.abs(frame - twin).max() < 5e-5
    inside = edge < -0.8
    assert np.sqrt(np.mean((frame - want)[inside] ** 2)) < (2e-4 if paint.softness else 1.2e-3)
    # a second plate behind continues the pattern: the seam between them must not show
    seam = plate(paint, half, move)
    cut = np.array([[0.0, 0.0], [2 * half[0], 2 * half[1] * 0.8]])
    points = np.vstack([seam.points, _at(cut, half, move)])
    rest = np.vstack([seam.rest, _at(cut, half, np.eye(2, 3))])
    frames = {name: seam.paint_frame(0) for name in ("a", "b")}
    # the line from (0, 0) to a point of the right side divides the plate in two regions
    joined = gs.Surface(
        points, np.array([[0, 3, 2, -1], [0, 2, 5, -1], [0, 5, 1, -1]]),
        {"a": paint, "b": paint}, region=np.array([0, 0, 1]), reference=rest, frames=frames,
    )  # fmt: skip
    two = gs.render([joined], camera(), background=0.3, device=device).radiance
    changed = np.abs(two - frame)[inside]
    print(f"seam: {np.sqrt(np.mean(changed**2)):.1e} RMS, worst {changed.max():.1e}")
    assert (changed > 0).sum() > 20
    assert np.sqrt(np.mean(changed**2)) < (2e-4 if paint.softness else 1.2e-3)


def _at(st: np.ndarray, half: tuple[float, float], move: np.ndarray) -> np.ndarray:
    moved = (st - half) @ move[:, :2].T + move[:, 2]
    return np.hstack([moved, np.full((len(st), 1), DISTANCE)])


def test_the_pattern_sticks_to_the_material_under_strain(device: Device) -> None:
    half = (32.0, 26.0)
    move = np.array([[1.04, 0.03, 0.37], [-0.01, 0.97, -0.21]])
    frame = gs.render([plate(SOFT, half, move)], camera(), device=device).radiance
    assert np.sqrt(np.mean((frame - brute_force(SOFT, half, move)) ** 2)) < 2e-4


def test_only_pixels_under_small_discs_are_cut_into_pieces() -> None:
    """Discs of 0.7 to 17 px: four cuts would take sixteen times as long everywhere."""
    extent = np.array([200.0, 150.0])
    table = speckle_table([(SPRAYED, np.zeros(2), extent, 0.5, False)])
    (grid,) = table.grids
    place = np.random.default_rng(3).uniform(0.0, 1.0, (2000, 2)) * extent
    at = np.floor(place / grid.cell).astype(int) - grid.lowest
    local = place - (at + grid.lowest) * grid.cell
    slot = grid.first + at[:, 1] * grid.shape[0] + at[:, 0]
    ex, ey = np.tile([[1.0, 0.0]], (2000, 1)), np.tile([[0.0, 1.0]], (2000, 1))
    cuts = _cuts_under(table, grid, table.start[slot], table.start[slot + 1], local, ex, ey)
    print(f"shares of pixels with 1, 2 … cuts: {np.bincount(cuts)[1:] / 2000}")
    assert grid.cuts == 4
    assert (cuts**2).mean() < 1.7
    centres, radii = SPRAYED.discs(np.zeros(2), extent)
    crossing = np.abs(np.linalg.norm(place[:, None] - centres, axis=2) - radii) < np.sqrt(0.5)
    smallest = np.where(crossing, radii, np.inf).min(axis=1)
    assert (np.sqrt(0.5) / cuts <= 2.0 / 3.0 * smallest).all()
    equal = speckle_table([(HARD, np.zeros(2), extent, 0.5, False)])
    assert equal.grids[0].smallest == 0.0


def test_views_of_the_same_plate_share_their_table() -> None:
    half = (32.0, 26.0)
    tables = [
        gs.optics.shading.setup.Setup.build(
            look([plate(SOFT, half, np.array([[scale, 0, 0.2], [0, scale, 0.1]]))], camera(),
                 lit=False), None, 0.0,
        ).table.speckle
        for scale in (1.0, 1.001)
    ]  # fmt: skip
    assert tables[0] is tables[1]


def test_discs_far_below_the_pixel_are_refused_unless_soft(device: Device) -> None:
    half = (1.6, 1.2)
    fine = gs.paint.Speckle(0.24, 0.5, seed=1)
    with pytest.raises(InputError, match=r"Speckle diameter; got discs down to 0\.24 .*pixel"):
        gs.render([plate(fine, half)], camera(), device=device)
    soft = gs.paint.Speckle(0.24, 0.5, 0.05, seed=1)
    frame = gs.render([plate(soft, half)], camera(), device=device).radiance
    x, y = WIDTH // 2, HEIGHT // 2
    middle = frame[y, x - 1 : x + 2]
    assert abs(middle.mean() - (0.9 - 0.85 * 0.5)) < 0.06  # three pixels of fifteen discs each


def test_correlation_finds_shifts_of_rendered_speckle(device: Device) -> None:
    """riley's accuracy test in small: 31 px subsets, quintic spline, 8 bit, no filter."""
    size, half = 160, (90.0, 90.0)
    paint = gs.paint.Speckle(8.0, 0.5, 1.0, seed=6)
    sensor = gs.Sensor(8, 1.0)

    def image(dx: float, strain: float) -> np.ndarray:
        move = np.array([[1.0 + strain, 0.0, dx], [0.0, 1.0, 0.0]])
        return sensor.expose(
            gs.render([plate(paint, half, move)], camera(size, size), device=device)
        )

    reference = image(0.0, 0.0)
    for dx, strain in ((0.1, 0.0), (0.25, 0.0), (0.5, 0.0), (0.0, 0.01)):
        found = gs.measure.dic(reference, image(dx, strain), subset=31, step=16, search_px=4,
                               roi=(6, 6, size - 7, size - 7))  # fmt: skip
        x = found.points[:, 0] - (size - 1) / 2
        error = found.displacement[:, 0] - (dx + strain * x)
        print(f"shift {dx}, strain {strain}: bias {error.mean():+.5f}, deviation {error.std():.5f}")
        assert np.isfinite(error).all() and len(error) >= 49
        # 49 points: the mean scatters by a seventh of the deviation
        assert abs(error.mean()) < 3e-4 and error.std() < 8e-4


def test_only_what_may_be_seen_is_filed() -> None:
    """A plate of 60 times the image's width has a table for the image's surroundings alone."""
    half = (30.0 * WIDTH, 30.0 * HEIGHT)
    setup = gs.optics.shading.setup.Setup.build(
        look([plate(SOFT, half)], camera(), lit=False), None, 0.0
    )
    (grid,) = setup.table.speckle.grids
    assert grid.cell * grid.shape[0] < 1100.0  # pieces of the plate reach 512 px outside


def test_large_views_take_larger_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    low, high = np.array([3.0, 2.0]), np.array([121.0, 93.0])
    usual = speckle_table([(SOFT, low, high, 0.5, False)])
    monkeypatch.setattr(tables, "MAX_TEXELS", 10_000)
    spared = speckle_table([(SOFT, low, high, 0.501, False)])
    sizes = [len(table.start) + len(table.disc) for table in (usual, spared)]
    assert spared.grids[0].cell > usual.grids[0].cell and sizes[1] < 10_000 < sizes[0]
    monkeypatch.setattr(tables, "MAX_TEXELS", 500)
    with pytest.raises(InputError, match=r"Speckle diameter; got 5, which makes .* at most 500"):
        speckle_table([(SOFT, low, high, 0.9, False)])


def test_shifts_behind_a_lens_are_found_without_bias(device: Device) -> None:
    """Hard speckle, PSF of 0.7 px, 8 bit: |bias| <= 0.001 px where interpolants err most."""
    size, half = 120, (75.0, 75.0)
    lens = gs.Lens(psf=psf.Gaussian(0.7))
    paint = gs.paint.Speckle(5.0, 0.5, seed=2, ground=0.95)

    def image(dx: float) -> np.ndarray:
        move = np.array([[1.0, 0.0, dx], [0.0, 1.0, 0.0]])
        frame = gs.photograph(
            [plate(paint, half, move)], camera(size, size), lens=lens, device=device
        )
        return gs.Sensor(8, 1.0).expose(frame)

    reference = image(0.0)
    found = gs.measure.dic(reference, image(0.2), subset=31, step=11, search_px=3,
                           roi=(8, 8, size - 9, size - 9))  # fmt: skip
    error = found.displacement[:, 0] - 0.2
    print(f"behind a lens: bias {error.mean():+.5f}, deviation {error.std():.5f}")
    assert np.isfinite(error).all() and len(error) >= 36
    assert abs(error.mean()) <= 1e-3 and error.std() < 1e-3


@pytest.mark.parametrize("stage", ["optics/shading/forward_pass", "optics/edge_pixels/resolve"])
def test_one_wrong_radius_on_the_device_is_seen(
    device: Device, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    write = Texels.write

    def corrupted(self: Texels, array: np.ndarray, first: int = 0) -> None:
        if self.label == "speckle.discs":
            array = array.copy()
            array[array[:, 2] > 0.0, 2] *= 1.02
        write(self, array, first)

    monkeypatch.setattr(Texels, "write", corrupted)
    monkeypatch.setattr(tables, "_uploaded", WeakKeyDictionary())
    with pytest.raises(TwinMismatch, match=stage):
        twin_checks()[stage](device)
