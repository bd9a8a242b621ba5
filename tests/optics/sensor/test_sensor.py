"""Digital numbers from radiance: rounding, saturation, values that aren't numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.frame import Band
from gpusim.optics.sensor.digital_numbers import scaled_twin


def frame_of(device: Device, radiance: npt.NDArray[np.float32], stride: int) -> gs.Frame:
    """A frame whose radiance is given, in two bands with unused columns at the right."""
    height, width = radiance.shape
    camera = gs.Camera(width, height, np.array([[50.0, 0, 3], [0, 50, 4], [0, 0, 1]]))
    surface = gs.Surface(np.array([[0.0, 0, 5], [1, 0, 5], [0, 1, 5]]), np.array([[0, 1, 2]]))
    view = gs.render([surface], camera, backend="numpy").view
    bands = []
    for row0, rows in ((0, height // 2), (height // 2, height - height // 2)):
        data = np.full((rows, stride), np.float32(77.0))
        data[:, :width] = radiance[row0 : row0 + rows]
        bands.append(Band(row0, rows, stride, (device.buffer(data, "test.radiance"),)))
    return gs.Frame(view, device, tuple(bands))


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
@pytest.mark.parametrize("width", [57, 58])
def test_device_equals_twin_exactly(device: Device, bits: int, width: int) -> None:
    radiance = np.random.default_rng(bits).uniform(-0.2, 1.3, (33, width)).astype(np.float32)
    sensor = gs.Sensor(bits, 0.9)
    image = sensor.expose(frame_of(device, radiance, 64))
    assert image.shape == (33, width)
    assert image.dtype == (np.uint8 if bits == 8 else np.uint16)
    np.testing.assert_array_equal(image, scaled_twin(sensor, radiance))
    assert image.min() == 0 and image.max() == 2**bits - 1
    want = np.clip(np.rint(radiance * (2**bits - 1) / 0.9), 0, 2**bits - 1)
    assert np.abs(image - want).max() <= 1  # float64 may fall on the other side of one half


def test_halves_round_to_even(device: Device) -> None:
    halves = (np.arange(57 * 33) % 250 + 0.5).reshape(33, 57).astype(np.float32)
    sensor = gs.Sensor(8, 255.0)
    want = (np.floor(halves / 2 + 0.25) * 2).astype(np.uint8)
    for image in (sensor.expose(frame_of(device, halves, 64)), scaled_twin(sensor, halves)):
        np.testing.assert_array_equal(image, want)


def test_values_that_are_not_finite_become_full_scale(device: Device) -> None:
    radiance = np.full((33, 57), np.float32(0.5))
    radiance[3, 5:8] = np.nan, np.inf, -np.inf
    radiance[4, 5] = 3e38
    for bits in (8, 12):
        sensor = gs.Sensor(bits, 1.0)
        with np.errstate(over="ignore", invalid="ignore"):
            twin = scaled_twin(sensor, radiance)
        image = sensor.expose(frame_of(device, radiance, 64))
        np.testing.assert_array_equal(image, twin)
        assert (image == 2**bits - 1).sum() == 4
        assert (image[3, 5:8] == 2**bits - 1).all() and image[4, 5] == 2**bits - 1


def test_numpy_and_device_frames_give_the_same_image(device: Device) -> None:
    camera = gs.Camera.from_lens((36, 24), 30, (57, 33), (0.1, -1, 0), (0, 0, 0))
    points = np.array([[-0.3, 0, -0.2], [0.3, 0, -0.2], [0.3, 0, 0.2], [-0.3, 0, 0.2]])
    surface = gs.Surface(points, np.array([[0, 1, 2, 3]]), paint=gs.paint.Checker(0.05))
    images = [
        gs.Sensor(8)
        .expose(gs.render([surface], camera, device=device, backend=backend))
        .astype(int)
        for backend in ("gpu", "numpy")
    ]
    assert np.abs(images[0] - images[1]).max() <= 1
    assert (images[0] != images[1]).mean() < 1e-2


def test_auto_exposure_keeps_the_brightest_pixel_below_full_scale(device: Device) -> None:
    radiance = np.random.default_rng(1).uniform(0.0, 3.0, (33, 57)).astype(np.float32)
    radiance[7, 9] = 40.0  # one bright pixel decides
    frame = frame_of(device, radiance, 64)
    sensor = gs.Sensor.auto_exposed(frame, bits=12)
    image = sensor.expose(frame)
    assert sensor.bits == 12 and image[7, 9] == image.max()
    assert 0.9 * 4095 < image.max() < 4095
    with pytest.raises(InputError, match="black"):
        gs.Sensor.auto_exposed(frame_of(device, 0 * radiance, 64))


def test_the_seed_changes_nothing_without_noise(device: Device) -> None:
    frame = frame_of(device, np.full((4, 7), np.float32(0.3)), 64)
    np.testing.assert_array_equal(gs.Sensor().expose(frame, 1), gs.Sensor().expose(frame, 2))


def test_a_released_frame_keeps_what_was_read(device: Device) -> None:
    radiance = np.random.default_rng(2).uniform(0.0, 1.0, (33, 57)).astype(np.float32)
    read, unread = (frame_of(device, radiance, 64) for _ in range(2))
    image = gs.Sensor().expose(read)
    np.testing.assert_array_equal(read.radiance, radiance)
    read.release()
    unread.release()
    np.testing.assert_array_equal(gs.Sensor().expose(read), image)
    with pytest.raises(InputError, match="released"):
        gs.Sensor().expose(unread)


@pytest.mark.parametrize(
    ("bits", "full_scale", "part"),
    [(7, 1.0, "bits; got 7"), (17, 1.0, "bits; got 17"), (8, 0.0, "full_scale; got 0.0"),
     (8, float("nan"), "full_scale; got nan")],
)  # fmt: skip
def test_sensors_that_cannot_be(bits: int, full_scale: float, part: str) -> None:
    with pytest.raises(InputError, match=part):
        replace(gs.Sensor(), bits=bits, full_scale=full_scale)


def test_exposures_that_cannot_be(device: Device) -> None:
    frame = frame_of(device, np.full((4, 7), np.float32(0.3)), 64)
    with pytest.raises(InputError, match="got a ndarray; expected a Frame"):
        gs.Sensor().expose(frame.radiance)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="seed; got -1"):
        gs.Sensor().expose(frame, seed=-1)
    with pytest.raises(InputError, match=r"number; got 1.5"):
        gs.Sensor().expose(frame, number=1.5)  # type: ignore[arg-type]
