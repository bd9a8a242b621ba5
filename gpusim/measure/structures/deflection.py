"""From tracked pixels to a deflection line in millimetres.

Scale coefficient: the similarity that maps measured marker centres (px) to their known positions
(mm), Umeyama 1991. Camera motion: the rigid motion of markers that can't move, subtracted from
all. Image y points down; the deflection line's second component points up.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.display import plotted
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.validation import require, unmasked

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@unmasked()
@dataclass(frozen=True)
class Scale:
    """mm = mm_per_px * rotation @ (px - origin_px) + origin_mm, with image y turned up.

    Attributes
    ----------
    mm_per_px : the scale coefficient.
    sigma : its standard uncertainty from the residuals, mm/px (0 residuals give 0; NaN for as few
        points as leave none, which are two).
    rotation : (2, 2) float64, image axes (x right, y down) to the axes of the positions.
    origin_px, origin_mm : (2,) float64, centroids.
    residuals_px : (M, 2) float64, known minus fitted positions seen in the image, px.
    residual_px : their RMS length.

    Examples
    --------
    >>> scale = gs.measure.scale_coefficient([[0, 0], [100, 0]], [[0, 0], [50, 0]])
    >>> scale.mm_per_px, scale.positions(np.array([[20.0, 0.0]])).round(6)
    (0.5, array([[10.,  0.]]))
    """

    mm_per_px: float
    sigma: float
    rotation: Float
    origin_px: Float
    origin_mm: Float
    residuals_px: Float
    residual_px: float
    __repr__ = field_summary

    def positions(self, points_px: Float) -> Float:
        """Points (K, 2) in px as positions (K, 2) in mm."""
        return self.vectors(points_px - self.origin_px) + self.origin_mm

    def vectors(self, vectors_px: Float) -> Float:
        """Displacements (K, 2) in px as (K, 2) in mm, along the axes of the positions."""
        result: Float = self.mm_per_px * vectors_px @ self.rotation.T
        return result


@unmasked()
def scale_coefficient(points_px: npt.ArrayLike, positions_mm: npt.ArrayLike) -> Scale:
    """Fit the scale between marker centres (M, 2) in px and their known positions in mm.

    ``positions_mm`` is (M, 2) in the object's plane with its second axis up, or (M,) along a
    straight member whose markers lie on one line: the first axis then runs along it, the second
    one is turned a quarter to the left of it (up, for a member that runs to the right).

    Examples
    --------
    >>> gs.measure.scale_coefficient([[0, 0], [100, 0]], [[0, 0], [50, 0]]).mm_per_px
    0.5
    """
    px = np.asarray(points_px, dtype=np.float64)
    mm = np.asarray(positions_mm, dtype=np.float64)
    if px.ndim != 2 or px.shape[1] != 2 or px.shape[0] < 2:
        raise InputError(f"points_px: got shape {px.shape}; expected (M, 2), at least two points")
    if mm.shape not in ((len(px),), (len(px), 2)):
        raise InputError(f"positions_mm: got shape {mm.shape}; expected ({len(px)},) or (…, 2)")
    if not (np.isfinite(px).all() and np.isfinite(mm).all()):
        raise InputError("scale: got NaN or infinite points; expected only measured ones")
    plane = mm if mm.ndim == 2 else np.column_stack([mm, np.zeros(len(mm))])
    up = px * [1.0, -1.0]
    source, target = up - up.mean(axis=0), plane - plane.mean(axis=0)
    spread = float((source**2).sum())
    if not (spread > 0 and float((target**2).sum()) > 0):
        raise InputError("scale: all points coincide; expected markers some distance apart")
    # complex numbers hold a scale and a rotation without reflection: target = z source
    z = _complex(source).conj() @ _complex(target) / spread
    mm_per_px = float(abs(z))
    if not mm_per_px * np.sqrt(spread) > 1e-6 * np.sqrt(float((target**2).sum())):
        raise InputError("scale: points and positions don't match; expected the same order in both")
    turn = np.array([[z.real, -z.imag], [z.imag, z.real]]) / mm_per_px
    residuals = (target - mm_per_px * source @ turn.T) / mm_per_px
    freedom = 2 * len(px) - 4 if mm.ndim == 2 else len(px) - 2
    squares = float((residuals**2).sum())
    sigma = mm_per_px * np.sqrt(squares / freedom / spread) if freedom > 0 else np.nan
    return Scale(
        mm_per_px=mm_per_px,
        sigma=float(sigma),
        rotation=turn @ np.diag([1.0, -1.0]),
        origin_px=px.mean(axis=0),
        origin_mm=plane.mean(axis=0),
        residuals_px=residuals @ turn * [1.0, -1.0],
        residual_px=float(np.sqrt(squares / len(px))),
    )


@unmasked()
@dataclass(frozen=True)
class RigidMotion:
    """A rotation by ``angle`` (rad, from +x to +y) about ``centre`` (2,) and a shift (2,), px.

    ``rms`` is what the static markers still move after it is taken out, px; ``count`` markers.

    Examples
    --------
    >>> motion = gs.measure.rigid_motion([[0, 0], [100, 0]], [[1, 0], [1, 0]])
    >>> motion.displacement(np.array([[50.0, 20.0]])).round(6)
    array([[1., 0.]])
    """

    angle: float
    shift: Float
    centre: Float
    rms: float
    count: int
    __repr__ = field_summary

    def displacement(self, points: Float) -> Float:
        """Apparent displacement (K, 2) that this motion gives to points (K, 2), px."""
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        turn = np.array([[cosine - 1.0, -sine], [sine, cosine - 1.0]])
        result: Float = (points - self.centre) @ turn.T + self.shift
        return result


@unmasked()
def rigid_motion(points: npt.ArrayLike, displacement: npt.ArrayLike) -> RigidMotion:
    """Rigid motion of static markers (M, 2) that seem to move by ``displacement`` (M, 2), px.

    One marker gives a shift only. Rows that aren't finite (not tracked) are left out.

    Examples
    --------
    >>> gs.measure.rigid_motion([[0, 0], [100, 0]], [[1, 2], [1, 2]]).shift
    array([1., 2.])
    """
    px = np.asarray(points, dtype=np.float64)
    moved = np.asarray(displacement, dtype=np.float64)
    if px.ndim != 2 or px.shape[1] != 2 or moved.shape != px.shape:
        raise InputError(f"static markers: got {px.shape} and {moved.shape}; expected (M, 2) twice")
    use = np.isfinite(px).all(axis=1) & np.isfinite(moved).all(axis=1)
    if not use.any():
        raise InputError("static markers: none was tracked; expected at least one")
    px, moved = px[use], moved[use]
    centre, shift = px.mean(axis=0), moved.mean(axis=0)
    source = _complex(px - centre)
    product = source.conj() @ _complex(px - centre + moved - shift)
    angle = float(np.angle(product)) if len(px) > 1 and abs(product) > 0 else 0.0
    motion = RigidMotion(angle, shift, centre, 0.0, len(px))
    rest = moved - motion.displacement(px)
    return RigidMotion(angle, shift, centre, float(np.sqrt((rest**2).sum(axis=1).mean())), len(px))


@dataclass(frozen=True)
class DeflectionLine:
    """How far a member moved at each marker; markers that weren't measured are NaN.

    Attributes
    ----------
    position_mm : (M,) float64, where each marker sits along the member.
    displacement_mm : (M, 2) float64, along the axes of the scale; the second one is up.
    sigma_mm : (M,) float64, standard uncertainty of the random part: of matching, from the grey
        values' residuals, and of the scale where that is known.
    status : (M,) int8, as tracked (0 = measured).
    scale : the scale that was used.
    camera : the rigid motion that was taken out, or None.

    Examples
    --------
    >>> scale = gs.measure.scale_coefficient([[0, 0], [100, 0]], [[0, 0], [50, 0]])
    >>> line = gs.measure.deflection_line([0, 50], [[0, 0], [100, 0]], [[0, 0], [0, 4]], scale)
    >>> line.displacement_mm.round(6) + 0.0
    array([[ 0.,  0.],
           [ 0., -2.]])
    """

    position_mm: Float
    displacement_mm: Float
    sigma_mm: Float
    status: npt.NDArray[np.int8]
    scale: Scale
    camera: RigidMotion | None
    __repr__ = field_summary

    def plot(self, ax: Axes | None = None, *, true: Any = None, **style: Any) -> Axes:
        """Draw the deflection (mm, up) along the member with its uncertainties.

        ``true``: what it should be, (M,) at the markers or (positions, values), mm: drawn as a
        line. ``style`` goes to ``Axes.errorbar``. Returns matplotlib's axes.
        """
        return plotted("deflection", self, ax, true=true, **style)

    def write_csv(self, path: str | Path) -> None:
        """Write one row per marker; what wasn't measured is left empty."""
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["position_mm", "along_mm", "across_mm", "sigma_mm", "status"])
            for position, (along, across), sigma, status in zip(
                self.position_mm, self.displacement_mm, self.sigma_mm, self.status, strict=True
            ):
                cells = [f"{v:.9g}" if np.isfinite(v) else "" for v in (along, across, sigma)]
                writer.writerow([f"{position:.9g}", *cells, int(status)])


@unmasked()
def deflection_line(
    position_mm: npt.ArrayLike,
    points_px: npt.ArrayLike,
    displacement_px: npt.ArrayLike,
    scale: Scale,
    *,
    status: npt.ArrayLike | None = None,
    sigma_px: npt.ArrayLike | None = None,
    camera: RigidMotion | None = None,
) -> DeflectionLine:
    """Displacements of markers in mm, sorted by where they sit along the member.

    ``position_mm`` (M,), ``points_px`` and ``displacement_px`` (M, 2), ``status`` and
    ``sigma_px`` (M,) as tracked. ``camera`` is the apparent motion of static markers.

    Examples
    --------
    >>> scale = gs.measure.scale_coefficient([[0, 0], [100, 0]], [[0, 0], [50, 0]])
    >>> line = gs.measure.deflection_line([0, 50], [[0, 0], [100, 0]], [[0, 0], [0, 4]], scale)
    >>> float(line.displacement_mm[1, 1].round(6))
    -2.0
    """
    position = np.asarray(position_mm, dtype=np.float64)
    points = np.asarray(points_px, dtype=np.float64)
    moved = np.asarray(displacement_px, dtype=np.float64)
    count = position.size
    fits = position.shape == (count,) and points.shape == (count, 2) and moved.shape == (count, 2)
    expected = "(M,), (M, 2), (M, 2)"
    require(fits, "deflection line", f"{position.shape}, {points.shape}, {moved.shape}", expected)
    if not (np.isfinite(position).all() and np.isfinite(points).all()):
        raise InputError("deflection line: got NaN or infinite positions; expected finite")
    measured = np.isfinite(moved).all(axis=1)
    codes = (
        np.where(measured, 0, 1).astype(np.int8)
        if status is None
        else np.asarray(status, dtype=np.int8)
    )
    noise = np.zeros(count) if sigma_px is None else np.asarray(sigma_px, dtype=np.float64)
    if codes.shape != (count,) or noise.shape != (count,):
        raise InputError("deflection line: status and sigma_px must have one value per marker")
    if camera is not None:
        moved = moved - camera.displacement(points)
    displacement = np.where((measured & (codes == 0))[:, None], scale.vectors(moved), np.nan)
    length = np.linalg.norm(displacement, axis=1)
    unsure = scale.sigma if np.isfinite(scale.sigma) else 0.0
    sigma = np.hypot(noise * scale.mm_per_px, length * unsure / scale.mm_per_px)
    order = np.argsort(position, kind="stable")
    return DeflectionLine(
        position[order], displacement[order], sigma[order], codes[order], scale, camera
    )


def _complex(vectors: Float) -> npt.NDArray[np.complex128]:
    return vectors[:, 0] + 1j * vectors[:, 1]
