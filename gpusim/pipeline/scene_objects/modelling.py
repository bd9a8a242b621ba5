"""A body's finite-element model: material, supports, and one load case per group of loads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gpusim import fem
from gpusim.arrays.array_types import Float, Int
from gpusim.errors import InputError
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.materials.j2 import fit_for_flow
from gpusim.fem.materials.linear_elasticity import LinearMaterial
from gpusim.fem.model.supports import check_supports
from gpusim.pipeline.scene_objects.meshing import cells_of, faces_of, naming_place, nodes_of
from gpusim.pipeline.scene_objects.surfaces import MeshedBody
from gpusim.scene.amplitudes import LoadGroup
from gpusim.scene.description import model as m
from gpusim.validation import require

_LAWS: dict[str, Callable[..., fem.Material]] = {
    "isotropic": fem.Isotropic,
    "saint-venant-kirchhoff": fem.SaintVenantKirchhoff,
    "neo-hookean": fem.NeoHookean,
    "hencky": fem.Hencky,
}


def build_material(material: m.MaterialTable) -> fem.Material:
    """The material of a scene, SI."""
    E: Any = material.youngs_modulus
    nu: Any = material.poissons_ratio
    G: Any = material.shear_modulus
    expansion: Any = material.expansion
    if material.type == "orthotropic":
        if not isinstance(expansion, tuple):
            expansion = (expansion,) * 3
        return fem.Orthotropic(E, nu, G, material.density, expansion, material.axes)
    if material.type != "j2":
        return _LAWS[material.type](E, nu, material.density, expansion)
    assert material.yield_stress is not None
    elastic = fem.Isotropic(E, nu, material.density, expansion)
    return fem.J2(elastic, material.yield_stress, _hardening(material))


def _hardening(material: m.MaterialTable) -> float | fem.Voce | list[tuple[float, float]]:
    curve = material.hardening_MPa
    if isinstance(curve, tuple):
        return [(strain, 1e6 * stress) for strain, stress in curve]
    if material.saturation is None or material.saturation_rate is None:
        return 1e6 * curve
    return fem.Voce(material.saturation, material.saturation_rate, 1e6 * curve)


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A body's ``model`` by linear theory, and ``displaced``, that for large displacements, with
    which heat and pressure that follows go; ``support`` (N, 3) is the first one that holds each
    degree of freedom, -1: none."""

    model: fem.Model
    displaced: fem.Model
    support: Int


def build_model(
    parts: MeshedBody, groups: Sequence[LoadGroup], may_be_free: bool = False
) -> BodyModel:
    """Material, supports and loads; each of the body's load ``groups`` is a load case (one group:
    forces (N,3)).

    Raises
    ------
    InputError
        A selection finds nothing, two supports want a node at different places, or the supports
        leave a rigid-body motion free, unless it ``may_be_free``.
    """
    body, grid = parts.body, parts.mesh
    if body.material is None:
        why = "its displacements are given, there is nothing to solve"
        raise InputError(f"body {body.name!r}: {why}; expected a body with a material")
    # supports that move alike have one group and one share of it
    support, place = _supports(parts, {k: (n, share) for n, one in enumerate(groups)
                             for k, share in one.supports})  # fmt: skip
    materials, of_cell = _materials(parts)
    prescribed = np.zeros((len(groups), grid.node_count, 3))
    # forces of all loads, and of those that are dead
    forces, dead = np.zeros((2, *prescribed.shape))
    following: list[fem.FollowerPressure] = []
    change = np.zeros((len(groups), grid.node_count))
    for case, group in enumerate(groups):
        for index, factor in group.loads:
            load = body.loads[index]
            with naming_place(f"body {body.name!r}, load {load.name!r}"):
                nodal = factor * _load(parts, materials, of_cell, load)
            forces[case] += nodal
            if isinstance(load, m.ThermalTable):
                change[case] += factor * load.temperature_change
            elif isinstance(load, m.PressureTable) and load.follows:
                faces = faces_of(grid, parts.skin.faces, load.where)
                following.append(fem.FollowerPressure(faces, factor * load.pressure, case))
            else:
                dead[case] += nodal
        for index, factor in group.supports:
            mine = support == index
            prescribed[case][mine] = factor * place[mine]
    cases = 0 if len(groups) == 1 else slice(None)
    model = fem.Model(
        grid,
        materials=materials,
        material_of_cell=of_cell,
        fixed=support >= 0,
        prescribed=prescribed[cases],
        forces=forces[cases],
        constraints=[_tie(parts, tie) for tie in body.ties],
    )
    if not may_be_free:
        with naming_place(f"body {body.name!r}"):
            check_supports(model)
    displaced, warm = model, change if change.any() else None
    if following or warm is not None:
        displaced = replace(model, forces=dead[cases], loads=following, temperature=warm)
    return BodyModel(model, displaced, support)


def linear_at_rest(model: fem.Model) -> fem.Model:
    """The same with laws for any strain as linear as they are at rest."""
    laws = [
        LinearMaterial(law) if isinstance(law, fem.Law) and law.finite_strain else law
        for law in model.materials
    ]
    linear = all(new is law for new, law in zip(laws, model.materials, strict=True))
    return model if linear else replace(model, materials=laws)


def temperature(body: m.Body, frame: int) -> float:
    """Temperature change (K) of a body in a frame."""
    return sum(
        load.temperature_change * load.amplitude[min(frame, len(load.amplitude) - 1)]
        for load in body.loads
        if isinstance(load, m.ThermalTable)
    )


def _supports(parts: MeshedBody, moves: Mapping[int, tuple[int, float]]) -> tuple[Int, Float]:
    """Of each degree of freedom (N,3) the support that holds it (-1: none), and where; ``moves``:
    equal for supports that move alike."""
    body, grid = parts.body, parts.mesh
    owner = np.full((grid.node_count, 3), -1, np.int32)
    place = np.zeros((grid.node_count, 3))
    for number, support in enumerate(body.supports):
        where = f"body {body.name!r}, support {support.name!r}"
        chosen = np.zeros((grid.node_count, 3), bool)
        with naming_place(where):
            if support.type == "symmetry":
                chosen = fem.symmetry(grid, faces_of(grid, parts.skin.faces, support.where))
            else:
                nodes = nodes_of(grid, support.where)
                for name in support.fix:
                    chosen[nodes, "xyz".index(name)] = True
        wanted = np.broadcast_to(np.array(support.displacement), place.shape)
        other = chosen & (owner >= 0)
        moving = any(support.displacement)
        for earlier in np.unique(owner[other]):
            before = body.supports[earlier]
            shared = other & (owner == earlier)
            apart = shared & (place != wanted)
            if moving and moves.get(earlier) != moves.get(number):
                apart |= shared & (wanted != 0.0)
            if apart.any():
                axis = int(np.flatnonzero(apart.any(axis=0))[0])
                count, by = int(apart[:, axis].sum()), f"an earlier support ({before.name!r})"
                what = f"{where}: {count} of its nodes are held at another {'xyz'[axis]} by {by}"
                got = f"{support.displacement[axis]:g} m"
                raise InputError(f"{what}; got {got}; expected one displacement per node")
        free = chosen & (owner < 0)
        owner[free] = number
        place[free] = wanted[free]
    return owner, place


def _tie(parts: MeshedBody, tie: m.TieTable) -> fem.Equations:
    with naming_place(f"body {parts.body.name!r}, tie {tie.name!r}"):
        faces = faces_of(parts.mesh, parts.skin.faces, tie.faces)
        nodes = nodes_of(parts.mesh, tie.nodes)
        return fem.tie(parts.mesh, faces, nodes, tolerance=tie.tolerance)


def _materials(parts: MeshedBody) -> tuple[list[fem.Material], Int]:
    """The materials of a body, and which of them each cell is of."""
    body = parts.body
    assert body.material is not None  # build_model made sure
    materials: list[fem.Material] = [build_material(body.material)]
    of_cell = np.zeros(parts.mesh.cell_count, np.int32)
    for number, part in enumerate(body.parts):
        with naming_place(f"body {body.name!r}, part {number} of {part.material.name!r}"):
            cells = cells_of(parts.mesh, part.where)
        of_cell[cells] = len(materials)
        materials.append(build_material(part.material))
    with naming_place(f"body {body.name!r}"):
        _check_flow(parts, materials, of_cell)
    return materials, of_cell


def _check_flow(parts: MeshedBody, materials: Sequence[fem.Material], of_cell: Int) -> None:
    """Raises InputError where metal is in elements that can't follow its flow."""
    flows = np.array([isinstance(one, fem.J2) for one in materials])[of_cell]
    for kind, first, block in parts.mesh.blocks():
        known = ELEMENTS[kind].formulations
        asked = parts.body.formulation
        rule = asked if asked in known else known[0]
        if not fit_for_flow(kind, rule):
            count = int(flows[first : first + len(block)].sum())
            require(count == 0, m.NO_FLOW, f"{count} of {kind} ({rule!r})", m.FLOWING)


def _load(parts: MeshedBody, materials: list[fem.Material], of_cell: Int, load: m.Load) -> Float:
    """(N,3) nodal forces at amplitude 1."""
    grid, body = parts.mesh, parts.body
    density = np.array([material.density for material in materials])[of_cell]
    if isinstance(load, m.GravityTable):
        return fem.body_force(grid, density, load.acceleration)
    if isinstance(load, m.CentrifugalTable):
        return fem.centrifugal(grid, density, load.axis_point, load.axis, load.speed)
    if isinstance(load, m.ThermalTable):
        return fem.thermal(
            grid, materials, load.temperature_change, of_cell, formulation=body.formulation
        )
    if isinstance(load, m.NodalForceTable):
        nodes = nodes_of(grid, load.where)
        return fem.nodal_force(grid, nodes, np.array(load.force) * len(nodes))
    if isinstance(load, m.LineForceTable):
        return fem.line_force(grid, nodes_of(grid, load.where), load.force)
    faces = faces_of(grid, parts.skin.faces, load.where)
    if isinstance(load, m.PressureTable):
        return fem.pressure(grid, faces, load.pressure)
    if isinstance(load, m.TractionTable):
        return fem.traction(grid, faces, load.traction)
    return fem.face_force(grid, faces, load.force)
