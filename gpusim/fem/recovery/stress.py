"""Stress recovery: at quadrature points, averaged at nodes, and how far the two disagree."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.arrays.unique import distinct
from gpusim.fem.elements.element import ELEMENTS, Rule
from gpusim.fem.elements.isoparametric_map import add_to, volumes
from gpusim.fem.elements.strain import point_stress
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.fem.model.thermal_loads import linear_temperature, point_temperature
from gpusim.field_summary import field_summary
from gpusim.mesh import CELL_TYPES
from gpusim.mesh.shape_functions import reference_nodes, shape_functions
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.parallel.threads import shared
from gpusim.validation import finite_numbers, require, unmasked

_CHUNK = 4096


@dataclass(frozen=True, eq=False)
class Stress:
    """Stress of a solution, order xx yy zz xy yz zx, in global axes and the model's units.

    Nodal values are extrapolated from the quadrature points of each cell (least squares with the
    shape functions of the cell's corners; midside nodes take the mean of their corners) and
    averaged, with equal weights, over the cells *of one material* at the node: stress may jump
    where the material changes. So nodes on such a border have one value per material.

    points : cell type -> (M,Q,6) at the quadrature points of the formulation.
    node_of, material_of, values : (P,), (P,), (P,6) the averages: node, material, stress.
    strains : (P,6) total strain that belongs to ``values``, engineering shear.
    node_count : N.
    cell : (M,6) volume mean of each cell, cells in the mesh's order.
    volume, energy : (M,) of each cell; energy is that of the stress, s.C^-1.s/2.
    results : more (P,…) like ``values`` by name, at large displacements: "piola_stress" second
        Piola-Kirchhoff stress, "green_lagrange_strain" as tensor components, "energy" that is
        stored per volume at rest (NaN where a law doesn't tell it), "plastic_strain" accumulated;
        and what a user's own law tells (`gpusim.fem.Law`).
    strain_energy : what is stored in the whole body then; NaN where that isn't known.
    error : (M,) energy norm of the difference between the averaged and the cell's own stress,
        the indicator of Zienkiewicz & Zhu, IJNME 24 (1987) 337: sqrt of the integral of
        (s* - s).C^-1.(s* - s).

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    >>> model = gs.Model(bar, gs.Isotropic(E=100.0, nu=0.0))
    >>> found = gs.fem.stress(model, bar.points * [0.01, 0, 0])
    >>> found.nodal.shape, float(found.cell[0, 0].round(6))
    ((8, 6), 1.0)
    """

    points: Mapping[str, Float]
    node_of: Long
    material_of: Long
    values: Float
    strains: Float
    node_count: int
    cell: Float
    volume: Float
    energy: Float
    error: Float
    results: Mapping[str, Float] = field(default_factory=dict)
    strain_energy: float = np.nan
    __repr__ = field_summary

    @cached_property
    def nodal(self) -> Float:
        """(N,6), where materials meet the value with the greatest von Mises stress; 0 at nodes of
        no cell."""
        return self._telling(self.values)

    @cached_property
    def nodal_strain(self) -> Float:
        """(N,6) strain that belongs to ``nodal``, as tensor components."""
        result = self._telling(self.strains)
        result[:, 3:] *= 0.5
        return result

    @cached_property
    def nodal_results(self) -> dict[str, Float]:
        """(N,…) of ``results``, by name, where ``nodal`` is."""
        return {name: self._telling(values) for name, values in self.results.items()}

    @property
    def nodal_plastic_strain(self) -> Float | None:
        """(N,) accumulated plastic strain where ``nodal`` is; None without plasticity."""
        return self.nodal_results.get("plastic_strain")

    def _telling(self, values: Float) -> Float:
        """(N,…) of values (P,…) those where the von Mises stress of a node is greatest."""
        result = np.zeros((self.node_count, *values.shape[1:]))
        order = np.argsort(von_mises(self.values), kind="stable")
        # the last one written is the greatest
        result[self.node_of[order]] = values[order]
        return result

    def renumbered(self, order: Long) -> Stress:
        """Of a mesh in which node k is number ``order[k]``."""
        return replace(self, node_of=order[self.node_of])

    @cached_property
    def von_mises(self) -> Float:
        """(N,) of ``nodal``."""
        return von_mises(self.nodal)

    @cached_property
    def principal(self) -> Float:
        """(N,3) principal stresses of ``nodal``, greatest first."""
        return principal(self.nodal)

    @cached_property
    def cell_von_mises(self) -> Float:
        """(M,) of ``cell``."""
        return von_mises(self.cell)

    @property
    def error_relative(self) -> float:
        """Estimated relative error in the energy norm, |e| / sqrt(|u|^2 + |e|^2); 0 unloaded."""
        error = float((self.error**2).sum())
        total = 2.0 * float(self.energy.sum()) + error
        return float(np.sqrt(error / total)) if total > 0.0 else 0.0

    @property
    def error_share(self) -> Float:
        """(M,) each cell's part of ``error_relative``; the squares add up to its square."""
        total = 2.0 * float(self.energy.sum()) + float((self.error**2).sum())
        return self.error / np.sqrt(total) if total > 0.0 else np.zeros_like(self.error)

    def of_material(self, number: int) -> Float:
        """(N,6) averages over the cells of one material, NaN at nodes that it doesn't reach."""
        result = np.full((self.node_count, 6), np.nan)
        mine = self.material_of == number
        result[self.node_of[mine]] = self.values[mine]
        return result


@unmasked()
def von_mises(stress: npt.ArrayLike) -> Float:
    """(…) von Mises equivalent of stress (…,6), order xx yy zz xy yz zx.

    Examples
    --------
    >>> float(gs.fem.von_mises([100.0, 0, 0, 0, 0, 0]))
    100.0
    """
    s = _stress(stress)
    x, y, z = s[..., 0], s[..., 1], s[..., 2]
    normal = (x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2
    return np.asarray(np.sqrt(0.5 * normal + 3.0 * (s[..., 3:] ** 2).sum(axis=-1)))


@unmasked()
def principal(stress: npt.ArrayLike) -> Float:
    """(…,3) principal values of stress (…,6), greatest first.

    Examples
    --------
    >>> gs.fem.principal([1.0, 0, 0, 2.0, 0, 0]).round(3)
    array([ 2.562,  0.   , -1.562])
    """
    s = _stress(stress)
    tensor = s[..., [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]
    return np.ascontiguousarray(np.linalg.eigvalsh(tensor)[..., ::-1])


@unmasked()
def stress(
    model: Model,
    u: npt.ArrayLike,
    formulation: str | Mapping[str, str] | None = None,
    *,
    temperature: npt.ArrayLike | None = None,
) -> Stress:
    """Stress of the displacements ``u`` (N,3) of a model.

    Parameters
    ----------
    formulation : the one that u was solved with, as for `solve`; internal modes of incompatible
        elements are recovered, so a bent beam has its exact stress.
    temperature : (N,) or scalar temperature change, the one of ``thermal``: its free strain causes
        no stress. None: the model's own, none where it has none.

    Raises InputError for several load cases at once (take one), or wrong shapes, and without
    ``temperature`` for a model that has several.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    >>> model = gs.Model(bar, gs.Isotropic(E=100.0, nu=0.0))
    >>> gs.fem.stress(model, bar.points * [0.01, 0, 0]).cell.round(6) + 0.0
    array([[1., 0., 0., 0., 0., 0.]])
    """
    require(isinstance(model, Model), "stress: model", type(model).__name__, "a Model")
    shape = model.mesh.points.shape
    expected = f"{shape} finite numbers, the displacements of one load case"
    own = finite_numbers(u, "stress: u", [shape], expected)
    if temperature is None and model.temperature is not None:
        cases = len(model.temperature)
        require(cases == 1, "stress: temperature", f"None, {cases} load cases", "that of u's case")
        temperature = model.temperature[0]
    change = None if temperature is None else linear_temperature("stress", model.mesh, temperature)
    # the work is shared out above BLAS
    with one_blas_thread():
        return Recovery(model, own, resolve_formulation(model, formulation), change).run()


@dataclass(frozen=True, eq=False)
class Part:
    """Some cells of one type, with what is needed of them."""

    kind: str
    cells: slice  # in the block
    numbers: slice  # global
    block: Int


class Recovery:
    """Stress at the points of all cells, and its averages at nodes."""

    def __init__(
        self, model: Model, u: Float, formulation: Mapping[str, str], change: Float | None
    ) -> None:
        self.model, self.u, self.formulation, self.change = model, u, formulation, change
        assert model.material_of_cell is not None
        self.material = model.material_of_cell
        self.moduli = np.stack([one.stiffness() for one in model.materials])
        self.compliance = np.asarray(np.linalg.inv(self.moduli), dtype=np.float64)
        self.expansion = np.stack([one.expansion_strain() for one in model.materials])
        # (M,k) node times number of materials, plus material; then the place among these keys
        self.pairs = {
            kind: block.astype(np.int64) * len(self.moduli)
            + self.material[first : first + len(block), None]
            for kind, first, block in model.mesh.blocks()
        }
        cells = model.mesh.cell_count
        self.points = {
            kind: np.empty((len(block), len(ELEMENTS[kind].rule(formulation[kind]).weight), 6))
            for kind, block in model.mesh.cells.items()
        }
        self.cell = np.zeros((cells, 6))
        self.volume, self.energy = np.zeros(cells), np.zeros(cells)
        keys = _number(list(self.pairs.values()))
        self.node_of, self.material_of = np.divmod(keys, len(self.moduli))

    def run(self) -> Stress:
        total = self.averaged(self._recover, 6)
        error = np.concatenate(shared(partial(self._error, total), list(self.parts())))
        for array in self.points.values():
            array.setflags(write=False)
        return Stress(
            points=MappingProxyType(self.points),
            node_of=self.node_of,
            material_of=self.material_of,
            values=total,
            strains=self._strains(total),
            node_count=self.model.mesh.node_count,
            cell=self.cell,
            volume=self.volume,
            energy=self.energy,
            error=error,
        )

    def averaged(self, at_nodes: Callable[[Part], Float], count: int) -> Float:
        """(P,count) means over the cells of one material at a node, of their values (M,k,count)."""
        parts, cells = list(self.parts()), np.zeros((len(self.node_of), 1))
        total = np.zeros((len(self.node_of), count))
        # parts are worked on side by side, but added up in order: the same bits in every run
        for part, values in zip(parts, shared(at_nodes, parts), strict=True):
            pair = self.pairs[part.kind][part.cells]
            add_to(total, pair, values)
            add_to(cells, pair, np.ones((*pair.shape, 1)))
        total /= cells
        return total

    def extrapolated(self, part: Part, values: Float) -> Float:
        """(M,k,…) at the nodes of some cells, of values (M,Q,…) at their points."""
        rule = ELEMENTS[part.kind].rule(self.formulation[part.kind])
        return np.asarray(
            np.matmul(_to_points(part.kind, rule, reference_nodes(part.kind)), values)
        )

    def parts(self) -> Iterator[Part]:
        for kind, first, block in self.model.mesh.blocks():
            for start in range(0, len(block), _CHUNK):
                end = min(start + _CHUNK, len(block))
                yield Part(kind, slice(start, end), slice(first + start, first + end),
                            block[start:end])  # fmt: skip

    def _of_cells(self, table: Float, part: Part) -> Float:
        """Rows of a table by material: one row if all cells have the same, else (M,…)."""
        materials = self.material[part.numbers]
        same = bool((materials == materials[0]).all())
        return np.asarray(table[materials[0] if same else materials])

    def _recover(self, part: Part) -> Float:
        """Everything of some cells; returns their stress at the nodes (M,k,6)."""
        values, weight = self._points(part)
        self.points[part.kind][part.cells] = values
        self.volume[part.numbers] = weight.sum(axis=1)
        mean = (values * weight[..., None]).sum(axis=1) / weight.sum(axis=1)[:, None]
        self.cell[part.numbers] = mean
        self.energy[part.numbers] = 0.5 * self._energy(part, values, weight)
        return self.extrapolated(part, values)

    def _points(self, part: Part) -> tuple[Float, Float]:
        free = None
        if self.change is not None:
            rule = ELEMENTS[part.kind].rule(self.formulation[part.kind])
            warm = point_temperature(part.kind, rule, self.change[part.block])
            expansion = self._of_cells(self.expansion, part)
            free = warm[..., None] * (expansion if expansion.ndim == 1 else expansion[:, None])
        return point_stress(
            part.kind, self.formulation[part.kind], self.model.mesh.points[part.block],
            self.u[part.block], self._of_cells(self.moduli, part), free,
        )  # fmt: skip

    def _energy(self, part: Part, values: Float, weight: Float) -> Float:
        """(M,) integral of s.C^-1.s."""
        strain = np.matmul(values, self._of_cells(self.compliance, part))
        return np.asarray(((strain * values).sum(axis=2) * weight).sum(axis=1))

    def _strains(self, values: Float) -> Float:
        strain = np.empty_like(values)
        for start in range(0, len(values), _CHUNK):
            rows = slice(start, start + _CHUNK)
            compliance = self.compliance[self.material_of[rows]]
            strain[rows] = np.matmul(values[rows, None], compliance)[:, 0]
        if self.change is not None:
            strain += self.change[self.node_of, None] * self.expansion[self.material_of]
        return strain

    def _error(self, averages: Float, part: Part) -> Float:
        element = ELEMENTS[part.kind]
        stress_rule = element.rule(self.formulation[part.kind])
        # finer than the stiffness rule where that one sees too little (one point in tet4)
        rule = element.mass if len(element.mass.weight) > len(stress_rule.weight) else stress_rule
        values = self.points[part.kind][part.cells]
        if rule is not stress_rule:
            values = np.matmul(_to_points(part.kind, stress_rule, rule.points), values)
        smooth = np.matmul(rule.shape, averages[self.pairs[part.kind][part.cells]])
        weight = volumes(self.model.mesh.points[part.block], rule)
        return np.asarray(np.sqrt(np.maximum(self._energy(part, smooth - values, weight), 0.0)))


def _number(arrays: list[Long]) -> Long:
    """The distinct keys, ascending; each array gets its keys' places among them."""
    keys = distinct(np.concatenate([array.ravel() for array in arrays]))
    for array in arrays:
        array[:] = np.searchsorted(keys, array)
    return keys


def _to_points(kind: str, rule: Rule, places: Float) -> Float:
    """(P,Q): from values at a rule's points to ``places`` (P,3) of the reference cell.

    The least-squares fit by the shape functions of the corners; of minimum norm where the rule has
    fewer points than the cell has corners.
    """
    linear = CELL_TYPES[kind].linear
    fit = np.linalg.pinv(shape_functions(linear, rule.points), rcond=1e-10)
    return np.asarray(shape_functions(linear, places) @ fit)


def _stress(value: npt.ArrayLike) -> Float:
    array = np.asarray(value, dtype=np.float64)
    expected = "(…,6), order xx yy zz xy yz zx"
    require(array.shape[-1:] == (6,), "stress", f"shape {array.shape}", expected)
    return array
