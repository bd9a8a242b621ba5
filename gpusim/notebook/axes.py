"""matplotlib's axes, of two and three dimensions, and shaded faces in these."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.arrays.array_types import Float, Int
from gpusim.surface.frames import face_normals
from gpusim.validation import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

METAL = (0.42, 0.52, 0.62)
"""Linear; of what has no paint."""
_LAMP = np.array([-0.3, -0.6, 0.74])
_METAL = "#a9bbc9"
_SIZE = (7.6, 4.6)  # inches
_ELEVATION, _AZIMUTH = 24.0, -58.0  # degrees


def flat_axes(ax: Axes | None) -> Axes:
    """``ax``, or that of a new figure, which a notebook shows at the end of the cell."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    axes: Axes = pyplot.subplots(layout="constrained")[1]
    return axes


def space_axes(ax: Axes | None, unit: str) -> Any:
    """``ax``, or new axes of three dimensions, labelled in ``unit``. Raises InputError for flat
    axes."""
    if ax is None:
        from matplotlib import pyplot

        ax = pyplot.figure(figsize=_SIZE).add_subplot(projection="3d")
    space: Any = ax
    deep = getattr(space, "name", "") == "3d"
    expected = "three: plt.figure().add_subplot(projection='3d')"
    require(deep, "plot: ax", "axes of two dimensions", expected)
    space.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})", zlabel=f"z ({unit})")
    space.view_init(_ELEVATION, _AZIMUTH)
    return space


def draw_faces(space: Any, points: Float, faces: Int, colours: Any = _METAL, **style: Any) -> None:
    """Add faces (F, 4), triangles of which end with -1, in one colour or (F, 4) of them."""
    from matplotlib.colors import to_rgba_array
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    corner = np.where(faces < 0, faces[:, [2, 2, 2, 2]], faces)
    normal = face_normals(points, faces)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    light = 0.72 + 0.28 * (normal @ _LAMP)
    rgba = np.array(np.broadcast_to(to_rgba_array(style.pop("color", colours)), (len(faces), 4)))
    rgba[:, :3] *= light[:, None]
    own = {"linewidth": 0.3 if len(faces) < 4000 else 0.0, "edgecolor": (0.1, 0.15, 0.2, 0.6)}
    if not {"linewidth", "edgecolor"} & set(style) and not own["linewidth"]:
        own["edgecolor"] = rgba  # without gaps between faces
    space.add_collection3d(Poly3DCollection(points[corner], facecolor=rgba, **{**own, **style}))
    _frame(space, points)


def _frame(space: Any, points: Float) -> None:
    """Limits around all that there is, lengths alike along all axes, and ticks that fit."""
    from matplotlib.ticker import MaxNLocator

    limits = [points.min(axis=0), points.max(axis=0)]
    if len(space.collections) > 1:
        limits.append(np.array([space.get_xlim(), space.get_ylim(), space.get_zlim()]).T)
    low, high = np.vstack(limits).min(axis=0), np.vstack(limits).max(axis=0)
    longest = float((high - low).max())
    thin = np.maximum(0.12 * longest - (high - low), 0.0)  # room for a tick label
    low, high = low - 0.5 * thin, high + 0.5 * thin
    space.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    space.set_box_aspect(high - low, zoom=1.1)
    for axis, side in zip((space.xaxis, space.yaxis, space.zaxis), high - low, strict=True):
        share = side / longest
        axis.set_major_locator(MaxNLocator(max(1, round(5 * share)), steps=[1, 2, 5, 10]))
        axis.labelpad = 14.0 if share > 0.5 else 4.0
