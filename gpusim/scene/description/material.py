"""``[[material]]``: elasticity, density and thermal expansion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from .table import (
    Direction,
    Length,
    Listed,
    Name,
    Table,
    Vec3,
    Words,
    across,
    cross,
    fault,
    in_si,
    not_zero,
    parallel,
    unit,
)

__all__ = ["Isotropic", "Material", "MaterialTable", "Orthotropic"]

_NUMBER: dict[str, Any] = {"type": "number"}


def _is_number(value: Any, positive: bool) -> bool:
    good = isinstance(value, int | float) and not isinstance(value, bool)
    return good and -1e300 < value < 1e300 and not (positive and not value > 0)


def _one_or_three(positive: bool) -> Any:
    """A number, or a list of three: converted to a float or a tuple of floats."""
    expected = "a number > 0, or a list of three" if positive else "a number, or a list of three"

    def check(value: Any) -> Any:
        if _is_number(value, positive):
            return float(value)
        if isinstance(value, list) and len(value) == 3:
            if all(_is_number(item, positive) for item in value):
                return tuple(float(item) for item in value)
        if isinstance(value, str):
            raise fault("", "wrong type", value, f"{expected}, without quotes")
        if isinstance(value, list) and len(value) != 3:
            raise fault("", "wrong length", Words(f"{len(value)} items"), expected)
        items = value if isinstance(value, list) else [value]
        numbers = all(_is_number(item, positive=False) for item in items)
        raise fault("", "out of range" if numbers else "wrong type", value, expected)

    return check


def _schema(positive: bool) -> WithJsonSchema:
    number: dict[str, Any] = {"type": "number"}
    if positive:
        number["exclusiveMinimum"] = 0
    three = {"type": "array", "items": number, "minItems": 3, "maxItems": 3}
    return WithJsonSchema({"anyOf": [number, three]})


@dataclass(frozen=True)
class Isotropic:
    """Linear elastic, isotropic: Pa, -, kg/m3, 1/K."""

    name: str
    youngs_modulus: float
    poissons_ratio: float
    density: float
    expansion: float


@dataclass(frozen=True)
class Orthotropic:
    """Linear elastic, orthotropic: Pa, -, kg/m3, 1/K along the material axes (rows of ``axes``).

    Ratios are nu12, nu23, nu31, shear moduli G12, G23, G31.
    """

    name: str
    youngs_moduli: Vec3
    poissons_ratios: Vec3
    shear_moduli: Vec3
    density: float
    expansion: Vec3
    axes: tuple[Vec3, Vec3, Vec3]


Material = Isotropic | Orthotropic


class MaterialTable(Table):
    """A linear elastic material: isotropic with one number per key, orthotropic with three."""

    name: Name
    type: Literal["isotropic", "orthotropic"] = "isotropic"
    youngs_modulus_GPa: Annotated[Any, BeforeValidator(_one_or_three(True)), _schema(True)]
    """Orthotropic: [E1, E2, E3] along the material axes."""
    poissons_ratio: Annotated[Any, BeforeValidator(_one_or_three(False)), _schema(False)]
    """Orthotropic: [nu12, nu23, nu31]; nu12: contraction along 2 when pulled along 1."""
    shear_modulus_GPa: Annotated[tuple[Length, Length, Length], Listed()] | None = None
    """Orthotropic: [G12, G23, G31]. Isotropic: not given, it follows from the other two."""
    axis_1: Direction = (1.0, 0.0, 0.0)
    """Orthotropic: direction of material axis 1."""
    axis_2: Direction = (0.0, 1.0, 0.0)
    """Orthotropic: direction of material axis 2, made perpendicular to axis_1; 3 follows."""
    density_kg_m3: Annotated[float, Field(ge=0)] = 0.0
    """Gravity and rotation need it."""
    expansion_per_K: Annotated[Any, BeforeValidator(_one_or_three(False)), _schema(False)] = 0.0
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
        if not -1 < self.poissons_ratio < 0.5:
            raise fault("poissons_ratio", "out of range", self.poissons_ratio, "-1 < value < 0.5")
        for key in ("shear_modulus_GPa", "axis_1", "axis_2"):
            if key in self.model_fields_set and getattr(self, key) is not None:
                given = type(self).model_fields[key].default
                if getattr(self, key) != given:
                    raise fault(key, "given for an isotropic material", getattr(self, key),
                                'none, or type = "orthotropic"')  # fmt: skip

    def _check_orthotropic(self) -> None:
        for key in ("youngs_modulus_GPa", "poissons_ratio"):
            if not isinstance(getattr(self, key), tuple):
                raise fault(key, "one number for an orthotropic material", getattr(self, key),
                            "a list of three")  # fmt: skip
        if self.shear_modulus_GPa is None:
            raise fault("shear_modulus_GPa", "missing", Words("nothing"),
                        "[G12, G23, G31] of the orthotropic material")  # fmt: skip
        for key in ("axis_1", "axis_2"):
            not_zero(key, getattr(self, key))
        if parallel(self.axis_1, self.axis_2):
            raise fault("axis_2", "parallel to axis_1", self.axis_2, "another direction")
        moduli, ratios = self.youngs_modulus_GPa, self.poissons_ratio
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

    def resolved(self) -> Material:
        """The material in SI; its axes are perpendicular to each other and of length 1."""
        moduli, expansion = in_si(self.youngs_modulus_GPa, "GPa"), self.expansion_per_K
        if self.type == "isotropic":
            return Isotropic(self.name, moduli, self.poissons_ratio, self.density_kg_m3, expansion)
        first = unit(self.axis_1)
        second = unit(across(self.axis_2, first))
        return Orthotropic(
            name=self.name,
            youngs_moduli=moduli,
            poissons_ratios=self.poissons_ratio,
            shear_moduli=in_si(self.shear_modulus_GPa, "GPa"),
            density=self.density_kg_m3,
            expansion=expansion if isinstance(expansion, tuple) else (expansion,) * 3,
            axes=(first, second, cross(first, second)),
        )
