"""Small models of every element, and the reference models, against dense algebra.

What the reference models are too large for is found by shift and invert on the assembled matrix,
and its frequencies in extended precision, see `rayleigh`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from benchmarks.vibration.rayleigh import rayleigh_frequencies
from gpusim.errors import GpusimError
from gpusim.fem import Isotropic, Model, mass_matrix, modes
from gpusim.fem.elements.element import ELEMENTS
from gpusim.mesh import Mesh, box
from tests.support.element_meshes import mesh_of, mixed_mesh
from tests.support.tied_blocks import blocks, joined
from tests.support.vibration_reference import (
    clusters,
    dense_modes,
    reduced_matrices,
    span_errors,
)

Float = npt.NDArray[np.float64]

HEADINGS = (
    "case", "unknowns", "modes", "by", "error of f", "stated", "1 - MAC, of doubles their span",
    "within 1e-8", "reference is",
)  # fmt: skip
_WANTED = 1e-8
_STEEL = Isotropic(210e9, 0.3, density=7850.0)
_REFERENCES = Path(__file__).resolve().parents[3] / "shared" / "refs"
# modes of the reference beyond those that are asked for: which of these are double is known then
_BEYOND = 4


@dataclass(frozen=True)
class SmallCase:
    """``formulation`` None: the default of its cells."""

    name: str
    build: Callable[[], Model]
    formulation: dict[str, str] | None = None
    count: int = 10
    method: str = "auto"


def _held(mesh: Mesh, *materials: Isotropic, second: float = np.inf) -> Model:
    """Clamped at the least x; cells with a middle beyond ``second`` are of the second material."""
    low = mesh.points[:, 0].min()
    fixed = np.repeat(mesh.points[:, :1] < low + 1e-9, 3, axis=1)
    middles = np.concatenate([mesh.points[cells].mean(axis=1) for _, _, cells in mesh.blocks()])
    which = (middles[:, 0] > second).astype(np.int32)
    return Model(mesh, list(materials) or [_STEEL], fixed, material_of_cell=which)


def small_cases() -> Iterator[SmallCase]:
    """Every element and formulation, doubles, triples, free bodies, contrasts, ties."""
    for kind, element in ELEMENTS.items():
        for name in element.formulations:
            yield SmallCase(f"{kind} {name}", lambda k=kind: _held(mesh_of(k, (2, 2, 3), 0.05)),
                            {kind: name}, 6)  # fmt: skip
    yield SmallCase("all kinds in one mesh", lambda: _held(mixed_mesh(0.05)), None, 6)
    for method in ("direct", "multigrid"):
        yield SmallCase("square rod, pairs", lambda: _held(box((4.0, 1.0, 1.0), (12, 4, 4))),
                        method=method)  # fmt: skip
        yield SmallCase("free cube, triples", lambda: Model(box((1.0,) * 3, (5, 5, 5)), _STEEL),
                        None, 16, method)  # fmt: skip
        yield SmallCase("free plate", lambda: Model(box((1.0, 1.0, 0.02), (14, 14, 1)), _STEEL),
                        None, 14, method)  # fmt: skip
        soft = Isotropic(210e5, 0.3, density=1000.0)
        yield SmallCase("E contrast 1e4", lambda soft=soft: _held(
            box((4.0, 1.0, 1.0), (12, 4, 4)), _STEEL, soft, second=2.0), method=method)  # fmt: skip
    rubber = Isotropic(1e6, 0.4999, density=1000.0)
    yield SmallCase("nu 0.4999", lambda: _held(box((2.0, 1.0, 1.0), (8, 4, 4)), rubber),
                    {"hex8": "bbar"})  # fmt: skip
    yield SmallCase("tied blocks", _tied)


def _tied() -> Model:
    mesh = blocks((3, 3, 3), (5, 5, 4))
    fixed = np.repeat(mesh.points[:, 2:] < mesh.points[:, 2].min() + 1e-9, 3, axis=1)
    return Model(mesh, _STEEL, fixed, constraints=[joined(mesh)])


def compared(
    case: SmallCase, model: Model, frequencies: Float, shapes: Float, source: str
) -> list[str]:
    """``frequencies`` and ``shapes`` of the reference, more than are asked for."""
    try:
        found = modes(model, case.count, formulation=case.formulation, method=case.method)
    except GpusimError as error:
        return [case.name, "", str(case.count), case.method, "", "", "", "no", str(error)]
    still = len(found.rigid)
    elastic = slice(still, case.count)
    error = np.abs(found.frequencies[elastic] / frequencies[elastic] - 1.0).max()
    whole = [one for one in clusters(frequencies) if still <= one.start and one.stop <= case.count]
    sine = span_errors(found.shapes, shapes, mass_matrix(model), whole).max(initial=0.0)
    good = found.converged and error <= _WANTED and sine**2 <= _WANTED
    good = good and (frequencies[:still] <= 1e-4 * frequencies[still]).all()
    return [
        case.name, f"{found.unknowns:,}", str(case.count), found.method, f"{error:.0e}",
        f"{found.error_estimate.max():.0e}", f"{sine**2:.0e}", "yes" if good else "NO", source,
    ]  # fmt: skip


def beside_dense(name: str) -> Iterator[list[str]]:
    """One row of text after the other, of cases whose name holds ``name``."""
    for case in small_cases():
        if name in case.name:
            model = case.build()
            exact = dense_modes(model, case.formulation).lowest(case.count + _BEYOND)
            yield compared(case, model, exact.frequencies, exact.shapes, "dense")
    folder = Path(os.environ.get("GPUSIM_REFS", _REFERENCES))
    for path in sorted(folder.glob("*.npz")):
        if name in path.stem:
            yield from _reference_rows(path)


def _reference_rows(path: Path) -> Iterator[list[str]]:
    with np.load(path) as file:
        kind = str(file["cell_type"])
        mesh = Mesh(file["points"], {kind: file["cells"]})
        materials = [Isotropic(float(E), float(nu), density=1.0)
                     for E, nu in zip(file["E"], file["nu"], strict=True)]  # fmt: skip
        model = Model(mesh, materials, file["fixed_dofs"], material_of_cell=file["mat"])
    rules = ("full", "incompatible", "bbar") if kind == "hex8" else ("full",)
    for rule in rules:
        case = SmallCase(f"{path.stem}, {rule}", lambda: model, {kind: rule})
        shapes = _by_shift_and_invert(model, {kind: rule}, case.count + _BEYOND)
        frequencies = rayleigh_frequencies(model, {kind: rule}, shapes)
        yield compared(case, model, frequencies, shapes, "SuperLU's shapes, in 80 bits")


def _by_shift_and_invert(model: Model, rules: dict[str, str], count: int) -> Float:
    """(n,N,3) shapes of the lowest modes of the assembled matrices."""
    motions, stiff, mass = reduced_matrices(model, rules)
    factor = splu(stiff, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                  options={"SymmetricMode": True})  # fmt: skip
    inverse = LinearOperator(stiff.shape, factor.solve)
    values, vectors = eigsh(stiff, count, mass, sigma=0.0, OPinv=inverse, tol=0.0)
    return np.asarray((motions @ vectors[:, np.argsort(values)]).T.reshape(count, -1, 3))
