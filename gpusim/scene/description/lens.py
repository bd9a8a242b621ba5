"""``[camera.lens]``, ``[camera.shutter]``, ``[camera.trigger]``: what a real camera does to a
pinhole's image."""

from __future__ import annotations

from random import Random
from statistics import NormalDist
from typing import Annotated, Literal

from pydantic import Field, model_validator

from gpusim.scene.tables.table import Length, Listed, Numbers, Seed, Table, Words, fault

Rows = Annotated[tuple[Numbers, ...], Listed(1, 401)]


class GaussianTable(Table):
    """A round Gaussian point spread.

    Example::

        type = "gaussian"
        sigma_px = 0.6
    """

    type: Literal["gaussian"]
    sigma_px: Annotated[float, Field(gt=0, le=30)]
    """Standard deviation."""


class AiryTable(Table):
    """Diffraction at a round aperture.

    Example::

        type = "airy"
        f_number = 8.0
        wavelength_nm = 532.0
    """

    type: Literal["airy"]
    f_number: Annotated[float, Field(gt=0, le=256)]
    """Focal length over diameter of the aperture."""
    wavelength_nm: Annotated[float, Field(gt=0, le=20_000)] = 550.0
    """Of the light."""


class DiscTable(Table):
    """An even disc, as of a lens that is out of focus everywhere alike.

    Example::

        type = "disc"
        radius_px = 1.5
    """

    type: Literal["disc"]
    radius_px: Annotated[float, Field(gt=0, le=30)]
    """Of the blurred image of a point."""


class MeasuredTable(Table):
    """A measured point spread.

    Example::

        type = "measured"
        kernel = [[0.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 0.0]]
    """

    type: Literal["measured"]
    kernel: Rows
    """Rows of one odd length, an odd number of them; scaled to sum 1, centred on the middle."""
    samples_per_px: Annotated[float, Field(gt=0, le=64)] = 1.0
    """Entries of the kernel per pixel, in each direction."""

    @model_validator(mode="after")
    def _check(self) -> MeasuredTable:
        width = len(self.kernel[0])
        if len(self.kernel) % 2 == 0 or width % 2 == 0 or any(len(r) != width for r in self.kernel):
            sizes = f"{len(self.kernel)} rows of {sorted({len(r) for r in self.kernel})}"
            expected = "an odd number of rows of one odd length"
            raise fault("kernel", "no middle", Words(sizes), expected)
        if not sum(map(sum, self.kernel)) > 0:
            raise fault("kernel", "its sum isn't above 0", sum(map(sum, self.kernel)), "a sum > 0")
        return self


Psf = GaussianTable | AiryTable | DiscTable | MeasuredTable
_WIDTHS = {
    "gaussian": ("sigma_px", " px"),
    "airy": ("f_number", ""),
    "disc": ("radius_px", " px"),
    "measured": ("samples_per_px", ""),
}
PsfTable = Annotated[Psf, Field(discriminator="type")]


class VignettingTable(Table):
    """Fall-off towards the corners: the product of what is given.

    Example::

        cos4 = false
        polynomial = [-0.2, 0.03]
    """

    cos4: bool = True
    """The natural law, cos^4 of the angle to the axis."""
    polynomial: Numbers = ()
    """(a1, a2, …) of 1 + a1 r^2 + a2 r^4 + …, r = 1 at half the image's diagonal."""
    map: Rows | None = None
    """Measured gains from corner to corner, rows of one length."""

    @model_validator(mode="after")
    def _check(self) -> VignettingTable:
        rows = self.map
        if rows is None:
            return self
        if len(rows) < 2 or len(rows[0]) < 2 or any(len(row) != len(rows[0]) for row in rows):
            sizes = f"{len(rows)} rows of {sorted({len(row) for row in rows})}"
            raise fault("map", "not a grid", Words(sizes), "2 rows or more, of 2 numbers or more")
        if min(map(min, rows)) < 0:
            raise fault("map", "negative", min(map(min, rows)), "gains from 0 up")
        return self


class LensTable(Table):
    """A real lens; what isn't given isn't rendered.

    Example::

        psf = { type = "gaussian", sigma_px = 0.6 }
        f_number = 8.0
        focal_mm = 25.0
        focus_distance_mm = 600.0
        vignetting = { cos4 = true }
    """

    psf: PsfTable | None = None
    """The image of a point."""
    fill_factor: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Light-sensitive share of a pixel's area, a square in its middle."""
    f_number: Annotated[float, Field(gt=0, le=256)] | None = None
    """With ``focus_distance_mm``: depth of field (the camera's focal_mm is the image distance)."""
    focal_mm: Length | None = None
    """Focal length as it stands on the lens, for the width of the aperture; without it it follows
    from the image distance. A camera with ``fx_px`` or ``calibration`` needs it, or the pixel."""
    focus_distance_mm: Length | None = None
    """Along the optical axis, from the camera's position."""
    blades: Annotated[int, Field(ge=0, le=24)] = 0
    """Of the iris; 0 for a round one."""
    positions: Annotated[int, Field(ge=1, le=4096)] | None = None
    """Points of the aperture that are rendered; without it as many, up to 256, as
    ``render.error`` needs."""
    vignetting: VignettingTable | None = None
    """Fall-off of brightness towards the corners; without it none."""

    @model_validator(mode="after")
    def _check(self) -> LensTable:
        if (self.f_number is None) != (self.focus_distance_mm is None):
            key = "focus_distance_mm" if self.focus_distance_mm is None else "f_number"
            raise fault(key, "missing", Words(""), "f_number and focus_distance_mm, or neither")
        for name in ("focal_mm", "positions"):
            if getattr(self, name) is not None and self.f_number is None:
                raise fault(name, "without depth of field", getattr(self, name),
                            "f_number and focus_distance_mm beside it")  # fmt: skip
        if self.blades in (1, 2):
            raise fault("blades", "no polygon", self.blades, "0 (round), or 3 to 24")
        return self

    def words(self) -> list[str]:
        """What it does."""
        done = []
        if self.psf is not None:
            key, unit = _WIDTHS[self.psf.type]
            done.append(f"{self.psf.type} point spread {getattr(self.psf, key):g}{unit}")
        if self.fill_factor != 1.0:
            done.append(f"fill factor {self.fill_factor:g}")
        if self.f_number is not None:
            done.append(f"depth of field f/{self.f_number:g}")
        if self.vignetting is not None:
            done.append("vignetting")
        return done


class ShutterTable(Table):
    """Exposure in time, around the instant of each frame; needs ``analysis.frame_rate_Hz``.

    Example::

        exposure_ms = 5.0
        line_time_us = 10.0
    """

    exposure_ms: Annotated[float, Field(ge=0)] = 0.0
    """What moves during it is blurred; dark current gathers during it."""
    line_time_us: float = 0.0
    """Rolling shutter: from the read-out of a row to that of the next. 0: all rows at once."""
    samples: Annotated[int, Field(ge=1, le=4096)] | None = None
    """Moments that the exposure is averaged over; without it as many, up to 256, as the motion
    needs to show no steps."""

    def words(self) -> list[str]:
        """What it does."""
        done = []
        if self.exposure:
            done.append(f"exposed for {1e3 * self.exposure:g} ms")
        if self.line_time:
            done.append(f"rolling shutter {1e6 * self.line_time:g} us a row")
        return done


class TriggerTable(Table):
    """When a camera's frames are exposed, while whoever measures in them takes the nominal times;
    needs a motion that is known at any instant.

    Example::

        delay_us = 150.0
        jitter_us = 2.0
    """

    delay_us: float = 0.0
    """By how much all frames are late; less than 0: early."""
    jitter_us: Annotated[float, Field(ge=0)] = 0.0
    """RMS of what each frame is late or early besides, normally distributed."""
    seed: Seed = 0
    """Of the jitter; every camera and frame has its own, independent of the others."""

    @property
    def latest(self) -> float:
        """s by which no frame is off."""
        return float(abs(self.delay) + 8.3 * self.jitter)  # a share of 2^-53 lies beyond 8.2

    def late(self, camera: str, frame: int) -> float:
        """s by which a ``frame`` of the ``camera`` is late."""
        share = Random(f"{self.seed} {camera} {frame}").random() or 0.5
        return float(self.delay + self.jitter * NormalDist().inv_cdf(share))
