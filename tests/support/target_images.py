"""Boards for calibration: rendered, photograph-like, or as points alone; and a stereo rig."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

import gpusim as gs
from gpusim.measure import Chessboard, Sighting
from gpusim.surface.paint import Checker

FloatArray = npt.NDArray[np.float64]
FACING = np.column_stack([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # a board seen along +y


def board_poses(count: int, middle: FloatArray, seed: int, spread: float = 100.0) -> FloatArray:
    """(count, 4, 4) world from board; tilted up to 35 degrees about ``middle`` (3,)."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    for pose in poses:
        angles = [rng.uniform(-35, 35), rng.uniform(-35, 35), rng.uniform(-25, 25)]
        pose[:3, :3] = FACING @ Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        pose[:3, 3] = middle + rng.uniform(-spread, spread, 3)
    return poses


def board_surface(board: Chessboard, pose: FloatArray) -> gs.Surface:
    """A plate with the board on it and a margin of two fields; board middle at the pose."""
    a = board.square
    half = np.array([a * (board.columns - 2), a * (board.rows - 2)]) / 2
    low, high = -3 * a, 2 * half + 3 * a
    corners = np.array([[low, high[1], 0], [high[0], high[1], 0], [high[0], low, 0], [low, low, 0]])
    middle = np.array([*half, 0.0])
    points = (corners - middle) @ pose[:3, :3].T + pose[:3, 3]
    frame = gs.PaintFrame(points[0], pose[:3, 0], -pose[:3, 1])
    odd = board.rows % 2 == 0  # the lower left field is dark where the upper left one isn't
    dark, light = (0.9, 0.05) if odd else (0.05, 0.9)
    paint = Checker(a, board.columns, board.rows, (2 * a, 2 * a), dark, light, 0.8)
    return gs.Surface(points, np.array([[0, 1, 2, 3]], np.int32), {"board": paint},
                      frames={"board": frame})  # fmt: skip


def places_in_world(board: Chessboard, places: FloatArray, pose: FloatArray) -> FloatArray:
    """Board coordinates (N, 3) in the world, for a board whose middle is at the pose."""
    middle = board.square / 2 * np.array([board.columns - 2, board.rows - 2, 0.0])
    result: FloatArray = (places - middle) @ pose[:3, :3].T + pose[:3, 3]
    return result


@dataclass(frozen=True)
class Photograph:
    """A camera with a distorting lens, blur, noise and uneven light."""

    size: tuple[int, int]
    K: FloatArray
    distortion: FloatArray
    blur: float = 0.8
    noise: float = 2.0
    samples: int = 3

    def rays(self) -> FloatArray:
        """(H n, W n, 2) directions x/z, y/z of the samples; the lens undone."""
        width, height = self.size
        x, y = (
            (np.arange(size * self.samples) + 0.5) / self.samples - 0.5 for size in (width, height)
        )
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 1, 2)
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 1e-10)
        undone = cv2.undistortPoints(grid, self.K, self.distortion, criteria=stop)
        return np.asarray(undone).reshape(height * self.samples, width * self.samples, 2)

    def take(
        self, board: Chessboard, camera_from_board: FloatArray, rays: FloatArray, seed: int
    ) -> npt.NDArray[np.uint8]:
        """The board's picture; fields beyond its border are pale, and so is the rest."""
        R, t = camera_from_board[:3, :3], camera_from_board[:3, 3]
        directions = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=2)
        depth = (R[:, 2] @ t) / (directions @ R[:, 2])
        on_board = (directions * depth[..., None] - t) @ R[:, :2] / board.square
        i, j = np.floor(on_board[..., 0]), np.floor(on_board[..., 1])
        inside = (i >= -1) & (i < board.columns - 1) & (j >= -1) & (j < board.rows - 1)
        white = ~inside | ((i + j) % 2 != 0)
        n = self.samples
        picture = gaussian_filter(np.where(white, 200.0, 30.0), n * self.blur)
        picture = picture.reshape(self.size[1], n, self.size[0], n).mean(axis=(1, 3))
        picture *= 0.6 + 0.4 * np.linspace(0, 1, self.size[0])  # brighter on the right
        picture += np.random.default_rng(seed).normal(0, self.noise, picture.shape)
        return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class PointRig:
    """Cameras that see points, without images: K, distortion (14,), camera_from_rig (4, 4)."""

    size: tuple[int, int]
    K: tuple[FloatArray, ...]
    distortion: tuple[FloatArray, ...]
    pose: tuple[FloatArray, ...]

    def project(self, camera: int, points: FloatArray) -> FloatArray:
        """Points (N, 3) of the rig in px."""
        T = self.pose[camera]
        image, _ = cv2.projectPoints(
            points, cv2.Rodrigues(T[:3, :3])[0], T[:3, 3], self.K[camera], self.distortion[camera]
        )
        return np.asarray(image, dtype=np.float64).reshape(-1, 2)

    def sightings(
        self, board: Chessboard, poses: FloatArray, noise: float, seed: int
    ) -> dict[str, list[Sighting]]:
        """What every camera sees of the board in each pose (rig from board middle)."""
        rng = np.random.default_rng(seed)
        seen: dict[str, list[Sighting]] = {f"camera-{c}": [] for c in range(len(self.K))}
        places = board.points()
        some = np.full(len(places), noise)
        for pose in poses:
            world = places_in_world(board, places, pose)
            for c, views in enumerate(seen.values()):
                image = self.project(c, world) + rng.normal(0, 1, (len(places), 2)) * noise
                views.append(Sighting(places, image, some, some, some, self.size, 0))
        return seen


def stereo_rig() -> PointRig:
    """Two different cameras, converging, with mild lenses; it looks along +y."""
    turn = FACING.T
    first = np.eye(4)
    first[:3, :3] = turn
    first[:3, 3] = -turn @ np.array([-200.0, -1000.0, 10.0])
    second = np.eye(4)
    second[:3, :3] = Rotation.from_euler("y", -22, degrees=True).as_matrix() @ turn
    second[:3, 3] = -second[:3, :3] @ np.array([230.0, -950.0, -15.0])
    K = [np.array([[1500.0, 0, 642.3], [0, 1498.0, 470.9], [0, 0, 1]]) for _ in range(2)]
    K[1][0, 0], K[1][0, 2] = 1611.0, 630.4
    lenses = np.zeros((2, 14))
    lenses[0, :5], lenses[1, :5] = [-0.12, 0.08, 4e-4, -3e-4, 0.0], [0.05, -0.1, -2e-4, 1e-4, 0.0]
    # coordinates of the rig are those of the first camera
    return PointRig(
        (1280, 960), tuple(K), tuple(lenses), (np.eye(4), second @ np.linalg.inv(first))
    )


def seen_poses(count: int, seed: int) -> FloatArray:
    """Board poses in the coordinates of `stereo_rig`'s first camera, about 1 m away."""
    poses = board_poses(count, np.array([200.0, 1000.0, -10.0]), seed)
    world = np.eye(4)
    world[:3, :3] = FACING.T
    result: FloatArray = world @ poses
    return result
