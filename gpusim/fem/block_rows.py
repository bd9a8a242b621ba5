"""The assembled stiffness as a table of distinct block rows.

On a structured mesh most nodes see the same surroundings, so their rows of 3x3 blocks are equal:
a few dozen distinct rows and one index per neighbour replace the whole matrix. On an
unstructured mesh every node has its own row, which is plain block storage.

The diagonal block isn't stored. Rigid translations cost no energy, so K_ii = -sum_j K_ij, and

    (K u)_i = sum_{j != i} K_ij (u_j - u_i)

needs off-diagonal blocks only; taking differences first also keeps the rounding error of slender
bodies, whose neighbours move nearly alike, well below that of the usual product.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.fem.congruence import congruence_classes, mix, unique_hashes
from gpusim.fem.element import ELEMENTS
from gpusim.fem.element_matrix import element_stiffness
from gpusim.fem.model import Model

__all__ = ["BlockRows", "assemble", "resolve_formulation"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]
Long = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BlockRows:
    """Distinct block rows of K, float64.

    ``start`` (N+1,) int64: the neighbours of node i are ``neighbour[start[i]:start[i+1]]``,
    ascending, itself left out. ``row_class`` (N,) int32. ``table`` (C,D,3,3): block k of a row
    belongs to the k-th neighbour; unused blocks are zero. ``diagonal`` (C,3,3). ``element_classes``
    the number of distinct element matrices.
    """

    start: Long
    neighbour: Int
    row_class: Int
    table: Float
    diagonal: Float
    element_classes: int

    @property
    def node_count(self) -> int:
        return len(self.row_class)

    @property
    def degree(self) -> Long:
        """(N,) neighbours per node."""
        return np.diff(self.start)


def resolve_formulation(
    model: Model, formulation: str | Mapping[str, str] | None
) -> dict[str, str]:
    """Formulation per cell type of the mesh; the element's first one where nothing is said.

    One name for all types counts where a type has it (tet4 has no "bbar"). Raises InputError for
    a type or name that no element has, also if the mesh has no such cells.
    """
    if isinstance(formulation, str):
        known = dict.fromkeys(name for e in ELEMENTS.values() for name in e.formulations)
        if formulation not in known:
            raise InputError(
                f"formulation: unknown; got {formulation!r}; expected one of {', '.join(known)}"
            )
        wanted = {k: formulation for k, e in ELEMENTS.items() if formulation in e.formulations}
    elif formulation is None or isinstance(formulation, Mapping):
        wanted = dict(formulation or {})
    else:
        raise InputError(
            f"formulation: got {formulation!r}; expected a name, or a mapping from cell type to one"
        )
    for kind, name in wanted.items():
        if kind not in ELEMENTS:
            raise InputError(
                f"formulation: unknown cell type; got {kind!r}; "
                f"expected keys among {', '.join(ELEMENTS)}"
            )
        if name not in ELEMENTS[kind].formulations:
            raise InputError(
                f"formulation: not available for {kind}; got {name!r}; "
                f"expected one of {', '.join(ELEMENTS[kind].formulations)}"
            )
    return {kind: wanted.get(kind, ELEMENTS[kind].formulations[0]) for kind in model.mesh.cells}


@dataclass(frozen=True)
class _Pairs:
    """Off-diagonal node pairs (a, b) of all elements: their blocks are to be added up."""

    row: Int
    column: Int
    block: Long  # number of the 3x3 block in the list of distinct blocks


def assemble(model: Model, formulation: Mapping[str, str]) -> BlockRows:
    """Distinct element matrices, then distinct rows, of a model."""
    mesh = model.mesh
    pairs, blocks, classes = _element_blocks(model, formulation)
    count = mesh.node_count
    key = pairs.row.astype(np.int64) * count + pairs.column
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    edge_start = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    edge_key = ordered[edge_start]
    row = edge_key // count
    neighbour = (edge_key % count).astype(np.int32)
    start = np.searchsorted(row, np.arange(count + 1)).astype(np.int64)
    slot = np.arange(len(row)) - start[row]
    edge_of_pair = np.empty(len(key), dtype=np.int64)
    edge_of_pair[order] = np.repeat(
        np.arange(len(edge_key)), np.diff(np.concatenate([edge_start, [len(key)]]))
    )
    hashes = [_row_hash(pairs.block[order], edge_start, slot, start, seed) for seed in (100, 200)]
    representative, row_class = unique_hashes(hashes[0], hashes[1])
    degree = np.diff(start)
    table = np.zeros((len(representative), int(degree.max()), 3, 3))
    class_of_node = np.full(count, -1, dtype=np.int64)
    class_of_node[representative] = np.arange(len(representative))
    wanted = np.flatnonzero(class_of_node[pairs.row] >= 0)
    target = class_of_node[pairs.row[wanted]] * table.shape[1] + slot[edge_of_pair[wanted]]
    flat = table.reshape(-1, 9)
    for component in range(9):
        flat[:, component] = np.bincount(
            target, weights=blocks[pairs.block[wanted], component], minlength=len(flat)
        )
    diagonal = -table.sum(axis=1)
    return BlockRows(
        start, neighbour, row_class.astype(np.int32), table,
        0.5 * (diagonal + diagonal.transpose(0, 2, 1)), classes,
    )  # fmt: skip


def _element_blocks(model: Model, formulation: Mapping[str, str]) -> tuple[_Pairs, Float, int]:
    mesh = model.mesh
    elasticity = np.stack([material.stiffness() for material in model.materials])
    assert model.material_of_cell is not None
    rows: list[Int] = []
    columns: list[Int] = []
    numbers: list[Long] = []
    blocks: list[Float] = []
    offset = classes = 0
    for kind, first, cells in mesh.blocks():
        if len(cells) == 0:
            continue
        material = model.material_of_cell[first : first + len(cells)]
        nodes = mesh.points[cells]
        representative, element_class = congruence_classes(nodes, material)
        matrices = element_stiffness(
            kind, nodes[representative], elasticity[material[representative]], formulation[kind]
        )
        width = cells.shape[1]
        a, b = np.nonzero(~np.eye(width, dtype=bool))
        split = matrices.reshape(-1, width, 3, width, 3).transpose(0, 1, 3, 2, 4)
        blocks.append(split[:, a, b].reshape(-1, 9))
        rows.append(cells[:, a].ravel())
        columns.append(cells[:, b].ravel())
        pair = offset + element_class[:, None] * len(a) + np.arange(len(a))
        numbers.append(pair.ravel())
        offset += len(representative) * len(a)
        classes += len(representative)
    joined = _Pairs(np.concatenate(rows), np.concatenate(columns), np.concatenate(numbers))
    return joined, np.concatenate(blocks), classes


def _row_hash(
    block: Long, edge_start: Long, slot: Long, start: Long, seed: int
) -> npt.NDArray[np.uint64]:
    """One hash per node of which blocks go to which neighbour, whatever the order of adding."""
    edge = np.add.reduceat(mix(block, seed), edge_start)
    edge = mix(edge + mix(slot, seed + 1), seed + 2)
    total = np.concatenate([[np.uint64(0)], np.cumsum(edge, dtype=np.uint64)])
    return np.asarray(total[start[1:]] - total[start[:-1]])
