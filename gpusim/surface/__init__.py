"""What cameras see: surfaces, their paint, and the skin of a finite-element mesh."""

from gpusim.surface import paint
from gpusim.surface.frames import Atlas, CylinderFrame
from gpusim.surface.skin import Skin
from gpusim.surface.surface import PaintFrame, Surface

__all__ = ["Atlas", "CylinderFrame", "PaintFrame", "Skin", "Surface", "paint"]


def __dir__() -> list[str]:
    return sorted(__all__)
