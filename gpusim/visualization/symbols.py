"""Symbols in space, drawn over a picture through its camera: supports, loads, axes, cameras.

Everything is projected in float64 by the camera itself, distortion included, and drawn by an
`gpusim.visualization.overlay.Overlay`. What a body hides is left out or pale, if the frame is
given.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.ragged import expand
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.frame import Frame
from gpusim.optics.truth import seen_in
from gpusim.visualization.overlay import INK, PAPER, Overlay, Shade, display_color
from gpusim.visualization.placement import Placement

SUPPORT, LOAD, CAMERA = "#2b6cb0", "#d1242f", "#b7791f"
AXES = ("#d62728", "#2a9134", "#1f5fc4")
HALO = "#ffffffb0"
SHAFT = 2.5
"""px: width of an arrow."""
PIECE = 6.0
"""px: what may be hidden, or is bent by a lens, is drawn in pieces as long."""
MOST_PIECES = 256
BEFORE = 2e-3
"""Of the depth, by which lines on a surface lie before it."""
DENSE = 3.0
"""px: borders of elements that are as short as this aren't drawn."""
MOST_ARROWS, LONGEST = 40, 70.0
"""Of loads, and its length in px."""
STEPS = 8
"""Lines along each side of a camera's image."""
PALE = 0.22
"""Opacity of symbols that a body hides."""
RING = 9.0
"""px: radius of a ring round a value."""
OUTSIDE = 100.0
"""So bad is a pixel of a text that isn't seen, beside one that hides a body or another mark."""


def clusters(
    points: Float, vectors: Float, most: int, side: float = 0.0
) -> tuple[Float, Float, Long]:
    """Vectors (n, 3) at points (n, 3) added up over cubes, so that at most so many are left.

    The cubes' sides are no shorter than ``side``. The sum of all stays the same; each lies at the
    mean of its points, weighted by their lengths. The last of what is returned: of how many.

    Examples
    --------
    >>> from gpusim.visualization.symbols import clusters
    >>> points = np.stack([np.linspace(0, 1, 50), np.zeros(50), np.zeros(50)], axis=1)
    >>> at, total, count = clusters(points, np.full((50, 3), 2.0), most=10)
    >>> len(at) <= 10, total.sum(axis=0).tolist(), int(count.sum())
    (True, [100.0, 100.0, 100.0], 50)
    """
    size = np.linalg.norm(vectors, axis=1)
    own = size > 1e-9 * size.max(initial=0.0)
    points, vectors, size = points[own], vectors[own], size[own]
    if len(points) == 0:
        return points, vectors, np.zeros(0, np.int64)
    low, extent = points.min(axis=0), max(float(np.ptp(points, axis=0).max()), 1e-300)
    count = max(1, int(min(most, extent / side if side else most)))
    while True:
        cell = np.minimum(((points - low) / extent * count).astype(np.int64), count - 1)
        number = np.unique(cell @ [count**2, count, 1], return_inverse=True)[1].reshape(-1)
        if number.max() < most:
            break
        count = 4 * count // 5
    weight = np.bincount(number, size)
    at = [np.bincount(number, size * points[:, k]) / weight for k in range(3)]
    total = [np.bincount(number, vectors[:, k]) for k in range(3)]
    return np.stack(at, axis=1), np.stack(total, axis=1), np.bincount(number)


def frustum(camera: Camera, depth: float) -> Float:
    """(4 `STEPS` + 1, 3) m, world: the border of a camera's image at a depth, closed, from its top
    left corner clockwise; bent where the lens distorts."""
    share = np.linspace(0.0, 1.0, STEPS, endpoint=False)
    w, h = camera.width, camera.height
    x = np.concatenate([share * w, np.full(STEPS, w), (1 - share) * w, np.zeros(STEPS), [0.0]])
    y = np.concatenate([np.zeros(STEPS), share * h, np.full(STEPS, h), (1 - share) * h, [0.0]])
    ideal = camera.undistort(np.stack([x, y], axis=1) - 0.5)
    rays = np.column_stack([ideal, np.ones(len(ideal))]) @ camera.ray_matrix().T
    T = camera.camera_from_world
    world: Float = (depth * rays - T[:3, 3]) @ T[:3, :3]
    return world


def _common(box: Float, other: Float) -> float:
    """The area that two boxes (2, 2), low and high corners, have in common."""
    sides = np.minimum(box[1], other[1]) - np.maximum(box[0], other[0])
    return float(sides.clip(0.0).prod())


class Symbols:
    """Draws in space over the picture of a camera.

    Parameters
    ----------
    overlay : takes everything.
    camera : of the picture, in the world.
    place : where the picture lies in the window; None: pixel for pixel.
    frame : the picture, whose bodies hide what is behind them; None: nothing is hidden. Its image
        may be of another size than the camera's: only what it sees has to be the same.

    Examples
    --------
    >>> from gpusim.visualization.overlay import Overlay
    >>> from gpusim.visualization.symbols import Symbols
    >>> camera = gs.Camera.from_lens((36, 24), 50, (60, 40), (0, -2, 1), (0, 0, 0))
    >>> overlay = Overlay(gs.Device())
    >>> Symbols(overlay, camera).arrows([[0, 0, 0.3]], [[0, 0, -0.3]])
    >>> len(overlay.quads())
    4
    """

    def __init__(
        self, overlay: Overlay, camera: Camera, place: Placement | None = None,
        frame: Frame | None = None,
    ) -> None:  # fmt: skip
        self.overlay, self.camera, self.place = overlay, camera, place or Placement()
        self.frame = frame

    # -- in space --------------------------------------------------------------------------

    def window(self, points: npt.ArrayLike) -> Float:
        """World points (…, 3) as places in the window (…, 2) px; NaN where not in front."""
        return self.place.window(self.camera.project(points))

    def seen(self, points: Float, around: bool = False) -> Bool:
        """(n,): whether no body hides points (n, 3); what is out of the image isn't hidden.

        ``around``: one of the four pixels round a point is enough, not its own alone, which sees
        at a corner of a body another face than those that meet in the point.
        """
        if self.frame is None or not len(points):
            return np.ones(len(points), bool)
        view, ids = self.frame.view, self.frame.ids()
        at = view.camera.project(points - view.origin)
        with np.errstate(invalid="ignore"):
            size = [view.camera.width - 0.5, view.camera.height - 0.5]
            seen = ~np.all((at >= -0.5) & (at < size), axis=1)
            side = np.where(at > np.rint(at), 1, -1)
        for step in product((0, 1, -1), repeat=2) if around else [(0, 0)]:
            asked = ~seen & np.all((np.array(step) == 0) | (side == step), axis=1)
            shifted = np.roll(ids, (-step[1], -step[0]), axis=(0, 1))
            seen[asked] = seen_in(view, shifted, points[asked])
        return np.asarray(seen)

    def rings(self, marks: Sequence[tuple[str, Float]], size: int, free: Float) -> None:
        """A ring round each of some points (3,), and its text beside it in letters of ``size`` px.

        Texts hide as little as they can of bodies and other marks, in what is ``free`` of the
        window, its upper left and its lower right corner (2, 2), px. They say what is hidden.
        """
        marks = [mark for mark in marks if np.isfinite(self.window(mark[1])).all()]
        points = np.array([point for _, point in marks]).reshape(-1, 3)
        middles, turn = self.window(points), np.linspace(0.0, 2.0 * np.pi, 25)
        circle = RING * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        taken = [np.stack([middle - RING, middle + RING]) for middle in middles]
        seen = self.seen(points, around=True)
        for (text, _), middle, clear in zip(marks, middles, seen, strict=True):
            for color, width in (("white", 5.0), (INK, 2.0)):
                self.overlay.line(middle + circle, color, width)
            text += "" if clear else ", hidden"
            extent = np.rint([self.overlay.text_width(text, size) + 12.0, size + 10.0])
            corners = product((16.0, -16.0 - extent[0]), (-12.0 - extent[1], 12.0))
            boxes = [np.rint(middle + corner) + np.outer((0, 1), extent) for corner in corners]
            box = min(boxes, key=lambda box: self._hidden(box, taken, free))
            taken.append(box)
            (left, top), (wide, tall) = box[0], extent
            self.overlay.rectangle(left, top, wide, tall, PAPER)
            self.overlay.text(left + 6.0, top + 0.5 * tall, text, size, INK, "lm")

    def _hidden(self, box: Float, taken: Sequence[Float], free: Float) -> tuple[float, float]:
        """How much a text in a box (2, 2) of the window hides, px, and how near it is to the
        middle: of equal ones that farther out is better, where bodies end."""
        hidden = sum(_common(box, other) for other in taken)
        hidden += OUTSIDE * (_common(box, box) - _common(box, free))
        if self.frame is not None:
            ids = self.frame.ids()
            share = np.array(ids.shape[::-1]) / (self.camera.width, self.camera.height)
            low, high = np.rint(share * (self.place.pixels(box) + 0.5)).clip(0).astype(int)
            pixels = np.count_nonzero(ids[low[1] : high[1], low[0] : high[0]])
            hidden += pixels * self.place.scale**2 / float(share.prod())
        return hidden, -float(np.linalg.norm((box - free).mean(axis=0)))

    def size_at(self, points: Float, pixels: float) -> Float:
        """(n,) m: what is ``pixels`` px long in the window, across the view, at points (n, 3)."""
        depth = np.maximum(self.camera.to_camera(points)[:, 2], 0.0)
        return np.asarray(pixels / (self.camera.K[0, 0] * self.place.scale) * depth)

    def lines(
        self, ends: npt.ArrayLike, color: Shade, width: float = 1.2, pale: float = 0.0
    ) -> None:
        """Straight lines in space, ends (n, 2, 3); ``pale``: opacity of what is hidden."""
        pieces = self._pieces(np.asarray(ends, np.float64).reshape(-1, 2, 3))
        if not len(pieces):
            return
        shades = np.tile(display_color(color), (len(pieces), 1))
        if self.frame is not None:
            middle, eye = pieces.mean(axis=1), self.camera.eye
            shades[~self.seen(eye + (1.0 - BEFORE) * (middle - eye), around=True), 3] *= pale
        own = shades[:, 3] > 0.0
        self.overlay.segments(self.window(pieces[own]), shades[own], width)

    def elements(self, ends: Float, color: Shade = "#00000060") -> None:
        """Borders of elements (n, 2, 3): as `lines`, and the paler the closer they are together."""
        at = self.window(ends)
        length = np.hypot(*(at[:, 1] - at[:, 0]).T)
        length = length[np.isfinite(length)]
        share = (float(np.median(length)) - DENSE) / (2.0 * DENSE) if len(length) else 0.0
        red, green, blue, alpha = display_color(color)
        if share > 0.0:
            self.lines(ends, (red, green, blue, alpha * min(share, 1.0)), 0.8)

    def _pieces(self, ends: Float) -> Float:
        """(m, 2, 3): the lines in front of the camera, cut where they bend or may be hidden."""
        depth = self.camera.to_camera(ends)[..., 2]
        least = 1e-3 * max(float(depth.max(initial=0.0)), 1e-12)
        own = (depth > least).any(axis=1)
        ends, depth = ends[own].copy(), depth[own]
        for k in (0, 1):
            behind = depth[:, k] <= least
            other = depth[behind, 1 - k]
            share = ((other - least) / (other - depth[behind, k]))[:, None]
            away = ends[behind, 1 - k]
            ends[behind, k] = away + share * (ends[behind, k] - away)
        if self.frame is None and self.camera.lens is None:
            return ends
        ideal = self.camera.without_distortion().project(ends) * self.place.scale
        length = np.hypot(*(ideal[:, 1] - ideal[:, 0]).T)
        count = np.clip(np.nan_to_num(length) / PIECE, 1, MOST_PIECES).astype(np.int64)
        line, step = expand(count)
        share = np.stack([step, step + 1], axis=1) / count[line, None]
        along = ends[line, 1] - ends[line, 0]
        return np.asarray(ends[line, None, 0] + share[..., None] * along[:, None])

    def pyramids(self, tips: npt.ArrayLike, axes: npt.ArrayLike) -> None:
        """Small pyramids, tips (n, 3), whose bases lie along ``axes`` (n, 3); hidden ones pale."""
        tip, axis = (np.asarray(v, np.float64).reshape(-1, 3) for v in (tips, axes))
        depth = self.camera.to_camera(tip)[:, 2]
        order = np.argsort(-depth)[: int((depth > 0.0).sum())]
        tip, axis = tip[order], axis[order]
        axis = axis / np.linalg.norm(axis, axis=1)[:, None]
        size = self.size_at(tip, 13.0)[:, None]
        side = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
        u = np.cross(axis, side)
        u *= 0.42 * size / np.linalg.norm(u, axis=1)[:, None]
        v, base = np.cross(axis, u), tip + size * axis
        corner = [base + u + v, base - u + v, base - u - v, base + u - v]
        faces = [[tip, corner[k], corner[(k + 1) % 4], corner[(k + 1) % 4]] for k in range(4)]
        solid = np.stack([np.stack(face, axis=1) for face in [*faces, corner[::-1]]], axis=1)
        normal = np.cross(solid[:, :, 1] - solid[:, :, 0], solid[:, :, 2] - solid[:, :, 1])
        normal /= np.linalg.norm(normal, axis=2)[..., None]
        sight = solid[:, :, 0] - self.camera.eye
        facing = (normal * sight).sum(axis=2) / np.linalg.norm(sight, axis=2)
        shades = np.tile(display_color(SUPPORT), (*facing.shape, 1))
        shades[..., :3] *= (0.55 + 0.45 * np.abs(facing))[..., None]
        shades[~self.seen(tip), :, 3] *= PALE
        front = (facing < 0.0) & np.isfinite(self.window(solid)).all(axis=(2, 3))
        self.overlay.polygons(self.window(solid[front]), shades[front])

    def arrows(self, tails: npt.ArrayLike, vectors: npt.ArrayLike) -> None:
        """Arrows in space from ``tails`` (n, 3) along ``vectors`` (n, 3); with a pale border."""
        tail = np.asarray(tails, np.float64).reshape(-1, 3)
        tip = tail + np.asarray(vectors, np.float64).reshape(-1, 3)
        order = np.argsort(-self.camera.to_camera(tail)[:, 2])
        ends = np.stack([self.window(tail[order]), self.window(tip[order])], axis=1)
        self._flat_arrows(ends[np.isfinite(ends).all(axis=(1, 2))], LOAD)

    def _flat_arrows(self, ends: Float, color: Shade) -> None:
        along = ends[:, 1] - ends[:, 0]
        length = np.hypot(*along.T)[:, None]
        along = np.where(length > 0.5, along / np.maximum(length, 0.5), [0.0, 1.0])
        head = np.minimum(4.6 * SHAFT, 0.55 * length)
        side = np.stack([along[:, 1], -along[:, 0]], axis=1)
        neck = ends[:, 1] - head * along
        for more, shade in ((1.0, HALO), (0.0, color)):
            shaft = np.stack([ends[:, 0] - more * along, neck], axis=1)
            self.overlay.segments(shaft, shade, SHAFT + 2.0 * more)
            wide = (0.42 * head + more) * side
            tips = [ends[:, 1] + 1.6 * more * along, neck - more * along + wide]
            self.overlay.polygons(np.stack([*tips, neck - more * along - wide], axis=1), shade)

    # -- what a scene has ------------------------------------------------------------------

    def supports(self, points: Float, fixed: Bool, most: int = 60) -> None:
        """Pyramids at supported nodes, points (n, 3), ``fixed`` (n, 3) in some directions.

        One that is held in all has one pyramid, others one for every direction; their bases lie
        away from the middle of ``points``. Give all nodes of the surface. Of more than ``most``, or
        close ones, some are taken, evenly spread; of those that are hidden none, unless all are.
        """
        held = fixed.any(axis=1)
        if not held.any():
            return
        apart = float(np.median(self.size_at(points[held], 18.0)))
        clamped: Bool = np.asarray(fixed.all(axis=1))
        away = points - points.mean(axis=0)
        if clamped.any():
            main = int(np.argmax(np.abs(away[clamped].mean(axis=0))))
            fixed = np.where(clamped[:, None], np.arange(3) == main, fixed)
        for k in np.flatnonzero(fixed.any(axis=0)):
            own = fixed[:, k]
            seen = own.copy()
            seen[own] = self.seen(points[own])
            own = seen if seen.any() else own
            at, _, _ = clusters(points[own], np.ones((int(own.sum()), 3)), most, apart)
            nearest = [int(np.argmin(((points[own] - one) ** 2).sum(axis=1))) for one in at]
            sign = np.where(away[own, k] >= 0.0, 1.0, -1.0)[nearest]
            self.pyramids(points[own][nearest], sign[:, None] * np.eye(3)[k])

    def loads(self, points: Float, forces: Float) -> None:
        """Arrows for nodal forces (n, 3), N, at points (n, 3), which they end at.

        Forces close to each other are one arrow, at most `MOST_ARROWS`, as long as the mean of its
        nodes is large: the longest about `LONGEST` px, none below half of it. The sum of all is
        written above them.
        """
        loaded = points[forces.any(axis=1)]
        apart = float(np.median(self.size_at(loaded, 26.0))) if len(loaded) else 0.0
        at, total, count = clusters(points, forces, MOST_ARROWS, apart)
        if not len(at):
            return
        size = np.linalg.norm(total, axis=1)
        most_px = float(np.median(self.size_at(at, LONGEST)))
        mean = size / count
        length = most_px * np.maximum(mean / mean.max(), 0.5)
        vectors = length[:, None] * total / size[:, None]
        self.arrows(at - vectors, vectors)
        tails = self.window(at - vectors)
        tails = tails[np.isfinite(tails).all(axis=1)]
        sum_of = float(np.linalg.norm(forces.sum(axis=0)))
        if len(tails) and sum_of > 1e-6 * size.sum():
            x, y = tails[np.argmin(tails[:, 1])] - (0.0, 6.0)
            self.overlay.text(x, y, f"{sum_of:.4g} N", 13, LOAD, anchor="ms", halo="#ffffffc0")

    def tripod(self, x: float, y: float, size: float) -> None:
        """The world's axes round (x, y) px in the window."""
        middle = np.array([x, y])
        R = self.camera.camera_from_world[:3, :3]
        for k in np.argsort(-R[2], kind="stable"):
            along = size * R[:2, k]
            self._flat_arrows(np.stack([middle, middle + along])[None], AXES[k])
            name_x, name_y = middle + along * (1.0 + 11.0 / max(float(np.hypot(*along)), 11.0))
            self.overlay.text(name_x, name_y, "xyz"[k], 14, AXES[k], anchor="mm", halo=HALO)

    def cameras(self, cameras: Sequence[Camera], depth: float) -> None:
        """Other cameras as pyramids ``depth`` m deep, with their names; bent as their lenses do."""
        for camera in cameras:
            border, eye = frustum(camera, depth), camera.eye
            corner = border[:-1:STEPS]
            up = 0.5 * (corner[0] + corner[1]) + 0.35 * (corner[0] - corner[3])
            rays = np.stack([np.broadcast_to(eye, corner.shape), corner], axis=1)
            roof = np.array([[corner[0], up], [up, corner[1]]])
            edges = np.stack([border[:-1], border[1:]], axis=1)
            self.lines(np.concatenate([rays, roof, edges]), CAMERA, 1.5, pale=PALE)
            x, y = self.window(eye)
            if np.isfinite([x, y]).all():
                self.overlay.text(x, y + 16, camera.name, 13, CAMERA, "ma", halo="#ffffffc0")
