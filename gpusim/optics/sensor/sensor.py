"""The sensor: digital numbers from linear radiance.

Without noise (the default, which costs nothing) DN = round(radiance x scale + black level),
clipped to [0, 2^bits - 1]. With a gain or a full well it is a camera by EMVA 1288
(`gpusim.optics.sensor.emva1288`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any
from zlib import crc32

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.frame import Band, Frame
from gpusim.optics.sensor.emva1288 import CAMERAS, Signal, emva_twin, expose_noisy
from gpusim.validation import checked

__all__ = ["Sensor", "sensor_twin"]

AUTO_LEVEL = 0.95
TILES = {"RGGB": (0, 1, 1, 2), "BGGR": (2, 1, 1, 0), "GRBG": (1, 0, 2, 1), "GBRG": (1, 2, 0, 1)}
UNLIMITED = 1e30  # electrons
CHUNK = 1 << 16  # pixels at a time, so that they stay in the cache
PLANCK_TIMES_LIGHT = 6.62607015e-34 * 299_792_458.0


@checked
@dataclass(frozen=True)
class Sensor:
    """A sensor with a linear response, grey unless it has a Bayer mosaic.

    Parameters
    ----------
    bits : 8 to 16; more than 8 are stored as uint16.
    full_scale : radiance that gives the largest digital number.
    gain : overall system gain K, DN per electron; needed for noise unless ``full_well`` gives it
        (then the full well is at full scale).
    full_well : saturation capacity, electrons.
    read_noise : standard deviation of the temporal dark noise without dark current, electrons.
    dark_current : electrons per second; with ``exposure_time`` (s) it adds a signal and its noise.
    dsnu, prnu : standard deviations of the pixels' offsets (electrons) and gains (1).
    black_level : DN of a dark pixel.
    quantum_efficiency : electrons per photon; only `metered` needs it.
    gamma : DN = full (linear DN / full)^(1 / gamma).
    bayer : "RGGB", "BGGR", "GRBG" or "GBRG": a raw mosaic whose pixels see the grey scene with the
        relative responses ``bayer_response`` (red, green, blue).

    Raises
    ------
    InputError
        Values out of range, or noise in electrons without a gain.

    Examples
    --------
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (3, 2), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> gs.Sensor(bits=8).expose(gs.render([wall], camera, backend="numpy"))
    array([[128, 128, 128],
           [128, 128, 128]], dtype=uint8)
    """

    bits: int = 8
    full_scale: float = 1.0
    gain: float | None = None
    full_well: float | None = None
    read_noise: float = 0.0
    dark_current: float = 0.0
    exposure_time: float = 0.0
    dsnu: float = 0.0
    prnu: float = 0.0
    black_level: float = 0.0
    quantum_efficiency: float = 1.0
    gamma: float = 1.0
    bayer: str | None = None
    bayer_response: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        if self.bits not in range(8, 17):
            raise InputError(f"Sensor bits; got {self.bits}; expected 8 to 16")
        if not (np.isfinite(self.full_scale) and self.full_scale > 0.0):
            raise InputError(
                f"Sensor full_scale; got {self.full_scale}; expected a radiance above 0"
            )
        for key in ("gain", "full_well", "gamma"):
            value = getattr(self, key)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise InputError(f"Sensor {key}; got {value}; expected above 0")
        for key in ("read_noise", "dark_current", "exposure_time", "dsnu", "prnu", "black_level"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"Sensor {key}; got {value}; expected from 0 up")
        full = 2**self.bits - 1
        if not self.black_level < full:
            raise InputError(f"Sensor black_level; got {self.black_level}; expected below {full}")
        if not 0.0 < self.quantum_efficiency <= 1.0:
            raise InputError(
                f"Sensor quantum_efficiency; got {self.quantum_efficiency}; expected above 0, to 1"
            )
        if self.bayer is not None and self.bayer not in TILES:
            raise InputError(f"Sensor bayer; got {self.bayer!r}; expected one of {sorted(TILES)}")
        response = np.asarray(self.bayer_response, np.float64)
        if response.shape != (3,) or not (np.isfinite(response) & (response >= 0.0)).all():
            raise InputError(
                f"Sensor bayer_response; got {self.bayer_response}; expected three numbers from 0"
            )
        if not self.noisy:
            for key in ("read_noise", "dark_current", "dsnu", "prnu"):
                if getattr(self, key) > 0.0:
                    raise InputError(
                        f"Sensor {key}; got {getattr(self, key)} without gain and full_well; "
                        "expected one of them: noise is counted in electrons"
                    )

    @staticmethod
    def preset(name: str, **changes: Any) -> Sensor:
        """A real camera (`gpusim.optics.sensor.emva1288`), with some values changed."""
        if name not in CAMERAS:
            raise InputError(f"Sensor preset; got {name!r}; expected one of {sorted(CAMERAS)}")
        values = dict(CAMERAS[name].values)
        unknown = sorted(set(changes) - {field.name for field in fields(Sensor)})
        if unknown:
            raise InputError(f"Sensor preset; got unknown values {unknown}")
        bits = changes.get("bits", values["bits"])
        if "gain" in values and "gain" not in changes and "full_well" not in changes:
            # grey values per electron grow with the number of grey values
            values["gain"] = values["gain"] * (2**bits - 1) / (2 ** values["bits"] - 1)
        return Sensor(**(values | changes))

    @staticmethod
    def auto_exposed(frame: Frame, bits: int = 8, like: Sensor | None = None) -> Sensor:
        """A sensor exposed so that the brightest pixel of ``frame`` is at 95 % of full scale, or of
        the full well where that is reached first.

        The maximum, not a quantile: the white of small markers is the first to saturate, and a
        clipped edge moves. Radiance has no noise, so that no outlier can decide. ``like`` gives
        everything but the exposure.
        """
        level = frame.brightest()
        if not level > 0.0:
            raise InputError("auto exposure: the frame is black; got radiance 0; add a light")
        sensor = Sensor(bits) if like is None else like
        return replace(sensor, full_scale=level / (AUTO_LEVEL * sensor._filled))

    def metered(
        self,
        pixel: float,
        f_number: float,
        exposure_time: float,
        wavelength: float = 550e-9,
        magnification: float = 0.0,
    ) -> Sensor:
        """This sensor behind a lens, for radiance in W / (m2 sr): its ``full_scale`` follows.

        Irradiance on the sensor is pi L / (4 N^2 (1 + magnification)^2); a photon carries
        h c / wavelength; ``pixel`` (side), wavelength in m, ``exposure_time`` in s.
        """
        given = (pixel, f_number, exposure_time, wavelength)
        if not all(np.isfinite(v) and v > 0.0 for v in given) or not magnification >= 0.0:
            raise InputError(
                f"Sensor metered; got {(*given, magnification)}; expected pixel, f_number, "
                "exposure_time and wavelength above 0, magnification from 0"
            )
        if not self.noisy:
            raise InputError("Sensor metered; got no gain and no full_well; expected one of them")
        irradiance = np.pi / (4.0 * (f_number * (1.0 + magnification)) ** 2)
        photons = irradiance * pixel**2 * exposure_time * wavelength / PLANCK_TIMES_LIGHT
        full = (2**self.bits - 1 - self.black_level) / self.system_gain
        return replace(
            self,
            full_scale=float(full / (photons * self.quantum_efficiency)),
            exposure_time=exposure_time,
        )

    @property
    def noisy(self) -> bool:
        """Whether electrons are counted: the sensor has a gain or a full well."""
        return self.gain is not None or self.full_well is not None

    @property
    def system_gain(self) -> float:
        """DN per electron: ``gain``, or what puts the full well at full scale."""
        if self.gain is not None:
            return self.gain
        if self.full_well is None:
            return 1.0
        return float(2**self.bits - 1 - self.black_level) / self.full_well

    @property
    def _filled(self) -> float:
        """Share of the range above the black level that a full well reaches, 1 at most."""
        if self.full_well is None:
            return 1.0
        full = float(2**self.bits - 1)
        return min(1.0, self.system_gain * self.full_well / (full - self.black_level))

    @property
    def saturation(self) -> int:
        """The grey value, DN, that a pixel gets no brighter than (but for noise in its readout).

        The full well or the largest digital number, whichever is reached first.
        """
        full = float(2**self.bits - 1)
        share = (self.black_level + self._filled * (full - self.black_level)) / full
        return round(full * float(share ** (1.0 / self.gamma)))

    @property
    def dtype(self) -> np.dtype[Any]:
        """uint8 up to 8 bits, else uint16."""
        return np.dtype(np.uint8 if self.bits <= 8 else np.uint16)

    @property
    def scale(self) -> np.float32:
        """Digital numbers per unit of radiance."""
        return np.float32((2**self.bits - 1 - self.black_level) / self.full_scale)

    def signal(self, seed: int = 0, number: int = 0, camera: str = "") -> Signal | None:
        """What the noise stage works with; None for a sensor that only scales."""
        plain = self.black_level == 0.0 and self.gamma == 1.0 and self.bayer is None
        if plain and not self.noisy:
            return None
        tile = [1.0] * 4
        if self.bayer is not None:
            tile = [float(self.bayer_response[k]) for k in TILES[self.bayer]]
        gain = self.system_gain
        return Signal(
            bits=self.bits,
            electrons=float((2**self.bits - 1 - self.black_level) / (gain * self.full_scale)),
            gain=gain,
            black=self.black_level,
            full_well=self.full_well if self.full_well is not None else UNLIMITED,
            shot=self.noisy,
            dark=self.dark_current * self.exposure_time,
            read_noise=self.read_noise,
            dsnu=self.dsnu,
            prnu=self.prnu,
            gamma=self.gamma,
            tile=(tile[0], tile[1], tile[2], tile[3]),
            seed=seed & 0xFFFFFFFF,
            camera=(crc32(camera.encode()) ^ (seed >> 32)) & 0xFFFFFFFF,
            frame=number & 0xFFFFFFFF,
        )

    def expose(
        self, frame: Frame, seed: int = 0, number: int = 0, camera: str | None = None
    ) -> npt.NDArray[Any]:
        """The image of ``frame``, (H, W) uint8 or uint16.

        Noise is that of (``seed``, ``camera``, ``number``), where ``camera`` is the name of the
        frame's camera unless given; DSNU and PRNU stay the same for every frame ``number``.

        Raises
        ------
        InputError
            Something else than a frame, or a seed or number that isn't whole or is below 0.
        """
        if not isinstance(frame, Frame):
            raise InputError(f"Sensor expose; got a {type(frame).__name__}; expected a Frame")
        for key, value in (("seed", seed), ("number", number)):
            if not (isinstance(value, int | np.integer) and value >= 0):
                raise InputError(f"Sensor expose {key}; got {value}; expected a whole number >= 0")
        name = frame.view.camera.name if camera is None else camera
        signal = self.signal(seed, number, name)
        if frame.device is None or not frame.bands:  # made by the twin, or released
            if signal is not None:
                return emva_twin(signal, frame.radiance).astype(self.dtype)
            return sensor_twin(self, frame.radiance)
        if signal is None:
            if frame.device.transfer.direct:
                return _expose_seen(self, frame.bands, frame.width)
            return _expose(frame.device, self, frame.bands, frame.width)
        return np.concatenate(
            [
                expose_noisy(
                    frame.device, signal, band.buffer, (band.rows, frame.width), band.stride,
                    band.row0, self.dtype,
                )
                for band in frame.bands
            ]
        )  # fmt: skip


def _expose(device: Device, sensor: Sensor, bands: Sequence[Band], width: int) -> npt.NDArray[Any]:
    """The bands' rows one below the other."""
    kernel = device.kernel("optics/sensor/sensor", constants={"bits": float(sensor.bits)})
    per_word = 4 // sensor.dtype.itemsize
    columns = -(-width // per_word)
    height = sum(band.rows for band in bands)
    out = device.empty(4 * columns * height, "sensor.words")
    with device.recording("optics.sensor") as recording:
        row = 0
        for band in bands:
            bindings = kernel.bind(
                params={"width": width, "rows": band.rows, "stride": band.stride,
                        "first_word": row * columns, "scale": sensor.scale},
                radiance=band.buffer,
                words=out,
            )  # fmt: skip
            recording.dispatch(kernel, bindings, threads=(columns, band.rows))
            row += band.rows
    image = out.read(sensor.dtype, (height, columns * per_word))
    return np.ascontiguousarray(image[:, :width])


def _expose_seen(sensor: Sensor, bands: Sequence[Band], width: int) -> npt.NDArray[Any]:
    """The same by NumPy, where bands lie in the host's memory: a kernel's lanes load words one by
    one, three times as slow."""
    image = np.empty((sum(band.rows for band in bands), width), sensor.dtype)
    step, row = max(1, CHUNK // width), 0
    for band in bands:
        # what overflows is full scale, as what isn't finite
        with band.seen() as values, np.errstate(over="ignore", invalid="ignore"):
            for first in range(0, band.rows, step):
                part = values[first : first + step, :width]
                image[row + first : row + first + len(part)] = sensor_twin(sensor, part)
        row += band.rows
    return image


def sensor_twin(sensor: Sensor, radiance: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
    """The same in NumPy float32; values that aren't finite become full scale."""
    full = np.float32(2**sensor.bits - 1)
    values = np.clip(np.rint(radiance * sensor.scale), 0.0, full)
    return np.where(np.isfinite(radiance), values, full).astype(sensor.dtype)
