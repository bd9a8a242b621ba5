"""Images: cameras, lights, visibility, closed-form shading, sensor and ground truth."""

from gpusim.optics import psf
from gpusim.optics.camera import Camera
from gpusim.optics.frame import Frame
from gpusim.optics.lens import Lens
from gpusim.optics.light import (
    AmbientLight,
    AreaLight,
    EnvironmentLight,
    PointLight,
    SpotLight,
    SunLight,
)
from gpusim.optics.photograph import photograph
from gpusim.optics.render import render
from gpusim.optics.sensor import Sensor
from gpusim.optics.shutter import Shutter
from gpusim.optics.truth import Truth
from gpusim.optics.vignette import Vignetting

__all__ = [
    "AmbientLight",
    "AreaLight",
    "Camera",
    "EnvironmentLight",
    "Frame",
    "Lens",
    "PointLight",
    "Sensor",
    "Shutter",
    "SpotLight",
    "SunLight",
    "Truth",
    "Vignetting",
    "photograph",
    "psf",
    "render",
]
