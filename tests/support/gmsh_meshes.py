"""Small meshes written by Gmsh, for the tests of readers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

CORNERS = {
    "tet4": [[0, 0, 0], [1.1, 0, 0], [0.2, 0.9, 0], [0.1, 0.2, 1.3]],
    "hex8": [
        [0, 0, 0], [1.1, 0, 0], [1.2, 0.9, 0], [0, 0.8, 0],
        [0.1, 0.2, 1.3], [1.2, 0, 1.4], [1.2, 1.1, 1.5], [0.1, 1, 1.3],
    ],
    "wedge6": [
        [0, 0, 0], [1.1, 0, 0], [0.2, 0.9, 0], [0.1, 0.2, 1.3], [1.2, 0.1, 1.4], [0.2, 1.1, 1.5],
    ],
    "pyramid5": [[0, 0, 0], [1.1, 0, 0], [1.2, 0.9, 0], [0, 0.8, 0], [0.5, 0.4, 1.3]],
}  # fmt: skip
_TYPES = {"tet4": 4, "hex8": 5, "wedge6": 6, "pyramid5": 7}


def gmsh_module() -> Any:
    """The gmsh package; skips the test where it, or a library that it needs, is missing."""
    try:
        import gmsh
    except (ImportError, OSError) as error:
        pytest.skip(f"gmsh can't be imported: {error}")
    return gmsh


class Gmsh:
    """A Gmsh session with a model of its own."""

    def __init__(self) -> None:
        self.gmsh = gmsh_module()

    def __enter__(self) -> Any:
        self.gmsh.initialize([], readConfigFiles=False, run=False, interruptible=False)
        self.gmsh.option.setNumber("General.Terminal", 0)
        self.gmsh.model.add("test")
        return self.gmsh

    def __exit__(self, *error: object) -> None:
        self.gmsh.finalize()


def write_one_cell(path: Path, linear: str, second: bool, complete: bool, **options: float) -> None:
    """One distorted cell with a physical group "my body", made quadratic by Gmsh if ``second``."""
    points = np.array(CORNERS[linear], dtype=float)
    with Gmsh() as gmsh:
        entity = gmsh.model.addDiscreteEntity(3)
        tags = list(range(1, len(points) + 1))
        gmsh.model.mesh.addNodes(3, entity, tags, points.ravel())
        gmsh.model.mesh.addElementsByType(entity, _TYPES[linear], [1], tags)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0 if complete else 1)
        if second:
            gmsh.model.mesh.setOrder(2)
        gmsh.model.addPhysicalGroup(3, [entity], 7, name="my body")
        for name, value in options.items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        gmsh.write(str(path))


def write_two_boxes(path: Path, order: int = 1, **options: float) -> None:
    """Two boxes, 2 x 1 x 1 and 1 x 1 x 1 at x = 2, with overlapping and unnamed groups."""
    with Gmsh() as gmsh:
        boxes = [gmsh.model.occ.addBox(x, 0, 0, dx, 1, 1) for x, dx in ((0, 2), (2, 1))]
        gmsh.model.occ.fragment([(3, boxes[0])], [(3, boxes[1])])
        gmsh.model.occ.synchronize()

        def at(dimension: int, axis: int, value: float) -> list[int]:
            found = []
            for _, tag in gmsh.model.getEntities(dimension):
                box = np.array(gmsh.model.getBoundingBox(dimension, tag)).reshape(2, 3)
                if np.abs(box[:, axis] - value).max() < 1e-6:
                    found.append(tag)
            return found

        gmsh.model.addPhysicalGroup(3, [1], 1, name="left part")
        gmsh.model.addPhysicalGroup(3, [1, 2], 2, name="both")
        gmsh.model.addPhysicalGroup(2, at(2, 0, 0.0), 1, name="clamp")
        gmsh.model.addPhysicalGroup(2, at(2, 0, 2.0), 5, name="inside")
        gmsh.model.addPhysicalGroup(2, at(2, 0, 3.0), 9)
        gmsh.model.addPhysicalGroup(1, gmsh.model.getEntitiesForPhysicalName("clamp") and [1], 3)
        gmsh.model.addPhysicalGroup(0, [1], 4, name="corner")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.7)
        for name, value in options.items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        gmsh.model.mesh.generate(3)
        if order == 2:
            gmsh.model.mesh.setOrder(2)
        gmsh.write(str(path))
