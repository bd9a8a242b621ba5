"""Correlation sees exactly the distortion that the lens model says."""

from __future__ import annotations

import cv2
import numpy as np

import gpusim as gs
from gpusim.gpu import Device

COEFFICIENTS = [-0.11, 0.06, 0.0011, -0.0007, 0.02]


def test_correlation_measures_the_distortion(device: Device) -> None:
    """From the bent image to the straight one, points move by undistortPoints(p) - p."""
    width, height = 341, 263
    K = np.array([[520.3, 0, 163.7], [0, 519.1, 138.2], [0, 0, 1]])
    T = np.eye(4)
    T[2, 3] = 1.0
    points = np.array([[-0.5, -0.42, 0], [0.5, -0.42, 0], [0.5, 0.42, 0], [-0.5, 0.42, 0]])
    paint = gs.paint.Speckle(diameter=0.009, coverage=0.5, seed=3)
    surface = gs.Surface(points, np.array([[0, 3, 2, 1]]), paint=paint)
    images = []
    for distortion in (COEFFICIENTS, None):
        camera = gs.Camera(width, height, K, distortion, T)
        lens = gs.Lens(psf=gs.psf.Gaussian(0.7))
        frame = gs.photograph([surface], camera, lens=lens, device=device)
        images.append(np.asarray(frame.radiance, np.float64))
    result = gs.measure.dic(images[0], images[1], subset=31, step=12, shape="quadratic")
    good = result.status == 0
    want = cv2.undistortPoints(
        result.points.reshape(-1, 1, 2), K, np.array(COEFFICIENTS), P=K,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12),
    ).reshape(-1, 2) - result.points  # fmt: skip
    error = (result.displacement - want)[good]
    rms, mean = np.sqrt(np.mean(error**2)), np.abs(error.mean(axis=0)).max()
    print(f"{good.sum()} of {len(good)} points, up to {np.abs(want[good]).max():.1f} px: rms "
          f"{rms:.4f} px, mean {mean:.5f} px")  # fmt: skip
    assert good.mean() > 0.9 and np.abs(want[good]).max() > 2.0
    assert rms < 0.01 and mean < 0.001
