"""Lens, shutter and sensor of a scene, in m, s, px and electrons; what they are in words."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Lens", "Psf", "Sensor", "Shutter", "Vignetting"]

Grid = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Psf:
    """A point spread: ``size`` is a sigma or a radius (px), or samples per px of ``kernel``.

    Type "airy" has a ``wavelength`` (m), and its f-number as the size.
    """

    type: str
    size: float
    wavelength: float = 0.0
    kernel: Grid = ()


@dataclass(frozen=True)
class Vignetting:
    """Factors that are multiplied: the natural law, a polynomial, a map of gains."""

    cos4: bool
    polynomial: tuple[float, ...]
    map: Grid | None


@dataclass(frozen=True)
class Lens:
    """``f_number`` and ``focus_distance`` are None together: no depth of field.

    ``focal``: as it stands on the lens; None to find it from the image distance. ``positions``:
    None for as many as needed.
    """

    psf: Psf | None
    fill_factor: float
    f_number: float | None
    focus_distance: float | None
    blades: int
    vignetting: Vignetting | None
    focal: float | None = None
    positions: int | None = None

    def words(self) -> list[str]:
        """What it does."""
        done = []
        if self.psf is not None:
            unit = {"gaussian": " px", "disc": " px"}.get(self.psf.type, "")
            done.append(f"{self.psf.type} point spread {self.psf.size:g}{unit}")
        if self.fill_factor != 1.0:
            done.append(f"fill factor {self.fill_factor:g}")
        if self.f_number is not None:
            done.append(f"depth of field f/{self.f_number:g}")
        if self.vignetting is not None:
            done.append("vignetting")
        return done


@dataclass(frozen=True)
class Shutter:
    """Times in s; ``line_time`` 0 is a global shutter; ``samples`` None: as many as needed."""

    exposure: float
    line_time: float
    samples: int | None = None

    def words(self) -> list[str]:
        """What it does."""
        done = []
        if self.exposure:
            done.append(f"exposed for {1e3 * self.exposure:g} ms")
        if self.line_time:
            done.append(f"rolling shutter {1e6 * self.line_time:g} us a row")
        return done


@dataclass(frozen=True)
class Sensor:
    """``exposure``: fraction of full scale per unit of radiance, None to choose it from frame 0.

    ``values``: by name of `gpusim.optics.sensor.sensor.Sensor`, what is given beside the preset.
    """

    bits: int
    exposure: float | None
    format: str
    seed: int = 0
    preset: str | None = None
    values: tuple[tuple[str, float | str | tuple[float, ...]], ...] = ()
    series: int = 0

    @property
    def noisy(self) -> bool:
        """Whether electrons are counted."""
        return self.preset is not None or bool({"gain", "full_well"} & dict(self.values).keys())

    def words(self) -> list[str]:
        """What it does beside counting light."""
        own = dict(self.values)
        done = [self.preset or "noise by EMVA 1288"] if self.noisy else ["no noise"]
        done += [f"{name} {own[name]}" for name in ("bayer", "gamma") if name in own]
        return done
