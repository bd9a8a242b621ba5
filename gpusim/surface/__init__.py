"""What cameras see: surfaces, their paint, and the skin of a finite-element mesh."""

from gpusim.surface import paint
from gpusim.surface.skin import Skin
from gpusim.surface.surface import PaintFrame, Surface

__all__ = ["PaintFrame", "Skin", "Surface", "paint"]
