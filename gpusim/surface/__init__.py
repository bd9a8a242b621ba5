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

from gpusim.public_names import public_names as _public_names
from gpusim.surface import paint as paint
from gpusim.surface.frames import Atlas as Atlas
from gpusim.surface.frames import CylinderFrame as CylinderFrame
from gpusim.surface.skin import Skin as Skin
from gpusim.surface.surface import PaintFrame as PaintFrame
from gpusim.surface.surface import Surface as Surface

__all__, __getattr__, __dir__ = _public_names(__name__, {__name__: "paint"})
