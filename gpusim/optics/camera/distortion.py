"""Lens distortion in OpenCV's model, both ways, exact, with a checked domain.

A point (x, y) = (X / Z, Y / Z) of the ideal image moves to

    x' = x R + 2 p1 x y + p2 (r2 + 2 x2) + s1 r2 + s2 r4
    y' = y R + p1 (r2 + 2 y2) + 2 p2 x y + s3 r2 + s4 r4
    R = (1 + k1 r2 + k2 r4 + k3 r6) / (1 + k4 r2 + k5 r4 + k6 r6)

and then through the homography of a sensor tilted by tau_x and tau_y (Scheimpflug). Radial terms:
Brown, "Close-range camera calibration", Photogrammetric Engineering 37, 1971; thin prism: Weng,
Cohen and Herniou, PAMI 14, 1992; tilt: Louhichi et al., Measurement Science and Technology 18,
2007; all as in the documentation of OpenCV's calib3d.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.errors import InputError

LENGTHS = (4, 5, 8, 12, 14)
"""How many coefficients OpenCV's models have."""

TOLERANCE = 1e-12
"""Largest residual of an inverted point, in units of the focal length."""

ITERATIONS = 30
NODES = 1025
CHUNK = 1 << 17


@dataclass(frozen=True, eq=False)
class Distortion:
    """A distorting lens.

    ``coefficients`` : (4, 5, 8, 12 or 14,) float64: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x
    tau_y]]]], tau in rad. All points are (…, 2) float64 in units of the focal length, the optical
    axis at (0, 0).

    Raises
    ------
    InputError
        Another number of coefficients, or values that aren't finite.
    """

    coefficients: Float

    def __post_init__(self) -> None:
        values = np.ravel(np.asarray(self.coefficients, np.float64))
        if len(values) not in LENGTHS or not np.isfinite(values).all():
            raise InputError(
                f"distortion; got {values.tolist()}; expected 4, 5, 8, 12 or 14 finite numbers: "
                "k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]]"
            )
        object.__setattr__(self, "coefficients", values)

    @cached_property
    def _all(self) -> tuple[float, ...]:
        values = np.zeros(14)
        values[: len(self.coefficients)] = self.coefficients
        return tuple(values.tolist())

    @cached_property
    def _tilt(self) -> Float | None:
        """(3, 3) homography of the tilted sensor, or None."""
        tau_x, tau_y = self._all[12:]
        if tau_x == 0.0 and tau_y == 0.0:
            return None
        cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]])
        about_y = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]])
        R = about_y @ about_x
        shift = np.array([[R[2, 2], 0.0, -R[0, 2]], [0.0, R[2, 2], -R[1, 2]], [0.0, 0.0, 1.0]])
        result: Float = shift @ R
        return result

    @cached_property
    def limit(self) -> float:
        """The ideal radius from which the radial part stops growing (inf if it never does)."""
        k1, k2, _, _, k3, k4, k5, k6 = self._all[:8]
        # in u = r^2: r R grows while (N + 2 u N') D > 2 u N D', and D has not changed sign
        N, D = (
            np.polynomial.Polynomial([1.0, a, b, c]) for a, b, c in ((k1, k2, k3), (k4, k5, k6))
        )
        u2 = np.polynomial.Polynomial([0.0, 2.0])
        slope = (N + u2 * N.deriv()) * D - u2 * N * D.deriv()
        smallest = np.inf
        for polynomial in (slope, D):
            roots = np.asarray(polynomial.trim().roots(), np.complex128)
            real = roots.real[(np.abs(roots.imag) <= 1e-7 * np.abs(roots)) & (roots.real > 0.0)]
            smallest = min(smallest, float(real.min(initial=np.inf)))
        return float(np.sqrt(smallest))

    def _radial(self, square: Float) -> tuple[Float, Float]:
        """R and dR / d(r^2) at r^2."""
        k1, k2, _, _, k3, k4, k5, k6 = self._all[:8]
        u = square
        above = 1.0 + u * (k1 + u * (k2 + u * k3))
        below = 1.0 + u * (k4 + u * (k5 + u * k6))
        above_slope = k1 + u * (2.0 * k2 + u * 3.0 * k3)
        below_slope = k4 + u * (2.0 * k5 + u * 3.0 * k6)
        ratio = above / below
        return ratio, (above_slope - ratio * below_slope) / below

    def _on_flat_sensor(self, points: Float) -> tuple[Float, Float]:
        """Distorted points (…, 2) before the tilt, and their Jacobian (…, 2, 2)."""
        p1, p2 = self._all[2:4]
        s1, s2, s3, s4 = self._all[8:12]
        x, y = points[..., 0], points[..., 1]
        xx, xy, yy = x * x, x * y, y * y
        u = xx + yy
        ratio, slope = self._radial(u)
        moved = np.empty(points.shape)
        moved[..., 0] = x * ratio + 2.0 * p1 * xy + p2 * (u + 2.0 * xx) + u * (s1 + s2 * u)
        moved[..., 1] = y * ratio + p1 * (u + 2.0 * yy) + 2.0 * p2 * xy + u * (s3 + s4 * u)
        jacobian = np.empty((*points.shape, 2))
        mixed = 2.0 * xy * slope + 2.0 * p1 * x + 2.0 * p2 * y
        prism_x, prism_y = 2.0 * (s1 + 2.0 * s2 * u), 2.0 * (s3 + 2.0 * s4 * u)
        jacobian[..., 0, 0] = ratio + 2.0 * xx * slope + 2.0 * p1 * y + 6.0 * p2 * x + prism_x * x
        jacobian[..., 0, 1] = mixed + prism_x * y
        jacobian[..., 1, 0] = mixed + prism_y * x
        jacobian[..., 1, 1] = ratio + 2.0 * yy * slope + 6.0 * p1 * y + 2.0 * p2 * x + prism_y * y
        return moved, jacobian

    def distort(self, points: Float) -> Float:
        """Ideal to distorted points; NaN beyond the domain, so that nothing folds back."""
        moved, jacobian = self._on_flat_sensor(points)
        turn = jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0]
        bad = ~((turn > 0.0) & (np.sum(points**2, axis=-1) < self.limit**2))
        moved[bad] = np.nan
        return moved if self._tilt is None else _homography(self._tilt, moved)

    def extended(self, points: Float) -> Float:
        """`distort`, continued straight outwards where the domain ends: for what is out of view."""
        if not np.isfinite(self.limit):
            moved = self._on_flat_sensor(points)[0]
        else:
            radius = np.sqrt(np.sum(points**2, axis=-1))[..., None]
            inner = np.minimum(1.0, 0.9999 * self.limit / np.maximum(radius, 1e-300))
            moved = self._on_flat_sensor(points * inner)[0]
            moved += points * (1.0 - inner) * self._radial(np.asarray(self.limit**2))[0]
        return moved if self._tilt is None else _homography(self._tilt, moved)

    def undistort(self, points: Float) -> Float:
        """Distorted to ideal points, by Newton's method to 1e-12; NaN where there is none."""
        flat = np.asarray(points, np.float64).reshape(-1, 2)
        if self._tilt is not None:
            flat = _homography(np.linalg.inv(self._tilt).astype(np.float64), flat)
        result = np.empty(flat.shape)
        for first in range(0, len(flat), CHUNK):
            result[first : first + CHUNK] = self._inverse(flat[first : first + CHUNK])
        return result.reshape(np.shape(points))

    def _inverse(self, target: Float) -> Float:
        start, solvable = self._radial_inverse(np.sqrt(np.sum(target**2, axis=-1)))
        guess = target * start[:, None]
        result = np.full(guess.shape, np.nan)
        rows = np.flatnonzero(solvable)
        guess, target = guess[rows], target[rows]
        for _ in range(ITERATIONS):
            moved, jacobian = self._on_flat_sensor(guess)
            error = moved - target
            a, b = jacobian[:, 0, 0], jacobian[:, 0, 1]
            c, d = jacobian[:, 1, 0], jacobian[:, 1, 1]
            turn = a * d - b * c
            worst = np.abs(error).max(axis=1)
            # one step more than the tolerance asks for: it converges quadratically
            good = (worst <= 1e-3 * TOLERANCE) | (worst <= 4e-16 * np.abs(target).max(axis=1))
            good &= turn > 0.0
            result[rows[good]] = guess[good]
            unsolved = ~good & np.isfinite(worst) & (turn != 0.0)
            if not unsolved.any():
                return result
            rows, guess, target = rows[unsolved], guess[unsolved], target[unsolved]
            error, turn = error[unsolved], turn[unsolved]
            step = np.empty(guess.shape)
            step[:, 0] = (d[unsolved] * error[:, 0] - b[unsolved] * error[:, 1]) / turn
            step[:, 1] = (a[unsolved] * error[:, 1] - c[unsolved] * error[:, 0]) / turn
            after = guess - step
            if np.isfinite(self.limit):
                radius = np.sqrt(np.sum(after**2, axis=1))
                before = np.sqrt(np.sum(guess**2, axis=1))
                over = radius >= self.limit
                shrink = 0.5 * (before + self.limit) / np.where(over, radius, 1.0)
                after = np.where(over[:, None], after * shrink[:, None], after)
            guess = after
        moved, jacobian = self._on_flat_sensor(guess)
        good = np.abs(moved - target).max(axis=1) <= TOLERANCE
        good &= np.linalg.det(jacobian) > 0.0
        result[rows[good]] = guess[good]
        return result

    def _radial_inverse(self, distorted: Float) -> tuple[Float, Bool]:
        """r / r' at distorted radii r' for the radial part alone, and whether one exists.

        The other terms may reach a little farther than the radial part: 10 % are allowed for.
        """
        most = float(distorted.max(initial=0.0))
        far = self.limit
        if not np.isfinite(far):
            far = max(most, 1e-6)
            for _ in range(60):
                if far * float(self._radial(np.asarray(far * far))[0]) >= most:
                    break
                far *= 1.5
        radius = np.linspace(0.0, far, NODES)
        bent = radius * self._radial(radius**2)[0]
        bent = np.maximum.accumulate(np.where(np.isfinite(bent), bent, 0.0))
        start = np.interp(distorted, bent, radius)
        small = distorted <= 1e-9 * max(far, 1e-300)
        share = np.where(small, 1.0, start / np.where(small, 1.0, distorted))
        return share, np.asarray(distorted <= 1.1 * bent[-1])


def _homography(H: Float, points: Float) -> Float:
    x, y = points[..., 0], points[..., 1]
    w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
    result = np.empty(points.shape)
    result[..., 0] = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w
    result[..., 1] = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w
    return result
