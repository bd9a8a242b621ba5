"""Whether an image must be the same as one before, as nothing has moved between the two."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.surface.surface import Surface


def same_surfaces(before: Sequence[Surface], after: Sequence[Surface]) -> bool:
    """Whether nothing at all has moved."""
    return len(before) == len(after) and all(
        a is b or (_alike(a, b) and np.array_equal(a.points, b.points))
        for a, b in zip(before, after, strict=True)
    )


def _alike(a: Surface, b: Surface) -> bool:
    """The same faces and paint, wherever they are."""
    return (
        a.points.shape == b.points.shape
        and (a.faces is b.faces or np.array_equal(a.faces, b.faces))
        and (a.rest is b.rest or np.array_equal(a.rest, b.rest))
        and (a.regions is b.regions or np.array_equal(a.regions, b.regions))
        and list(a.paints) == list(b.paints)
        and all(p is q for p, q in zip(a.paints.values(), b.paints.values(), strict=True))
    )
