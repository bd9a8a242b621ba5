"""How large a mesh recipe makes a body, without making it."""

from __future__ import annotations

from gpusim.scene.description.mesh_recipe import (
    BeamMesh,
    BoxMesh,
    BracketMesh,
    CraneMesh,
    FieldMesh,
    FileMesh,
    MeshRecipe,
    Vec3,
)

__all__ = ["element_sizes", "extent"]


def extent(recipe: MeshRecipe) -> Vec3 | None:
    """Lengths along x, y, z (m); the members' sides for crane and bracket. None for files."""
    if isinstance(recipe, FileMesh | FieldMesh):
        return None
    if isinstance(recipe, BoxMesh):
        return recipe.size
    if isinstance(recipe, BeamMesh):
        width = min(recipe.width, recipe.end_width)
        return recipe.length, width, min(recipe.height, recipe.end_height)
    if isinstance(recipe, CraneMesh):
        reach = recipe.length + recipe.height + recipe.foot
        return reach, recipe.width, min(recipe.column_thickness, recipe.beam_thickness)
    if isinstance(recipe, BracketMesh):
        return recipe.base_length + recipe.wall_height, recipe.width, recipe.thickness
    return recipe.length, recipe.width, recipe.thickness


def element_sizes(recipe: MeshRecipe) -> tuple[float, ...]:
    """Sides (m) of the elements of a box or a beam, away from notches; () for others."""
    if not isinstance(recipe, BoxMesh | BeamMesh):
        return ()
    size = extent(recipe)
    assert size is not None
    return tuple(side / count for side, count in zip(size, recipe.divisions, strict=True))
