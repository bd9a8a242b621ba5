"""Cameras of real rigs in general position, and points of a scene in front of each."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

import gpusim as gs

Array = npt.NDArray[np.float64]

RATIONAL = [0.31, -0.12, 0.0004, 0.0006, 0.02, 0.42, -0.05, 0.01]
PRISM = [-0.11, 0.05, 0.0004, 0.0006, -0.02, 0.04, -0.05, 0.01, 0.0011, -0.002, 0.0007, 0.0005]
# name: width, height, fx, fy, skew, cx, cy, coefficients, distance
_RIGS: dict[str, tuple[int, int, float, float, float, float, float, list[float] | None, float]] = {
    "off centre": (2464, 2056, 3471.0, 3466.0, 0.0, 1731.4, 604.7, [-0.11, 0.19, 0.001, -8e-4], 1),
    "skewed": (1441, 1083, 2011.0, 2018.0, 11.3, 702.2, 561.8, [0.08, -0.2, -6e-4, 3e-4, 0.1], 0.7),
    "rational": (2048, 1536, 1650.0, 1652.0, 0.0, 1011.3, 778.1, RATIONAL, 0.5),
    "tilted": (1920, 1200, 2750.0, 2749.0, 0.0, 950.7, 612.2, [*PRISM, 0.06, -0.04], 0.6),
    "10 m lens": (5120, 3413, 2.1e5, 2.1e5, 0.0, 2510.1, 1711.9, [0.2, 0, 1e-4, 0, -125.0], 10.0),
    "5616 px": (5616, 3744, 4680.0, 4682.5, 0.0, 2731.4, 1904.7, [-0.12, 0.06, 6e-4, -4e-4, -0.01],
                1.0),
}  # fmt: skip
RIGS = list(_RIGS)


def rig(name: str, points: int) -> tuple[gs.Camera, Array]:
    """A camera that looks at the origin, and points (n, 3) about it that fill its image."""
    width, height, fx, fy, skew, cx, cy, coefficients, distance = _RIGS[name]
    rng = np.random.default_rng(RIGS.index(name))
    rotation = Rotation.from_euler("xyz", rng.uniform(-0.4, 0.4, 3)).as_matrix()
    T = np.eye(4)
    T[:3, :3] = rotation
    T[:3, 3] = [0.0, 0.0, distance]
    K = np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    pixels = rng.uniform([0.0, 0.0], [width, height], (points, 2))
    depth = distance * rng.uniform(0.9, 1.1, points)
    rays = np.c_[pixels, np.ones(points)] @ np.linalg.inv(K).T
    X: Array = (depth[:, None] * rays - T[:3, 3]) @ rotation
    return gs.Camera(width, height, K, coefficients, T, name), X
