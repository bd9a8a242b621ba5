"""``[[camera]]``: from where a scene is seen."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from gpusim.scene.tables.table import (
    Direction,
    Length,
    Listed,
    Name,
    Numbers,
    Pair,
    PositivePair,
    Table,
    Vector,
    Words,
    between,
    fault,
    norm,
    parallel,
)

from .lens import LensTable, ShutterTable, TriggerTable
from .sensor import CameraSensorTable, Gains, SensorTable, merged

PIXEL_SQUARE = 1e-3
Side = Annotated[int, Field(ge=1, le=65535)]


class CameraTable(Table):
    """A camera: as a photographer describes it, by its calibration, or from a calibration file.

    The lens is ``sensor_mm`` and ``focal_mm``, or ``fx_px`` … ``cy_px``, or ``calibration``; the
    pose ``position_mm`` and ``target_mm``, or a rotation and ``translation_mm``, or the file's.

    Example::

        name = "front"
        sensor_mm = [8.8, 6.6]
        resolution_px = [2560, 1920]
        focal_mm = 25.0
        position_mm = [100.0, -600.0, 5.0]
        target_mm = [100.0, 0.0, 5.0]
    """

    name: Name
    """Of its folder of images, and what [[measure]] and --set call it."""
    sensor_mm: PositivePair | None = None
    """Width and height of the sensor."""
    pixel_um: Length | None = None
    """Side of its pixels, in place of ``sensor_mm``."""
    resolution_px: Annotated[tuple[Side, Side], Listed()]
    """Columns and rows of its pictures."""
    focal_mm: Length | None = None
    """Distance from the centre of projection to the sensor; with ``sensor_mm`` or ``pixel_um``."""
    fx_px: Length | None = None
    """Focal length in columns; the pixel in column i and row j is centred at (i, j)."""
    fy_px: Length | None = None
    """Focal length in rows."""
    cx_px: float | None = None
    """Column of the principal point."""
    cy_px: float | None = None
    """Row of the principal point."""
    skew_px: float = 0.0
    """Entry (1, 2) of the camera matrix."""
    distortion: Numbers = ()
    """OpenCV's k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]]; tau in rad."""
    calibration: str | None = None
    """File of OpenCV, Kalibr, MatchID (.caldat), VIC (.xml) or DICe (.xml)."""
    calibration_camera: str | Annotated[int, Field(ge=0)] = 0
    """Which camera of the file: its name, or its number from 0 on."""
    calibration_unit_mm: Length | None = None
    """Length of the file's unit; by default 1, and 1000 for Kalibr."""
    position_mm: Vector | None = None
    """The centre of projection."""
    target_mm: Vector | None = None
    """A point on the optical axis."""
    up: Direction = (0.0, 0.0, 1.0)
    """Roughly up in the image."""
    rotation_vector: Vector | None = None
    """Rotation R of X_camera = R X + T as a Rodrigues vector, rad."""
    rotation_matrix: Annotated[tuple[Vector, Vector, Vector], Listed()] | None = None
    """The same as three rows; camera axes are x right, y down, z forward."""
    translation_mm: Vector | None = None
    """T of X_camera = R X + T."""
    moved_um: Vector | None = None
    """Where it stands in all frames after the first, against the first: right, down and forward in
    its picture; measures and truth don't know."""
    turned_deg: Vector | None = None
    """How it is turned in them, a rotation vector along the same axes."""
    principal_point_offset_mm: Pair = (0.0, 0.0)
    """Where the optical axis meets the sensor: right and down from the image's centre."""
    square_pixels: bool = True
    """Set to false to say that pixels of unequal sides are meant."""
    lens: LensTable | None = None
    """Without it a pinhole."""
    shutter: ShutterTable | None = None
    """Without it an instant."""
    trigger: TriggerTable | None = None
    """Without it frames are at their times."""
    channels: Literal["mono", "rgb"] = "mono"
    """Of its pictures: grey, or red, green and blue."""
    white_balance: Gains | None = None
    """Gains of the digital numbers of red, green and blue."""
    white_balance_K: Annotated[float, Field(ge=2000, le=40_000)] | None = None
    """The temperature of the light in which a grey surface shall be grey, in their place."""
    own_sensor: Annotated[CameraSensorTable | None, Field(alias="sensor")] = None
    """What differs from [sensor] in this camera."""
    _electronics: SensorTable | None = None

    @property
    def sensor(self) -> tuple[float, float]:
        """Width and height (m); 0 where nobody said them."""
        width, height = self.size_mm() or (0.0, 0.0)
        return width / 1000.0, height / 1000.0

    @property
    def focal(self) -> float:
        """Focal length (m); 0 where nobody said it."""
        focal, size = self.focal_mm or 0.0, self.size_mm()
        if self.fx_px is not None and size is not None:
            focal = self.fx_px * size[0] / self.resolution_px[0]
        return focal / 1000.0

    @property
    def intrinsics(self) -> tuple[float, ...]:
        """fx, fy, cx, cy and skew (px), or nothing; they come before `focal`."""
        given = self.fx_px, self.fy_px, self.cx_px, self.cy_px, self.skew_px
        return () if self.fx_px is None else tuple(value or 0.0 for value in given)

    @property
    def rotation(self) -> tuple[float, ...]:
        """A Rodrigues vector, nine numbers row by row, or nothing."""
        if self.rotation_matrix is not None:
            return tuple(value for row in self.rotation_matrix for value in row)
        return self.rotation_vector or ()

    def late(self, frame: int) -> float:
        """s by which a ``frame`` is exposed after its time."""
        return 0.0 if self.trigger is None else self.trigger.late(self.name, frame)

    @property
    def unsteady(self) -> bool:
        """Whether it doesn't stand in later frames as in the first."""
        return any(self.moved_um or ()) or any(self.turned_deg or ())

    @property
    def electronics(self) -> SensorTable | None:
        """Its sensor, where it isn't the scene's."""
        return self._electronics

    def equip(self, common: SensorTable, where: str) -> None:
        """Enter what its own table makes of the scene's sensor. Raises a fault of the key ``where``
        if both, or a sensor and what the camera says of colour, don't go together."""
        if self.own_sensor is not None:
            self._electronics = merged(common, self.own_sensor, f"{where}.sensor")
        sensor = self.electronics or common
        filtered = self.channels == "rgb" or sensor.bayer is not None
        for key in ("white_balance", "white_balance_K"):
            value = getattr(self, key)
            if value is not None and not filtered:
                raise fault(f"{where}.{key}", "needs pixels behind colour filters", value,
                            'channels = "rgb", or a sensor with bayer')  # fmt: skip
        if self.white_balance_K is not None and sensor.bayer and not all(sensor.bayer_response):
            raise fault(f"{where}.white_balance_K", "can't lift what has no bayer_response",
                        sensor.bayer_response, "responses above 0")  # fmt: skip
        if self.channels == "rgb" and sensor.bayer is not None and sensor.demosaic is None:
            raise fault(f"{where}.channels", "its sensor makes a raw mosaic", "rgb",
                        'demosaic beside bayer, or channels = "mono"')  # fmt: skip
        if self.channels == "mono" and sensor.demosaic is not None:
            raise fault(f"{where}.channels", "its sensor makes a picture in colour of its mosaic",
                        "mono", 'channels = "rgb", or no demosaic')  # fmt: skip
        rows = sensor.sensitivities
        if rows is not None and isinstance(rows[0], tuple) != filtered:
            expected = "3 rows of 3 numbers" if filtered else "3 numbers"
            raise fault(f"{where}.channels", "doesn't go with the sensor's sensitivities",
                        Words(f"{self.channels}, and {rows}"), expected)  # fmt: skip

    def color_words(self) -> list[str]:
        """What it does to colours; nothing if it is grey."""
        words = ["in colour"] if self.channels == "rgb" else []
        if self.white_balance is not None:
            words.append("white balance " + " ".join(f"{gain:g}" for gain in self.white_balance))
        if self.white_balance_K is not None:
            words.append(f"white balance for {self.white_balance_K:g} K")
        return words

    @model_validator(mode="after")
    def _check(self) -> CameraTable:
        self._check_lens()
        self._check_pose()
        self._check_blur()
        if self.white_balance is not None and self.white_balance_K is not None:
            expected = "one of them"
            raise fault("white_balance", "beside white_balance_K", self.white_balance, expected)
        return self

    def _check_blur(self) -> None:
        """What blurs needs lengths on the sensor."""
        if self.lens is None:
            return
        focus = self.lens.focus_distance
        focal, width = self.lens.focal or self.focal, self.sensor[0]
        # a calibration file says fx in pixels
        if focus is not None and not focal and not (self.calibration is not None and width):
            raise fault("lens.focus_distance_mm", "needs the width of the aperture",
                        self.lens.focus_distance_mm,
                        "lens.focal_mm as it stands on the lens, or pixel_um")  # fmt: skip
        if focus is not None and focal and not focus > focal:
            raise fault("lens.focus_distance_mm", "inside the lens", self.lens.focus_distance_mm,
                        "more than focal_mm")  # fmt: skip
        if self.lens.psf is not None and self.lens.psf.type == "airy" and not width:
            expected = "sensor_mm or pixel_um"
            raise fault("lens.psf", "needs lengths on the sensor", Words("airy"), expected)

    def size_mm(self) -> tuple[float, float] | None:
        """Width and height of the sensor, if they are known."""
        if self.pixel_um is None:
            return self.sensor_mm
        columns, rows = (count * self.pixel_um / 1000.0 for count in self.resolution_px)
        return columns, rows

    def _check_lens(self) -> None:
        inner = {key: getattr(self, key) for key in ("fx_px", "fy_px", "cx_px", "cy_px")}
        given = [key for key, value in inner.items() if value is not None]
        ways = [self.calibration is not None, bool(given), self.focal_mm is not None]
        if sum(ways) != 1:
            expected = "focal_mm with sensor_mm, or fx_px, fy_px, cx_px, cy_px, or calibration"
            problem = "the lens must be said in one way"
            raise fault("focal_mm", problem, Words(f"{sum(ways)} ways"), expected)
        if given and len(given) < 4:
            raise fault(given[0], "the camera matrix is incomplete", given, "all of fx_px … cy_px")
        if self.sensor_mm is not None and self.pixel_um is not None:
            raise fault("pixel_um", "beside sensor_mm", Words("both"), "one of them")
        if self.focal_mm is not None and self.size_mm() is None:
            expected = "sensor_mm or pixel_um"
            raise fault("sensor_mm", "needed with focal_mm", Words("nothing"), expected)
        if self.focal_mm is None and any(self.principal_point_offset_mm):
            raise fault("principal_point_offset_mm", "goes with focal_mm only",
                        self.principal_point_offset_mm, "cx_px and cy_px")  # fmt: skip
        if not given and self.skew_px != 0.0:
            raise fault("skew_px", "goes with fx_px … cy_px only", self.skew_px, "no skew_px")
        if self.calibration is not None and self.distortion:
            raise fault("distortion", "stands in the calibration file", self.distortion, "nothing")
        if len(self.distortion) not in (0, 4, 5, 8, 12, 14):
            got = Words(f"{len(self.distortion)} numbers")
            raise fault("distortion", "no model of OpenCV", got, "4, 5, 8, 12 or 14")
        if self.sensor_mm is not None:
            (width, height), (columns, rows) = self.sensor_mm, self.resolution_px
            ratio = (width / columns) / (height / rows)
            if self.square_pixels and not abs(ratio - 1) <= PIXEL_SQUARE:
                raise fault(
                    "resolution_px", "sensor_mm and resolution_px make pixels that aren't square",
                    Words(f"{1000 * width / columns:.4g} x {1000 * height / rows:.4g} um"),
                    "equal sides within 0.1 %, or square_pixels = false",
                )  # fmt: skip

    def _check_pose(self) -> None:
        turned = [self.rotation_vector is not None, self.rotation_matrix is not None]
        by_matrix = any(turned) or self.translation_mm is not None
        by_place = self.position_mm is not None or self.target_mm is not None
        if by_matrix and by_place:
            expected = "position_mm with target_mm, or a rotation with translation_mm"
            problem = "the pose must be said in one way"
            raise fault("position_mm", problem, Words("two ways"), expected)
        if by_matrix:
            if sum(turned) != 1 or self.translation_mm is None:
                problem, got = (
                    "the pose is incomplete or said twice",
                    Words(f"{sum(turned)} rotations"),
                )
                raise fault("translation_mm", problem, got, "one rotation and translation_mm")
        elif by_place:
            if self.position_mm is None or self.target_mm is None:
                key = "position_mm" if self.position_mm is None else "target_mm"
                expected = "position_mm and target_mm"
                raise fault(key, "missing: the pose is incomplete", Words(""), expected)
            view = between(self.position_mm, self.target_mm)
            if not norm(view) > 0:
                raise fault("target_mm", "is where the camera is", self.target_mm, "another point")
            if parallel(view, self.up):
                raise fault("up", "is along the view", self.up, "a vector across it")
        elif self.calibration is None:
            raise fault("position_mm", "the camera's pose is missing", Words("nothing"),
                        "position_mm and target_mm, or a rotation and translation_mm")  # fmt: skip
