"""``[[light]]``: lamps, the sun and the surroundings.

Radiant flux is ``power_W``, or ``power_lm`` taken as light of 555 nm (683 lm are 1 W).
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from gpusim.scene.tables.colors import TintedTable
from gpusim.scene.tables.table import (
    Direction,
    Length,
    Name,
    PositivePair,
    Share,
    Table,
    Vector,
    Words,
    between,
    fault,
    known_suffix,
    norm,
    parallel,
)

LUMENS_PER_WATT = 683.0
# The endings that the reader knows; said here too, because a plan loads no numerics.
PANORAMA_SUFFIXES = (".hdr", ".pic", ".exr", ".tif", ".tiff", ".npy")
Radiance = Annotated[float, Field(ge=0)]


class FlickerTable(Table):
    """How light varies about its mean, which is what the light's other keys say: with the mains, or
    switched on and off (pulse-width modulation). Frames are to be in time.

    Example::

        mains_Hz = 50.0
        modulation = 0.3
    """

    mains_Hz: Length | None = None
    """1 + modulation cos(4 pi mains_Hz t + phase_deg) of the mean."""
    modulation: Share | None = None
    """With ``mains_Hz``: 0 is steady light; at 1 it is dark between its peaks."""
    pwm_Hz: Length | None = None
    """How often it is switched on."""
    duty: Annotated[float, Field(gt=0, le=1)] | None = None
    """With ``pwm_Hz``: the share of each period in which it shines, with 1 / duty of the mean."""
    phase_deg: float = 0.0
    """Of the light, at time 0."""

    @model_validator(mode="after")
    def _check(self) -> FlickerTable:
        given = {key for key, value in self if value is not None} - {"phase_deg"}
        if given not in ({"mains_Hz", "modulation"}, {"pwm_Hz", "duty"}):
            wanted = "mains_Hz and modulation, or pwm_Hz and duty"
            got = Words(" ".join(sorted(given)) or "nothing")
            raise fault("", "how light varies is to be said in one way", got, wanted)
        return self

    @property
    def frequency(self) -> float:
        """Of the light (Hz)."""
        return self.pwm_Hz or 2.0 * (self.mains_Hz or 0.0)


class _Light(TintedTable):
    name: Name
    """What messages and --set call it."""
    flicker: FlickerTable | None = None
    """Without it steady light."""


class _Lamp(_Light):
    shadows: bool = True
    """Whether surfaces hide it."""


class _Powered(_Lamp):
    position_mm: Vector
    """Its centre."""
    power_W: Length | None = None
    """Radiant flux; or give power_lm."""
    power_lm: Length | None = None
    """Luminous flux."""

    @model_validator(mode="after")
    def _check_power(self) -> _Powered:
        if (self.power_W is None) == (self.power_lm is None):
            got = Words("neither" if self.power_W is None else "both")
            expected = "power_W or power_lm"
            raise fault("power_W", "how strong the lamp is must be said once", got, expected)
        return self

    @property
    def power(self) -> float:
        """Radiant flux (W)."""
        return self.power_W or (self.power_lm or 0.0) / LUMENS_PER_WATT


class PointTable(_Powered):
    """A small lamp that shines evenly in all directions.

    Example::

        name = "bulb"
        type = "point"
        position_mm = [-300.0, -900.0, 500.0]
        power_W = 40.0
    """

    type: Literal["point"]


class _Aimed(_Powered):
    target_mm: Vector
    """A point that it shines at."""

    @model_validator(mode="after")
    def _check_aim(self) -> _Aimed:
        if not norm(between(self.position_mm, self.target_mm)) > 0:
            raise fault("target_mm", "is where the lamp is", self.target_mm, "another point")
        return self


class SpotTable(_Aimed):
    """A small lamp with a beam, as of a halogen spot.

    Example::

        name = "spot"
        type = "spot"
        position_mm = [-300.0, -900.0, 500.0]
        target_mm = [100.0, 0.0, 5.0]
        cone_deg = 40.0
        power_lm = 4000.0
    """

    type: Literal["spot"]
    cone_deg: Annotated[float, Field(gt=0, lt=180)] = 60.0
    """The full angle of the beam."""
    penumbra: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Share of the half angle over which the beam fades (nothing to do with shadows)."""


class AreaTable(_Aimed):
    """A lamp with a face, which looks at its target and radiates as a diffuse surface does.

    Example::

        name = "panel"
        type = "area"
        position_mm = [0.0, -900.0, 400.0]
        target_mm = [100.0, 0.0, 5.0]
        size_mm = [300.0, 200.0]
        power_W = 30.0
    """

    type: Literal["area"]
    size_mm: PositivePair
    """Width (level) and height: how soft its shadows are."""
    shape: Literal["rectangle", "ellipse"] = "rectangle"
    """Of its face; "ellipse" fills ``size_mm`` as a disc does."""


class SunTable(_Lamp):
    """Light from infinitely far.

    Example::

        name = "sun"
        type = "sun"
        direction = [0.3, 1.0, -1.0]
        irradiance_W_m2 = 500.0
    """

    type: Literal["sun"]
    direction: Direction
    """The way the light goes."""
    irradiance_W_m2: Length
    """On a face square to it."""
    diameter_deg: Annotated[float, Field(ge=0, le=10)] = 0.533
    """How large it looks: the softness of its shadows."""


class AmbientTable(_Light):
    """What the surroundings send back, equally from every direction.

    Example::

        name = "room"
        type = "ambient"
        radiance_W_m2_sr = 0.5
    """

    type: Literal["ambient"]
    radiance_W_m2_sr: Length
    """Radiance of the surroundings."""
    occlusion: bool = False
    """Whether bodies and props hide it from each other (ambient occlusion)."""


class EnvironmentTable(_Light):
    """Surroundings that light all faces and are mirrored by glossy ones: bright sky (or ceiling)
    above and ground below, or a picture of them all.

    Example::

        name = "hall"
        type = "environment"
        sky_W_m2_sr = 1.0
        ground_W_m2_sr = 0.3
    """

    type: Literal["environment"]
    sky_W_m2_sr: Radiance | None = None
    """Radiance above the horizon; or give file."""
    ground_W_m2_sr: Radiance | None = None
    """Radiance below it."""
    path: Annotated[Annotated[str, Field(min_length=1)] | None, Field(alias="file")] = None
    """Equirectangular picture of radiances (.hdr, .exr, .tif of floats, .npy), relative to the
    scene file."""
    channels: Literal["rgb", "grey"] = "rgb"
    """"rgb": a file in colour is light in colour; "grey": its luminance alone counts."""
    studio_W_m2_sr: Length | None = None
    """Mean radiance of a photographer's studio: soft boxes, a horizon and a pale floor, for steel
    to mirror; instead of sky and ground or a file."""
    scale_W_m2_sr: Length = 1.0
    """Radiance of the value 1 in the file."""
    up: Direction = (0.0, 0.0, 1.0)
    """Where the file's first row looks."""
    forward: Direction | None = None
    """Where the middle of the file or studio is; without it +y, or +x where up is along y."""
    occlusion: bool = False
    """Whether bodies and props hide it from each other (ambient occlusion)."""

    @model_validator(mode="after")
    def _check(self) -> EnvironmentTable:
        studio = self.studio_W_m2_sr is not None
        picture = "studio_W_m2_sr" if studio else "file" if self.path is not None else ""
        if studio and self.path is not None:
            raise fault("file", f"beside {picture}", self.path, "one of them")
        for key in ("sky_W_m2_sr", "ground_W_m2_sr"):
            value = getattr(self, key)
            if picture and value is not None:
                raise fault(key, f"beside {picture}", value, "one of them")
            if not picture and value is None:
                raise fault(key, "missing", Words("neither file nor both radiances"),
                            "sky_W_m2_sr and ground_W_m2_sr, or file")  # fmt: skip
        if self.path is not None:
            known_suffix("picture", self.path, PANORAMA_SUFFIXES)
        if self.forward is not None:
            if not picture:
                raise fault("forward", "without file", self.forward, "a file beside it")
            if parallel(self.up, self.forward):
                raise fault("forward", "is along up", self.forward, "a vector across it")
        return self


Light = PointTable | SpotTable | AreaTable | SunTable | AmbientTable | EnvironmentTable
LightTable = Annotated[Light, Field(discriminator="type")]
