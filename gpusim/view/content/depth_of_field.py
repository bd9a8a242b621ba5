"""Depths between which a camera is sharp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.lens.thin_lens import Lens


@dataclass(frozen=True)
class DepthOfField:
    """Depths between which a point is blurred to a disc of at most ``blur`` px, m; ``far`` may be
    infinite. ``focus``: the depth that is sharp."""

    near: float
    far: float
    focus: float
    blur: float

    def blur_at(self, depth: float) -> float:
        """Diameter of the disc that a point at a depth is blurred to, px."""
        nearest = 1.0 / self.near - 1.0 / self.focus
        return self.blur * abs(1.0 / depth - 1.0 / self.focus) / nearest

    def describe(self) -> str:
        """For people.

        Examples
        --------
        >>> from gpusim.view.content.depth_of_field import DepthOfField
        >>> DepthOfField(0.95, 1.06, 1.0, 1.0).describe()
        'sharp within 1 px from 950 to 1060 mm, focus at 1000 mm'
        """
        far = "infinity" if np.isinf(self.far) else f"{1e3 * self.far:.4g} mm"
        limits = f"sharp within {self.blur:g} px from {1e3 * self.near:.4g} to {far}"
        return f"{limits}, focus at {1e3 * self.focus:.4g} mm"


def depth_of_field(camera: Camera, lens: Lens | None, blur: float = 1.0) -> DepthOfField | None:
    """The depth of field of a camera for discs of ``blur`` px; None for a pinhole.

    The disc of a point at depth d has f A |1/d - 1/s| px, with the aperture A, the focus s and the
    focal length f in px (`gpusim.optics.lens.thin_lens`).

    Examples
    --------
    >>> from gpusim.view.content.depth_of_field import depth_of_field
    >>> camera = gs.Camera.from_lens((36, 24), 50, (3600, 2400), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> lens = gs.Lens(f_number=8.0, focal_length=0.05, focus_distance=2.0)
    >>> found = depth_of_field(camera, lens)
    >>> round(found.near, 4), round(found.far, 4)
    (1.8797, 2.1368)
    """
    if lens is None or not lens.aperture or lens.focus_distance is None:
        return None
    step = blur / (max(camera.K[0, 0], camera.K[1, 1]) * lens.aperture)
    inverse = 1.0 / lens.focus_distance
    far = 1.0 / (inverse - step) if inverse > step else float("inf")
    return DepthOfField(1.0 / (inverse + step), far, lens.focus_distance, blur)
