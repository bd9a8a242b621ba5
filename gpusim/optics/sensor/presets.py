"""Real cameras, as measured by EMVA 1288 and published."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

__all__ = ["CAMERAS", "Preset"]


@dataclass(frozen=True)
class Preset:
    """Values of a `gpusim.optics.sensor.sensor.Sensor`, and where they come from."""

    values: dict[str, Any]
    source: str


CAMERAS = {
    "stereo-dic-5mp": Preset(
        {
            "bits": 8,
            "gain": 1.0 / 124.0,
            "full_well": 32_000.0,
            # 0.07 DN^2 of temporal dark noise
            "read_noise": 124.0 * 0.07**0.5,
        },
        "photon transfer of a 5 megapixel stereo-DIC camera: 124 electrons per DN at 8 bit, full "
        "well 32,000 electrons, dark noise 0.07 DN^2",
    ),
    "imx174": Preset(
        {
            "bits": 12,
            "full_well": 32_691.0,
            "read_noise": 6.83,
            "quantum_efficiency": 0.77,
        },
        "Sony IMX174 (2.3 megapixels, 5.86 um) as published for Point Grey's Grasshopper3 "
        "GS3-U3-23S6M by EMVA 1288: quantum efficiency 77 % at 525 nm, temporal dark noise 6.83 "
        "electrons, saturation capacity 32,691 electrons",
    ),
    "icx625-pilot": Preset(
        {
            "bits": 12,
            "full_well": 7_000.0,
            "read_noise": 13.0,
            "quantum_efficiency": 0.47,
        },
        "Sony ICX625 (5 megapixels, 3.45 um) in Basler's piA2400-17gm, EMVA 1288: quantum "
        "efficiency 47 % at 545 nm, temporal dark noise 13 electrons, saturation capacity 7,000 "
        "electrons",
    ),
    "icx625-grasshopper": Preset(
        {
            "bits": 12,
            "full_well": 5_903.0,
            "read_noise": 8.28,
            "quantum_efficiency": 0.57,
        },
        "Sony ICX625 (5 megapixels, 3.45 um) in Point Grey's GS3-PGE-50S5M, EMVA 1288: quantum "
        "efficiency 57 % at 525 nm, temporal dark noise 8.28 electrons, saturation capacity 5,903 "
        "electrons",
    ),
}
