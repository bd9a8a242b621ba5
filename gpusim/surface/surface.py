"""A textured surface: points, faces, and paint that sticks to the undeformed material."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.display import notebook_html, plotted
from gpusim.errors import InputError
from gpusim.mesh.polygons import cut_at_dents
from gpusim.surface.color import in_band
from gpusim.surface.frames import Frame, PaintFrame, face_normals, plane_frame, used_vertices
from gpusim.surface.paint import Paint, Plain
from gpusim.surface.topology import Topology, triangulate
from gpusim.validation import Rule, checked, require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["PaintFrame", "Surface", "face_normals", "plane_frame", "triangulate"]


HalfTurn = Annotated[float, Rule("0 to pi (rad)", lambda angle: 0.0 <= angle <= np.pi)]


@checked
@dataclass(frozen=True, eq=False)
class Surface:
    """Faces to be seen by cameras.

    Parameters
    ----------
    points : (P, 3) float64, where the vertices are now, in any unit of length.
    faces : (F, 3) or (F, 4) int, vertex numbers counter-clockwise seen from outside; a triangle
        among quadrilaterals ends with -1. A quadrilateral with a dent becomes two triangles.
    paint : one paint for all, or one per region name.
    region : (F,) int, index into the paints in the mapping's order; needed with several paints.
    reference : (P, 3) float64, undeformed positions, which the paint sticks to; default: points.
    frames : paint coordinates per region name; default: `PaintFrame.facing` of the region's plane.
    smooth_angle : rad; edges that turn more are creases, others are shaded smoothly.

    Raises
    ------
    InputError
        Wrong shapes, indices out of range, values that aren't finite, faces without area, unknown
        regions, or a pattern on a region that isn't plane.

    Examples
    --------
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> float(wall.moved(wall.points + [0, 0, 0.1]).rest[:, 2].max())
    0.0
    """

    points: Float
    faces: Int
    paint: Paint | Mapping[str, Paint] = field(default_factory=Plain)
    region: Int | None = None
    reference: Float | None = None
    frames: Mapping[str, Frame] = field(default_factory=dict)
    smooth_angle: HalfTurn = np.pi / 6
    name: str = "surface"

    def __post_init__(self) -> None:
        where = f"Surface {self.name!r}"
        points = _points(self.points, f"{where} points")
        reference = points
        if self.reference is not None:
            reference = _points(self.reference, f"{where} reference")
            fits = reference.shape == points.shape
            require(fits, f"{where} reference", reference.shape, f"{points.shape}")
        faces = _faces(self.faces, reference, where)
        paints = self.paint if isinstance(self.paint, Mapping) else {"surface": self.paint}
        if not paints or not all(map(_is_paint, paints.values())):
            raise InputError(
                f"{where} paint; got {self.paint!r}; expected a Paint or at least one by region"
            )
        region = np.zeros(len(faces), np.int32) if self.region is None else np.asarray(self.region)
        integers = region.dtype.kind in "iu"
        require(integers, f"{where} region", f"dtype {region.dtype}", "integers")
        given = self.region is not None or len(paints) == 1
        require(given, f"{where} region", f"None with {len(paints)} paints", "(F,)")
        low, high = region.min(initial=0), region.max(initial=0)
        fits = region.shape == (len(faces),) and low >= 0 and high < len(paints)
        got = f"shape {region.shape}, values {low} to {high}"
        require(fits, f"{where} region", got, f"({len(faces)},) with 0 to {len(paints) - 1}")
        cut, whole = cut_at_dents(reference, faces)
        region = region[whole]
        if not isinstance(self.frames, Mapping):
            raise InputError(f"{where} frames; got {self.frames!r}; expected a mapping by region")
        unknown = sorted(set(self.frames) - set(paints))
        require(not unknown, f"{where} frames", f"regions {unknown}", f"{sorted(paints)}")
        for key, value in (
            ("points", points),
            ("reference", reference),
            ("faces", cut.astype(np.int32)),
            ("region", region.astype(np.int32)),
            ("paint", dict(paints)),
        ):
            object.__setattr__(self, key, value)

    def __repr__(self) -> str:
        """Counts, not arrays."""
        painted = ", ".join(f"{key}: {type(paint).__name__}" for key, paint in self.paints.items())
        counts = f"{len(self.points)} points, {len(self.faces)} faces"
        return f"Surface({self.name!r}, {counts}, {painted})"

    def _repr_html_(self) -> str | None:
        return notebook_html("surface", self)

    def plot(self, ax: Axes | None = None, *, unit: str = "m", **style: Any) -> Axes:
        """Draw the faces in matplotlib's axes of three dimensions, each in its paint's ground.

        ``unit`` is what labels call the unit of length; ``style`` goes to ``Poly3DCollection``.
        Returns the axes, new ones unless given.
        """
        return plotted("surface", self, ax, unit=unit, **style)

    @property
    def paints(self) -> dict[str, Paint]:
        """Paint per region name, in region order."""
        assert isinstance(self.paint, dict)
        return self.paint

    @property
    def regions(self) -> Int:
        """Region index of every face."""
        assert self.region is not None
        return self.region

    @property
    def rest(self) -> Float:
        """Undeformed positions of the vertices."""
        assert self.reference is not None
        return self.reference

    @cached_property
    def topology(self) -> Topology:
        """Triangles and edges; found once and shared by all that `moved` makes."""
        return Topology.of(self.faces)

    @cached_property
    def inside_out(self) -> bool:
        """Whether it is closed and encloses, undeformed, a negative volume."""
        if not self.topology.closed:
            return False
        middle = self.rest.mean(axis=0)
        a, b, c = (self.rest[self.topology.triangles[:, k]] - middle for k in range(3))
        return bool(np.einsum("ij,ij->", a, np.cross(b, c)) < 0.0)

    @cached_property
    def extents(self) -> dict[int, tuple[Float, Float]]:
        """Lowest and highest paint coordinates (2,) of the regions that carry a pattern."""
        result = {}
        for region, paint in enumerate(self.paints.values()):
            topology = self.topology
            own = np.flatnonzero(self.regions[topology.source] == region)
            if len(own) and _has_pattern(paint):
                frame = self.paint_frame(region)
                if isinstance(frame, PaintFrame):
                    used = used_vertices(topology.triangles[own], len(self.rest))
                    st = frame.coordinates(self.rest[used])
                else:
                    st = frame.of_triangles(self.rest[topology.triangles[own]], own)
                    st = st.reshape(-1, 2)
                result[region] = st.min(axis=0), st.max(axis=0)
        return result

    def moved(self, points: Float) -> Surface:
        """The same surface with its vertices at ``points``; the paint stays on the material."""
        now = _points(points, f"Surface {self.name!r} points")
        same = now.shape == self.rest.shape
        require(same, f"Surface {self.name!r} points", now.shape, f"{self.rest.shape}")
        return self._changed(points=now, frames=self._all_frames())

    def relative_to(self, origin: Float) -> Surface:
        """The same surface seen from ``origin`` (3,); its undeformed shape and paint stay."""
        return self._changed(points=self.points - origin)

    def _changed(self, **values: Any) -> Surface:
        """A copy with other ``values``; what was found for the shape at rest isn't done again."""
        _ = self.topology, self.extents, self.inside_out, self._found_frames
        result = copy.copy(self)
        for name, value in values.items():
            object.__setattr__(result, name, value)
        return result

    def paint_frame(self, region: int) -> Frame:
        """The paint coordinates of a region, given or made from its (plane) faces."""
        name = list(self.paints)[region]
        if name in self.frames:
            return self.frames[name]
        if region not in self._found_frames:
            where, own = f"Surface {self.name!r} region {name!r}", self.regions == region
            self._found_frames[region] = plane_frame(self.rest, self.faces[own], where)
        found: Frame = self._found_frames[region]
        return found

    @cached_property
    def _found_frames(self) -> dict[int, Frame]:
        return {}

    def _all_frames(self) -> dict[str, Frame]:
        frames = dict(self.frames)
        for index, (name, paint) in enumerate(self.paints.items()):
            if name in frames or not (self.regions == index).any():
                continue
            if _has_pattern(paint):
                frames[name] = self.paint_frame(index)
        return frames


def _is_paint(value: object) -> bool:
    return hasattr(value, "ground") and not isinstance(value, type)


def _has_pattern(paint: Paint) -> bool:
    return in_band(paint, 0).features(np.zeros(2), np.zeros(2)) is not None


def _faces(values: npt.ArrayLike, points: Float, where: str) -> Long:
    """(F, 4) numbers of the vertices at ``points``, -1 for the fourth of a triangle."""
    faces = np.asarray(values)
    fits = faces.ndim == 2 and faces.shape[1] in (3, 4) and len(faces) > 0
    require(fits, f"{where} faces", f"shape {faces.shape}", "(F, 3) or (F, 4)")
    whole = np.issubdtype(faces.dtype, np.integer)
    require(whole, f"{where} faces", f"dtype {faces.dtype}", "integers")
    faces = faces.astype(np.int64)
    if faces.shape[1] == 3:
        faces = np.concatenate([faces, np.full((len(faces), 1), -1)], axis=1)
    bad = (faces >= len(points)) | (faces < 0)
    bad[:, 3] &= faces[:, 3] != -1
    if bad.any():
        face = int(np.argmax(bad.any(axis=1)))
        raise InputError(
            f"{where} face {face}; got vertices {faces[face].tolist()}; "
            f"expected numbers from 0 to {len(points) - 1}"
        )
    empty = ~(np.linalg.norm(face_normals(points, faces), axis=1) > 0.0)
    if empty.any():
        face = int(np.argmax(empty))
        raise InputError(
            f"{where} face {face}; got vertices {faces[face].tolist()} without area between "
            "them; expected a face with an area"
        )
    return faces


def _points(values: npt.ArrayLike, what: str) -> Float:
    points = np.asarray(values, np.float64)
    fits = points.ndim == 2 and points.shape[1] == 3
    require(fits, what, f"shape {points.shape}", "(P, 3)")
    if not np.isfinite(points).all():
        row = int(np.argmax(~np.isfinite(points).all(axis=1)))
        raise InputError(f"{what} row {row}; got {points[row].tolist()}; expected finite numbers")
    return points
