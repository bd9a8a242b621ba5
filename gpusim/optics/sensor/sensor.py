"""The sensor: digital numbers from linear radiance.

Without noise (the default, which costs nothing) DN = round(radiance x scale + black level),
clipped to [0, 2^bits - 1]. With a gain or a full well it is a camera by EMVA 1288
(`gpusim.optics.sensor.emva1288`). A colour picture is taken channel by channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any
from zlib import crc32

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool
from gpusim.errors import InputError
from gpusim.optics.frame import Frame
from gpusim.optics.sensor.channels import (
    Weights,
    check_sensitivities,
    picked,
    seen,
    weights_of,
)
from gpusim.optics.sensor.demosaicing import METHODS, TILES
from gpusim.optics.sensor.development import RAW_BITS, Development, at_least, check_gains
from gpusim.optics.sensor.digital_numbers import scaled_on_device, scaled_twin
from gpusim.optics.sensor.emva1288 import CAMERAS, Signal, emva_twin, expose_noisy
from gpusim.validation import (
    FromZero,
    Portion,
    Positive,
    Rule,
    checked,
    one_of,
    positive,
    require,
    within,
)

AUTO_LEVEL = 0.95
UNLIMITED = 1e30  # electrons
Response = Annotated[
    tuple[float, float, float],
    Rule("three numbers from 0", lambda response: all(0.0 <= own < np.inf for own in response)),
]
PLANCK_TIMES_LIGHT = 6.62607015e-34 * 299_792_458.0


@checked
@dataclass(frozen=True)
class Sensor:
    """A sensor with a linear response.

    Its digital numbers are linear in the radiance unless ``gamma`` is given, in colour too: viewers
    show linear pictures dark, and right with ``gamma="srgb"``.

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
    gamma : DN = full (linear DN / full)^(1 / gamma); or "srgb": by the curve of that standard.
    bayer : "RGGB", "BGGR", "GRBG" or "GBRG": a raw mosaic whose pixels see the channel of their
        filter with the relative responses ``bayer_response`` (red, green, blue).
    channels : "mono": pictures (H, W); "rgb": (H, W, 3), of three chips, or of one with ``bayer``
        and ``demosaic``.
    sensitivities : in the bands red, green, blue of a coloured frame. 3 numbers of a mono sensor (a
        third each by default), or 3 rows of 3, a channel each, of a colour sensor or mosaic
        (by default each channel sees its band).
    white_balance : gains of red, green and blue above the black level, on digital numbers with
        their noise, then clipped; `gpusim.optics.sensor.development`.
    demosaic : "bilinear" or "malvar" (`gpusim.optics.sensor.demosaicing`), after white balance;
        makes a mosaic (H, W, 3). None leaves it raw.

    Raises
    ------
    InputError
        Values out of range, noise in electrons without a gain, or what doesn't go together.

    Examples
    --------
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (3, 2), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> gs.Sensor(bits=8).expose(gs.render([wall], camera, backend="numpy"))
    array([[128, 128, 128],
           [128, 128, 128]], dtype=uint8)
    """

    bits: Annotated[int, within(8, 16)] = 8
    full_scale: Annotated[float, positive("a radiance above 0")] = 1.0
    gain: Positive | None = None
    full_well: Positive | None = None
    read_noise: FromZero = 0.0
    dark_current: FromZero = 0.0
    exposure_time: FromZero = 0.0
    dsnu: FromZero = 0.0
    prnu: FromZero = 0.0
    black_level: FromZero = 0.0
    quantum_efficiency: Portion = 1.0
    gamma: Positive | Annotated[str, one_of("srgb")] = 1.0
    bayer: Annotated[str, one_of(*sorted(TILES))] | None = None
    bayer_response: Response = (1.0, 1.0, 1.0)
    channels: Annotated[str, one_of("mono", "rgb")] = "mono"
    sensitivities: Sequence[float] | Sequence[Sequence[float]] | None = None
    white_balance: tuple[float, float, float] | None = None
    demosaic: str | None = None

    def __post_init__(self) -> None:
        full = 2**self.bits - 1
        dark = self.black_level < full
        require(dark, "Sensor black_level", self.black_level, f"below {full}")
        for key in ("read_noise", "dark_current", "dsnu", "prnu"):
            value = getattr(self, key)
            counted = self.noisy or value == 0.0
            expected = "one of them: noise is counted in electrons"
            require(counted, f"Sensor {key}", f"{value} without gain and full_well", expected)
        self._check_color()

    def _check_color(self) -> None:
        methods = f"one of {sorted(METHODS)}"
        fits = self.demosaic is None or (self.demosaic in METHODS and self.bayer is not None)
        got = f"{self.demosaic!r} with bayer {self.bayer!r}"
        require(fits, "Sensor demosaic", got, f"{methods}, and a bayer pattern")
        fits = self.bayer is None or (self.channels == "rgb") == (self.demosaic is not None)
        got = f"{self.demosaic!r} with channels {self.channels!r} and bayer {self.bayer!r}"
        expected = f"{methods} with channels 'rgb', none with 'mono': a raw mosaic"
        require(fits, "Sensor demosaic", got, expected)
        if self.sensitivities is not None:
            rows = check_sensitivities(self.sensitivities, self._filtered)
            object.__setattr__(self, "sensitivities", rows if self._filtered else rows[0])
        if self.white_balance is not None:
            gains = check_gains(self.white_balance, self._filtered)
            object.__setattr__(self, "white_balance", gains)

    @staticmethod
    def preset(name: str, **changes: Any) -> Sensor:
        """A real camera (`gpusim.optics.sensor.emva1288`), with some values changed."""
        require(name in CAMERAS, "Sensor preset", repr(name), f"one of {sorted(CAMERAS)}")
        values = dict(CAMERAS[name].values)
        bits = changes.get("bits", values["bits"])
        if "gain" in values and "gain" not in changes and "full_well" not in changes:
            # grey values per electron grow with the number of grey values
            values["gain"] = values["gain"] * (2**bits - 1) / (2 ** values["bits"] - 1)
        return Sensor(**(values | changes))

    @staticmethod
    def auto_exposed(frame: Frame, bits: int = 8, like: Sensor | None = None) -> Sensor:
        """A sensor exposed so that the brightest pixel of ``frame`` is at 95 % of full scale, or of
        the full well where that is reached first; in colour, that of the brightest channel.

        The maximum, not a quantile: the white of small markers is the first to saturate, and a
        clipped edge moves. Radiance has no noise, so that no outlier can decide. ``like`` gives
        everything but the exposure.
        """
        sensor = Sensor(bits) if like is None else like
        level = 0.0
        for channel, row in enumerate(sensor._sensitivities):
            lift = max(sensor._gains[channel], 1.0)  # what is lowered is cut off before
            if sensor.bayer is not None:
                lift *= sensor.bayer_response[channel]
            with seen(frame, weights_of(row, frame)) as plane:
                level = max(level, plane.brightest() * lift)
        if not level > 0.0:
            raise InputError("auto exposure: the frame is black; got radiance 0; add a light")
        return replace(sensor, full_scale=level / (AUTO_LEVEL * sensor._filled))

    @checked
    def metered(
        self,
        pixel: Positive,
        f_number: Positive,
        exposure_time: Positive,
        wavelength: Positive = 550e-9,
        magnification: FromZero = 0.0,
    ) -> Sensor:
        """This sensor behind a lens, for radiance in W / (m2 sr): its ``full_scale`` follows.

        Irradiance on the sensor is pi L / (4 N^2 (1 + magnification)^2); a photon carries
        h c / wavelength; ``pixel`` (side), wavelength in m, ``exposure_time`` in s.
        """
        require(self.noisy, "Sensor metered", "no gain and no full_well", "one of them")
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
        """The grey value, DN, that a pixel gets no brighter than (but for noise in its readout):
        the full well or the largest digital number, whichever is reached first; in colour that of
        the channel that gets brightest."""
        return int(self._tops.max())

    @property
    def _tops(self) -> npt.NDArray[Any]:
        """(2, 2) or (2, 2, 3): the same of the pixels of a tile."""
        full = float(2**self.bits - 1)
        share = (self.black_level + self._filled * (full - self.black_level)) / full
        shape = (2, 2, 3) if self.channels == "rgb" and self.bayer is None else (2, 2)
        if self._development is not None:
            return self._development.picture(np.full(shape, share * (2**RAW_BITS - 1)))
        return np.full(shape, round(full * float(share ** (1.0 / float(self.gamma)))))

    def saturated(self, image: npt.NDArray[Any]) -> Bool:
        """Which pixels of an image that it took are as bright as they get, of the image's shape."""
        return at_least(image, self._tops)

    @property
    def _filtered(self) -> bool:
        """Whether pixels lie behind filters of red, green and blue."""
        return self.channels == "rgb" or self.bayer is not None

    @property
    def _sensitivities(self) -> tuple[Weights, ...]:
        """A row of three for every channel."""
        return check_sensitivities(self.sensitivities, self._filtered)

    @property
    def _gains(self) -> tuple[float, float, float]:
        return (1.0, 1.0, 1.0) if self.white_balance is None else self.white_balance

    @property
    def _development(self) -> Development | None:
        """What is made of raw numbers; None where they are the picture."""
        if self._gains == (1.0, 1.0, 1.0) and self.demosaic is None and self.gamma != "srgb":
            return None
        black = self.black_level / (2**self.bits - 1)
        return Development(self.bits, black, self._gains, self.bayer, self.demosaic, self.gamma)

    @property
    def _raw(self) -> Sensor:
        """The sensor whose linear numbers are developed."""
        finer = (2**RAW_BITS - 1) / (2**self.bits - 1)
        return replace(
            self,
            bits=RAW_BITS,
            gain=None if self.gain is None else finer * self.gain,
            black_level=finer * self.black_level,
            gamma=1.0,
            white_balance=None,
            channels="mono" if self.bayer is not None else self.channels,
            demosaic=None,
        )

    @property
    def dtype(self) -> np.dtype[Any]:
        """uint8 up to 8 bits, else uint16."""
        return np.dtype(np.uint8 if self.bits <= 8 else np.uint16)

    @property
    def scale(self) -> np.float32:
        """Digital numbers per unit of radiance."""
        return np.float32((2**self.bits - 1 - self.black_level) / self.full_scale)

    def signal(
        self, seed: int = 0, number: int = 0, camera: str = "", chip: int = 0
    ) -> Signal | None:
        """What the noise stage works with; None for a sensor that only scales. Of several, every
        ``chip`` has noise of its own."""
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
            gamma=1.0 if self.gamma == "srgb" else float(self.gamma),
            tile=(tile[0], tile[1], tile[2], tile[3]),
            seed=seed & 0xFFFFFFFF,
            camera=(crc32(camera.encode(), chip) ^ (seed >> 32)) & 0xFFFFFFFF,
            frame=number & 0xFFFFFFFF,
        )

    def expose(
        self, frame: Frame, seed: int = 0, number: int = 0, camera: str | None = None
    ) -> npt.NDArray[Any]:
        """The image of ``frame``, (H, W) or (H, W, 3) uint8 or uint16.

        Noise is that of (``seed``, ``camera``, ``number``), where ``camera`` is the name of the
        frame's camera unless given; DSNU and PRNU stay the same for every frame ``number``.

        Raises
        ------
        InputError
            Something else than a frame, or a seed or number that isn't whole or is below 0.
        """
        got = f"a {type(frame).__name__}"
        require(isinstance(frame, Frame), "Sensor expose", got, "a Frame")
        for key, value in (("seed", seed), ("number", number)):
            whole = isinstance(value, int | np.integer) and value >= 0
            require(whole, f"Sensor expose {key}", value, "a whole number >= 0")
        name = frame.view.camera.name if camera is None else camera
        if self._development is not None:
            return self._development.picture(self._raw.expose(frame, seed, number, name))
        weights = [weights_of(row, frame) for row in self._sensitivities]
        if self.bayer is not None:  # the same chip through three filters
            signal = self.signal(seed, number, name)
            taken = {own: self._taken(frame, own, signal) for own in dict.fromkeys(weights)}
            return picked([taken[own] for own in weights], self.bayer)
        if self.channels == "mono":
            return self._taken(frame, weights[0], self.signal(seed, number, name))
        signals = (self.signal(seed, number, name, chip) for chip in (1, 2, 3))
        chips = [self._taken(frame, *each) for each in zip(weights, signals, strict=True)]
        return np.asarray(cv2.merge(chips))

    def _taken(self, frame: Frame, weights: Weights, signal: Signal | None) -> npt.NDArray[Any]:
        """The image (H, W) of one channel."""
        with seen(frame, weights) as plane:
            if plane.device is None or not plane.bands:  # made by the twin, or released
                if signal is not None:
                    return emva_twin(signal, plane.radiance).astype(self.dtype)
                return scaled_twin(self, plane.radiance)
            device, width = plane.device, plane.width
            if signal is None:
                return scaled_on_device(self, device, plane.bands, width)
            rows = [expose_noisy(device, signal, b, width, self.dtype) for b in plane.bands]
            return np.concatenate(rows)
