"""Lights, in radiometric units; `gpusim.optics.light.quadrature` turns them into what is summed up.

Power is radiant flux in W. Photometric data are converted by `watts`: 683 lm/W at 555 nm, which is
exact for monochromatic green light and a matter of definition for everything else.

Light of a colour has a mean of 1 over red, green and blue: power, irradiance and radiance are what
a sensor gets of it that is equally sensitive to all three, whatever its colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from typing import Self

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.files.input_file import InputFile
from gpusim.optics.light.light_color import ColoredLight, LightColor
from gpusim.optics.light.panorama import read_panorama
from gpusim.surface.color import BANDS
from gpusim.validation import checked

Vector = tuple[float, float, float]

LUMENS_PER_WATT = 683.0
SUN_DIAMETER = 9.3e-3
"""rad; the sun seen from the Earth."""


def watts(lumens: float) -> float:
    """Luminous flux (lm) as radiant flux (W) at 555 nm, where 683 lm are one watt."""
    return lumens / LUMENS_PER_WATT


def _check(what: str, **vectors: Vector) -> None:
    for name, vector in vectors.items():
        if np.shape(vector) != (3,) or not np.isfinite(vector).all():
            raise InputError(f"{what} {name}; got {vector}; expected three finite numbers")


def _check_positive(what: str, unit: str, **values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{what} {name}; got {value}; expected {unit} above 0")


def _check_aim(what: str, position: Vector, target: Vector) -> None:
    _check(what, position=position, target=target)
    if tuple(position) == tuple(target):
        raise InputError(f"{what} target; got the lamp's own position {target}")


@checked
@dataclass(frozen=True)
class PointLight(ColoredLight):
    """Shines equally in all directions: radiant flux ``power`` (W), intensity power / 4 pi.

    ``shadows``: whether surfaces hide it, ``color``: red, green and blue in any scale, "#rrggbb",
    or what `blackbody` gives; here and in the other lamps.

    Examples
    --------
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (6, 4), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> lit = gs.render([wall], camera, [gs.PointLight((0, 0, 3), power=100.0)], backend="numpy")
    >>> print(f"{lit.radiance[2, 3]:.3f}")
    0.140
    """

    position: Vector
    power: float
    shadows: bool = True
    color: LightColor = LightColor()

    def __post_init__(self) -> None:
        _check_positive("PointLight", "watts", power=self.power)
        _check("PointLight", position=self.position)


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
    power: float
    cone: float = np.pi / 3
    penumbra: float = 0.2
    shadows: bool = True
    color: LightColor = LightColor()

    def __post_init__(self) -> None:
        _check_positive("SpotLight", "watts", power=self.power)
        _check_aim("SpotLight", self.position, self.target)
        if not 0.0 < self.cone < np.pi:
            raise InputError(f"SpotLight cone; got {self.cone}; expected an angle in 0 … pi (rad)")
        if not 0.0 <= self.penumbra <= 1.0:
            raise InputError(f"SpotLight penumbra; got {self.penumbra}; expected 0 to 1")

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
    size: tuple[float, float]
    power: float
    shape: str = "rectangle"
    shadows: bool = True
    color: LightColor = LightColor()

    def __post_init__(self) -> None:
        _check_positive("AreaLight", "watts", power=self.power)
        _check_aim("AreaLight", self.position, self.target)
        size = np.asarray(self.size, np.float64)
        if size.shape != (2,) or not (np.isfinite(size) & (size > 0.0)).all():
            raise InputError(f"AreaLight size; got {self.size}; expected two lengths above 0")
        if self.shape not in ("rectangle", "ellipse"):
            raise InputError(
                f"AreaLight shape; got {self.shape!r}; expected 'rectangle' or 'ellipse'"
            )


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
    irradiance: float
    diameter: float = SUN_DIAMETER
    shadows: bool = True
    color: LightColor = LightColor()

    def __post_init__(self) -> None:
        _check_positive("SunLight", "W per square unit", irradiance=self.irradiance)
        _check("SunLight", direction=self.direction)
        if not float(np.linalg.norm(self.direction)) > 0.0:
            raise InputError(f"SunLight direction; got {self.direction}; expected one, not zero")
        if not 0.0 <= self.diameter <= 0.2:
            raise InputError(f"SunLight diameter; got {self.diameter}; expected 0 to 0.2 (rad)")


@checked
@dataclass(frozen=True)
class AmbientLight(ColoredLight):
    """Surroundings of one ``radiance`` (W per square unit and sr) in every direction.

    It stands for what a room's walls send back; every face receives pi x radiance, or with
    ``occlusion`` the share of it that surfaces around leave open (see docs/light.md).

    Examples
    --------
    >>> gs.AmbientLight(radiance=0.3)
    AmbientLight(radiance=0.3, occlusion=False, color=None)
    """

    strengths = ("radiance",)
    radiance: float
    occlusion: bool = False
    color: LightColor = LightColor()

    def __post_init__(self) -> None:
        _check_positive("AmbientLight", "a radiance", radiance=self.radiance)


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
    sky: float = 0.0
    ground: float = 0.0
    image: Float | None = None
    up: Vector = (0.0, 0.0, 1.0)
    forward: Vector = (0.0, 1.0, 0.0)
    occlusion: bool = False
    color: LightColor = LightColor()
    __repr__ = field_summary

    def __post_init__(self) -> None:
        _check("EnvironmentLight", up=self.up, forward=self.forward)
        if not float(np.linalg.norm(np.cross(self.up, self.forward))) > 0.0:
            raise InputError(f"EnvironmentLight up; got {self.up}, along forward {self.forward}")
        if self.image is None:
            for name, value in (("sky", self.sky), ("ground", self.ground)):
                if not (np.isfinite(value) and value >= 0.0):
                    raise InputError(
                        f"EnvironmentLight {name}; got {value}; expected a radiance from 0 up"
                    )
            return
        image = np.array(self.image, np.float64)
        image.setflags(write=False)  # what follows from it is kept
        shaped = image.ndim == 2 or image.shape[2:] == (3,)
        if not shaped or not image.size or not np.isfinite(image).all():
            raise InputError(
                f"EnvironmentLight image; got shape {image.shape}; expected finite values (H, W), "
                "or (H, W, 3) of three colours"
            )
        if not (image >= 0.0).all():
            raise InputError(f"EnvironmentLight image; got {image.min()}; expected radiances >= 0")
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
        scale: float = 1.0,
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
        _check_positive("EnvironmentLight", "a radiance", scale=scale)
        image = scale * read_panorama(path, channels)
        return EnvironmentLight(
            image=image, up=up, forward=forward, occlusion=occlusion, color=color
        )


Light = PointLight | SpotLight | AreaLight | SunLight | AmbientLight | EnvironmentLight


def is_light(value: object) -> bool:
    """Whether ``value`` is one of the lights."""
    return isinstance(value, Light)
