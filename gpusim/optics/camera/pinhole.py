"""Cameras in the OpenCV convention: integer pixel coordinates are pixel centres.

A pinhole with a flat sensor, and a lens that may distort (`gpusim.optics.camera.distortion`). Pixel
positions of the same camera without distortion are called ideal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.display import notebook_html, plotted
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.optics.camera.distortion import Distortion
from gpusim.validation import Portion, checked, real_numbers, require, within

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Sides = Annotated[int, within(1, 65535, "pixels")]


def _identity() -> Float:
    return np.eye(4)


@checked
@dataclass(frozen=True, eq=False)
class Camera:
    """A camera with a flat sensor and a lens that may distort.

    Parameters
    ----------
    width, height : px.
    K : (3, 3) float64, [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] in px; the pixel in column i and
        row j is centred at (i, j), so that the image's centre is ((width - 1) / 2, …).
    distortion : OpenCV coefficients k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]];
        None or zeros for a lens without. They act on (x, y) = (X / Z, Y / Z) before K does.
    camera_from_world : (4, 4) rigid transform; camera axes are x right, y down, z forward.
    lens_K : (3, 3), what turns pixels into (x, y) for the distortion; None: K. Another principal
        point there than in K is a pencil of rays that comes through the lens off its centre.
    pixel_side : px, of the square in a pixel's middle that is sensitive to light; `gs.Lens` says it
        by its area, ``fill_factor``.

    Raises
    ------
    InputError
        Sizes, shapes or values that make no camera, or a lens whose distortion folds inside the
        image (it isn't monotonic there: two points of the scene would share a pixel).

    Examples
    --------
    >>> camera = gs.Camera(width=300, height=200, K=[[1000, 0, 150], [0, 1000, 100], [0, 0, 1]])
    >>> camera.project([[0.01, 0.0, 1.0]])
    array([[160., 100.]])
    """

    width: Sides
    height: Sides
    K: Float
    distortion: Sequence[float] | Float | None = None
    camera_from_world: Float = field(default_factory=_identity)
    name: str = "camera"
    lens_K: Float | None = None
    pixel_side: Portion = 1.0
    __repr__ = field_summary

    def __post_init__(self) -> None:
        where = f"Camera {self.name!r}"
        for key in ("width", "height"):
            object.__setattr__(self, key, int(getattr(self, key)))
        K = _matrix(self.K, (3, 3), f"{where} K")
        fits = K[0, 0] > 0 and K[1, 1] > 0 and K[1, 0] == 0 and (K[2] == [0, 0, 1]).all()
        expected = "[[fx, skew, cx], [0, fy, cy], [0, 0, 1]] with fx, fy above 0"
        require(fits, f"{where} K", K.tolist(), expected)
        through = K if self.lens_K is None else np.asarray(self.lens_K, np.float64)
        fits = through.shape == (3, 3) and np.array_equal(through[:, :2], K[:, :2])
        expected = "K with another principal point"
        require(fits, f"{where} lens_K", through.tolist(), expected)
        T = _matrix(self.camera_from_world, (4, 4), f"{where} camera_from_world")
        R = T[:3, :3]
        rigid = np.abs(R @ R.T - np.eye(3)).max() <= 1e-9 and np.linalg.det(R) > 0
        rigid = rigid and bool((T[3] == [0, 0, 0, 1]).all())
        expected = "a rotation and translation"
        require(rigid, f"{where} camera_from_world", T.tolist(), expected)
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "camera_from_world", T)
        if self.distortion is not None:
            try:
                lens = Distortion(real_numbers(self.distortion, "distortion"))
            except InputError as error:
                raise InputError(f"{where} {error}") from None
            object.__setattr__(self, "distortion", lens.coefficients)
            if lens.coefficients.any():
                self._require_invertible(lens)

    def _repr_html_(self) -> str | None:
        return notebook_html("camera", self)

    def plot(
        self,
        ax: Axes | None = None,
        *,
        plane: str = "xy",
        reach: float | None = None,
        unit: str = "m",
        **style: Any,
    ) -> Axes:
        """Draw where it stands and what it sees, from above ("xy") or a side ("xz", "yz").

        ``reach``: how far its view is drawn; to the origin unless given. ``unit``: what labels call
        the world's unit of length. ``style`` goes to ``Axes.plot``. Returns the axes.
        """
        return plotted("camera", self, ax, plane=plane, reach=reach, unit=unit, **style)

    def _require_invertible(self, lens: Distortion) -> None:
        """Refuse a lens whose distortion can't be undone somewhere in the image."""
        columns = np.linspace(-0.5, self.width - 0.5, 33)
        rows = np.linspace(-0.5, self.height - 0.5, 33)
        pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        points = self._from_pixels(pixels)
        bad = np.isnan(lens.undistort(points)).any(axis=1)
        if not bad.any():
            return
        radius = np.hypot(*points.T)
        first = int(np.argmin(np.where(bad, radius, np.inf)))
        reach = radius[first]
        if np.isfinite(lens.limit):
            edge = np.array([[0.999999 * lens.limit, 0.0]])
            reach = min(reach, float(np.hypot(*lens.distort(edge)[0])))
        if not np.isfinite(reach):
            reach = radius[first]
        fx, corner = self.K[0, 0], radius.max()
        raise InputError(
            f"Camera {self.name!r} distortion; got {lens.coefficients.tolist()}, which is "
            f"monotonic only up to {reach * fx:.6g} px from the principal point (radius "
            f"{reach:.6g} in focal lengths); expected a lens that is so in the whole image: pixel "
            f"({pixels[first, 0]:g}, {pixels[first, 1]:g}) shows nothing, and the corners are at "
            f"{corner * fx:.6g} px (radius {corner:.6g})"
        )

    @cached_property
    def lens(self) -> Distortion | None:
        """The distortion; None if there is none."""
        if self.distortion is None or not np.any(self.distortion):
            return None
        return Distortion(np.asarray(self.distortion, np.float64))

    @property
    def distorting_K(self) -> Float:
        """``lens_K``, or K where there is none."""
        return self.K if self.lens_K is None else self.lens_K

    def without_distortion(self) -> Camera:
        """The same camera with an ideal lens."""
        return self if self.distortion is None else replace(self, distortion=None)

    def reframed(
        self,
        width: int,
        height: int,
        corner: tuple[float, float] = (0.0, 0.0),
        scale: tuple[float, float] = (1.0, 1.0),
    ) -> Camera:
        """The same view in an image of other pixels.

        It has ``width`` x ``height`` px, begins at the ``corner`` (column, row) of this one, and
        has ``scale`` (across, down) pixels for each of this one's.

        Examples
        --------
        >>> camera = gs.Camera.from_lens((36, 24), 50, (6, 4), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
        >>> camera.reframed(12, 8, scale=(2, 2)).K[:2, 2].tolist()
        [5.5, 3.5]
        """
        times = np.array(scale, np.float64)

        def moved(K: Float) -> Float:
            result = K.copy()
            result[:2, 2] -= corner
            result[:2] *= times[:, None]
            result[:2, 2] += 0.5 * times - 0.5  # integers are pixels' centres
            return result

        lens_K = None if self.lens_K is None else moved(self.lens_K)
        return replace(self, width=width, height=height, K=moved(self.K), lens_K=lens_K)

    @staticmethod
    @checked
    def from_lens(
        sensor_mm: tuple[float, float],
        focal_mm: float,
        resolution: tuple[int, int],
        eye: npt.ArrayLike,
        target: npt.ArrayLike,
        up: npt.ArrayLike = (0.0, 0.0, 1.0),
        principal_point_offset_mm: tuple[float, float] = (0.0, 0.0),
        name: str = "camera",
        distortion: Sequence[float] | Float | None = None,
    ) -> Camera:
        """A camera as a photographer describes it.

        ``sensor_mm`` (width, height) and ``focal_mm`` give fx = focal / (sensor width / columns);
        ``eye``, ``target`` and ``up`` are in world units. The principal point lies in the middle
        of the sensor, moved right and down by ``principal_point_offset_mm``.
        """
        where = f"Camera {name!r}"
        numbers = [*sensor_mm, focal_mm]
        fits = all(0 < v < np.inf for v in numbers)
        require(fits, f"{where} sensor_mm, focal_mm", numbers, "above 0")
        width, height = resolution
        eye3, target3, up3 = (
            real_numbers(value, f"{where} {key}")
            for key, value in (("eye", eye), ("target", target), ("up", up))
        )
        for key, vector, shape in (
            ("eye", eye3, (3,)),
            ("target", target3, (3,)),
            ("up", up3, (3,)),
            ("principal_point_offset_mm", np.asarray(principal_point_offset_mm), (2,)),
        ):
            fits = vector.shape == shape and bool(np.isfinite(vector).all())
            require(fits, f"{where} {key}", vector.tolist(), f"{shape[0]} finite numbers")
        forward = target3 - eye3
        distance = np.linalg.norm(forward)
        if not distance > 0.0:
            raise InputError(f"{where}: eye and target are the same point {eye3.tolist()}")
        z: Float = forward / distance
        x: Float = np.cross(z, up3)
        if not np.linalg.norm(x) > 1e-9 * np.linalg.norm(up3):
            raise InputError(f"{where} up; got {up3.tolist()}, parallel to the viewing direction")
        x = x / float(np.linalg.norm(x))
        y: Float = np.cross(z, x)
        camera_from_world = np.eye(4)
        camera_from_world[:3, :3] = np.stack([x, y, z])
        camera_from_world[:3, 3] = -camera_from_world[:3, :3] @ eye3
        px, py = width / sensor_mm[0], height / sensor_mm[1]
        K = np.array(
            [
                [focal_mm * px, 0.0, 0.5 * (width - 1) + principal_point_offset_mm[0] * px],
                [0.0, focal_mm * py, 0.5 * (height - 1) + principal_point_offset_mm[1] * py],
                [0.0, 0.0, 1.0],
            ]
        )
        return Camera(width, height, K, distortion, camera_from_world, name)

    @property
    def eye(self) -> Float:
        """World position of the projection centre, (3,)."""
        R, t = self.camera_from_world[:3, :3], self.camera_from_world[:3, 3]
        return -R.T @ t

    def to_camera(self, X: Float) -> Float:
        """World points (…, 3) in camera coordinates."""
        T = self.camera_from_world
        result: Float = X @ T[:3, :3].T + T[:3, 3]
        return result

    def project(self, X: npt.ArrayLike) -> Float:
        """World points (…, 3) to pixel coordinates (…, 2); NaN for points not in front."""
        points = real_numbers(X, "project")
        fits = points.shape[-1:] == (3,)
        require(fits, "project", f"points of shape {points.shape}", "(…, 3)")
        Xc = self.to_camera(points)
        z = Xc[..., 2]
        z = np.where(z > 0.0, z, np.nan)
        flat = np.stack([Xc[..., 0] / z, Xc[..., 1] / z], axis=-1)
        K, x, y = self.K, flat[..., 0], flat[..., 1]
        ideal = np.stack([K[0, 0] * x + K[0, 1] * y + K[0, 2], K[1, 1] * y + K[1, 2]], axis=-1)
        return ideal if self.lens is None else self.distort(ideal)

    def undistort(self, pixels: npt.ArrayLike) -> Float:
        """Pixel positions (…, 2) to where the camera without distortion has them, exact to 1e-12 f.

        NaN where the lens shows nothing. The same as cv2.undistortPoints(pixels, K, d, P=K).
        """
        points = _pixels(pixels, "undistort")
        if self.lens is None:
            return points.copy()
        return self._to_pixels(self.lens.undistort(self._from_pixels(points)))

    def distort(self, pixels: npt.ArrayLike, beyond: bool = False) -> Float:
        """Ideal pixel positions (…, 2) to where the lens puts them; NaN beyond its domain.

        ``beyond``: continued straight outwards there instead, for geometry that leaves the image.
        """
        points = _pixels(pixels, "distort")
        if self.lens is None:
            return points.copy()
        flat = self._from_pixels(points)
        return self._to_pixels(self.lens.extended(flat) if beyond else self.lens.distort(flat))

    def _to_pixels(self, flat: Float) -> Float:
        K, x, y = self.distorting_K, flat[..., 0], flat[..., 1]
        return np.stack([K[0, 0] * x + K[0, 1] * y + K[0, 2], K[1, 1] * y + K[1, 2]], axis=-1)

    def _from_pixels(self, pixels: Float) -> Float:
        K = self.distorting_K
        y = (pixels[..., 1] - K[1, 2]) / K[1, 1]
        x = (pixels[..., 0] - K[0, 2] - K[0, 1] * y) / K[0, 0]
        return np.stack([x, y], axis=-1)

    def ray_matrix(self) -> Float:
        """(3, 3) matrix D with camera-space direction = D [x, y, 1], of unit depth."""
        result: Float = np.linalg.inv(self.K).astype(np.float64)
        return result


def _matrix(values: npt.ArrayLike, shape: tuple[int, int], where: str) -> Float:
    matrix = real_numbers(values, where)
    fits = matrix.shape == shape and np.isfinite(matrix).all()
    require(fits, where, f"shape {matrix.shape}", f"finite {shape}")
    return matrix


def _pixels(values: npt.ArrayLike, what: str) -> Float:
    pixels = real_numbers(values, what)
    require(pixels.shape[-1:] == (2,), what, f"pixels of shape {pixels.shape}", "(…, 2)")
    return pixels
