"""Images: cameras, lights, visibility, closed-form shading, sensor and ground truth."""

from gpusim.optics.camera import Camera
from gpusim.optics.frame import Frame
from gpusim.optics.light import (
    AmbientLight,
    AreaLight,
    PointLight,
    SpotLight,
    SunLight,
)
from gpusim.optics.render import render
from gpusim.optics.sensor import Sensor
from gpusim.optics.truth import Truth

__all__ = [
    "AmbientLight",
    "AreaLight",
    "Camera",
    "Frame",
    "PointLight",
    "Sensor",
    "SpotLight",
    "SunLight",
    "Truth",
    "render",
]
