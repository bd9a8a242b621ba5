"""``[sensor]``: from radiance to grey values."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)

from gpusim.scene.tables.table import (
    Length,
    Listed,
    Seed,
    Table,
    add_descriptions,
    fault,
    name_and_unit,
)

Some = Annotated[float, Field(ge=0)] | None
Most = Annotated[float, Field(gt=0)] | None


Bits = Literal[8, 10, 12, 14, 16]
Exposure = Literal["auto"] | Length
Gamma = Literal["srgb"] | Length
Preset = Literal["stereo-dic-5mp", "imx174", "icx625-pilot", "icx625-grasshopper"]
Mosaic = Literal["RGGB", "BGGR", "GRBG", "GBRG"]
Demosaic = Literal["bilinear", "malvar"]
Share = Annotated[float, Field(ge=0)]
Gains = Annotated[tuple[Length, Length, Length], Listed()]
Response = Annotated[tuple[Share, Share, Share], Listed()]
Sensitivities = Response | Annotated[tuple[Response, Response, Response], Listed()]
_NOISE = (
    "gain_DN_per_e", "full_well_e", "read_noise_e", "dark_current_e_per_s", "dsnu_e",
    "prnu_percent", "black_level_DN",
)  # fmt: skip


class _Electronics(Table):
    bits: Bits = 8
    """More than 8 are stored as 16-bit numbers, not scaled up: viewers show 12-bit pictures nearly
    black (full scale is 4095 of 65535), unless ``upper_bits`` is true."""
    upper_bits: bool = False
    """Files hold numbers of 10 to 14 bits in the upper bits of 16 (12: times 16), so that viewers
    show full scale as white. Reports and measurements are the same."""
    exposure_: Annotated[Exposure, Field(alias="exposure")] = "auto"
    """Fraction of full scale per unit of radiance; "auto": set once for all frames of a camera."""
    preset: Preset | None = None
    """A real camera's values; keys given beside it replace them."""
    gain_DN_per_e: Most = None
    """Overall system gain; without it the full well is at full scale."""
    full_well_e: Most = None
    """Saturation capacity in electrons."""
    read_noise_e: Some = None
    """Standard deviation of the temporal dark noise in electrons."""
    dark_current_e_per_s: Some = None
    """Gathers during ``camera.shutter.exposure_ms``."""
    dsnu_e: Some = None
    """Standard deviation of the pixels' offsets in electrons."""
    prnu_percent: Some = None
    """Standard deviation of the pixels' gains."""
    black_level_DN: Some = None
    """Grey value of a dark pixel."""
    gamma: Gamma | None = None
    """Grey value = full scale x (linear share)^(1 / gamma), or by the curve of "srgb", as viewers
    expect it; without it linear, in colour too."""
    bayer: Mosaic | None = None
    """A colour mosaic before the pixels, raw unless demosaiced."""
    bayer_response: Response = (1.0, 1.0, 1.0)
    """Relative responses of red, green and blue pixels."""
    demosaic: Demosaic | None = None
    """How the mosaic becomes a picture in colour."""
    sensitivities: Sensitivities | None = None
    """In the bands red, green, blue: 3 numbers of a mono camera (by default a third each), or 3
    rows of them, for the red, green and blue channel (by default each sees its band)."""

    @field_validator("sensitivities")
    @classmethod
    def _seeing(cls, rows: Any) -> Any:
        if rows is not None and not all(map(any, rows if isinstance(rows[0], tuple) else [rows])):
            raise fault("", "a channel that sees nothing", rows, "none all zero")
        return rows


class SensorTable(_Electronics):
    """From radiance to grey values, without noise unless a gain, a full well or a preset is given.

    Noise follows EMVA 1288: shot noise and dark current are Poisson distributed, the read-out's is
    normal, and pixels differ in offset and gain.

    Example::

        bits = 12
        format = "tiff"
        full_well_e = 10500.0
        read_noise_e = 2.4
        prnu_percent = 0.5
        seed = 1
    """

    format: Literal["png", "tiff"] = "png"
    """Of the pictures' files."""
    seed: Seed = 0
    """Of the noise; every camera and frame has its own, independent of the others."""
    series: Annotated[int, Field(ge=0, lt=100_000)] = 0
    """Of the same sensor: pixels keep their offsets and gains, all other noise is new. Variants are
    series 0, 1, 2 … unless they say otherwise."""

    drift_percent: Annotated[float, Field(gt=-100)] | None = None
    """By how much frames after the first are brighter, as of lamps that drift."""

    @model_validator(mode="after")
    def _check(self) -> SensorTable:
        counted = self.preset or self.gain_DN_per_e is not None or self.full_well_e is not None
        for key in ("read_noise_e", "dark_current_e_per_s", "dsnu_e", "prnu_percent"):
            if getattr(self, key) and not counted:
                raise fault(key, "noise without electrons", getattr(self, key),
                            "gain_DN_per_e, full_well_e or preset beside it")  # fmt: skip
        black = self.black_level_DN
        if black is not None and not black < 2**self.bits - 1:
            raise fault("black_level_DN", "above full scale", black, f"below {2**self.bits - 1}")
        if self.demosaic is not None and self.bayer is None:
            raise fault("demosaic", "no mosaic", self.demosaic, "bayer beside it")
        return self

    @property
    def exposure(self) -> float | None:
        """Fraction of full scale per unit of radiance, None to choose it from frame 0."""
        return None if self.exposure_ == "auto" else float(self.exposure_)

    @property
    def shift(self) -> int:
        """How many bits further up than they were counted the numbers are in files."""
        return 16 - self.bits if self.upper_bits and self.bits > 8 else 0

    @property
    def values(self) -> dict[str, Any]:
        """By name of `gpusim.optics.sensor.sensor.Sensor`, what is given beside the preset."""
        noise = [name_and_unit(key)[0] for key in _NOISE]
        names = [*noise, "gamma", "demosaic", "sensitivities"]
        if self.bayer is not None:
            names += ["bayer", "bayer_response"]
        given = {name: getattr(self, name) for name in names}
        return {name: value for name, value in given.items() if value is not None}

    @property
    def noisy(self) -> bool:
        """Whether electrons are counted."""
        return self.preset is not None or bool({"gain", "full_well"} & self.values.keys())

    def words(self) -> list[str]:
        """What it does beside counting light."""
        done = [self.preset or "noise by EMVA 1288"] if self.noisy else ["no noise"]
        own = self.values
        return [
            *done,
            *(f"{name} {own[name]}" for name in ("bayer", "demosaic", "gamma") if name in own),
        ]


def _without_defaults(schema: dict[str, Any], table: type[BaseModel]) -> None:
    add_descriptions(schema, table)
    for value in schema["properties"].values():
        del value["default"]


class CameraSensorTable(_Electronics):
    """What is another sensor in one camera: keys given here replace those of [sensor].

    A ``preset`` given here replaces all that [sensor] says of gain, noise and black level.

    Example::

        bits = 12
        gain_DN_per_e = 0.4
    """

    model_config = ConfigDict(json_schema_extra=_without_defaults)

    @model_serializer(mode="wrap")
    def _given(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """What is said, without what is as in [sensor]."""
        fields = type(self).model_fields
        given = {fields[name].alias or name for name in self.model_fields_set}
        return {key: value for key, value in write(self).items() if key in given}


def merged(common: SensorTable, own: CameraSensorTable, where: str) -> SensorTable:
    """The sensor of a camera. Raises a fault under the key ``where`` if both don't go together."""
    values = common.model_dump(by_alias=True, exclude_none=True)
    if own.preset is not None:
        values = {key: value for key, value in values.items() if key not in _NOISE}
    values |= own.model_dump(by_alias=True)
    try:
        return SensorTable.model_validate(values)
    except ValidationError as error:
        found = error.errors()[0].get("ctx", {})
        key = f"{where}.{found['key']}"
        problem = f"{found['problem']}, with what [sensor] says"
        raise fault(key, problem, found["got"], found["expected"]) from None
