"""The colour of what glows: Planck's spectrum as the CIE 1931 standard observer sees it."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from gpusim.validation import checked, within

Temperature = Annotated[float, within(800.0, 40_000.0, "K")]
SECOND_CONSTANT = 1.438776877e-2
"""m K; h c / k (CODATA 2018)."""
WAVELENGTHS = 1e-9 * np.arange(380.0, 771.0, 10.0)

# ISO/CIE 11664-1: x, y, z at the wavelengths; four decimals
OBSERVER = np.array([
    [.0014, .0042, .0143, .0435, .1344, .2839, .3483, .3362, .2908, .1954, .0956, .0320, .0049,
     .0093, .0633, .1655, .2904, .4334, .5945, .7621, .9163, 1.0263, 1.0622, 1.0026, .8544, .6424,
     .4479, .2835, .1649, .0874, .0468, .0227, .0114, .0058, .0029, .0014, .0007, .0003, .0002,
     .0001],
    [.0000, .0001, .0004, .0012, .0040, .0116, .0230, .0380, .0600, .0910, .1390, .2080, .3230,
     .5030, .7100, .8620, .9540, .9950, .9950, .9520, .8700, .7570, .6310, .5030, .3810, .2650,
     .1750, .1070, .0610, .0320, .0170, .0082, .0041, .0021, .0010, .0005, .0002, .0001, .0001,
     .0000],
    [.0065, .0201, .0679, .2074, .6456, 1.3856, 1.7471, 1.7721, 1.6692, 1.2876, .8130, .4652,
     .2720, .1582, .0782, .0422, .0203, .0087, .0039, .0021, .0017, .0011, .0008, .0003, .0002,
     *[.0] * 15],
])  # fmt: skip

XYZ_OF_RGB = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
"""IEC 61966-2-1."""


@checked
def blackbody(temperature: Temperature) -> tuple[float, float, float]:
    """The colour of light of a temperature (K, 800 to 40,000): red, green, blue with a mean of 1.

    Linear, in the primaries of sRGB, whose white is daylight of about 6500 K; what lies beyond
    their triangle (blue of incandescent light below 1,900 K) is set to 0. Its chromaticity is
    within 2e-4 of published values (Wyszecki and Stiles, "Color Science", 2nd ed., 1982) from
    1,000 to 10,000 K.

    Raises
    ------
    InputError
        Another temperature.

    Examples
    --------
    >>> print(*(f"{value:.3f}" for value in gs.blackbody(2856.0)))
    1.906 0.854 0.241
    >>> gs.PointLight((0, 0, 3), power=60.0, color=gs.blackbody(6504)).colored
    True
    """
    rgb = np.maximum(np.linalg.solve(XYZ_OF_RGB, tristimulus(temperature)), 0.0)
    red, green, blue = (rgb / rgb.mean()).tolist()
    return red, green, blue


def tristimulus(temperature: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """X, Y, Z (3,) of Planck's spectrum, in any scale."""
    exponent = SECOND_CONSTANT / (WAVELENGTHS * temperature)
    # relative to 560 nm, so that cold spectra stay in range
    spectrum = (WAVELENGTHS / 560e-9) ** -5.0 * np.exp(-exponent) / -np.expm1(-exponent)
    return np.asarray(OBSERVER @ (spectrum / spectrum.max()))
