"""The whole chain: speckle, lens, sensor, then image correlation finds the shift put in."""

from __future__ import annotations

import gc
import weakref

import numpy as np

import gpusim as gs
from gpusim.gpu import Device

WIDTH, HEIGHT = 236, 205


def test_rigid_shifts_of_a_speckle_behind_a_lens(device: Device) -> None:
    """Shifts of 0 to 1 px in steps of 0.05, point spread of 0.7 px, 8 bit, quintic IC-GN."""
    corners = 0.4 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + [0, 0, 1.0]
    paint = gs.paint.Speckle(diameter=0.004, coverage=0.5, seed=3)
    plate = gs.Surface(corners, np.array([[0, 3, 2, 1]]), paint=paint)
    camera = gs.Camera(WIDTH, HEIGHT, np.array([[1000.0, 0, 117.1], [0, 1000, 103.8], [0, 0, 1]]))
    lens = gs.Lens(psf=gs.psf.Gaussian(0.7), samples_per_px=2)

    def image(shift: float) -> np.ndarray:
        # the rows move by 0.6 of what the columns do: no shift is along one axis alone
        moved = plate.moved(plate.points + np.array([1e-3 * shift, 0.6e-3 * shift, 0.0]))
        frame = gs.photograph([moved], camera, lens=lens, device=device)
        return gs.Sensor(8, 1.0).expose(frame)

    reference = image(0.0)
    bias, spread = [], []
    for shift in 0.05 * np.arange(1, 21):
        found = gs.measure.dic(reference, image(shift), subset=31, step=15, device=device)
        error = found.displacement - [shift, 0.6 * shift]
        assert np.isfinite(error).all() and len(error) > 100
        bias.append(error.mean(axis=0))
        spread.append(error.std(axis=0))
    worst, noise = np.abs(bias).max(), np.max(spread)
    assert worst <= 0.001, f"{worst:.5f} px"
    assert noise <= 0.0015, f"{noise:.5f} px"


def test_a_frame_that_nobody_holds_is_gone_at_once(device: Device) -> None:
    """Views are large, and the garbage collector comes seldom."""
    corners = np.array([[-0.3, -0.2, 1.0], [0.4, -0.25, 1.1], [0.35, 0.3, 1.2], [-0.2, 0.25, 1.0]])
    surface = gs.Surface(corners, np.array([[0, 3, 2, 1]]), paint=gs.paint.Plain(0.6))
    camera = gs.Camera(97, 61, np.array([[90.0, 0.0, 48.0], [0.0, 90.0, 30.0], [0.0, 0.0, 1.0]]))
    frame = gs.render([surface], camera, background=0.1, device=device)
    frame.release()
    gone = weakref.ref(frame)
    gc.disable()
    try:
        del frame
        assert gone() is None
    finally:
        gc.enable()
