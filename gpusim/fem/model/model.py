"""The model: mesh, materials, supports, loads and formulations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int
from gpusim.errors import InputError
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.materials.law import Material
from gpusim.fem.model.constraints import Equations, checked_constraints, objects_of, touched
from gpusim.fem.model.follower_loads import FollowerPressure
from gpusim.field_summary import field_summary
from gpusim.mesh import Mesh
from gpusim.validation import as_float64, require, require_one_of, unmasked

_MATERIALS = "Isotropic, Orthotropic or another law, or a list of them"


@unmasked()
@dataclass(frozen=True, eq=False)
class Model:
    """A linear static problem in any consistent units.

    Parameters
    ----------
    mesh : the body (or bodies).
    materials : ``Isotropic``, ``Orthotropic``, or anything else that has a ``Material``'s parts;
        a list of them; a single one is taken as a list of one.
    material_of_cell : (M,) index into ``materials`` per global cell; None: all the first.
    fixed : (N,3) bool, degrees of freedom whose displacement is given; None: none is, which
        `solve` refuses.
    prescribed : (N,3) float64 displacement where ``fixed``, or (L,N,3), one per load case;
        None: zero. Non-zero elsewhere is an error, so that a forgotten ``fixed`` can't pass.
    forces : (N,3) or (L,N,3) float64 nodal forces, L load cases; None: zero. One (N,3) with L
        prescribed displacements counts in every load case.
    constraints : further equations between displacements: ties and others, see
        `gpusim.fem.tie` and `gpusim.fem.equations`.
    loads : loads that go with the deformed body (`gpusim.fem.FollowerPressure`), each in a load
        case; linear statics takes their forces on the undeformed one.
    temperature : change of temperature at factor 1: one number, (N,) at the nodes, or (L,N);
        None: none. Its free strain turns with the material; see `gpusim.fem.thermal`.

    Arrays are copied, checked and made read-only. Raises InputError.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(4, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> model = gs.Model(bar, [gs.Isotropic(210e9, 0.3)], fixed=fixed)
    >>> int(model.fixed.sum()), model.load_cases.shape
    (12, (1, 20, 3))
    """

    mesh: Mesh
    materials: Sequence[Material]
    fixed: Bool | None = None
    forces: Float | None = None
    material_of_cell: Int | None = None
    prescribed: Float | None = None
    constraints: Sequence[Equations] = ()
    loads: Sequence[FollowerPressure] = ()
    temperature: Float | None = None
    __repr__ = field_summary

    def __post_init__(self) -> None:
        require(isinstance(self.mesh, Mesh), "Model.mesh", type(self.mesh).__name__, "a Mesh")
        shape = self.mesh.points.shape
        # a protocol is as good as a class here
        materials = objects_of(Material, self.materials, "Model.materials", _MATERIALS)  # type: ignore[type-abstract]
        require(bool(materials), "Model.materials", "none", _MATERIALS)
        _check_stiffness(materials)
        fixed = np.zeros(shape, dtype=bool) if self.fixed is None else np.array(self.fixed)
        fits = fixed.shape == shape and fixed.dtype == np.bool_
        require(fits, "Model.fixed", f"{fixed.shape} {fixed.dtype}", f"{shape} bool")
        forces = np.zeros(shape) if self.forces is None else _float("forces", self.forces)
        fits = shape in (forces.shape, forces.shape[1:])
        expected = f"{shape} or (L, {shape[0]}, 3)"
        require(fits, "Model.forces: wrong shape", forces.shape, expected)
        require(forces.size > 0, "Model.forces: no load case", "L = 0", "L >= 1")
        given = np.zeros(shape) if self.prescribed is None else self.prescribed
        prescribed = _float("prescribed", given)
        cases = (len(forces), *shape) if forces.ndim == 3 else (len(prescribed), *shape)
        fits = prescribed.shape in (shape, cases) and prescribed.size > 0
        count = str(len(forces)) if forces.ndim == 3 else "L"
        expected = f"{shape}, or ({count}, {shape[0]}, 3) for each load case"
        require(fits, "Model.prescribed: wrong shape", prescribed.shape, expected)
        if prescribed.ndim == 3 and forces.ndim == 2:
            forces = np.repeat(forces[None], len(prescribed), axis=0)
        loose = np.flatnonzero(((prescribed != 0.0) & ~fixed).reshape(-1, *shape).any(axis=(0, 2)))
        if loose.size:
            raise InputError(
                f"Model.prescribed: {loose.size} nodes have a displacement but aren't fixed; "
                f"got node {loose[0]}; expected fixed = True there"
            )
        cells = self.mesh.cell_count
        if self.material_of_cell is None:
            of_cell = np.zeros(cells, dtype=np.int32)
        else:
            of_cell = _material_numbers(self.material_of_cell, cells, len(materials))
        constraints = checked_constraints(self.constraints, fixed.size)
        _refuse_loaded_dangling(self.mesh, forces, fixed | touched(constraints, shape))
        object.__setattr__(self, "materials", materials)
        object.__setattr__(self, "constraints", constraints)
        loads = _following(self.loads, self.mesh, len(forces) if forces.ndim == 3 else 1)
        object.__setattr__(self, "loads", loads)
        arrays = {"fixed": fixed, "forces": forces, "prescribed": prescribed}
        if self.temperature is not None:
            arrays["temperature"] = _temperature(self.temperature, forces.shape)
        for name, array in {**arrays, "material_of_cell": of_cell}.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def load_cases(self) -> Float:
        """(L,N,3) float64, also for a single load case."""
        assert self.forces is not None
        return self.forces if self.forces.ndim == 3 else self.forces[None]

    @property
    def prescribed_cases(self) -> Float:
        """(1,N,3) or (L,N,3) float64: the same for all load cases, or one for each."""
        assert self.prescribed is not None
        return self.prescribed if self.prescribed.ndim == 3 else self.prescribed[None]

    @property
    def densities(self) -> Float:
        """(M,) density per cell."""
        return np.array([one.density for one in self.materials])[self.material_of_cell]


def _float(name: str, value: Any) -> Float:
    array = np.array(as_float64(value, f"Model.{name}", "float64"))
    if not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))
        raise InputError(
            f"Model.{name}: {len(bad)} values aren't finite; got the first at index "
            f"{tuple(int(k) for k in bad[0])}; expected finite numbers"
        )
    return array


def _check_stiffness(materials: Sequence[Material]) -> None:
    """Materials of the user's own are checked like ours: symmetric, positive definite."""
    matrices = [np.asarray(material.stiffness()) for material in materials]
    expected = "(6, 6), stress over strain, xx yy zz xy yz zx"
    for number, matrix in enumerate(matrices):
        what = f"Model.materials[{number}]: stiffness() has the wrong shape"
        require(matrix.shape == (6, 6), what, matrix.shape, expected)
    stack = _float("materials: stiffness()", np.stack(matrices))
    skew = np.abs(stack - stack.transpose(0, 2, 1)).max(axis=(1, 2))
    bad = np.flatnonzero(~(skew <= 1e-9 * np.abs(stack).max(axis=(1, 2))))
    if bad.size:
        raise InputError(
            f"Model.materials[{bad[0]}]: stiffness() isn't symmetric; got a difference of "
            f"{skew[bad[0]]:.3g}; expected a symmetric (6, 6) matrix"
        )
    size = np.sqrt(np.abs(np.diagonal(stack, axis1=1, axis2=2)))
    size = np.where(size > 0.0, size, 1.0)  # a zero on the diagonal shows as an eigenvalue <= 0
    least = np.linalg.eigvalsh(stack / (size[:, :, None] * size[:, None, :]))[:, 0]
    bad = np.flatnonzero(~(least > 0.0))
    if bad.size:
        raise InputError(
            f"Model.materials[{bad[0]}]: stiffness() isn't positive definite; got "
            f"{materials[bad[0]]!r}; expected energy > 0 for every strain"
        )


def _material_numbers(value: Any, cells: int, count: int) -> Int:
    numbers = np.asarray(value)
    fits = numbers.shape == (cells,) and numbers.dtype.kind in "iu"
    got = f"{numbers.shape} {numbers.dtype}"
    require(fits, "Model.material_of_cell", got, f"({cells},) integers")
    first, last = numbers.min(), numbers.max()
    if first < 0 or last >= count:
        expected = f"expected 0 … {count - 1}"
        raise InputError(f"Model.material_of_cell: got {first} … {last}; {expected}")
    return np.array(numbers, dtype=np.int32)


def _following(loads: Any, mesh: Mesh, cases: int) -> tuple[FollowerPressure, ...]:
    following = objects_of(FollowerPressure, loads, "Model.loads")
    for number, one in enumerate(following):
        where = f"Model.loads[{number}]"
        same = np.array_equal(one.faces.points, mesh.points)
        require(same, where, "faces of another mesh", "faces of the model's")
        require(0 <= one.case < cases, f"{where}.case", one.case, f"0 … {cases - 1}")
    return following


def _temperature(value: Any, forces: tuple[int, ...]) -> Float:
    """(L,N), of the corners; see `linear_temperature`."""
    cases, nodes = (forces[0] if len(forces) == 3 else 1), forces[-2]
    given = _float("temperature", value)
    shapes = ((), (nodes,), (cases, nodes))
    expected = f"a number, ({nodes},) or ({cases}, {nodes})"
    require(given.shape in shapes, "Model.temperature: wrong shape", given.shape, expected)
    return np.array(np.broadcast_to(given, shapes[-1]))


def _refuse_loaded_dangling(mesh: Mesh, forces: Float, held: Bool) -> None:
    nodes = mesh.dangling_nodes
    loads = forces if forces.ndim == 3 else forces[None]
    loaded = nodes[((loads[:, nodes] != 0.0).any(axis=0) & ~held[nodes]).any(axis=1)]
    if loaded.size:
        raise InputError(
            f"Model.forces: {loaded.size} loaded nodes belong to no cell; got node {loaded[0]}; "
            "expected forces on nodes of the mesh's cells"
        )


def resolve_formulation(
    model: Model, formulation: str | Mapping[str, str] | None
) -> dict[str, str]:
    """Formulation per cell type of the mesh; the element's first one where nothing is said.

    One name for all types counts where a type has it (tet4 has no "bbar"). Raises InputError for
    a type or name that no element has, also if the mesh has no such cells, and for one name that
    no cell of the mesh has, unless it is a default: that asks for nothing unusual.
    """
    if isinstance(formulation, str):
        known = dict.fromkeys(name for e in ELEMENTS.values() for name in e.formulations)
        require_one_of("formulation: unknown", formulation, known)
        wanted = {k: formulation for k, e in ELEMENTS.items() if formulation in e.formulations}
        usual = any(formulation == e.formulations[0] for e in ELEMENTS.values())
        had = usual or any(kind in wanted for kind in model.mesh.cells)
        got = f"{formulation!r} for {', '.join(model.mesh.cells)}"
        expected = f"cells among {', '.join(wanted)}"
        require(had, "formulation: no cell of the mesh has it", got, expected)
    else:
        named = isinstance(formulation, Mapping | None)
        expected = "a name, or a mapping from cell type to one"
        require(named, "formulation", repr(formulation), expected)
        wanted = dict(formulation or {})
    for kind, name in wanted.items():
        expected = f"keys among {', '.join(ELEMENTS)}"
        require(kind in ELEMENTS, "formulation: unknown cell type", repr(kind), expected)
        names = ELEMENTS[kind].formulations
        require_one_of(f"formulation: not available for {kind}", name, names)
    return {kind: wanted.get(kind, ELEMENTS[kind].formulations[0]) for kind in model.mesh.cells}
