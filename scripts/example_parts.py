"""Makes the parts of examples/plate_hole_stereo.toml, curved_stereo.toml and ring.toml with Gmsh.

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


def ring() -> None:
    """A ring about y of radius 50, 1 mm thick and 2 mm wide: a mesh of 128 quadratic bricks."""
    radii, wide, quarters = (49.5, 50.5), 2.0, ((1, 0), (0, 1), (-1, 0), (0, -1))
    geo = gmsh.model.geo
    centre = geo.addPoint(0.0, -0.5 * wide, 0.0)
    corners = [[geo.addPoint(r * x, -0.5 * wide, r * z) for x, z in quarters] for r in radii]
    spokes = [geo.addLine(inside, outside) for inside, outside in zip(*corners, strict=True)]
    for k in range(4):
        after = (k + 1) % 4
        inside, outside = (geo.addCircleArc(row[k], centre, row[after]) for row in corners)
        loop = geo.addCurveLoop([spokes[k], outside, -spokes[after], -inside])
        face = geo.addPlaneSurface([loop])
        for arc in (inside, outside):
            geo.mesh.setTransfiniteCurve(arc, 33)
        geo.mesh.setTransfiniteSurface(face)
        geo.mesh.setRecombine(2, face)
        geo.extrude([(2, face)], 0.0, wide, 0.0, numElements=[1], recombine=True)
    for spoke in spokes:
        geo.mesh.setTransfiniteCurve(spoke, 2)


def write_mesh() -> None:
    """Of the model, with midside nodes on its curves."""
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="ring")
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    gmsh.write(str(OUT / "ring.msh"))


def main() -> None:
    """Write the files."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 0)
    for part in (plate_hole, vessel):
        gmsh.clear()
        part()
        gmsh.model.occ.synchronize()
        gmsh.write(str(OUT / f"{part.__name__}.step"))
    gmsh.clear()
    ring()
    gmsh.model.geo.synchronize()
    write_mesh()
    gmsh.finalize()


if __name__ == "__main__":
    main()
