"""Makes the parts of examples/plate_hole_stereo.toml and examples/curved_stereo.toml with Gmsh.

python scripts/example_parts.py
"""

from __future__ import annotations

from pathlib import Path

import gmsh

OUT = Path(__file__).resolve().parent.parent / "examples"


def plate_hole() -> None:
    """A plate of 100 x 40 x 3 mm whose front is z = 3 mm, with a hole of 10 mm in its middle."""
    plate = gmsh.model.occ.addBox(0.0, 0.0, 0.0, 100.0, 40.0, 3.0)
    hole = gmsh.model.occ.addCylinder(50.0, 20.0, -1.0, 0.0, 0.0, 5.0, 5.0)
    gmsh.model.occ.cut([(3, plate)], [(3, hole)])


def vessel() -> None:
    """A closed tube along y, 120 mm long, 60 mm wide, its wall 2 mm and its ends 8 mm thick."""
    outside = gmsh.model.occ.addCylinder(0.0, -60.0, 0.0, 0.0, 120.0, 0.0, 30.0)
    inside = gmsh.model.occ.addCylinder(0.0, -52.0, 0.0, 0.0, 104.0, 0.0, 28.0)
    gmsh.model.occ.cut([(3, outside)], [(3, inside)])


def main() -> None:
    """Write both files."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 0)
    for part in (plate_hole, vessel):
        gmsh.clear()
        part()
        gmsh.model.occ.synchronize()
        gmsh.write(str(OUT / f"{part.__name__}.step"))
    gmsh.finalize()


if __name__ == "__main__":
    main()
