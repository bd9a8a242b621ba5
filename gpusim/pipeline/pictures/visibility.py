"""What cameras see and what hides it, cameras and lamps inside of bodies: before any picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import look
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.surface import Surface

LEAST_SEEN = 3.0  # px
_CHUNK = 1 << 18
OWN_SHARE = 0.05  # of a marker's size: how near to it a surface is its own


def blind_cameras(surfaces: Sequence[Surface], cameras: Sequence[Camera]) -> dict[str, str]:
    """Camera -> a sentence, for those that see no surface, or all of them within a few pixels."""
    found = {}
    for camera in cameras:
        inside = enclosing(surfaces, camera.eye)
        name = f"camera {camera.name!r}"
        if inside:
            found[camera.name] = f"{name} is inside {inside}: move it out"
            continue
        view = look(surfaces, camera, lit=False)
        if view.count:
            size = np.array([camera.width, camera.height])
            screen = np.clip(view.screen.reshape(-1, 2), -0.5, size - 0.5)
            wide, high = np.ptp(screen, axis=0)
            if not max(wide, high) > LEAST_SEEN:
                found[camera.name] = (
                    f"{name} sees all surfaces within {wide:.2g} x {high:.2g} px, from "
                    f"{_distance(surfaces, camera):.4g} m away: move it nearer, or take a longer "
                    "lens"
                )
        elif surfaces:
            found[camera.name] = f"{name} sees no surface: {_why(surfaces, camera)}"
    return found


def _why(surfaces: Sequence[Surface], camera: Camera) -> str:
    points = np.concatenate([surface.points for surface in surfaces])
    ahead = points[camera.to_camera(points)[:, 2] > 0.0]
    if not len(ahead):
        return "everything is behind it; it looks the other way"
    u, v = np.nan_to_num(camera.without_distortion().project(ahead), posinf=0.0, neginf=0.0).T
    sides = [
        word
        for word, out in (
            ("left of", (u < -0.5).all()), ("right of", (u > camera.width - 0.5).all()),
            ("above", (v < -0.5).all()), ("below", (v > camera.height - 0.5).all()),
        ) if out
    ]  # fmt: skip
    if sides:
        return f"all that is before it lies {sides[0]} its image"
    return "nothing before it is in its image with a side that can be seen"


def _distance(surfaces: Sequence[Surface], camera: Camera) -> float:
    return min(
        float(np.linalg.norm(surface.points - camera.eye, axis=1).min()) for surface in surfaces
    )


def lamps_inside(scene: Scene, surfaces: Sequence[Surface]) -> list[str]:
    """A sentence for each lamp with a place that a closed body encloses."""
    found = []
    for light in scene.lights:
        if isinstance(light, m.PointTable | m.SpotTable | m.AreaTable):
            inside = enclosing(surfaces, np.array(light.position))
            if inside:
                found.append(
                    f"light {light.name!r} is inside {inside}: nothing outside is lit by it"
                )
    return found


def enclosing(surfaces: Sequence[Surface], point: Float) -> str:
    """Name of a closed surface that ``point`` (3,) is inside of, as told to people, or "".

    A room, whose walls face inwards, encloses nothing.
    """
    for surface in surfaces:
        low, high = surface.points.min(axis=0), surface.points.max(axis=0)
        if not ((low <= point) & (point <= high)).all() or not surface.topology.closed:
            continue
        if winding_numbers(surface, point[None])[0] > 0.5:
            return repr(surface.name)
    return ""


def winding_numbers(surface: Surface, points: Float) -> Float:
    """How often (n,) a surface goes round points (n, 3): 1 inside of a closed one, 0 outside.

    The solid angle of its triangles over 4 pi: van Oosterom & Strackee, IEEE TBME 30 (1983) 125.
    """
    result = np.zeros(len(points))
    triangles = surface.topology.triangles
    for k, point in enumerate(points):
        arms = surface.points - point
        length = np.linalg.norm(arms, axis=1)
        for first in range(0, len(triangles), _CHUNK):
            i, j, l = triangles[first : first + _CHUNK].T  # noqa: E741 - three corners
            a, b, c = arms[i], arms[j], arms[l]
            la, lb, lc = length[i], length[j], length[l]
            triple = np.einsum("ti,ti->t", a, np.cross(b, c))
            below = (
                la * lb * lc
                + np.einsum("ti,ti->t", a, b) * lc
                + np.einsum("ti,ti->t", b, c) * la
                + np.einsum("ti,ti->t", c, a) * lb
            )
            result[k] += 2.0 * float(np.arctan2(triple, below).sum())
    return result / (4.0 * np.pi)


def in_image(camera: Camera, points: Float) -> Bool:
    """Whether points (…, 3) fall on the camera's image, hidden or not."""
    u, v = np.moveaxis(camera.project(points), -1, 0)
    ahead = camera.to_camera(points)[..., 2] > 0.0
    inside = (-0.5 <= u) & (u <= camera.width - 0.5) & (-0.5 <= v) & (v <= camera.height - 0.5)
    return np.asarray(ahead & inside)


def spread_points(corners: Float, least: int) -> Float:
    """Points (T, n, 3) spread evenly over triangles (T, 3, 3), at least so many in all."""
    each = -(-least // max(1, len(corners)))
    # the plastic number's sequence, folded
    s, t = (np.arange(1, each + 1)[:, None] * [0.7548776662, 0.5698402910] % 1.0).T
    s, t = np.where(s + t > 1.0, 1.0 - s, s), np.where(s + t > 1.0, 1.0 - t, t)
    weights = np.stack([1.0 - s - t, s, t], axis=1)
    return np.asarray(np.einsum("kc,tca->tka", weights, corners))


def unseen(camera: Camera, position: Float, size: Float, surfaces: Sequence[Surface]) -> list[str]:
    """Why ``camera`` doesn't see points (M, 3) of things of ``size`` (M,): "" where it does."""
    depth = camera.to_camera(position)[:, 2]
    pixels = camera.project(position)
    reasons = []
    # what hides another body is of more interest than its own side
    tables = [_Triangles(surface, camera) for surface in reversed(surfaces)]
    for point, wide, z, (u, v) in zip(position, size, depth, pixels, strict=False):
        if not z > 0.0:
            reasons.append("behind the camera")
        elif not (-0.5 <= u <= camera.width - 0.5 and -0.5 <= v <= camera.height - 0.5):
            reasons.append("beside its image")
        else:
            hits = (table.name for table in tables if table.hides(point, OWN_SHARE * wide))
            by = next(hits, "")
            reasons.append(f"hidden by {by!r}" if by else "")
    return reasons


class _Triangles:
    """The triangles of a surface, and where in the image each one lies."""

    def __init__(self, surface: Surface, camera: Camera) -> None:
        self.name = surface.name
        self.points, self.triangles = surface.points - camera.eye, surface.topology.triangles
        self.turn = camera.camera_from_world[:3, :3]
        place = self.points @ self.turn.T
        flat = place[:, :2] / np.where(place[:, 2:] > 0.0, place[:, 2:], np.inf)
        corners = flat[self.triangles]
        self.low, self.high = corners.min(axis=1), corners.max(axis=1)
        # what reaches behind the camera may be anywhere
        open_ = ~(place[:, 2] > 0.0)[self.triangles].all(axis=1)
        self.low[open_], self.high[open_] = -np.inf, np.inf
        self.eye = camera.eye

    def hides(self, point: Float, own: float) -> bool:
        """Whether one is between the camera and ``point`` (3,), and farther than ``own`` off it."""
        ray = point - self.eye
        place = self.turn @ ray
        flat = place[:2] / place[2]
        near = ((self.low <= flat) & (flat <= self.high)).all(axis=1)
        if not near.any():
            return False
        a, b, c = (self.points[self.triangles[near, k]] for k in range(3))
        first, second = b - a, c - a
        across = np.cross(ray, second)
        det = np.einsum("ti,ti->t", first, across)
        met = det != 0.0
        a, first, second, across, det = a[met], first[met], second[met], across[met], det[met]
        s = np.einsum("ti,ti->t", -a, across) / det
        side = np.cross(-a, first)
        t = (side @ ray) / det
        way = np.einsum("ti,ti->t", second, side) / det
        last = 1.0 - own / float(np.linalg.norm(ray))
        hit = (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0) & (way > 0.0) & (way < last)
        return bool(hit.any())
