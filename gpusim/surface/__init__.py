"""What cameras see: surfaces, their paint, and the skin of a finite-element mesh.

In the order in which data passes:

- `color`: Colour: a grey number, or the three linear numbers red, green and blue.
- `features`: What the renderer needs of a paint: a ground albedo, the shapes on it, and its fine
  relief.
- `fiducials`: ArUco and AprilTag markers, ChArUco boards, ring codes.
- `speckle`: Random discs of paint.
- `texture`: Pictures laid by the texture coordinates of a file.
- `bitmap`: A bitmap as paint.
- `paint`: All paints, and those of plain shapes: boards, dots, lines, circles, stars.
- `frames`: Paint coordinates of regions: of a plane, round a cylinder, or of any surface unfolded.
- `topology`: What a surface's triangles share, found once and kept for every frame and camera.
- `surface`: Points, faces, and paint that sticks to the undeformed material.
- `skin`: The skin of a finite-element mesh as a surface: boundary faces, cut into flat pieces.
"""

from gpusim.surface import paint
from gpusim.surface.frames import Atlas, CylinderFrame
from gpusim.surface.skin import Skin
from gpusim.surface.surface import PaintFrame, Surface

__all__ = ["Atlas", "CylinderFrame", "PaintFrame", "Skin", "Surface", "paint"]


def __dir__() -> list[str]:
    return sorted(__all__)
