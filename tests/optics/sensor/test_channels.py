"""Colour from three planes: sensitivities, noise of each chip, mosaics, white balance."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.frame import Band
from gpusim.surface.color import color

WIDTH, HEIGHT = 57, 33
GAINS = (1.7, 1.0, 1.3)


def planes(seed: int = 3) -> npt.NDArray[np.float32]:
    """(3, H, W) of different radiance, none above 1."""
    rng = np.random.default_rng(seed)
    scale = np.array([0.4, 0.9, 0.6])[:, None, None]
    return (scale * rng.uniform(0.1, 1.0, (3, HEIGHT, WIDTH))).astype(np.float32)


def frame_of(values: npt.NDArray[Any], device: Device | None = None) -> gs.Frame:
    """A frame with given planes (1 or 3, H, W): of the host, or in two bands of the device."""
    camera = gs.Camera(WIDTH, HEIGHT, np.diag([50.0, 50.0, 1.0]), name="left")
    surface = gs.Surface(np.array([[0.0, 0, 5], [1, 0, 5], [0, 1, 5]]), np.array([[0, 1, 2]]))
    view = gs.render([surface], camera, backend="numpy").view
    made = []
    for number, plane in enumerate(values.astype(np.float32)):
        if device is None:
            made.append(gs.Frame(view, None, radiance=plane))
            continue
        bands = []
        for row0, rows in ((0, 14), (14, HEIGHT - 14)):
            data = np.full((rows, WIDTH + 7), np.float32(5.0))
            data[:, :WIDTH] = plane[row0 : row0 + rows]
            buffer = device.buffer(data, f"test.radiance {number}")
            bands.append(Band(row0, rows, WIDTH + 7, (buffer,)))
        made.append(gs.Frame(view, device, tuple(bands)))
    return gs.Frame.of_planes(made)


def test_three_rendered_planes_make_a_colour_picture() -> None:
    """As a coloured wall: each band of it is a grey scene."""
    corners = [[-9, -9, 2], [9, -9, 2], [9, 9, 2], [-9, 9, 2]]
    camera = gs.Camera(WIDTH, HEIGHT, np.array([[40.0, 0, 20], [0, 40, 11], [0, 0, 1]]))
    albedo = color("#c0a080")
    assert isinstance(albedo, tuple)
    walls = [gs.Surface(corners, [[0, 3, 2, 1]], paint=gs.paint.Plain(a)) for a in albedo]
    made = [gs.render([wall], camera, backend="numpy") for wall in walls]
    frame = gs.Frame.of_planes(made)
    linear = gs.Sensor(8, channels="rgb").expose(frame)
    assert linear.shape == (HEIGHT, WIDTH, 3) and linear.dtype == np.uint8
    assert np.unique(linear.reshape(-1, 3), axis=0).tolist() == [[round(255 * a) for a in albedo]]
    # what a viewer has to be given for the colour that was asked for
    shown = gs.Sensor(8, channels="rgb", gamma="srgb").expose(frame)
    assert np.unique(shown.reshape(-1, 3), axis=0).tolist() == [[0xC0, 0xA0, 0x80]]


@pytest.mark.parametrize("on_device", [False, True])
def test_a_mono_sensor_sees_the_weighted_sum(device: Device, on_device: bool) -> None:
    values = planes()
    frame = frame_of(values, device if on_device else None)
    for weights in (None, (0.2, 0.7, 0.05), (0.0, 1.0, 0.0), (0.0, 0.5, 0.0)):
        sensor = gs.Sensor(16, sensitivities=weights)
        want = np.tensordot(weights or (1 / 3, 1 / 3, 1 / 3), values.astype(np.float64), 1)
        got = sensor.expose(frame).astype(np.float64)
        assert np.abs(got - 65535.0 * want).max() <= 0.51


def test_a_grey_frame_is_what_it_was_for_a_mono_sensor(device: Device) -> None:
    """The same code path: not even a buffer is made for the sum."""
    values = planes()[:1]
    for place in (None, device):
        frame = frame_of(values, place)
        sensor = gs.Sensor(8, full_well=9000.0, read_noise=4.0, bayer="GRBG",
                           bayer_response=(0.5, 1.0, 0.7))  # fmt: skip
        mosaic = sensor.expose(frame, seed=4)
        colored = frame_of(np.repeat(values, 3, axis=0), place)
        np.testing.assert_array_equal(mosaic, sensor.expose(colored, seed=4))
        plain = gs.Sensor(10).expose(frame)
        three = gs.Sensor(10, channels="rgb").expose(frame)
        np.testing.assert_array_equal(three, np.repeat(plain[..., None], 3, axis=2))


def test_camera_channels_mix_the_bands(device: Device) -> None:
    values = planes()
    mix = np.array([[0.8, 0.15, 0.0], [0.1, 0.7, 0.1], [0.0, 0.2, 0.9]])
    sensor = gs.Sensor(16, channels="rgb", sensitivities=mix)
    want = 65535.0 * np.einsum("cb,bhw->hwc", mix, values.astype(np.float64))
    for place in (None, device):
        assert np.abs(sensor.expose(frame_of(values, place)) - want).max() <= 0.51
    # grey light is the same in all bands
    grey = sensor.expose(frame_of(values[:1])).astype(float)
    assert np.abs(grey - 65535.0 * mix.sum(axis=1) * values[0][..., None]).max() <= 0.51
    assert hash(sensor) == hash(replace(sensor))


def test_chips_have_noise_of_their_own(device: Device) -> None:
    """Shot noise, read-out, offsets and gains of three chips don't go together."""
    frame = frame_of(np.full((1, HEIGHT, WIDTH), 0.5), device)
    sensor = gs.Sensor(12, channels="rgb", full_well=9000.0, read_noise=12.0, dsnu=30.0, prnu=0.01)
    image = sensor.expose(frame, seed=5, number=2).astype(float)
    mono = replace(sensor, channels="mono").expose(frame, seed=5, number=2).astype(float)
    taken = np.stack([*np.moveaxis(image, 2, 0), mono]).reshape(4, -1)
    electrons = np.array([4500.0, 12.0**2, 30.0**2, (0.01 * 4500.0) ** 2]).sum()
    assert taken.std(axis=1) == pytest.approx(4095 / 9000.0 * np.sqrt(electrons), rel=0.08)
    others = np.corrcoef(taken) - np.eye(4)
    assert np.abs(others).max() <= 4.5 / np.sqrt(WIDTH * HEIGHT)
    other = sensor.expose(frame, seed=5, number=3).astype(float)
    kept = np.corrcoef(image[..., 1].ravel(), other[..., 1].ravel())[0, 1]
    assert kept == pytest.approx((30.0**2 + 45.0**2) / electrons, abs=0.1)


@pytest.mark.parametrize("pattern", ["RGGB", "BGGR", "GRBG", "GBRG"])
def test_pixels_of_a_mosaic_see_the_channel_of_their_filter(device: Device, pattern: str) -> None:
    values = planes()
    response = (0.5, 1.0, 0.8)
    sensor = gs.Sensor(16, bayer=pattern, bayer_response=response)
    channel = np.array(["RGB".index(letter) for letter in pattern]).reshape(2, 2)
    at = np.tile(channel, (HEIGHT // 2 + 1, WIDTH // 2 + 1))[:HEIGHT, :WIDTH]
    want = np.take_along_axis(values, at[None], 0)[0] * np.array(response)[at]
    for place in (None, device):
        image = sensor.expose(frame_of(values, place))
        assert image.shape == (HEIGHT, WIDTH)
        assert np.abs(image - 65535.0 * want).max() <= 0.51


def test_white_balance_makes_grey_grey_and_clips(device: Device) -> None:
    """Gains act above the black level, after the noise."""
    light = np.array([1 / 1.7, 1.0, 1 / 1.3]).reshape(3, 1, 1)
    ramp = np.linspace(0.0, 1.2, HEIGHT * WIDTH).reshape(1, HEIGHT, WIDTH)
    frame = frame_of(light * ramp, device)
    sensor = gs.Sensor(12, channels="rgb", white_balance=GAINS, black_level=100.0)
    image = sensor.expose(frame).astype(float)
    rounded = 0.5 + 0.5 * 1.7 * 4095 / 65535 + 1e-3  # once here, once in the raw number
    want = np.minimum(100.0 + 3995.0 * ramp[0], 4095.0)
    assert np.abs(image - want[..., None]).max() <= rounded
    mosaic = replace(sensor, channels="mono", bayer="GBRG").expose(frame)
    assert np.abs(mosaic - want).max() <= rounded
    assert (replace(sensor, white_balance=(1, 1, 1)).expose(frame)
            == replace(sensor, white_balance=None).expose(frame)).all()  # fmt: skip
    # noise is amplified with the signal
    noisy = replace(sensor, full_well=20_000.0, black_level=0.0, read_noise=5.0)
    flat = frame_of(np.full((1, HEIGHT, WIDTH), 0.3), device)
    spread = noisy.expose(flat, seed=1).std(axis=(0, 1))
    assert spread / spread[1] == pytest.approx(GAINS, rel=0.08)


def test_what_is_saturated_by_channel() -> None:
    bright = frame_of(np.full((3, HEIGHT, WIDTH), 1.4))
    dark = frame_of(np.full((3, HEIGHT, WIDTH), 0.4))
    common: dict[str, Any] = {"white_balance": (0.5, 1.0, 1.5), "full_well": 4000.0}
    clear = {"bayer": "RGGB", "demosaic": "malvar", "channels": "rgb"}
    for own in ({"channels": "rgb"}, {"bayer": "RGGB"}, clear):
        sensor = gs.Sensor(12, gain=0.8, **common, **own)
        image = sensor.expose(bright, seed=1)
        assert sensor.saturated(image).all(), own
        assert not sensor.saturated(sensor.expose(dark, seed=1)).any()
        if image.ndim == 3:
            assert [int(v) for v in image[0, 0]] == [1600, 3200, 4095]
        assert sensor.saturation == 4095
    assert gs.Sensor(8, full_well=100.0, gain=2.0).saturation == 200


@pytest.mark.parametrize("on_device", [False, True])
def test_auto_exposure_is_for_the_brightest_channel(device: Device, on_device: bool) -> None:
    values = planes()
    frame = frame_of(values, device if on_device else None)
    peaks = values.max(axis=(1, 2)).astype(float)

    def exposed(**own: Any) -> npt.NDArray[np.float64]:
        sensor = gs.Sensor.auto_exposed(frame, like=gs.Sensor(12, **own))
        return sensor.expose(frame).astype(np.float64)

    assert exposed(channels="rgb").max(axis=(0, 1)) == pytest.approx(
        0.95 * 4095 * peaks / peaks.max(), abs=0.6
    )
    # a gain may lift another channel above it
    lifted = exposed(channels="rgb", white_balance=(3.0, 1.0, 1.0)).max(axis=(0, 1))
    assert lifted.max() == pytest.approx(0.95 * 4095, abs=0.6) and lifted.argmax() == 0
    # that of a weak filter lifts it to where it would be
    weak = {"bayer": "RGGB", "bayer_response": (0.5, 1.0, 0.5), "white_balance": (2.0, 1.0, 2.0)}
    assert exposed(**weak).max() == pytest.approx(0.95 * 4095, rel=0.03)
    # and one that only weakens leaves room for more light
    for gains in (None, (1.0, 1.0, 1.0), (0.9, 0.8, 1.0)):
        for response in ((0.4, 0.5, 0.3), (1.5, 2.0, 1.2)):
            image = exposed(bayer="RGGB", bayer_response=response, white_balance=gains)
            lowered = 0.8 if gains and gains[1] < 1.0 else 1.0
            assert image.max() == pytest.approx(lowered * 0.95 * 4095, rel=0.03)
    assert exposed().max() == pytest.approx(0.95 * 4095, abs=0.6)


def test_gamma_comes_last() -> None:
    ramp = np.linspace(0.0, 1.0, HEIGHT * WIDTH).reshape(1, HEIGHT, WIDTH)
    frame = frame_of(np.array([0.5, 1.0, 0.25]).reshape(3, 1, 1) * ramp)
    image = gs.Sensor(16, channels="rgb", white_balance=(2, 1, 4), gamma=2.2).expose(frame)
    slope = ramp[0, 9, 0] ** (1 / 2.2 - 1) / 2.2  # of the curve, by which the raw error grows
    error = np.abs(image - 65535 * ramp[0][..., None] ** (1 / 2.2))[9:]
    assert error.max(axis=(0, 1)) == pytest.approx(0.5 + 0.5 * slope * np.array([2, 1, 4]), abs=0.3)
    # IEC 61966-2-1: linear below 0.0031308
    grey = gs.Sensor(8, gamma="srgb").expose(frame_of(ramp)).ravel().astype(int)
    assert [int(grey[np.abs(ramp.ravel() - v).argmin()]) for v in (0.0, 0.2140, 0.5029, 1.0)] == [
        0, 127, 188, 255
    ]  # fmt: skip
    assert (np.diff(grey) >= 0).all()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"channels": "grey"}, "channels; got 'grey'; expected 'mono' or 'rgb'"),
        ({"demosaic": "malvar"}, "demosaic; got 'malvar' with bayer None"),
        ({"demosaic": "best", "bayer": "RGGB"}, r"expected one of \['bilinear', 'malvar'\]"),
        ({"channels": "rgb", "bayer": "RGGB"}, "got None with channels 'rgb' and bayer 'RGGB'"),
        ({"demosaic": "malvar", "bayer": "RGGB"}, "with channels 'rgb', none with 'mono'"),
        ({"sensitivities": (1.0, 2.0)}, r"sensitivities; got \[1.0, 2.0\]; expected 3 numbers"),
        ({"sensitivities": np.eye(3)}, r"\(3, 3\) is for colour"),
        ({"sensitivities": (1, 1, 1), "channels": "rgb"}, "expected 3 rows"),
        ({"sensitivities": np.diag([1, 0, 1]), "channels": "rgb"}, "none of them all zero"),
        ({"sensitivities": (-1.0, 1.0, 1.0)}, "from 0"),
        ({"sensitivities": "red"}, "expected an array of real numbers"),
        ({"white_balance": (1, 2, 1)}, "with channels 'mono'"),
        ({"white_balance": (1, 0, 1), "channels": "rgb"}, "gains of red, green and blue above 0"),
        ({"white_balance": (1, 1), "bayer": "RGGB"}, "gains of red, green and blue above 0"),
        ({"gamma": "log"}, "gamma; got 'log'; expected above 0 or 'srgb'"),
    ],
)
def test_what_does_not_go_together(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        gs.Sensor(**values)
