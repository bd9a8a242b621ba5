"""Published cases of vibration: NAFEMS' natural frequencies and forced vibration, prestressed beams
and a column.

"The Standard NAFEMS Benchmarks", TNSB rev. 3 (1990), and "Selected Benchmarks for Forced
Vibration", R0016 (1993). Lengths in m.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.fem import Isotropic, Model, equations, face_force
from gpusim.mesh import Mesh, select_faces
from tests.support.fem_reference import bar
from tests.support.plate_theory import SkewPlate, clamped_solid, thin_plate

Float = npt.NDArray[np.float64]
Divisions = tuple[int, int, int]

STEEL = Isotropic(200e9, 0.3, density=8000.0)
_DEEP = (10.0, 2.0, 2.0)


@dataclass(frozen=True, eq=False)
class ModalCase:
    """``expected`` (n,) Hz of the modes after ``rigid`` rigid-body ones, from ``source``;
    ``published``: what a publication has, where theory is better."""

    name: str
    model: Model
    formulation: str
    expected: Float
    source: str
    rigid: int = 0
    published: Float | None = None

    @property
    def count(self) -> int:
        """Modes to ask for."""
        return self.rigid + len(self.expected)

    def errors(self, frequencies: Float) -> Float:
        """(n,) relative."""
        return np.asarray(frequencies[self.rigid : self.count] / self.expected - 1.0)


def tapered_membrane(divisions: Divisions, formulation: str = "full") -> ModalCase:
    """FV32: a cantilever from 5 m to 1 m of height, in its plane."""
    mesh = bar("hex20", (10.0, 1.0, 0.05), divisions)
    points = mesh.points - np.array([0.0, 0.5, 0.025])
    points[:, 1] *= 5.0 - 0.4 * points[:, 0]
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[points[:, 0] == 0.0, :2] = True
    fixed[np.isclose(points[:, 2], 0.0, atol=1e-9), 2] = True
    expected = np.array([44.619, 130.016, 162.692, 245.997, 379.734, 391.412])
    published = np.array([44.623, 130.03, 162.70, 246.05, 379.90, 391.44])
    return ModalCase("FV32 tapered membrane", Model(Mesh(points, mesh.cells), STEEL, fixed),
                     formulation, expected, "hex20 32x16x1", published=published)  # fmt: skip


def solid_plate(divisions: Divisions = (4, 4, 1)) -> ModalCase:
    """FV52: held across along the lower edges. Finer meshes find a plate that is held less: a line
    has no stiffness in a solid."""
    mesh = bar("hex20", (10.0, 10.0, 1.0), divisions)
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[_sides(mesh.points, (10.0, 10.0)) & (mesh.points[:, 2] == 0.0), 2] = True
    expected = np.array([44.762, 110.52, 110.52, 169.08, 193.93, 206.64])
    published = np.array([45.897, 109.44, 109.44, 167.89, 193.59, 206.19])
    return ModalCase("FV52 solid square plate", Model(mesh, STEEL, fixed), "full", expected,
                     "hex20 4x4x1 of 27 points", 3, published)  # fmt: skip


def free_plate(kind: str, divisions: Divisions, formulation: str) -> ModalCase:
    """FV12."""
    mesh, plate = bar(kind, (10.0, 10.0, 0.05), divisions), _plate(0.05)
    # a third of the rigid-body motions lie in the plate
    expected = thin_plate(plate, (0, 0), (0, 0), 12)[3:9]
    published = np.array([1.622, 2.360, 2.922, 4.233, 4.233, 7.416])
    return ModalCase("FV12 free thin plate", Model(mesh, STEEL), formulation, expected,
                     "thin-plate theory", 6, published)  # fmt: skip


def cantilever_plate(kind: str, divisions: Divisions, formulation: str) -> ModalCase:
    """FV16."""
    mesh = _graded(kind, divisions, 0.05)
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    expected = thin_plate(_plate(0.05), (2, 0), (0, 0), 20)[:6]
    published = np.array([0.421, 1.029, 2.582, 3.306, 3.753, 6.555])
    return ModalCase("FV16 cantilevered thin plate", Model(mesh, STEEL, fixed), formulation,
                     expected, "thin-plate theory", published=published)  # fmt: skip


def rhombic_plate(kind: str, divisions: Divisions, formulation: str) -> ModalCase:
    """FV22: thick, at 45 degrees, clamped. What is published is Mindlin's theory, whose clamped
    sides are softer than those of a solid."""
    mesh = _graded(kind, divisions, 1.0)
    points = mesh.points.copy()
    fixed = np.repeat(_sides(points, (10.0, 10.0))[:, None], 3, axis=1)
    fixed[np.isclose(points[:, 2], 0.5), :2] = True
    points[:, 0] += np.sqrt(0.5) * points[:, 1]
    points[:, 1] *= np.sqrt(0.5)
    expected = clamped_solid(_plate(1.0, 45.0), 12, 3)[:5]
    published = np.array([133.95, 201.41, 265.81, 282.74, 334.45])
    model = Model(Mesh(points, mesh.cells), STEEL, fixed)
    return ModalCase("FV22 clamped thick rhombic plate", model, formulation, expected,
                     "elasticity, Ritz", published=published)  # fmt: skip


def _plate(thickness: float, angle: float = 90.0) -> SkewPlate:
    return SkewPlate(10.0, 10.0, thickness, STEEL.E, STEEL.nu, STEEL.density, angle)


def _graded(kind: str, divisions: Divisions, thickness: float) -> Mesh:
    """A square of 10, its cells thin at the sides."""
    mesh = bar(kind, (2.0, 2.0, thickness), divisions)
    points = mesh.points.copy()
    place = points[:, :2] - 1.0
    points[:, :2] = 5.0 * (1.0 + 0.2 * place + 0.8 * np.sin(0.5 * np.pi * place))
    return Mesh(points, mesh.cells)


def _sides(points: Float, size: Sequence[float]) -> npt.NDArray[np.bool_]:
    """(N,) nodes on the four sides."""
    ends = np.isclose(points[:, :2], 0.0) | np.isclose(points[:, :2], size)
    return np.asarray(ends.any(axis=1))


def deep_beam(kind: str = "hex20", divisions: Divisions = (10, 2, 2)) -> Model:
    """NAFEMS' Test 5: 10 x 2 x 2, simply supported as a beam is: what is held is the mean
    displacement of the end sections, and the mean turn of the first about the axis. Loaded by
    1 MN/m in y over its length."""
    block = bar(kind, _DEEP, divisions)
    mesh = Mesh(block.points - np.array([0.0, 1.0, 1.0]), block.cells)
    first = _shares(mesh, 0.0, "-x")
    last = _shares(mesh, _DEEP[0], "+x")
    nodes = np.flatnonzero(first)
    _, y, z = mesh.points.T
    turn = [(n, "z", first[n] * y[n]) for n in nodes] + [(n, "y", -first[n] * z[n]) for n in nodes]
    rows = [(_mean(first, axis), 0.0) for axis in "xyz"] + [(turn, 0.0)]
    rows += [(_mean(last, axis), 0.0) for axis in "yz"]
    load = (0.0, 1e6 * _DEEP[0], 0.0)
    top = select_faces(mesh, plane=((0.0, 1.0, 0.0), "+y"))
    below = select_faces(mesh, plane=((0.0, -1.0, 0.0), "-y"))
    # half of it above and half below, so that the middle isn't squeezed
    forces = 0.5 * (face_force(mesh, top, load) + face_force(mesh, below, load))
    return Model(mesh, STEEL, forces=forces, constraints=[equations(mesh, rows)])


def deep_beam_modes(kind: str, divisions: Divisions, formulation: str) -> ModalCase:
    """NAFEMS' Test 5, free."""
    expected = np.array([42.650, 42.650, 71.20, 125.00, 148.15, 148.15, 213.61, 283.47, 283.47])
    return ModalCase("NAFEMS Test 5, deep beam", deep_beam(kind, divisions), formulation,
                     expected, "NAFEMS R0016")  # fmt: skip


def _shares(mesh: Mesh, x: float, side: str) -> Float:
    """(N,) of the area of an end section."""
    faces = select_faces(mesh, plane=((x, 0.0, 0.0), side))
    return np.asarray(face_force(mesh, faces, (1.0, 0.0, 0.0))[:, 0])


def _mean(shares: Float, axis: str) -> Iterable[tuple[int, str, float]]:
    return [(int(node), axis, float(shares[node])) for node in np.flatnonzero(shares)]


@dataclass(frozen=True)
class GuidedColumn:
    """Half a wave of a column: guided at x = 0, simply supported at ``length``; the section a
    square of 1, nu 0, E 1, density 1. The closed forms of beams hold for it, shear included."""

    length: float

    @property
    def _stiffness(self) -> tuple[float, float, float]:
        """Wave number, bending E I, shear k G A."""
        return 0.5 * np.pi / self.length, 1.0 / 12.0, 5.0 / 6.0 * 0.5

    @property
    def euler(self) -> float:
        """Its load by Euler."""
        wave, bending, _ = self._stiffness
        return bending * wave**2

    @property
    def engesser(self) -> float:
        """Its load with shear, by Engesser."""
        return self.euler / (1.0 + self.euler / self._stiffness[2])

    def frequency(self, tension: float) -> float:
        """Hz of the first mode under an axial force, of Timoshenko's beam."""
        wave, bending, shear = self._stiffness
        stiff = np.array([[(shear + tension) * wave**2, -shear * wave],
                          [-shear * wave, shear + bending * wave**2]])  # fmt: skip
        inertia = np.array([1.0, 1.0 / 12.0])
        values = np.linalg.eigvals(stiff / inertia[:, None]).real
        return float(np.sqrt(values.min()) / (2.0 * np.pi))

    def model(self, tension: float, divisions: Divisions, kind: str = "hex20") -> Model:
        """It moves in the plane of x and z."""
        mesh = bar(kind, (self.length, 1.0, 1.0), divisions)
        fixed = np.zeros(mesh.points.shape, dtype=bool)
        fixed[:, 1] = True
        fixed[mesh.points[:, 0] == 0.0, 0] = True
        fixed[np.isclose(mesh.points[:, 0], self.length), 2] = True
        end = select_faces(mesh, plane=((self.length, 0.0, 0.0), "+x"))
        force = face_force(mesh, end, (tension, 0.0, 0.0))
        return Model(mesh, Isotropic(1.0, 0.0, density=1.0), fixed, force)
