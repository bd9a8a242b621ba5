"""Shadows in small versions of the scenes of `benchmarks.faces`, pixel by pixel, against rays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from benchmarks.faces import camera_of, scene_of
from gpusim.gpu import Device
from gpusim.optics.geometry.view import look
from gpusim.optics.light.quadrature import Lamp, lamps_of
from gpusim.optics.shadow.lamp_visibility import VisibleShares
from gpusim.optics.shadow.light_space import light_spaces
from gpusim.optics.shadow.occluders import Occluders, relative_points
from gpusim.optics.shadow.receivers import PixelReceivers, Receivers
from gpusim.optics.visibility_buffer import visibility_twin
from tests.support.optics_rays import may_meet
from tests.support.shadow_rays import blocked, box, ray_shares, triangles_of

Array = npt.NDArray[np.float64]

SCENES = ("crane", "beam-soft", "sheet-soft", "rod-soft", "flanges-soft", "tube-shadows")
SLACK = 4e-6


def seen(
    device: Device, name: str, faces: int, width: int
) -> tuple[list[gs.Surface], gs.Camera, list[Lamp], npt.NDArray[np.int64], Receivers, Array, Array]:
    """Scene, lamps relative to the eye, and of each pixel that sees something its number, as a
    receiver, what it sees of each lamp, and the triangle (of all surfaces, in their order)."""
    surface, behind, lights = scene_of(name, faces)
    surfaces, camera = [surface, *behind], camera_of(name, width)
    view = look(surfaces, camera, lit=True)
    occluders = Occluders.of(surfaces)
    pixels = PixelReceivers.of(view, visibility_twin(view), occluders)
    points = relative_points(surfaces, camera.eye)
    spaces = light_spaces(lamps_of(lights), points, camera.eye)
    pixel, own = pixels.receivers()
    shares = VisibleShares(device, occluders, pixels).find(points, spaces)[pixel].astype(np.float64)
    return surfaces, camera, [space.lamp for space in spaces], pixel, own, shares, occluders.rank


def within(own: Receivers, corners: Array, rank: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """(n,): whether all of a pixel lies in its triangle."""
    triangle = corners[np.argsort(rank)][own.on]
    normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    result = np.ones(len(own.at), bool)
    for k in range(3):
        inwards = np.cross(normal, triangle[:, (k + 1) % 3] - triangle[:, k])
        most = np.abs(np.sum(own.across * inwards, axis=1))
        most += np.abs(np.sum(own.down * inwards, axis=1))
        result &= np.sum((own.at - triangle[:, k]) * inwards, axis=1) > 0.5 * most
    return result


@pytest.mark.parametrize("name", SCENES)
def test_pixels_within_a_triangle(device: Device, name: str) -> None:
    surfaces, camera, lamps, _, own, shares, rank = seen(device, name, 300, 240)
    corners, is_open = triangles_of(surfaces)
    corners = corners - camera.eye
    random = np.random.default_rng(4)
    inside = within(own, corners, rank)
    errors = []
    for column, lamp in enumerate(lamps):
        share = shares[:, column]
        part = np.flatnonzero(inside & (share > 0.01) & (share < 0.99))
        rest = np.flatnonzero(inside)
        rows = np.concatenate([random.permutation(part)[:8], random.permutation(rest)[:3]])
        to = lamp.centre - own.at[rows]
        rows = rows[np.sum(own.normal[rows] * to, axis=1) > 0.0]
        want = ray_shares(lamp, corners, is_open, own[rows], SLACK, 24)
        errors.append(share[rows] - want)
    every = np.concatenate(errors)
    assert np.abs(every).max() <= 0.06
    assert np.sqrt((every**2).mean()) <= 0.015


def on_surface(camera: gs.Camera, pixel: int, corners: Array, random: np.random.Generator) -> Array:
    """Places (n, 3), relative to the eye, that rays all over a pixel meet first, and the triangle
    of each in the last column; those that meet one."""
    rays = camera.camera_from_world[:3, :3].T @ camera.ray_matrix()
    place = np.array([pixel % camera.width, pixel // camera.width]) + random.random((400, 2)) - 0.5
    ray = place @ rays[:, :2].T + rays[:, 2]
    # only triangles behind the pixel's own part of the picture, or that reach behind the camera
    at = corners @ np.linalg.inv(rays).T
    before = (at[:, :, 2] > 0.0).all(axis=1)
    seen_at = at[:, :, :2] / np.where(before[:, None, None], at[:, :, 2:], 1.0)
    low, high = seen_at.min(axis=1), seen_at.max(axis=1)
    around = (low <= place.max(axis=0)) & (high >= place.min(axis=0))
    some = np.flatnonzero(~before | around.all(axis=1))
    a, b, c = (corners[some, k] for k in range(3))
    sides = np.stack([ray @ np.cross(p, q).T for p, q in ((a, b), (b, c), (c, a))])
    hit = (sides >= 0.0).all(axis=0) | (sides <= 0.0).all(axis=0)
    normal = np.cross(b - a, c - a)
    height, fall = np.sum(normal * a, axis=1), ray @ normal.T
    depth = np.where(hit & (fall != 0.0), height / np.where(fall != 0.0, fall, 1.0), np.inf)
    first = depth.argmin(axis=1)
    near = depth[np.arange(len(ray)), first]
    return np.column_stack([near[:, None] * ray, some[first]])[np.isfinite(near)]


def test_a_bumpy_open_sheet_in_grazing_light(device: Device) -> None:
    # pixels here reach over several triangles that are turned apart by up to 60 degrees: what takes
    # the plane of one for the surface is right on the average, but not pixel by pixel
    surfaces, camera, lamps, pixel, own, shares, rank = seen(device, "eggs-low", 1000, 300)
    corners, is_open = triangles_of(surfaces)
    corners, lamp = corners - camera.eye, lamps[0]
    random = np.random.default_rng(6)
    beyond = ~within(own, corners, rank) & np.isin(
        np.argsort(rank)[own.on], np.flatnonzero(is_open)
    )
    facing = np.sum(own.normal * (lamp.centre - own.at), axis=1) > 0.0
    rows = np.flatnonzero(beyond & facing & (shares[:, 0] > 0.01) & (shares[:, 0] < 0.99))
    rows = random.permutation(rows)[:300]
    errors = []
    for row in rows:
        found = on_surface(camera, int(pixel[row]), corners, random)
        if np.ptp(np.linalg.norm(found[:, :3], axis=1)) > 0.01:
            continue
        reach = np.linalg.norm(found[:, :3] - own.at[row], axis=1).max(keepdims=True)
        near = may_meet(lamp, own.at[row : row + 1], reach + SLACK, corners)[0]
        on_lamp = random.uniform(-1.0, 1.0, (len(found), 2)) @ np.stack([lamp.u, lamp.v])
        hidden = np.zeros(len(found), bool)
        for triangle in np.unique(found[:, 3]).astype(int):
            some = found[:, 3] == triangle
            others = np.flatnonzero(near)
            others = others[others != triangle]
            stop = lamp.centre + on_lamp[some]
            hidden[some] = blocked(
                found[some, :3], stop, own.normal[row], corners[others], is_open[others], SLACK
            )
        errors.append(shares[row, 0] - 1.0 + hidden.mean())
    every = np.array(errors)
    assert len(every) > 200
    assert np.sqrt((every**2).mean()) <= 0.1
    assert abs(every.mean()) <= 0.04


def test_triangles_of_a_view_know_their_occluders() -> None:
    # bent quads, on either side of their diagonals, and a closed body
    surface, behind, _ = scene_of("eggs-low", 1000)
    surfaces = [surface, *behind, box((0.0, -0.3, 0.2), (0.05, 0.04, 0.03), 2)]
    camera = camera_of("eggs-low", 300)
    view, occluders = look(surfaces, camera, lit=True), Occluders.of(surfaces)
    on = PixelReceivers.of(view, np.zeros((1, 1), np.uint32), occluders).on
    is_open = np.array([not v.topology.closed for v in surfaces])[view.body]
    assert np.array_equal(on >= 0, is_open) and not is_open.all()
    middle = view.corners_of(np.flatnonzero(is_open), slice(0, 3)).mean(axis=1)
    points = np.concatenate([camera.to_camera(v.points) for v in surfaces])
    want = points[occluders.triangles[on[is_open]]].mean(axis=1)
    assert np.abs(middle - want).max() <= 1e-12
