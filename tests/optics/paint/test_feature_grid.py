"""Targets against dense sampling of their definition, and found by OpenCV's detectors."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.geometry.pixel_footprint import RegionPaint
from gpusim.optics.paint.feature_grid import FeatureGrid
from gpusim.surface.fiducials import ring_codes
from tests.support.optics_reference import Array, Plate, difference, reference

QUAD = np.array([[0, 1, 2, 3]])


def camera(width: int, height: int) -> gs.Camera:
    return gs.Camera.from_lens(
        (36.0, 36.0 * height / width), 30.0, (width, height), eye=(0.13, -0.78, 0.21),
        target=(0.03, 0.0, 0.02), up=(0.1, 0.0, 1.0),
    )  # fmt: skip


def plate(value: Callable[[Array, Array], Array]) -> Plate:
    turn = 0.15
    s_axis, t_axis = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([0.0, 0.0, 1.0])
    return Plate(np.array([-0.32, 0.01, -0.24]), s_axis, t_axis, (0.73, 0.47), value)


CENTRES = np.array([[0.21, 0.16], [0.49, 0.31]])
CIRCLES = gs.paint.Circles(CENTRES, (0.21, 0.14, 0.037), 0.1, 0.8, 0.6)
LINES = gs.paint.Lines(0.053, 0.011, "both", 9, 5, (0.09, 0.07), 0.1, 0.8)
ALONG = gs.paint.Lines(0.031, 0.012, "t", None, None, (0.013, 0.0))
STAR = gs.paint.Star(np.array([[0.34, 0.22]]), 0.41, 18, 0.21, 0.1, 0.7, 0.5)
RINGS = gs.paint.RingCodes(CENTRES, (0b101100111011, 0b000000011111), 0.071, angle=0.3)


def circles(s: Array, t: Array) -> Array:
    value = np.full(np.shape(s), CIRCLES.ground)
    for k, diameter in enumerate(CIRCLES.diameters):
        for x, y in CENTRES:
            value[np.hypot(s - x, t - y) < 0.5 * diameter] = (0.1, 0.8)[k % 2]
    return value


def lines(s: Array, t: Array) -> Array:
    i, j = (s - 0.09) / 0.053, (t - 0.07) / 0.053
    half = 0.5 * 0.011 / 0.053
    inside = (i > -half) & (i < 9 + half) & (j > -half) & (j < 5 + half)
    near = (np.abs(i - np.rint(i)) < half) | (np.abs(j - np.rint(j)) < half)
    return np.where(inside & near, 0.1, 0.8)


def along(s: Array, t: Array) -> Array:
    i = (s - 0.013) / 0.031
    return np.where(np.abs(i - np.rint(i)) < 0.5 * 0.012 / 0.031, ALONG.albedo, ALONG.ground)


def star(s: Array, t: Array) -> Array:
    x, y = s - 0.34, t - 0.22
    phase = np.mod(np.arctan2(y, x) - 0.21, 2 * np.pi / 18) * 18 / np.pi
    return np.where(np.hypot(x, y) < 0.205, np.where(phase < 1.0, 0.1, 0.7), 0.5)


def coded(s: Array, t: Array) -> Array:
    value = np.full(np.shape(s), RINGS.ground)
    for (x, y), code in zip(CENTRES, RINGS.codes, strict=True):
        r = np.hypot(s - x, t - y) / 0.071
        bit = np.floor(np.mod(np.arctan2(t - y, s - x) - 0.3, 2 * np.pi) * 12 / (2 * np.pi))
        lit = (code >> np.clip(bit, 0, 11).astype(int)) & 1 == 1
        value[(r < 0.5) | ((r > 1.0) & (r < 1.5) & lit)] = RINGS.dot
    return value


@pytest.mark.parametrize(
    ("paint", "value"),
    [(CIRCLES, circles), (LINES, lines), (ALONG, along), (STAR, star), (RINGS, coded)],
    ids=["circles", "lines", "along", "star", "ring_codes"],
)
def test_targets_against_sampling(
    device: Device, paint: gs.paint.Paint, value: Callable[[Array, Array], Array]
) -> None:
    view = camera(97, 61)
    board = plate(value)
    surface = gs.Surface(board.corners(), QUAD, paint=paint)
    want = reference(view, [board], 0.3, (15, 45))
    twin = gs.render([surface], view, background=0.3, backend="numpy").radiance
    got = gs.render([surface], view, background=0.3, device=device).radiance
    found = difference(got[15:45], want, block=30)
    print(f"{type(paint).__name__}: {found}; twin {np.abs(got - twin).max():.1e}")
    assert found.rms < 6e-4 and found.worst < 1e-2
    assert np.abs(got - twin).max() < 1e-4  # sums of up to six float32 shares
    assert np.abs(found.bias).max() < 5e-4


def face_on(surface_size: tuple[float, float], pixels: int) -> tuple[gs.Camera, Array]:
    """A camera before a plate in the x-z plane, and the plate's corners."""
    width, height = surface_size
    across = int(pixels * width / height)
    view = gs.Camera.from_lens(
        (36.0 * across / pixels, 36.0), 40.0, (across, pixels), (0.07, -1.25 * height, 0.05),
        (0.01, 0.0, -0.02),
    )  # fmt: skip
    corners = np.array(
        [[-0.5 * width, 0, -0.5 * height], [0.5 * width, 0, -0.5 * height],
         [0.5 * width, 0, 0.5 * height], [-0.5 * width, 0, 0.5 * height]]
    )  # fmt: skip
    return view, corners


def picture(paint: gs.paint.Paint, view: gs.Camera, corners: Array, device: Device) -> np.ndarray:
    frame = gs.render([gs.Surface(corners, QUAD, paint=paint)], view, background=0.9, device=device)
    return np.round(255 * np.clip(frame.radiance, 0, 1)).astype(np.uint8)


@pytest.mark.parametrize("name", ["4X4_50", "6X6_250", "APRILTAG_36h11"])
def test_opencv_finds_the_markers(device: Device, name: str) -> None:
    centres = np.array([[0.3, 0.3], [0.95, 0.35], [0.62, 0.83]])
    paint = gs.paint.Aruco(centres, (3, 11, 24), 0.31, name, angle=0.2)
    view, corners = face_on((1.3, 1.1), 420)
    image = picture(paint, view, corners, device)
    options = cv2.aruco.DetectorParameters()
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
    found, ids, _ = cv2.aruco.ArucoDetector(dictionary, options).detectMarkers(image)
    assert sorted(np.ravel(ids).tolist()) == [3, 11, 24]
    for number, place in zip(np.ravel(ids), found, strict=True):
        centre = centres[(3, 11, 24).index(number)]
        # upper left first, then clockwise
        c, s = np.cos(0.2), np.sin(0.2)
        square = 0.155 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
        st = centre + square @ np.array([[c, s], [-s, c]])
        want = view.project(np.stack([st[:, 0] - 0.65, 0 * st[:, 0], st[:, 1] - 0.55], axis=1))
        off = np.linalg.norm(np.reshape(place, (4, 2)) - want, axis=1)
        print(f"{name} {number}: corners off by {off}")
        assert off.max() < 0.5  # cv2.cornerSubPix on an outer corner


def test_opencv_finds_the_board(device: Device) -> None:
    paint = gs.paint.Charuco(7, 5, 0.2, 0.14, "5X5_100", (0.11, 0.06))
    view, corners = face_on((1.6, 1.15), 480)
    image = picture(paint, view, corners, device)
    found, ids, _, marks = cv2.aruco.CharucoDetector(paint.board()).detectBoard(image)
    assert np.ravel(ids).tolist() == list(range(24)) and len(marks) == 17
    st = paint.corners() - [0.8, 0.575]
    want = view.project(np.stack([st[:, 0], 0 * st[:, 0], st[:, 1]], axis=1))
    off = np.reshape(found, (-1, 2)) - want
    print(f"ChArUco corners: rms {np.sqrt((off**2).mean()):.4f} px, worst {np.abs(off).max():.4f}")
    assert np.sqrt((off**2).mean()) < 0.06  # that of cv2.cornerSubPix on perfect images


def test_discs_of_targets_lie_where_they_should(device: Device) -> None:
    """Grey-value centroids, against the centroid of the projected shape: 0.02 px."""
    view, corners = face_on((1.0, 0.8), 301)
    centres = np.array([[0.23, 0.31], [0.71, 0.52]])
    paint = gs.paint.RingCodes(centres, (0b1011, 0b1011011), 0.11, dot=1.0, ground=0.0)
    frame = gs.render([gs.Surface(corners, QUAD, paint=paint)], view, device=device)
    y, x = np.mgrid[: view.height, : view.width]
    turn = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    for centre in centres:
        ring = centre + 0.055 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        outline = view.project(np.stack([ring[:, 0] - 0.5, 0 * turn, ring[:, 1] - 0.4], axis=1))
        a, b = outline, np.roll(outline, -1, axis=0)
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        want = ((a + b) * cross[:, None]).sum(axis=0) / (3 * cross.sum())
        near = np.hypot(x - want[0], y - want[1]) < 1.5 * np.ptp(outline[:, 0]) / 2
        weight = np.where(near, frame.radiance.astype(np.float64), 0.0)
        got = np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()
        assert np.abs(got - want).max() < 2e-3


def test_ring_codes_read_back(device: Device) -> None:
    assert len(ring_codes(12)) == 350 and ring_codes(4) == (1, 3, 5, 7)
    view, corners = face_on((1.0, 0.8), 301)
    codes = (ring_codes(14)[200], ring_codes(14)[801])
    centres = np.array([[0.25, 0.4], [0.72, 0.38]])
    paint = gs.paint.RingCodes(centres, codes, 0.13, bits=14)
    image = picture(paint, view, corners, device)
    for centre, code in zip(centres, codes, strict=True):
        turn = (np.arange(14) + 0.5) * 2 * np.pi / 14
        st = centre + 0.13 * 1.25 * np.stack([np.cos(turn), np.sin(turn)], axis=1) - [0.5, 0.4]
        at = np.rint(view.project(np.stack([st[:, 0], 0 * turn, st[:, 1]], axis=1))).astype(int)
        bits = image[at[:, 1], at[:, 0]] > 127
        assert sum(1 << k for k in range(14) if bits[k]) == code


def test_wrong_targets_are_refused(device: Device) -> None:
    with pytest.raises(gs.InputError, match="that fall"):
        gs.paint.Circles(CENTRES, (0.1, 0.2))
    with pytest.raises(gs.InputError, match="less than the pitch"):
        gs.paint.Lines(0.1, 0.1)
    with pytest.raises(gs.InputError, match="4X4_50"):
        gs.paint.Aruco(CENTRES, (1, 2), 0.1, "4x4")
    with pytest.raises(gs.InputError, match="0 to 49"):
        gs.paint.Aruco(CENTRES, (1, 50), 0.1)
    with pytest.raises(gs.InputError, match="with 50 markers"):
        gs.paint.Charuco(11, 10, 0.1, 0.07)
    with pytest.raises(gs.InputError, match="of 12 bits"):
        gs.paint.RingCodes(CENTRES, (1, 1 << 12), 0.1)
    close = gs.paint.Aruco(CENTRES, (1, 2), 0.35)
    board = plate(circles)
    with pytest.raises(gs.InputError, match="overlap"):
        gs.render([gs.Surface(board.corners(), QUAD, paint=close)], camera(31, 19), device=device)
    far, near = np.full(2, 1e12), CENTRES + 1e12
    region = RegionPaint(gs.paint.Circles(near, (0.1,)), far - 1.0, far + 2.0, 1e-3)
    with pytest.raises(gs.InputError, match="surface too large for its pattern"):
        FeatureGrid.build([region])
