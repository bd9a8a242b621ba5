"""Bundle adjustment of a rig: cameras, their places in the rig, and where the target stood.

All parameters at once by Levenberg-Marquardt in float64 (Triggs et al., "Bundle adjustment: a
modern synthesis", 2000), with the lens model and derivatives of OpenCV. ``cv2.calibrateCamera``
takes points in float32 and ``cv2.stereoCalibrate`` keeps one pose per view for two cameras only;
here any number of cameras share the views, and the covariance of every parameter comes with it.

A covariance from the residuals takes every point's error for its own. Where neighbours err alike (a
lens model that lacks a term, corners that share a bias, a board that isn't flat) parameters are
less certain than that says, as the pull of whole views on them shows: the clustered variance of
Liang and Zeger, "Longitudinal data analysis using generalized linear models", Biometrika 73 (1986),
here one factor for all parameters, since some ten views don't tell one for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.errors import GpusimError

LENSES: dict[str, tuple[int, ...]] = {
    "pinhole": (),
    "radial": (0, 1),
    "radial3": (0, 1, 4),
    "radtan": (0, 1, 2, 3),
    "brown": (0, 1, 2, 3, 4),
    "rational": (0, 1, 2, 3, 4, 5, 6, 7),
    "prism": tuple(range(12)),
    "tilted": tuple(range(14)),
}
"""Which of OpenCV's coefficients k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y are free."""
DISTORTION = 14
MAX_STEPS = 60
SETTLED = 1e-10  # relative decrease of the squares
FIRST_DAMPING = 1e-4
MIN_SHARE = 0.1  # of the largest part in a change that leaves residuals as they are


@dataclass(frozen=True, eq=False)
class Rows:
    """Points of one view in one camera: ``board`` (N, 3), ``image`` (N, 2) px."""

    camera: int
    view: int
    board: Float
    image: Float


@dataclass(frozen=True, eq=False)
class Rig:
    """The parameters: C cameras and V views.

    ``focal``, ``centre`` (C, 2) px; ``distortion`` (C, 14); ``camera_pose`` (C, 6), rotation
    vector and translation that take camera 0's coordinates to each camera's (the first is zero);
    ``view_pose`` (V, 6) take board coordinates to camera 0's.
    """

    focal: Float
    centre: Float
    distortion: Float
    camera_pose: Float
    view_pose: Float

    def matrix(self, camera: int) -> Float:
        """K (3, 3) of a camera."""
        (fx, fy), (cx, cy) = self.focal[camera], self.centre[camera]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def pose(self, camera: int, view: int) -> Float:
        """(6,) from board coordinates to those of a camera."""
        return compose(self.view_pose[view], self.camera_pose[camera])


@dataclass(frozen=True, eq=False)
class Adjusted:
    """The result: ``rig``, ``residuals`` per entry of the rows (N, 2) px, ``covariance`` (Q, Q)
    of the free parameters named ``names``, and how many steps it took. The covariance is wider than
    that of independent errors where whole views differ by more (`_view_scatter`)."""

    rig: Rig
    residuals: tuple[Float, ...]
    covariance: Float
    names: tuple[tuple[str, int, str], ...]
    steps: int


def compose(first: Float, second: Float) -> Float:
    """The pose (6,) that does ``first``, then ``second``."""
    result = cv2.composeRT(first[:3], first[3:], second[:3], second[3:])
    return np.concatenate([np.ravel(result[0]), np.ravel(result[1])])


def inverse(pose: Float) -> Float:
    """The pose (6,) that undoes ``pose``."""
    turn = rotation(pose)
    return np.concatenate([-pose[:3], -turn.T @ pose[3:]])


def rotation(pose: Float) -> Float:
    """Rotation matrix (3, 3) of a pose."""
    return np.asarray(cv2.Rodrigues(pose[:3])[0], dtype=np.float64)


class _Layout:
    """Where each free parameter stands in the vector."""

    def __init__(self, rig: Rig, lens: str, square_pixels: bool) -> None:
        self.rig, self.square = rig, square_pixels
        self.free = LENSES[lens]
        names: list[tuple[str, int, str]] = []
        coefficients = "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y".split()
        for c in range(len(rig.focal)):
            focal = ("f",) if square_pixels else ("fx", "fy")
            inner = (*focal, "cx", "cy", *(coefficients[k] for k in self.free))
            names += [("camera", c, name) for name in inner]
        for c in range(1, len(rig.focal)):
            names += [("rig", c, name) for name in ("rx", "ry", "rz", "tx", "ty", "tz")]
        for v in range(len(rig.view_pose)):
            names += [("view", v, name) for name in ("rx", "ry", "rz", "tx", "ty", "tz")]
        self.names = tuple(names)
        self.inner = (1 if square_pixels else 2) + 2 + len(self.free)
        self.first_rig = self.inner * len(rig.focal)
        self.first_view = self.first_rig + 6 * (len(rig.focal) - 1)

    def unpack(self, p: Float) -> Rig:
        cameras = len(self.rig.focal)
        own = p[: self.first_rig].reshape(cameras, self.inner)
        lens = self.inner - len(self.free)
        distortion = self.rig.distortion.copy()
        distortion[:, self.free] = own[:, lens:]
        poses = np.zeros((cameras, 6))
        poses[1:] = p[self.first_rig : self.first_view].reshape(-1, 6)
        return Rig(
            own[:, [0, 0]] if self.square else own[:, :2].copy(),
            own[:, lens - 2 : lens].copy(),
            distortion,
            poses,
            p[self.first_view :].reshape(-1, 6).copy(),
        )

    def pack(self, rig: Rig) -> Float:
        focal = rig.focal.mean(axis=1, keepdims=True) if self.square else rig.focal
        own = np.concatenate([focal, rig.centre, rig.distortion[:, self.free]], axis=1)
        return np.concatenate([own.ravel(), rig.camera_pose[1:].ravel(), rig.view_pose.ravel()])

    def places(self, camera: int, view: int) -> Long:
        """Positions in the vector of what a sighting depends on."""
        parts = [np.arange(camera * self.inner, (camera + 1) * self.inner)]
        if camera:
            parts.append(self.first_rig + 6 * (camera - 1) + np.arange(6))
        parts.append(self.first_view + 6 * view + np.arange(6))
        return np.concatenate(parts)


def adjust(
    start: Rig, rows: Sequence[Rows], lens: str = "brown", square_pixels: bool = False
) -> Adjusted:
    """Minimise the reprojection errors of all rows from a first estimate.

    Raises
    ------
    GpusimError
        The points don't determine the parameters, or the iteration doesn't settle.
    """
    layout = _Layout(start, lens, square_pixels)
    p = layout.pack(start)
    normal, gradient, square = _normal(layout, p, rows)
    damping = FIRST_DAMPING
    steps = 0
    for _ in range(MAX_STEPS):
        steps += 1
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        scaled = normal / np.outer(scale, scale)
        scaled[np.diag_indices_from(scaled)] += damping
        try:
            trial = p - np.linalg.solve(scaled, gradient / scale) / scale
        except np.linalg.LinAlgError:
            raise GpusimError("calibration: singular; expected views that differ more") from None
        new_normal, new_gradient, new_square = _normal(layout, trial, rows)
        if new_square <= square:
            gain = square - new_square
            p, normal, gradient, square = trial, new_normal, new_gradient, new_square
            damping = max(damping / 10.0, 1e-15)
            if gain <= SETTLED * square + 1e-26:
                break
        else:
            damping *= 10.0
            if damping > 1e8:  # no direction goes down any more: rounding decides
                break
    else:
        points = sum(len(r.image) for r in rows)
        raise GpusimError(
            f"calibration: not settled after {MAX_STEPS} steps, at {np.sqrt(square / points):.3g} "
            f"px RMS: the views don't determine {_weakest(layout.names, normal)}; expected views "
            "that do: tilt the target more, fill the image's corners, or take a lens with fewer "
            "coefficients"
        )
    rig = layout.unpack(p)
    count = 2 * sum(len(r.image) for r in rows)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverted = np.linalg.pinv(normal / np.outer(scale, scale), hermitian=True)
    variance = square / max(count - len(p), 1)
    covariance = inverted / np.outer(scale, scale) * variance
    covariance *= max(_view_scatter(layout, p, rows, variance), 1.0)
    residuals = tuple(_project(layout, rig, r)[0] - r.image for r in rows)
    return Adjusted(rig, residuals, covariance, layout.names, steps)


def _weakest(names: Sequence[tuple[str, int, str]], normal: Float) -> str:
    """The camera parameters that change the residuals least when they change together."""
    own = [i for i, (kind, _, _) in enumerate(names) if kind != "view"]
    inner, outer = np.ix_(own, own), [i for i in range(len(names)) if i not in set(own)]
    taken = normal[np.ix_(own, outer)]
    views = np.linalg.pinv(normal[np.ix_(outer, outer)], hermitian=True)
    reduced = normal[inner] - taken @ views @ taken.T
    scale = np.sqrt(np.maximum(np.diag(reduced), 1e-300))
    _, vectors = np.linalg.eigh(reduced / np.outer(scale, scale))
    share = np.abs(vectors[:, 0])
    chosen = [names[own[i]] for i in np.flatnonzero(share >= MIN_SHARE * share.max())]
    cameras = sorted({number for _, number, _ in chosen})
    parts = [f"{' '.join(name for _, number, name in chosen if number == c)} of camera {c + 1}"
             for c in cameras]  # fmt: skip
    return ", ".join(parts)


def _view_scatter(layout: _Layout, p: Float, rows: Sequence[Rows], variance: float) -> float:
    """Mean squared pull of the views on the parameters they share, at the minimum ``p``, over that
    of independent errors whose residuals have the ``variance`` (px^2)."""
    shared, rest = [], slice(None, layout.first_view)
    for view in sorted({r.view for r in rows}):
        normal, gradient, _ = _normal(layout, p, [r for r in rows if r.view == view])
        mine = slice(layout.first_view + 6 * view, layout.first_view + 6 * view + 6)
        right = np.column_stack([normal[mine, rest], gradient[mine]])
        taken = normal[rest, mine] @ np.linalg.pinv(normal[mine, mine], hermitian=True) @ right
        shared.append((normal[rest, rest] - taken[:, :-1], gradient[rest] - taken[:, -1]))
    total = np.sum([normal for normal, _ in shared], axis=0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    both = np.outer(scale, scale)
    inverse = np.linalg.pinv(total * both, hermitian=True) * both
    pull = sum(float(gradient @ inverse @ gradient) for _, gradient in shared)
    # the pulls add up to nothing, so that a view which tells most of a parameter pulls little
    parts = [inverse @ normal for normal, _ in shared]
    expected = variance * sum(float(np.trace(part - part @ part)) for part in parts)
    return pull / expected if expected > 0 else 1.0


def _normal(layout: _Layout, p: Float, rows: Sequence[Rows]) -> tuple[Float, Float, float]:
    """Normal matrix, gradient and sum of squares at ``p``."""
    rig = layout.unpack(p)
    normal, gradient, square = np.zeros((len(p), len(p))), np.zeros(len(p)), 0.0
    if not (np.isfinite(p).all() and (rig.focal > 0).all()):
        return normal, gradient, float("inf")
    for r in rows:
        image, slopes = _project(layout, rig, r)
        residual = (image - r.image).ravel()
        at = layout.places(r.camera, r.view)
        normal[np.ix_(at, at)] += slopes.T @ slopes
        gradient[at] += slopes.T @ residual
        square += float(residual @ residual)
    return normal, gradient, square if np.isfinite(square) else float("inf")


def _project(layout: _Layout, rig: Rig, r: Rows) -> tuple[Float, Float]:
    """Image points (N, 2) and their derivatives (2N, …) by the parameters at `places`."""
    if not len(r.board):
        return np.zeros((0, 2)), np.zeros((0, len(layout.places(r.camera, r.view))))
    view, own = rig.view_pose[r.view], rig.camera_pose[r.camera]
    pose = view
    if r.camera:
        parts = cv2.composeRT(view[:3], view[3:], own[:3], own[3:])
        pose = np.concatenate([np.ravel(parts[0]), np.ravel(parts[1])])
        turn_view, move_view, turn_own, move_own = (np.asarray(part) for part in parts[2:6])
        t_view, t_move, t_own, t_shift = (np.asarray(part) for part in parts[6:10])
        by_view = np.block([[turn_view, move_view], [t_view, t_move]])
        by_own = np.block([[turn_own, move_own], [t_own, t_shift]])
    image, full = cv2.projectPoints(
        r.board, pose[:3], pose[3:], rig.matrix(r.camera), rig.distortion[r.camera]
    )
    by_pose, by_focal = full[:, :6], full[:, 6:8]
    if layout.square:
        by_focal = by_focal.sum(axis=1, keepdims=True)
    lens = full[:, 10:][:, list(layout.free)]
    parts_of = [by_focal, full[:, 8:10], lens]
    parts_of += [by_pose @ by_own, by_pose @ by_view] if r.camera else [by_pose]
    jacobian = np.concatenate(parts_of, axis=1, dtype=np.float64)
    return np.array(image, dtype=np.float64).reshape(-1, 2), jacobian


def residuals(rig: Rig, rows: Sequence[Rows]) -> list[Float]:
    """Projected minus seen positions (N, 2) px of every entry."""
    layout = _Layout(rig, "pinhole", square_pixels=False)
    return [_project(layout, rig, r)[0] - r.image for r in rows]


def without(rows: Sequence[Rows], kept: Sequence[Bool]) -> list[Rows]:
    """The rows with only the points that are kept; empty ones stay, so that indices do too."""
    return [
        replace(r, board=r.board[keep], image=r.image[keep])
        for r, keep in zip(rows, kept, strict=True)
    ]
