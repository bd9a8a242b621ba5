"""Motion during the exposure, and rows that are read one after the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.special import j0

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.lens.exposure import Exposure, plan_exposure
from gpusim.optics.lens.shutter import divided, moments, moments_for, motion, rolled
from tests.support.optics_edges import ANGLE, HEIGHT, camera, half_plane, pixel_transfer, transfer

FREQUENCY = np.linspace(0.02, 0.5, 25)
LINE = 20e-6


def edge_columns(
    image: npt.NDArray[np.float32], rows: npt.NDArray[np.int64]
) -> npt.NDArray[np.float64]:
    """Where an edge, dark to bright, crosses rows: from the bright length of each."""
    return image.shape[1] - 0.5 - image[rows].astype(np.float64).sum(axis=1) / 0.8


@pytest.mark.parametrize("way", [0.6, 4.0])
def test_motion_blur_transfer(device: Device, way: float) -> None:
    """Even motion across the edge: sinc of its way."""
    exposure = 0.01

    def at(time: float) -> list[gs.Surface]:
        return [half_plane(shift=way * (time / exposure - 0.5))]

    frame = gs.photograph(at, camera(), shutter=gs.Shutter(exposure), device=device)
    want = pixel_transfer(FREQUENCY) * np.abs(np.sinc(way * np.cos(ANGLE) * FREQUENCY))
    assert np.abs(transfer(frame.radiance, FREQUENCY) - want).max() <= 0.02
    assert f"{way:.3g} px" in frame.facts["motion"]


@pytest.mark.parametrize("periods", [1, 4, 8, 28, 256])
def test_a_vibration_blurs_though_it_comes_back(device: Device, periods: int) -> None:
    """Whole periods across the edge: Bessel's J0 of the amplitude, however often they are looked
    at when nothing seems to have moved."""
    exposure, amplitude = 0.01, 1.1

    def at(time: float) -> list[gs.Surface]:
        return [half_plane(shift=amplitude * np.sin(2.0 * np.pi * periods * time / exposure))]

    frame = gs.photograph(at, camera(), shutter=gs.Shutter(exposure), device=device)
    blur = np.abs(j0(2.0 * np.pi * amplitude * np.cos(ANGLE) * FREQUENCY))
    want = pixel_transfer(FREQUENCY) * blur
    assert np.abs(transfer(frame.radiance, FREQUENCY) - want).max() <= 0.02


@pytest.mark.parametrize("phase", [0.0, 0.7, np.pi / 2])
@pytest.mark.parametrize("periods", [0.5, 1, 3, 4, 8, 10, 16, 28, 31.45, 256, 2000])
def test_the_way_of_a_vibration_grows_with_its_periods(periods: float, phase: float) -> None:
    """However few looks a period gets: four amplitudes each."""

    def at(time: float) -> list[gs.Surface]:
        return [half_plane(shift=2.5 * np.sin(2.0 * np.pi * periods * time / 0.02 + phase))]

    angles = phase + 2.0 * np.pi * periods * np.linspace(0.0, 1.0, 100_001)
    want = np.abs(np.diff(2.5 * np.sin(angles))).sum()
    assert motion(at, lambda _: camera(), 0.0, 0.02) == pytest.approx(want, rel=0.16)


def test_a_moving_camera_blurs_as_moving_surfaces_do(device: Device) -> None:
    def moving(time: float) -> gs.Camera:
        T = np.eye(4)
        T[0, 3] = 300.0 * (time - 0.005) / 900.0 * 2.0
        return replace(camera(), camera_from_world=T)

    shutter = gs.Shutter(0.01)
    by_camera = gs.photograph([half_plane()], moving, shutter=shutter, device=device).radiance
    by_surface = gs.photograph(
        lambda time: [half_plane(shift=300.0 * (time - 0.005))], camera(), shutter=shutter,
        device=device,
    ).radiance  # fmt: skip
    np.testing.assert_allclose(by_camera, by_surface, atol=2e-5)


def test_a_motion_too_small_to_see_is_left_out(device: Device) -> None:
    def at(time: float) -> list[gs.Surface]:
        return [half_plane(shift=time)]

    frame = gs.photograph(at, camera(), shutter=gs.Shutter(0.01), device=device)
    assert "1 moments" in frame.facts["motion"]
    still = gs.photograph([half_plane()], camera(), shutter=gs.Shutter(0.01), device=device)
    assert "motion" not in still.facts
    many = gs.photograph(at, camera(), shutter=gs.Shutter(0.01, samples=9), device=device)
    assert np.abs(many.radiance - frame.radiance).max() * 255 <= 0.2


def test_moments_integrate_polynomials() -> None:
    shares, weights = moments(gs.Shutter(0.2), 3.0)
    for power in range(2 * len(shares)):
        assert weights @ shares**power == pytest.approx(1.0 / (power + 1), rel=1e-10)
    assert np.diff(shares).max() * 3.0 <= 0.5


@pytest.mark.parametrize("speed", [2000.0, -9000.0])
def test_rolling_shutter_skews_by_speed_times_line_time(device: Device, speed: float) -> None:
    """An edge that moves along the rows at ``speed`` px/s leans by speed x line time a row."""

    def at(time: float) -> list[gs.Surface]:
        return [half_plane(shift=speed * (time - 0.5 * HEIGHT * LINE))]

    frame = gs.photograph(at, camera(), shutter=gs.Shutter(line_time=LINE), device=device)
    rows = np.arange(20, HEIGHT - 20)
    still = gs.render([half_plane()], camera(), device=device).radiance
    lean = edge_columns(frame.radiance, rows) - edge_columns(still, rows)
    want = speed * LINE * (rows - 0.5 * HEIGHT)
    # the edge leans itself: a row's share of the motion is that of the time it is read at
    assert np.abs(lean - want).max() <= 0.01
    assert "rolling" in frame.facts["shutter"]


def test_rolling_along_the_columns_stretches(device: Device) -> None:
    """A body that moves with the read-out at speed v is longer by 1 / (1 - v line time)."""
    speed = 0.1 / LINE

    def at(time: float) -> list[gs.Surface]:
        points = np.array([[-0.03, -0.1, 2], [0.03, -0.1, 2], [0.03, 0.02, 2], [-0.03, 0.02, 2]])
        points[:, 1] += speed * time / 900.0 * 2.0
        return [gs.Surface(points, np.array([[0, 3, 2, 1]]), paint=gs.paint.Plain(1.0))]

    frame = gs.photograph(at, camera(), shutter=gs.Shutter(line_time=LINE), device=device)
    column = frame.radiance[:, 46].astype(float)
    top = 76.1 - 0.1 * 450.0
    bottom = 76.1 + 0.02 * 450.0
    assert column.sum() == pytest.approx((bottom - top) / 0.9, abs=0.01)
    first = np.flatnonzero(column > 0.0)[0]
    assert first + 0.5 - column[first] == pytest.approx(top / 0.9, abs=0.01)


def turning(angle: float) -> gs.Surface:
    """One square face that turns about the viewing direction, seen at a slant."""
    c, s = np.cos(angle), np.sin(angle)
    corners = 0.12 * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    flat = corners @ np.array([[c, s], [-s, c]])
    points = np.stack([flat[:, 0], flat[:, 1], 2.0 + 0.5 * flat[:, 0]], axis=1)
    return gs.Surface(points, np.array([[0, 3, 2, 1]]), paint=gs.paint.Checker(0.03))


def test_rolling_of_a_turning_plate_equals_the_render_of_each_row(device: Device) -> None:
    """Row by row by definition: every row from the scene at its own time."""
    rate = 0.12 / (HEIGHT * LINE)  # rad during the read-out: up to 0.04 px a row

    def at(time: float) -> list[gs.Surface]:
        return [turning(0.0).moved(turning(rate * time).points)]

    frame = gs.photograph(at, camera(), shutter=gs.Shutter(line_time=LINE), device=device)
    rows = np.arange(25, HEIGHT - 25, 7)
    want = np.stack(
        [
            gs.render(
                at(float(row) * LINE),
                replace(camera(), height=1, K=camera().K - [[0, 0, 0], [0, 0, row], [0, 0, 0]]),
                device=device,
            ).radiance[0]
            for row in rows
        ]
    )
    # edges along a row are up to half a row's motion off: all of a pixel has its row's time, while
    # a point has that of its place in the pixel
    error = frame.radiance[rows] - want
    assert np.sqrt(np.mean(error**2)) <= 2e-3
    assert len(rolled(at, lambda _: camera(), 0.0, LINE)[0][0].faces) > 4


def test_divided_faces_keep_shape_and_paint() -> None:
    points = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [3, 0, 1]])
    faces = np.array([[0, 1, 2, 3], [1, 4, 2, -1]])
    paint = {"a": gs.paint.Plain(0.3), "b": gs.paint.Plain(0.6)}
    surface = gs.Surface(points, faces, paint, region=np.array([0, 1]))
    finer, mean = divided(surface)
    np.testing.assert_array_equal(finer.faces.reshape(2, 4, 4)[1, :, 3], -1)
    np.testing.assert_array_equal(finer.regions, [0] * 4 + [1] * 4)
    np.testing.assert_allclose(finer.points, mean(points))

    def area(s: gs.Surface, region: int) -> float:
        from gpusim.surface.surface import face_normals

        normals = face_normals(s.points, s.faces)[s.regions == region]
        unit = normals / np.linalg.norm(normals, axis=1)[:, None]
        np.testing.assert_allclose(unit - unit[0], 0.0, atol=1e-12)  # none is turned over
        return float(np.linalg.norm(normals, axis=1).sum())

    for region in (0, 1):
        assert area(finer, region) == pytest.approx(area(surface, region))


def test_what_cannot_be_is_refused(device: Device) -> None:
    with pytest.raises(InputError, match="exposure_time; got -1"):
        gs.Shutter(-1.0)
    with pytest.raises(InputError, match="line_time; got nan"):
        gs.Shutter(line_time=float("nan"))
    rolling = gs.Shutter(line_time=LINE)

    def jump(time: float) -> list[gs.Surface]:
        return [half_plane(shift=50.0 * (time > 0.3 * HEIGHT * LINE))]

    with pytest.raises(InputError, match="expected a smooth motion"):
        gs.photograph(jump, camera(), shutter=rolling, device=device)

    def falling(time: float) -> list[gs.Surface]:
        surface = half_plane()
        return [surface.moved(surface.points + np.array([0, 1.3 * time / LINE * 2.0 / 900.0, 0]))]

    with pytest.raises(InputError, match=r"1\.3 rows per line_time"):
        gs.photograph(falling, camera(), shutter=rolling, device=device)


def planned(way: float, lens: gs.Lens, shutter: gs.Shutter) -> Exposure:
    """A wall (2 m, before a camera of 100 px / rad) that goes ``way`` px during 10 ms."""
    corners = np.array([[-2.0, -1.0, 2.0], [2.0, -1.1, 2.0], [1.9, 1.0, 2.3]])
    wall = gs.Surface(corners, np.array([[0, 2, 1]]))
    K = np.array([[100.0, 0.0, 30.5], [0.0, 100.0, 20.5], [0.0, 0.0, 1.0]])
    speed = np.array([way * 2.0 / 100.0 / 0.01, 0.0, 0.0])
    return plan_exposure(
        lambda time: [wall.moved(corners + time * speed)], gs.Camera(62, 42, K), lens, shutter,
        0.0, 0.25,
    )  # fmt: skip


def test_too_few_moments_are_told() -> None:
    """80 px and more would need over 256 moments: how far the edges' steps are is said."""
    shutter = gs.Shutter(0.01)
    assert planned(70.0, gs.Lens(), shutter).warnings == ()
    exposure = planned(100.0, gs.Lens(), shutter)
    assert len(exposure.parts) == 256 and len(exposure.warnings) == 1
    nodes, _ = moments(shutter, 100.0)
    widest = 100.0 * float(np.diff(nodes).max())
    assert f"steps of up to {widest:.2g} px" in exposure.warnings[0]
    wanted = moments_for(100.0)
    assert f"{wanted} samples of the shutter" in exposure.warnings[0]
    more = planned(100.0, gs.Lens(), gs.Shutter(0.01, samples=wanted))
    assert len(more.parts) == wanted == 322 and more.warnings == ()


def test_too_few_lens_positions_are_told() -> None:
    lens = gs.Lens(f_number=1.0, focal_length=0.5, focus_distance=0.9)
    exposure = planned(0.0, lens, gs.Shutter())
    assert len(exposure.parts) == 256
    (warning,) = exposure.warnings
    assert "by 256 lens positions" in warning and "expected 1.4e-03" in warning
    weaker = gs.Lens(f_number=60.0, focal_length=0.5, focus_distance=1.9)
    fine = planned(0.0, weaker, gs.Shutter())
    assert 1 < len(fine.parts) < 256 and fine.warnings == ()
    both = planned(5.0, weaker, gs.Shutter(0.01))
    count = len(fine.parts) * moments_for(5.0)
    assert len(both.parts) == count and both.facts["renderings"].startswith(f"{count}: ")
    assert "renderings" not in fine.facts
