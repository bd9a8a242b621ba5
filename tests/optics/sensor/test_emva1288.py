"""The noise of a camera: EMVA 1288's own measurements give back what was put in."""

from __future__ import annotations

from typing import Any
from zlib import crc32

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.frame import Band
from gpusim.optics.sensor.emva1288 import (
    CAMERAS,
    normal_quantile,
    philox,
    poisson_quantile,
    uniform_of,
)

SHAPE = (150, 200)


def frame_of(device: Device, radiance: npt.NDArray[Any] | float, name: str = "left") -> gs.Frame:
    """A frame with given radiance, in two bands with unused columns at the right."""
    values = np.broadcast_to(np.float32(radiance), SHAPE)
    camera = gs.Camera(SHAPE[1], SHAPE[0], np.diag([50.0, 50.0, 1.0]), name=name)
    surface = gs.Surface(np.array([[0.0, 0, 5], [1, 0, 5], [0, 1, 5]]), np.array([[0, 1, 2]]))
    shown = gs.render([surface], camera, backend="numpy").view
    bands = []
    for row0, rows in ((0, 61), (61, SHAPE[0] - 61)):
        data = np.full((rows, SHAPE[1] + 8), np.float32(9.0))
        data[:, : SHAPE[1]] = values[row0 : row0 + rows]
        bands.append(Band(row0, rows, SHAPE[1] + 8, (device.buffer(data, "test.radiance"),)))
    return gs.Frame(shown, device, tuple(bands))


@pytest.mark.parametrize(
    ("counter", "key", "want"),
    [
        ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((2**32 - 1,) * 4, (2**32 - 1,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        ((0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344), (0xA4093822, 0x299F31D0),
         (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1)),
    ],
)  # fmt: skip
def test_philox_gives_the_published_words(
    counter: tuple[int, ...], key: tuple[int, ...], want: tuple[int, ...]
) -> None:
    """Known answers of the authors' Random123 library."""
    got = philox(np.array(counter, np.uint32), np.array(key, np.uint32))
    assert tuple(int(word) for word in got) == want


def test_normal_quantiles() -> None:
    p = ((np.arange(1 << 16) + 0.5) / (1 << 16)).astype(np.float32)
    np.testing.assert_allclose(normal_quantile(p), stats.norm.ppf(p.astype(float)), atol=3e-5)


@pytest.mark.parametrize("mean", [0.05, 1.7, 11.99, 12.0, 40.0, 900.0, 30_000.0])
def test_poisson_quantiles(mean: float) -> None:
    """Against SciPy: never off by more than one, and by one for few of the quantiles."""
    u = ((np.arange(1 << 16) + 0.5) / (1 << 16)).astype(np.float32)
    got = poisson_quantile(np.full(len(u), mean, np.float32), u)
    want = stats.poisson.ppf(u.astype(float), float(np.float32(mean)))
    assert np.abs(got - want).max() <= 1.0
    assert np.mean(got != want) <= (0.0 if mean < 12.0 else 2e-3)


@pytest.mark.parametrize("mean", [0.4, 6.0, 12.5, 300.0])
def test_electrons_are_poisson_distributed(device: Device, mean: float) -> None:
    """Chi-square of the device's own counts, one grey value per electron."""
    sensor = gs.Sensor(12, full_scale=1.0, gain=1.0)
    counts = np.concatenate(
        [
            sensor.expose(frame_of(device, mean / 4095.0), seed=11, number=number).ravel()
            for number in range(4)
        ]
    )
    edges = stats.poisson.ppf(np.linspace(0.02, 0.98, 25), mean).astype(int)
    edges = np.unique(edges)
    cells = np.digitize(counts, edges + 0.5)
    seen = np.bincount(cells, minlength=len(edges) + 1)
    share = np.diff(np.concatenate([[0.0], stats.poisson.cdf(edges, mean), [1.0]]))
    assert stats.chisquare(seen, share * len(counts)).pvalue > 0.01


def test_photon_transfer_gives_the_gain_and_the_dark_noise(device: Device) -> None:
    """EMVA 1288 release 4.0, 6.6: slope of variance over mean, from pairs of images."""
    gain, read = 0.21, 7.0
    sensor = gs.Sensor(
        12, full_scale=1.0, gain=gain, full_well=20_000.0, read_noise=read, black_level=64.0,
        dsnu=4.0, prnu=0.02,
    )  # fmt: skip

    def pair(level: float) -> tuple[float, float]:
        a, b = (
            sensor.expose(frame_of(device, level), seed=5, number=number).astype(float)
            for number in (1, 2)
        )
        return 0.5 * float(a.mean() + b.mean()), 0.5 * float(np.mean((a - b) ** 2))

    dark_mean, dark = pair(0.0)
    levels = np.linspace(0.05, 0.7, 14)
    points = np.array([pair(level) for level in levels])
    x, y = points[:, 0] - dark_mean, points[:, 1] - dark
    slope = float(x @ (y / x) / x.sum())  # each variance is known to a share of itself
    assert slope == pytest.approx(gain, rel=0.01)
    assert np.sqrt(dark - 1.0 / 12.0) / gain == pytest.approx(read, rel=0.03)
    assert dark_mean == pytest.approx(64.0, abs=0.05)


def test_pattern_noise_stays_and_has_its_size(device: Device) -> None:
    sensor = gs.Sensor(
        16, full_scale=1.0, gain=1.0, dsnu=30.0, prnu=0.01, black_level=500.0, full_well=60_000.0
    )
    dark = [sensor.expose(frame_of(device, 0.0), seed=3, number=n).astype(float) for n in (0, 7)]
    assert np.std(dark[0]) == pytest.approx(30.0, rel=0.02)
    np.testing.assert_array_equal(dark[0], dark[1])  # nothing temporal in the dark
    stack = np.mean(
        [sensor.expose(frame_of(device, 0.5), seed=3, number=n).astype(float) for n in range(12)],
        axis=0,
    )
    gains = stack - dark[0]
    expected = np.hypot(0.01 * 32_517.0, np.sqrt(32_517.0 / 12.0))
    assert np.std(gains) == pytest.approx(expected, rel=0.03)


def test_the_last_of_the_random_words_is_no_certainty(device: Device) -> None:
    """Its share would be rounded to 1, whose quantile is infinite: a dead pixel in five million.
    Seed and pixel were searched for."""
    seed, place = 30, 13_370
    key = np.array([seed, crc32(b"left")], np.uint32)
    word = philox(np.array([place, 0, 0, 0], np.uint32), key)[1:2]
    assert word[0] >> 8 == 2**24 - 1 and uniform_of(word)[0] < 1.0
    assert normal_quantile(uniform_of(word))[0] == pytest.approx(5.29, abs=0.1)
    sensor = gs.Sensor(16, full_scale=1.0, gain=1.0, read_noise=20.0, black_level=500.0)
    image = sensor.expose(frame_of(device, 0.0), seed=seed)
    np.testing.assert_allclose(image.ravel()[place], 500.0 + 20.0 * 5.29, atol=3.0)


def test_dark_current_adds_its_signal_and_its_noise(device: Device) -> None:
    sensor = gs.Sensor(16, full_scale=1.0, gain=2.0, dark_current=400.0, exposure_time=0.25)
    image = sensor.expose(frame_of(device, 0.0)).astype(float)
    assert image.mean() == pytest.approx(200.0, rel=0.01)
    assert image.var() == pytest.approx(4.0 * 100.0, rel=0.03)


def test_the_full_well_limits_and_full_scale_clips(device: Device) -> None:
    sensor = gs.Sensor(12, full_scale=1.0, gain=1.0, full_well=3000.0)
    image = sensor.expose(frame_of(device, 0.9))
    assert image.max() == 3000 == image.min()
    assert gs.Sensor(12, gain=1.0).expose(frame_of(device, 3.0)).min() == 4095


def test_seeds_cameras_and_frames_are_independent(device: Device) -> None:
    sensor = gs.Sensor(12, full_scale=1.0, gain=0.5, read_noise=3.0)
    frame = frame_of(device, 0.4)
    first = sensor.expose(frame, seed=1, number=4)
    np.testing.assert_array_equal(first, sensor.expose(frame, seed=1, number=4))
    others = [
        sensor.expose(frame, seed=1, number=5),
        sensor.expose(frame, seed=2, number=4),
        sensor.expose(frame, seed=1 + 2**32, number=4),
        sensor.expose(frame_of(device, 0.4, "right"), seed=1, number=4),
    ]
    limit = 4.0 / np.sqrt(first.size)
    for other in others:
        assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) <= limit
    centred = first - first.mean()
    for step in ((0, 1), (1, 0), (1, 1)):  # nor are neighbours
        shifted = np.roll(centred, step, axis=(0, 1))
        assert abs(np.mean(centred * shifted) / first.var()) <= limit


def test_device_equals_twin(device: Device) -> None:
    radiance = np.random.default_rng(2).uniform(-0.05, 1.1, SHAPE).astype(np.float32)
    radiance[:40] *= 0.003
    radiance[3, 4:6] = np.nan, np.inf
    sensor = gs.Sensor.preset("imx174", bits=10, bayer="GBRG", bayer_response=(0.7, 1.0, 0.4),
                              gamma=2.2, dsnu=3.0, prnu=0.01)  # fmt: skip
    frame = frame_of(device, radiance)
    image = sensor.expose(frame, seed=9, number=2)
    frame.radiance  # noqa: B018 - read, then released: the twin exposes it
    frame.release()
    twin = sensor.expose(frame, seed=9, number=2)
    assert image.dtype == twin.dtype == np.uint16
    # near black, gamma turns one electron into several grey values
    difference = np.abs(image.astype(int) - twin.astype(int))
    assert np.mean(difference > 0) <= 2e-3 and difference[40:].max() <= 1
    assert (image[3, 4:6] == 1023).all()


def test_bayer_mosaic_and_gamma_without_noise(device: Device) -> None:
    frame = frame_of(device, 0.5)
    image = gs.Sensor(8, bayer="RGGB", bayer_response=(0.2, 1.0, 0.6)).expose(frame)
    tile = [[round(127.5 * 0.2), 128], [128, round(127.5 * 0.6)]]
    np.testing.assert_array_equal(image[60:64, 100:104], np.tile(tile, (2, 2)))
    curved = gs.Sensor(8, gamma=2.0).expose(frame)
    assert (curved == round(255 * 0.5**0.5)).all()


def test_metering_counts_photons() -> None:
    """100 W/(m2 sr) at f/8, 1 ms, 5.5 um pixels, 550 nm: worked by hand."""
    sensor = gs.Sensor(12, gain=0.5, quantum_efficiency=0.6).metered(5.5e-6, 8.0, 1e-3, 550e-9)
    photons = np.pi * 100.0 / 256.0 * (5.5e-6) ** 2 * 1e-3 / 3.61171e-19
    signal = sensor.signal()
    assert signal is not None
    assert signal.electrons * 100.0 == pytest.approx(0.6 * photons, rel=1e-4)
    assert sensor.exposure_time == 1e-3


@pytest.mark.parametrize("name", sorted(CAMERAS))
def test_presets(device: Device, name: str) -> None:
    sensor = gs.Sensor.preset(name, full_scale=1.0)
    assert sensor.noisy and len(CAMERAS[name].source) > 40
    image = sensor.expose(frame_of(device, 0.5), seed=1).astype(float)
    assert sensor.full_well is not None
    electrons = 0.5 * (2**sensor.bits - 1) / sensor.system_gain
    want = sensor.system_gain**2 * (electrons + sensor.read_noise**2) + 1 / 12
    assert image.var() == pytest.approx(want, rel=0.04)
    eight, twelve = (gs.Sensor.preset(name, bits=b).system_gain for b in (8, 12))
    assert twelve / eight == pytest.approx(4095 / 255)


def test_the_stereo_dic_camera_has_its_published_dark_variance(device: Device) -> None:
    """At 12 bit, because steps of 8 bit are wider than the noise; in the units of 8 bit."""
    sensor = gs.Sensor.preset("stereo-dic-5mp", bits=12, black_level=100.0)
    image = sensor.expose(frame_of(device, 0.0), seed=2).astype(float)
    assert (image.var() - 1.0 / 12.0) * (255 / 4095) ** 2 == pytest.approx(0.07, rel=0.03)


@pytest.mark.parametrize(
    ("values", "part"),
    [
        ({"read_noise": 3.0}, "read_noise; got 3.0 without gain"),
        ({"gain": 0.0}, "gain; got 0.0"),
        ({"gain": 1.0, "prnu": float("nan")}, "prnu; got nan"),
        ({"black_level": 255.0}, "black_level; got 255.0"),
        ({"bayer": "RGB"}, "bayer; got 'RGB'"),
        ({"quantum_efficiency": 1.2}, "quantum_efficiency; got 1.2"),
    ],
)
def test_sensors_that_cannot_be(values: dict[str, Any], part: str) -> None:
    with pytest.raises(InputError, match=part):
        gs.Sensor(**values)
    with pytest.raises(InputError, match="expected one of"):
        gs.Sensor.preset("no such camera")
