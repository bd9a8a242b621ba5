"""``[[material]]``: elasticity, density and thermal expansion."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .table import (
    Direction,
    Length,
    Listed,
    Name,
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
SeveralPositive = Length | Annotated[tuple[Length, Length, Length], Listed()]


class MaterialTable(Table):
    """A linear elastic material: isotropic with one number per key, orthotropic with three.

    Example::

        name = "steel"
        youngs_modulus_GPa = 210.0
        poissons_ratio = 0.3
        density_kg_m3 = 7850.0
    """

    name: Name
    """What [[body]] and [[body.part]] call it."""
    type: Literal["isotropic", "orthotropic"] = "isotropic"
    """"isotropic": alike in all directions; "orthotropic": three axes, as wood or laminates."""
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

    @model_validator(mode="after")
    def _check(self) -> MaterialTable:
        if self.type == "isotropic":
            self._check_isotropic()
        else:
            self._check_orthotropic()
        return self

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
            if getattr(self, key) != type(self).model_fields[key].default:
                raise fault(key, "given for an isotropic material", getattr(self, key),
                            'none, or type = "orthotropic"')  # fmt: skip

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
