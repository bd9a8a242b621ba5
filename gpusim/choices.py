"""What scenes, commands and functions let users choose from by a word, where they share it."""

from __future__ import annotations

from typing import Literal

Shape = Literal["translation", "rigid", "affine", "quadratic"]
"""How a subset may deform."""
Update = Literal["never", "auto", "always"]
"""When the reference of a series is renewed."""
Start = Literal["auto", "search", "features"]
"""How the motion is found first."""
StrainKind = Literal["small", "green-lagrange", "hencky", "almansi"]
SurfaceStrain = Literal["green-lagrange", "hencky"]
LensModel = Literal[
    "pinhole", "radial", "radial3", "radtan", "brown", "rational", "prism", "tilted"
]
"""What a calibration is to find: no distortion, k1 k2, + k3, + p1 p2, + k4..k6, + s1..s4, + tau."""
LengthUnit = Literal["m", "cm", "mm", "um", "in"]
