"""The samples in which receivers look at a lamp, the bits of a mask.

Seen from a receiver at the origin, a face with corners D_k hides the direction L if L lies on the
same side of all planes through the receiver and its edges: sign((D_k x D_k+1) . L) is that of the
face's own side. Along a row of samples on the lamp this is linear, so that each face covers an
interval of 32 bits (Eisemann and Decoret, "Visibility sampling on GPU and applications", 2007, with
exact outlines in place of a table). Nothing is biased: of closed bodies only faces whose outside
looks at the receiver can begin a shadow, so that no surface shadows itself, and contacts are exact:
a receiver in a face's plane is hidden by it if the two look at each other, as a floor is under a
box (samples of a pixel beside the box reach there).

The 512 samples are a lattice: 512 distinct places along either side of the lamp. Each of the 16
rows looks from another place in the pixel, so that a shadow sharper than a pixel is filtered as
its edges are; a lamp without size uses the whole lattice for that. Where the plane of an open
surface's face passes through the pixel or the halves of those around it, at no more than 60 degrees
to the receiver's, all rows look from its middle: what the receiver's plane goes on to beyond an
edge may lie behind the next faces.

``shaders/lib/shadow/sample_mask.wgsl`` has the same lattice, and which samples lie on one side of a
plane; that in NumPy is `gpusim.optics.shadow.brute_force.EdgeFunctions.hidden`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.optics.light.quadrature import Lamp

ROWS, COLUMNS = 16, 32
SAMPLES = ROWS * COLUMNS
STEP_A, STEP_B = 2.0 / COLUMNS, 2.0 / SAMPLES

SHIFT = (14, 8, 2, 12, 6, 0, 10, 4, 11, 5, 15, 9, 3, 13, 7, 1)
OFFSET = (13, 8, 1, 15, 4, 6, 14, 2, 3, 9, 12, 7, 0, 10, 5, 11)
STRIP = (0, 2, 4, 6, 8, 10, 12, 14, 1, 3, 5, 7, 9, 11, 13, 15)
"""Places of the rows of samples, from a search for the least errors over lamp and pixel: of edges
in all directions, of penumbrae of all widths, of those along the lamp's sides above all."""


def lattice() -> Float:
    """(16, 4): -a or a and b (-1 to 1) of the first sample of each row, the pixel offset in x that
    the row looks from, and the direction (1 or -1) that a takes along it (of a lamp with a size).

    Sample c of a row lies ``STEP_A`` c further along a and ``STEP_B`` c in b. On its way the offset
    in y goes once through the pixel, so that no strip of the lamp is looked at from one side.
    """
    row = np.arange(ROWS)
    return np.stack(
        [
            STEP_A * (np.array(SHIFT) + 0.5) / ROWS - 1.0,
            2.0 * (np.array(STRIP) + 0.5 / COLUMNS) / ROWS - 1.0,
            (np.array(OFFSET) + 0.5) / ROWS - 0.5,
            np.where(row < ROWS // 2, 1.0, -1.0),
        ],
        axis=1,
    )


def lamp_masks(lamp: Lamp) -> npt.NDArray[np.uint32]:
    """(16,) words: the samples of the lattice that lie on the lamp's face."""
    if not lamp.round or not lamp.extended:
        return np.full(ROWS, 0xFFFFFFFF, np.uint32)
    column = np.arange(COLUMNS)
    a = lattice()[:, :1] + STEP_A * column
    b = lattice()[:, 1:2] + STEP_B * column
    bits = ((a * a + b * b <= 1.0) * (1 << column.astype(np.uint64))).sum(axis=1)
    result: npt.NDArray[np.uint32] = bits.astype(np.uint32)
    return result
