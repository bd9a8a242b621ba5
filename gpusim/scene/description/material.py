"""``[[material]]``: elasticity, yielding, density and thermal expansion."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from gpusim.scene.tables.table import (
    Direction,
    Length,
    Listed,
    Name,
    Pair,
    Table,
    Vec3,
    Vector,
    Words,
    across,
    cross,
    fault,
    parallel,
    unit,
)

Several = float | Vector
Curve = Annotated[tuple[Pair, ...], Listed(1)]
FINITE_STRAIN = ("saint-venant-kirchhoff", "neo-hookean", "hencky", "j2")
"""Types that hold for any strain: linear theory has no such thing."""
NO_FLOW = "metal flows at constant volume, elements that can't follow are far too stiff"
FLOWING = 'hex8 ("incompatible" or "bbar"), hex20 ("reduced"), tet10 ("bbar")'
"""What is said of elements that aren't fit for metal that yields, and those that are."""
SeveralPositive = Length | Annotated[tuple[Length, Length, Length], Listed()]


class MaterialTable(Table):
    """A material: linear elastic, hyperelastic or one that yields. Orthotropic ones have three
    numbers where others have one.

    Example::

        name = "steel"
        youngs_modulus_GPa = 210.0
        poissons_ratio = 0.3
        density_kg_m3 = 7850.0
    """

    name: Name
    """What [[body]] and [[body.part]] call it."""
    type: Literal[
        "isotropic", "orthotropic", "saint-venant-kirchhoff", "neo-hookean", "hencky", "j2"
    ] = "isotropic"
    """Linear elastic, strains of some per cent at most: "isotropic", alike in all directions, or
    "orthotropic", three axes, as wood or laminates. For any strain, alike in all directions, of
    bodies that are solved nonlinearly: "hencky" (linear in logarithmic strain), "neo-hookean"
    (rubber), "saint-venant-kirchhoff" (not where it is pressed hard), and "j2", metal that
    yields."""
    youngs_modulus_GPa: SeveralPositive
    """Orthotropic: [E1, E2, E3] along the material axes; isotropic: one for all directions."""
    poissons_ratio: Several
    """Orthotropic: [nu12, nu23, nu31]; nu12: contraction along 2 when pulled along 1."""
    shear_modulus_GPa: Annotated[tuple[Length, Length, Length], Listed()] | None = None
    """Orthotropic: [G12, G23, G31]. Isotropic: not given, it follows from the other two."""
    axis_1: Direction = (1.0, 0.0, 0.0)
    """Orthotropic: direction of material axis 1."""
    axis_2: Direction = (0.0, 1.0, 0.0)
    """Orthotropic: direction of material axis 2, made perpendicular to axis_1; 3 follows."""
    density_kg_m3: Annotated[float, Field(ge=0)] = 0.0
    """Mass per volume; gravity and rotation need it."""
    expansion_per_K: Several = 0.0
    """Linear thermal expansion; orthotropic: one number or [a1, a2, a3]."""

    yield_stress_MPa: Length | None = None
    """Of type "j2": true stress at which a bar begins to yield."""
    hardening_MPa: Annotated[float, Field(ge=0)] | Curve = 0.0
    """Of type "j2": by how much the yield stress grows per plastic strain; or pairs of plastic
    strain (logarithmic) and yield stress (true, MPa), from [0.0, yield_stress_MPa] on."""
    saturation_MPa: Length | None = None
    """Of type "j2": what the yield stress tends to, beside what a number for hardening_MPa adds
    (Voce)."""
    saturation_rate: Length | None = None
    """Of type "j2": how fast, per plastic strain: 1 - exp(-rate p) of the way."""

    @property
    def finite_strain(self) -> bool:
        """Whether bodies of it have to be solved nonlinearly."""
        return self.type in FINITE_STRAIN

    @property
    def has_history(self) -> bool:
        """Whether its stress depends on the way on which a strain was reached."""
        return self.type == "j2"

    @model_validator(mode="after")
    def _check(self) -> MaterialTable:
        if self.type == "orthotropic":
            self._check_orthotropic()
        else:
            self._check_isotropic()
        if self.type == "j2":
            self._check_j2()
        else:
            for key in ("yield_stress_MPa", "hardening_MPa", "saturation_MPa", "saturation_rate"):
                self._refuse(key, "for a material that doesn't yield", 'none, or type = "j2"')
        return self

    def _refuse(self, key: str, why: str, expected: str) -> None:
        """A key that has no meaning for this type."""
        if getattr(self, key) != type(self).model_fields[key].default:
            raise fault(key, f"given {why}", getattr(self, key), expected)

    def _check_j2(self) -> None:
        start, curve = self.yield_stress_MPa, self.hardening_MPa
        if start is None:
            raise fault("yield_stress_MPa", "missing", Words("nothing"), "that of the metal")
        if (self.saturation_MPa is None) != (self.saturation_rate is None):
            raise fault("saturation_rate", "one without the other", Words("one"),
                        "saturation_MPa and saturation_rate, or none")  # fmt: skip
        if self.saturation_MPa is not None and not self.saturation_MPa >= start:
            raise fault("saturation_MPa", "below the yield stress", self.saturation_MPa,
                        f"at least {start:g}")  # fmt: skip
        if isinstance(curve, float):
            return
        if self.saturation_MPa is not None:
            raise fault("hardening_MPa", "a curve beside saturation_MPa", curve, "one of them")
        if curve[0] != (0.0, start):
            raise fault("hardening_MPa", "doesn't begin at the yield stress", curve[0],
                        f"[0.0, {start:g}]")  # fmt: skip
        for (before, lower), (after, higher) in pairwise(curve):
            if not (after > before and higher >= lower):
                raise fault("hardening_MPa", "falls", (after, higher),
                            f"more than {before:g}, and at least {lower:g}")  # fmt: skip

    def _check_isotropic(self) -> None:
        for key in ("youngs_modulus_GPa", "poissons_ratio", "expansion_per_K"):
            value = getattr(self, key)
            if isinstance(value, tuple):
                raise fault(key, "three numbers for an isotropic material", value,
                            'one number, or type = "orthotropic"')  # fmt: skip
        ratio = self.poissons_ratio
        if isinstance(ratio, float) and not -1 < ratio < 0.5:
            raise fault("poissons_ratio", "out of range", ratio, "-1 < value < 0.5")
        for key in ("shear_modulus_GPa", "axis_1", "axis_2"):
            self._refuse(key, "for an isotropic material", 'none, or type = "orthotropic"')

    def _check_orthotropic(self) -> None:
        moduli, ratios = self.youngs_modulus_GPa, self.poissons_ratio
        for key, value in (("youngs_modulus_GPa", moduli), ("poissons_ratio", ratios)):
            if not isinstance(value, tuple):
                raise fault(key, "one number for an orthotropic material", value,
                            "a list of three")  # fmt: skip
        assert isinstance(moduli, tuple) and isinstance(ratios, tuple)
        if self.shear_modulus_GPa is None:
            raise fault("shear_modulus_GPa", "missing", Words("nothing"),
                        "[G12, G23, G31] of the orthotropic material")  # fmt: skip
        if parallel(self.axis_1, self.axis_2):
            raise fault("axis_2", "parallel to axis_1", self.axis_2, "another direction")
        scaled = []
        for number, (i, j) in enumerate(((0, 1), (1, 2), (2, 0))):
            limit = (moduli[i] / moduli[j]) ** 0.5
            if not abs(ratios[number]) < limit:
                raise fault("poissons_ratio", f"nu{i + 1}{j + 1} makes the stiffness indefinite",
                            ratios[number], f"a size below {limit:.4g}")  # fmt: skip
            scaled.append(ratios[number] / limit)
        x, y, z = scaled
        if not 1 - x * x - y * y - z * z - 2 * x * y * z > 1e-12:
            raise fault("poissons_ratio", "makes the stiffness indefinite", ratios,
                        "1 - nu12 nu21 - nu23 nu32 - nu31 nu13 - 2 nu21 nu32 nu13 > 0")  # fmt: skip

    @property
    def axes(self) -> tuple[Vec3, Vec3, Vec3]:
        """The material axes, perpendicular to each other and of length 1."""
        first = unit(self.axis_1)
        second = unit(across(self.axis_2, first))
        return first, second, cross(first, second)
