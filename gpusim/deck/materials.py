"""Materials, orientations and sections of a deck."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag

from gpusim.arrays.array_types import Float, Int
from gpusim.errors import InputError
from gpusim.fem import (
    J2,
    IsochoricNeoHookean,
    Isotropic,
    Material,
    Rayleigh,
    SaintVenantKirchhoff,
)
from gpusim.fem.materials.linear_elasticity import LinearElasticity
from gpusim.fem.materials.saint_venant_kirchhoff import GreenLagrangeElasticity
from gpusim.fem.materials.symmetric_tensors import strain_congruence
from gpusim.mesh import Mesh
from gpusim.mesh.file_content.coordinate_systems import Frame
from gpusim.mesh.formats.abaqus.cards import Card, Names, number
from gpusim.mesh.formats.abaqus.content import InpContent
from gpusim.mesh.formats.abaqus.reader import LabelledMesh
from gpusim.validation import require

# Abaqus orders stress 11 22 33 12 13 23, we xx yy zz xy yz zx.
FROM_ABAQUS = np.array([0, 1, 2, 3, 5, 4])
_CONSTANTS = {
    "ISO": (2, "E, nu"),
    "ORTHO": (9, "D1111, D1122, D2222, D1133, D2233, D3333, D1212, D1313, D2323"),
    "ENGINEERINGCONSTANTS": (9, "E1, E2, E3, nu12, nu13, nu23, G12, G13, G23"),
    "ANISO": (21, "21 constants D1111 … D2323"),
}
"""Of *ELASTIC by its TYPE: how many, and which."""


@dataclass(frozen=True, eq=False)
class Anisotropic(LinearElasticity):
    """Linear elasticity given by its stiffness in global axes.

    ``matrix`` (6,6) float64 stress over strain, order xx yy zz xy yz zx, engineering shear
    strains; ``density`` >= 0; ``expansion`` (6,) free strain per unit of temperature.
    """

    matrix: Float
    density: float = 0.0
    expansion: Float = field(default_factory=lambda: np.zeros(6))

    def stiffness(self) -> Float:
        return self.matrix

    def expansion_strain(self) -> Float:
        return self.expansion


@dataclass(frozen=True, eq=False)
class AnisotropicSaintVenantKirchhoff(GreenLagrangeElasticity, Anisotropic):
    """The same between second Piola-Kirchhoff stress and Green-Lagrange strain."""


@dataclass(frozen=True, eq=False)
class Body:
    """What a deck's loads act on; ``nonlinear``: on the deformed body. ``damping`` is that of
    *DYNAMIC, the ``loss_factor`` that of *STEADY STATE DYNAMICS."""

    content: InpContent
    labelled: LabelledMesh
    materials: Sequence[Material]
    material_of_cell: Int
    formulation: Mapping[str, str]
    nonlinear: bool
    damping: Rayleigh
    loss_factor: float

    @property
    def mesh(self) -> Mesh:
        return self.labelled.mesh

    @property
    def has_history(self) -> bool:
        """Whether a material remembers what it has been through."""
        return any(isinstance(one, J2) for one in self.materials)


@dataclass
class _Material:
    """What the cards after a *MATERIAL say; ``matrix`` in Abaqus order and material axes; ``flow``:
    plastic strains and yield stresses; ``rubber``: C10 and D1."""

    card: Card
    given: dict[str, Card] = field(default_factory=dict)
    isotropic: tuple[float, float] | None = None
    matrix: Float | None = None
    flow: Sequence[tuple[float, float]] = ()
    rubber: tuple[float, float] | None = None
    density: float = 0.0
    loss_factor: float = 0.0
    expansion: Float = field(default_factory=lambda: np.zeros(3))


class Sections:
    """Collects material, orientation and section cards; ``resolve`` gives each cell a material."""

    def __init__(self, content: InpContent) -> None:
        self.content = content
        self.materials: Names[_Material] = Names("material")
        self.orientations: Names[Float | None] = Names("orientation")
        self.sections: list[Card] = []
        self.current: _Material | None = None
        self.rayleigh = {"ALPHA": 0.0, "BETA": 0.0}

    def readers(self) -> dict[str, Callable[[Card], None]]:
        """Keyword -> the method that reads its card."""
        return {
            "MATERIAL": self._material,
            "ELASTIC": self._elastic,
            "DENSITY": self._density,
            "DAMPING": self._damping,
            "EXPANSION": self._expansion,
            "PLASTIC": self._plastic,
            "HYPERELASTIC": self._hyperelastic,
            "ORIENTATION": self._orientation,
            "SOLIDSECTION": self.sections.append,
        }

    def resolve(
        self, labelled: LabelledMesh, formulation: Mapping[str, str], deflects: bool
    ) -> Body:
        """The body with its materials, at large displacements if it ``deflects``; it also does if
        one of them holds for nothing less. Raises InputError."""
        found: dict[tuple[str, str], int] = {}
        of_set: dict[str, Card] = {}
        materials: list[Material] = []
        losses: dict[float, Card] = {}
        of_cell = np.full(labelled.mesh.cell_count, -1, dtype=np.int32)
        for card in self.sections:
            where = card.where()
            named = card.parameters.get("MATERIAL", "")
            turned = card.parameters.get("ORIENTATION", "")
            key = (named.upper(), turned.upper())
            if key not in found:
                material = self.materials.get(named, where)
                axes = self.orientations.get(turned, where) if turned else np.eye(3)
                materials.append(_finished(material, named, axes, where))
                found[key] = len(materials) - 1
                losses.setdefault(material.loss_factor, card)
            name = card.parameters.get("ELSET", "")
            cells = self.content.cell_sets.get(name, where)
            other = of_set.setdefault(name.upper(), card)
            got = f"the first at {other.where()}"
            require(other is card, f"{where}: a second section for set {name}", got, "one")
            of_cell[labelled.cell_index(cells)] = found[key]
        bare = np.flatnonzero(of_cell < 0)
        if bare.size:
            raise InputError(
                f"{self.content.blocks[0].card.file}: {bare.size} elements have no *SOLID SECTION; "
                f"got element {self.content.cells.shown(labelled.cell_labels[bare[0]])}; expected "
                "a section for each"
            )
        deflects |= any(isinstance(one, J2 | IsochoricNeoHookean) for one in materials)
        if deflects:
            materials = [at_finite_strain(one) for one in materials]
        if len(losses) > 1:
            *_, card = losses.values()
            card.fail(f"materials of different STRUCTURAL damping; got {[*losses]}; expected one")
        damping, (loss_factor,) = Rayleigh(*self.rayleigh.values()), losses
        return Body(
            self.content, labelled, materials, of_cell, formulation, deflects, damping, loss_factor
        )

    def _material(self, card: Card) -> None:
        name = card.parameters.get("NAME", "")
        if not name:
            card.fail("no name; expected NAME=name")
        self.current = _Material(card)
        self.materials.define(name, self.current, card.where())

    def _own(self, card: Card) -> _Material:
        if self.current is None:
            card.fail("outside of a material; expected *MATERIAL before it")
        first = self.current.given.setdefault(card.keyword, card)
        if first is not card:
            card.fail(
                f"a second one for one material; got the first at {first.where()}; expected one"
            )
        return self.current

    def _elastic(self, card: Card) -> None:
        material = self._own(card)
        written = "".join(card.parameters.get("TYPE", "ISO").upper().split())
        kind = next((name for name in _CONSTANTS if written.startswith(name[:5])), "")
        if not kind:
            card.fail(
                f"TYPE={written} isn't supported; expected ISO, ORTHO, "
                "ENGINEERING CONSTANTS or ANISO"
            )
        values = _constant(card, *_CONSTANTS[kind])
        if kind == "ISO":
            material.isotropic = (float(values[0]), float(values[1]))
        elif kind == "ORTHO":
            material.matrix = block_diag(_symmetric(values[:6]), np.diag(values[6:]))
        elif kind == "ANISO":
            material.matrix = _symmetric(values)
        else:
            material.matrix = _from_engineering(values, card.where())

    def _density(self, card: Card) -> None:
        self._own(card).density = float(_constant(card, 1, "a density")[0])

    def _damping(self, card: Card) -> None:
        """ALPHA and BETA hold for all materials, as in CalculiX."""
        material, where = self._own(card), card.where()
        for name, text in card.parameters.items():
            value = number(text, where)
            require(value >= 0.0, f"{where}: {name}", f"{value:g}", "a number >= 0")
            if name == "STRUCTURAL":
                material.loss_factor = value
            else:
                self.rayleigh[name] = value

    def _expansion(self, card: Card) -> None:
        material = self._own(card)
        kind = card.parameters.get("TYPE", "ISO").upper()
        if not kind.startswith(("ISO", "ORTHO")):
            card.fail(f"TYPE={kind} isn't supported; expected ISO or ORTHO")
        count = 1 if kind.startswith("ISO") else 3
        material.expansion = np.broadcast_to(_constant(card, count, "coefficients"), (3,))

    def _plastic(self, card: Card) -> None:
        expected = "yield stress, plastic strain (and temperature)"
        rows = [
            [number(text or "0", where) for text in (*row, "")[:3]]
            for where, row in card.records(2, 3, expected)
        ]
        if len({temperature for _, _, temperature in rows}) != 1:
            card.fail(f"got {len(rows)} rows, of different temperatures; expected one table")
        self._own(card).flow = tuple((strain, stress) for stress, strain, _ in rows)

    def _hyperelastic(self, card: Card) -> None:
        if "NEOHOOKE" not in card.parameters:
            card.fail("isn't supported but for NEO HOOKE; expected that")
        c10, d1 = _constant(card, 2, "C10, D1").tolist()
        require(min(c10, d1) > 0.0, f"{card.where()}: C10, D1", (c10, d1), "numbers above 0")
        self._own(card).rubber = c10, d1

    def _orientation(self, card: Card) -> None:
        name = card.parameters.get("NAME", "")
        system = card.parameters.get("SYSTEM", "RECTANGULAR").upper()
        if not system.startswith("R"):
            self.orientations.define(
                name, None, card.where()
            )  # of no account to an isotropic material
            return
        rows = [[number(text or "0", where) for text in row] for where, row in card.records()]
        values = rows[0] if rows else []
        turned = len(rows) > 2 or (len(rows) == 2 and rows[1][-1] != 0.0)
        if len(values) not in (6, 9) or turned:
            card.fail(
                f"got {len(values)} numbers and {len(rows)} lines; expected one "
                "line with the points a and b, and the origin where it isn't 0"
            )
        origin = np.array(values[6:] or [0.0] * 3)
        frame = Frame.from_x(origin, np.array(values[:3]), np.array(values[3:6]), card.where())
        self.orientations.define(name, frame.axes, card.where())


def at_finite_strain(material: Material) -> Material:
    """As CalculiX has linear elasticity with NLGEOM: on Green-Lagrange strain."""
    if isinstance(material, Isotropic):
        return SaintVenantKirchhoff(material.E, material.nu, material.density, material.expansion)
    if isinstance(material, Anisotropic):
        return AnisotropicSaintVenantKirchhoff(
            material.matrix, material.density, material.expansion
        )
    return material


def _nonlinear(material: _Material, name: str) -> Material:
    """Rubber, or metal that flows."""
    card, a = material.card, material.expansion
    known = material.isotropic is not None
    if known == (material.rubber is not None) or not (a == a[0]).all():
        card.fail(f"{name}: expected either *HYPERELASTIC, or *PLASTIC with isotropic *ELASTIC, "
                  "and isotropic *EXPANSION")  # fmt: skip
    try:
        if material.rubber is not None:
            shear, bulk = 2.0 * material.rubber[0], 2.0 / material.rubber[1]
            E, nu = 9.0 * bulk * shear, 3.0 * bulk - 2.0 * shear
            rest = 3.0 * bulk + shear
            return IsochoricNeoHookean(E / rest, nu / (2.0 * rest), material.density, float(a[0]))
        assert material.isotropic is not None
        elastic = Isotropic(*material.isotropic, material.density, float(a[0]))
        return J2(elastic, material.flow[0][1], material.flow)
    except InputError as error:
        raise InputError(f"{card.where()}: {name}: {error}") from None


def _finished(material: _Material, name: str, axes: Float | None, where: str) -> Material:
    card = material.card
    if material.flow or material.rubber is not None:
        return _nonlinear(material, name)
    if material.isotropic is not None:
        E, nu = material.isotropic
        a = material.expansion
        if (a == a[0]).all():
            try:
                return Isotropic(E, nu, material.density, float(a[0]))
            except InputError as error:
                raise InputError(f"{card.where()}: {name}: {error}") from None
        own = _swapped(Isotropic(E, nu).stiffness())
    elif material.matrix is None:
        card.fail(f"{name} has no *ELASTIC; expected one after it")
    else:
        own = material.matrix
    if axes is None:
        raise InputError(
            f"{where}: {name} isn't isotropic and its orientation isn't rectangular; expected "
            "SYSTEM=RECTANGULAR"
        )
    size = np.sqrt(np.abs(np.diag(own)))
    if not (size.all() and np.linalg.eigvalsh(own / np.outer(size, size))[0] > 0.0):
        card.fail(
            f"{name}: the stiffness isn't positive definite; expected constants "
            "that give energy to every strain"
        )
    turn = strain_congruence(axes)
    strain = np.linalg.solve(turn, np.array([*material.expansion, 0.0, 0.0, 0.0]))
    return Anisotropic(turn.T @ _swapped(own) @ turn, material.density, strain)


def _swapped(matrix: Float) -> Float:
    """Between Abaqus' order of components and ours; the swap is its own inverse."""
    return np.asarray(matrix[np.ix_(FROM_ABAQUS, FROM_ABAQUS)])


def _symmetric(values: Float) -> Float:
    """The matrix with these numbers 11 12 22 13 23 33 … in its upper half, column by column."""
    size = int(np.sqrt(2 * len(values)))
    matrix = np.zeros((size, size))
    rows, columns = np.tril_indices(size)
    matrix[rows, columns] = matrix[columns, rows] = values
    return matrix


def _from_engineering(values: Float, where: str) -> Float:
    E, nu, G = values[:3], values[3:6], values[6:]
    if not ((E > 0.0).all() and (G > 0.0).all()):
        raise InputError(f"{where}: a modulus isn't positive; got {values.tolist()}; expected > 0")
    compliance = np.diag(1.0 / E)
    for (i, j), one in zip(((0, 1), (0, 2), (1, 2)), nu, strict=True):
        compliance[i, j] = compliance[j, i] = -one / E[i]
    return block_diag(np.linalg.inv(compliance), np.diag(G))


def _constant(card: Card, count: int, expected: str) -> Float:
    """``count`` constants; tables over temperature are refused unless all their rows agree."""
    values: list[float] = []
    lines: list[int] = []
    for line, row in card.rows():
        where = card.where(line)
        # eight numbers fit a line, so a row may go on
        values += [number(text or "0", where) for text in row]
        lines.append(line)
    if len(values) < count:
        card.fail(f"got {len(values)} numbers; expected {expected}")
    width = count + 1
    rows = [values[k : k + width] for k in range(0, len(values), width)]
    for k, other in enumerate(rows[1:], start=1):
        if other[:count] != rows[0][:count]:
            line = lines[min(k * len(lines) // len(rows), len(lines) - 1)]
            card.fail(
                f"depends on temperature; got {len(rows)} rows; expected one row of constants", line
            )
    return np.array(rows[0][:count])
