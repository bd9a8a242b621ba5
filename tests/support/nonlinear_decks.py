"""Nonlinear decks of small bodies, one for each element and feature; CalculiX solves them as well.

Each prints displacements and stresses, and asks CalculiX for residuals of 1e-9.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

import gpusim as gs
from gpusim.mesh.file_content.numbering import ABAQUS_SIDES

Lines = list[str]
_PER_LINE = 10
_TYPES = {"hex8": "C3D8", "hex20": "C3D20", "tet4": "C3D4", "tet10": "C3D10", "wedge6": "C3D6",
          "wedge15": "C3D15"}  # fmt: skip
_CORNERS = {"hex20": "hex8", "tet10": "tet4", "wedge15": "wedge6"}

STEEL = ["*ELASTIC", "210000., 0.3", "*EXPANSION", "1.2E-5", "*DENSITY", "7.8E-9"]
METAL = ["*ELASTIC", "210000., 0.3", "*PLASTIC", "250., 0.", "650., 0.02", "4250., 0.2"]
RUBBER = ["*HYPERELASTIC, NEO HOOKE", "0.5, 0.05"]
WOOD = ["*ELASTIC, TYPE=ENGINEERING CONSTANTS", "11000., 800., 400., 0.4, 0.3, 0.35, 700., 600.",
        "100."]  # fmt: skip
CLAMPED = ["*BOUNDARY", "XMIN, 1, 3"]
MOVED = [*CLAMPED, "XMAX, 1, 3"]


def listed(values: Sequence[object]) -> Lines:
    """A row of an input file, over as many lines as it needs."""
    entries = [str(value) for value in values]
    rows = [entries[k : k + _PER_LINE] for k in range(0, len(entries), _PER_LINE)]
    return [", ".join(row) + ("," if row is not rows[-1] else "") for row in rows]


def written(
    mesh: gs.Mesh,
    material: Lines,
    steps: Sequence[Lines],
    kind: str = "",
    before: Sequence[str] = (),
    section: str = "",
) -> str:
    """A deck; nodes at the ends of the body are the sets XMIN … ZMAX."""
    ((name, _, block),) = mesh.blocks()
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{k}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in enumerate(mesh.points, 1)]
    lines.append(f"*ELEMENT, TYPE={kind or _TYPES[name]}, ELSET=BODY")
    for number, cell in enumerate(block + 1, 1):
        lines += listed([number, *cell])
    for axis in range(3):
        for value, end in zip((mesh.points.min(axis=0), mesh.points.max(axis=0)), ("MIN", "MAX"),
                              strict=True):  # fmt: skip
            nodes = np.flatnonzero(np.isclose(mesh.points[:, axis], value[axis]))
            lines += [f"*NSET, NSET={'XYZ'[axis]}{end}", *listed(nodes + 1)]
    lines += [*before, "*MATERIAL, NAME=M", *material]
    lines.append(f"*SOLID SECTION, ELSET=BODY, MATERIAL=M{section}")
    return "\n".join([*lines, *(line for step in steps for line in step)]) + "\n"


def step(static: str, *cards: str, head: str = "*STEP, NLGEOM, INC=1000") -> Lines:
    """A step with its increments; ``static`` is *STATIC, with its line after a blank line."""
    return [
        head, *static.split("\n"), *cards, "*CONTROLS, PARAMETERS=FIELD", "1.E-9, 1.E-9",
        "*NODE PRINT, NSET=ALL, GLOBAL=YES", "U", "*EL PRINT, ELSET=BODY, GLOBAL=YES", "S",
        "*END STEP",
    ]  # fmt: skip


def end_force(mesh: gs.Mesh, total: float, axis: int, op: str = "") -> Lines:
    """*CLOAD on the end at the greatest x."""
    faces = gs.mesh.select_faces(mesh, normal="+x")
    forces = gs.fem.face_force(mesh, faces, total=total * np.eye(3)[axis])[:, axis]
    loaded = np.flatnonzero(forces)
    return [f"*CLOAD{op}", *(f"{k + 1}, {axis + 1}, {forces[k]:.12e}" for k in loaded)]


def pressure(mesh: gs.Mesh, normal: str, value: float) -> Lines:
    """*DLOAD on the faces of a side."""
    ((kind, _, block),) = mesh.blocks()
    faces = gs.mesh.select_faces(mesh, normal=normal)
    lines = ["*DLOAD"]
    for cell, nodes in zip(faces.cell, faces.nodes, strict=True):
        sides = [set(block[cell][list(side)]) for side in ABAQUS_SIDES[_CORNERS.get(kind, kind)]]
        (number,) = (k for k, side in enumerate(sides, 1) if side <= set(nodes))
        lines.append(f"{cell + 1}, P{number}, {value}")
    return lines


def bar(length: float, *divisions: int, quadratic: bool = True) -> gs.Mesh:
    """Of a square section 1 x 1."""
    mesh = gs.mesh.box(size=(length, 1, 1), divisions=divisions)
    return gs.mesh.quadratic(mesh) if quadratic else mesh


def wedges(mesh: gs.Mesh) -> gs.Mesh:
    """Each brick as two wedges."""
    bricks = mesh.cells["hex8"]
    halves = bricks[:, [0, 1, 2, 4, 5, 6]], bricks[:, [0, 2, 3, 4, 6, 7]]
    return gs.Mesh(mesh.points, {"wedge6": np.concatenate(halves)})


def _tip(mesh: gs.Mesh, force: float, kind: str = "") -> str:
    return written(mesh, STEEL, [step("*STATIC\n0.1, 1.", *end_force(mesh, force, 2))], kind,
                   CLAMPED)  # fmt: skip


def _pressed(kind: str) -> str:
    mesh = bar(8, 4, 2, 2)
    static = step("*STATIC\n0.1, 1.", *pressure(mesh, "-z", 60.0))
    return written(mesh, STEEL, [static], kind, CLAMPED)


def _rubber(mesh: gs.Mesh, kind: str, along: float, across: float) -> str:
    moved = step("*STATIC\n0.25, 1.", "*BOUNDARY", f"XMAX, 1, 1, {along}", f"XMAX, 2, 2, {across}")
    return written(mesh, RUBBER, [moved], kind, MOVED)


def _hole() -> str:
    """A plate pulled until it flows, and unloaded."""
    mesh = gs.mesh.plate_with_hole(100.0, 40.0, 5.0, 20.0, around=16, radial=3, through=1)
    steps = [
        step(f"*STATIC, DIRECT\n{part}, 1.", "*BOUNDARY", f"XMAX, 1, 1, {end}")
        for part, end in ((0.1, 0.5), (0.05, 0.1))
    ]
    held = ["*BOUNDARY", "XMIN, 1", "ZMIN, 3", "1, 2", "XMAX, 1, 1"]
    return written(mesh, METAL, steps, "C3D8", held)


def _cyclic() -> str:
    mesh = bar(4, 4, 2, 2, quadratic=False)
    updown = ["*AMPLITUDE, NAME=UPDOWN", "0., 0., 0.25, 1., 0.75, -1., 1., 0.5"]
    moved = step("*STATIC\n0.025, 1., 1.E-6, 0.025", "*BOUNDARY, AMPLITUDE=UPDOWN",
                 "XMAX, 2, 2, 0.08")  # fmt: skip
    return written(mesh, METAL, [moved], "C3D8", [*updown, *MOVED])


def _loads() -> str:
    """Pressure and gravity, then a force beside them, then all but the force."""
    mesh = bar(8, 4, 2, 2)
    steps = [
        step("*STATIC\n0.5, 2.", *pressure(mesh, "-z", 60.0), "BODY, GRAV, 9.E9, 0., 0., -1."),
        step("*STATIC", *end_force(mesh, -500.0, 1)),
        step("*STATIC", *end_force(mesh, 100.0, 1, ", OP=NEW")),
    ]
    return written(mesh, STEEL, steps, "C3D20R", CLAMPED)


def _warm() -> str:
    mesh = bar(8, 4, 2, 2)
    heated = step("*STATIC", *end_force(mesh, -500.0, 1), "*TEMPERATURE", "ALL, 80.")
    initial = ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", "ALL, 20."]
    return written(mesh, STEEL, [heated], "C3D20R", [*initial, *CLAMPED])


def _turned() -> str:
    axes = ["*TRANSFORM, NSET=XMAX, TYPE=R", "1., 0.5, 0., 0., 1., 0."]
    moved = step("*STATIC", "*BOUNDARY", "XMAX, 2, 2, 1.")
    return written(bar(8, 4, 2, 2), STEEL, [moved], "C3D20R", [*axes, *CLAMPED])


def _wood() -> str:
    mesh = bar(8, 4, 2, 2)
    axes = ["*ORIENTATION, NAME=O", "1., 0.3, 0.1, 0., 1., 0."]
    bent = step("*STATIC\n0.1, 1.", *end_force(mesh, 8.0, 2))
    return written(mesh, WOOD, [bent], "C3D20R", [*axes, *CLAMPED], ", ORIENTATION=O")


DECKS: dict[str, Callable[[], str]] = {
    "tip_c3d8": lambda: _tip(bar(8, 8, 2, 2, quadratic=False), 800.0),
    "tip_c3d8i": lambda: _tip(bar(8, 8, 2, 2, quadratic=False), 800.0, "C3D8I"),
    "tip_c3d20": lambda: _tip(bar(8, 4, 2, 2), 800.0),
    "tip_c3d20r": lambda: _tip(bar(8, 4, 2, 2), 800.0, "C3D20R"),
    "tip_c3d4": lambda: _tip(gs.mesh.split(bar(3, 4, 2, 2, quadratic=False)), 9000.0),
    "tip_c3d10": lambda: _tip(
        gs.mesh.quadratic(gs.mesh.split(bar(4, 3, 1, 1, quadratic=False))), 4000.0
    ),
    "tip_c3d6": lambda: _tip(wedges(bar(3, 4, 2, 2, quadratic=False)), 9000.0),
    "tip_c3d15": lambda: _tip(gs.mesh.quadratic(wedges(bar(4, 3, 1, 1, quadratic=False))), 4000.0),
    "pressed_c3d20": lambda: _pressed("C3D20"),
    "pressed_c3d20r": lambda: _pressed("C3D20R"),
    "rubber_c3d8": lambda: _rubber(bar(2, 3, 2, 2, quadratic=False), "C3D8", 0.8, 0.3),
    "rubber_c3d20r": lambda: _rubber(bar(2, 2, 1, 1), "C3D20R", -0.5, 0.2),
    "hole_c3d8": _hole,
    "cyclic_c3d8": _cyclic,
    "loads_c3d20r": _loads,
    "turned_c3d20r": _turned,
    "wood_c3d20r": _wood,
    "warm_c3d20r": _warm,
}
"""By name: what a test compares."""
