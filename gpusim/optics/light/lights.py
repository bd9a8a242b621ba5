"""Lights, in radiometric units; `gpusim.optics.light.quadrature` turns them into what is summed up.

Power is radiant flux in W. Photometric data are divided by `LUMENS_PER_WATT`, at 555 nm, which is
exact for monochromatic green light and a matter of definition for everything else.

Light of a colour has a mean of 1 over red, green and blue: power, irradiance and radiance are what
a sensor gets of it that is equally sensitive to all three, whatever its colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from typing import Annotated, Self

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.files.input_file import InputFile
from gpusim.optics.light.flicker import Flicker
from gpusim.optics.light.light_color import ColoredLight, LightColor
from gpusim.optics.light.panorama import read_panorama
from gpusim.surface.color import BANDS
from gpusim.validation import Rule, Share, checked, one_of, positive, require, within

Watts = Annotated[float, positive("watts above 0")]
RadianceFromZero = Annotated[
    float, Rule("a radiance from 0 up", lambda value: 0.0 <= value < np.inf)
]
Radiance = Annotated[float, positive("a radiance above 0")]
Vector = Annotated[
    tuple[float, float, float],
    Rule("three finite numbers", lambda vector: bool(np.isfinite(vector).all())),
]
Size = Annotated[
    tuple[float, float],
    Rule("two lengths above 0", lambda size: all(0.0 < side < np.inf for side in size)),
]

LUMENS_PER_WATT = 683.0
SUN_DIAMETER = 9.3e-3
"""rad; the sun seen from the Earth."""


def _check_aim(what: str, position: Vector, target: Vector) -> None:
    if tuple(position) == tuple(target):
        raise InputError(f"{what} target; got the lamp's own position {target}")


@checked
@dataclass(frozen=True)
class PointLight(ColoredLight):
    """Shines equally in all directions: radiant flux ``power`` (W), intensity power / 4 pi.

    ``shadows``: whether surfaces hide it, ``color``: red, green and blue in any scale, "#rrggbb",
    or what `blackbody` gives, ``flicker``: how its light varies about that power; here and in the
    other lamps.

    Examples
    --------
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (6, 4), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> lit = gs.render([wall], camera, [gs.PointLight((0, 0, 3), power=100.0)], backend="numpy")
    >>> print(f"{lit.radiance[2, 3]:.3f}")
    0.140
    """

    position: Vector
    power: Watts
    shadows: bool = True
    color: LightColor = LightColor()
    flicker: Flicker | None = None


@checked
@dataclass(frozen=True)
class SpotLight(ColoredLight):
    """A small lamp whose beam has a ``cone`` (full angle, rad) around the way to ``target``.

    Within the cone less ``penumbra`` (the share of the half angle over which it fades, 0 to 1;
    nothing to do with shadows) the intensity is even; ``power`` (W) is the flux of the whole beam.

    Examples
    --------
    >>> gs.SpotLight(position=(0, 0, 2), target=(0, 0, 0), power=40.0, cone=0.5).penumbra
    0.2
    """

    position: Vector
    target: Vector
    power: Watts
    cone: Annotated[float, Rule("an angle in 0 … pi (rad)", lambda angle: 0.0 < angle < np.pi)] = (
        np.pi / 3
    )
    penumbra: Share = 0.2
    shadows: bool = True
    color: LightColor = LightColor()
    flicker: Flicker | None = None

    def __post_init__(self) -> None:
        _check_aim("SpotLight", self.position, self.target)

    @property
    def cosines(self) -> tuple[float, float]:
        """Cosines of the angles from the axis where the beam ends and where it is full."""
        outer = 0.5 * self.cone
        return float(np.cos(outer)), float(np.cos(outer * (1.0 - max(self.penumbra, 1e-3))))

    @property
    def intensity(self) -> float:
        """W/sr on the axis: the smooth step between the cosines has a mean of one half."""
        outer, inner = self.cosines
        return self.power / (2.0 * np.pi * (1.0 - 0.5 * (outer + inner)))


@checked
@dataclass(frozen=True)
class AreaLight(ColoredLight):
    """A lamp of ``size`` (width, height) that faces ``target`` and emits by Lambert's law.

    ``shape`` is ``"rectangle"`` or ``"ellipse"`` (a disc where both sizes are equal). Its width
    runs level. ``power`` is its radiant flux (W); its radiance is power / (pi x its area). The
    larger it is, the softer are its shadows.

    Examples
    --------
    >>> gs.AreaLight(position=(0, 0, 2), target=(0, 0, 0), size=(0.3, 0.2), power=40.0).shape
    'rectangle'
    """

    position: Vector
    target: Vector
    size: Size
    power: Watts
    shape: Annotated[str, one_of("rectangle", "ellipse")] = "rectangle"
    shadows: bool = True
    color: LightColor = LightColor()
    flicker: Flicker | None = None

    def __post_init__(self) -> None:
        _check_aim("AreaLight", self.position, self.target)


@checked
@dataclass(frozen=True)
class SunLight(ColoredLight):
    """Light from infinitely far: it travels along ``direction``.

    ``irradiance`` (W per square unit) is that of a face square to it; ``diameter`` (rad) is how
    large it looks, which decides how soft its shadows are.

    Examples
    --------
    >>> gs.SunLight(direction=(0, 0, -1), irradiance=800.0).diameter
    0.0093
    """

    direction: Vector
    strengths = ("irradiance",)
    irradiance: Annotated[float, positive("W per square unit above 0")]
    diameter: Annotated[float, within(0.0, 0.2, "(rad)")] = SUN_DIAMETER
    shadows: bool = True
    color: LightColor = LightColor()
    flicker: Flicker | None = None

    def __post_init__(self) -> None:
        some = float(np.linalg.norm(self.direction)) > 0.0
        require(some, "SunLight direction", self.direction, "one, not zero")


@checked
@dataclass(frozen=True)
class AmbientLight(ColoredLight):
    """Surroundings of one ``radiance`` (W per square unit and sr) in every direction.

    It stands for what a room's walls send back; every face receives pi x radiance, or with
    ``occlusion`` the share of it that surfaces around leave open (see docs/light.md).

    Examples
    --------
    >>> gs.AmbientLight(radiance=0.3)
    AmbientLight(radiance=0.3, occlusion=False, color=None, flicker=None)
    """

    strengths = ("radiance",)
    radiance: Radiance
    occlusion: bool = False
    color: LightColor = LightColor()
    flicker: Flicker | None = None


@checked
@dataclass(frozen=True, eq=False)
class EnvironmentLight(ColoredLight):
    """Surroundings at a distance, given by their radiance (W per square unit and sr).

    Either ``sky`` above and ``ground`` below the horizon, or an equirectangular ``image`` (H, W),
    or (H, W, 3) of red, green and blue: its first row looks ``up``, its middle column along
    ``forward``, columns run to the right as seen from the middle. They light diffusely and are
    mirrored by glossy paints; with ``occlusion`` surfaces hide them. A ``color`` tints all of them.

    Examples
    --------
    >>> gs.EnvironmentLight(sky=1.0, ground=0.2, occlusion=True).sky
    1.0
    """

    strengths = ("sky", "ground")
    sky: RadianceFromZero = 0.0
    ground: RadianceFromZero = 0.0
    image: Float | None = None
    up: Vector = (0.0, 0.0, 1.0)
    forward: Vector = (0.0, 1.0, 0.0)
    occlusion: bool = False
    color: LightColor = LightColor()
    flicker: Flicker | None = None
    __repr__ = field_summary

    def __post_init__(self) -> None:
        if not float(np.linalg.norm(np.cross(self.up, self.forward))) > 0.0:
            raise InputError(f"EnvironmentLight up; got {self.up}, along forward {self.forward}")
        if self.image is None:
            return
        image = np.array(self.image, np.float64)
        image.setflags(write=False)  # what follows from it is kept
        shaped = (image.ndim == 2 or image.shape[2:] == (3,)) and image.size > 0
        expected = "finite values (H, W), or (H, W, 3) of three colours"
        whole = shaped and bool(np.isfinite(image).all())
        require(whole, "EnvironmentLight image", f"shape {image.shape}", expected)
        require((image >= 0.0).all(), "EnvironmentLight image", image.min(), "radiances >= 0")
        if image.ndim == 3 and (image == image[..., :1]).all():
            image = image[..., 0]
        object.__setattr__(self, "image", image)

    @property
    def colored(self) -> bool:
        """Whether it isn't grey."""
        return super().colored or (self.image is not None and self.image.ndim == 3)

    @cached_property
    def _grey(self) -> Self:
        if self.image is None:
            return replace(self, color=None)
        images = [np.asarray(self.in_band(band).image) for band in BANDS]
        return replace(self, color=None, image=np.mean(images, axis=0))

    def _of_band(self, band: int) -> Self:
        result = super()._of_band(band)
        if self.image is not None:
            image = self.image if self.image.ndim == 2 else self.image[..., band]
            share = 1.0 if self.color is None else self.color[band]
            object.__setattr__(result, "image", share * image)
        return result

    @staticmethod
    @checked
    def read(
        path: str | PathLike[str] | InputFile,
        *,
        scale: Radiance = 1.0,
        up: Vector = (0.0, 0.0, 1.0),
        forward: Vector = (0.0, 1.0, 0.0),
        occlusion: bool = False,
        color: float | str | Sequence[float] | None = None,
        channels: str = "rgb",
    ) -> EnvironmentLight:
        """The surroundings in an equirectangular picture of radiances.

        ``scale`` is the radiance of its value 1, ``channels`` as of `read_panorama`. Raises
        InputError naming the file.
        """
        image = scale * read_panorama(path, channels)
        return EnvironmentLight(
            image=image, up=up, forward=forward, occlusion=occlusion, color=color
        )


Light = PointLight | SpotLight | AreaLight | SunLight | AmbientLight | EnvironmentLight


def dimmed(light: Light, share: float) -> Light:
    """A steady light of a ``share`` above 0 of the strength."""
    fields = [*light.strengths, "image"] if isinstance(light, EnvironmentLight) else light.strengths
    strengths = {name: getattr(light, name) for name in fields}
    changed = {name: share * one for name, one in strengths.items() if one is not None}
    return replace(light, flicker=None, **changed)


def is_light(value: object) -> bool:
    """Whether ``value`` is one of the lights."""
    return isinstance(value, Light)
