"""The programs of a frame that come after the first ones: compiled while those work.

A test holds this list against what frames ask for.
"""

from __future__ import annotations

from gpusim.gpu.programs import Key, kernel_key
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shadow.receivers import lens_constants

__all__ = ["frame_programs"]


def frame_programs(setup: Setup, shadowed: bool, plate_border: bool) -> list[Key]:
    """What the edge pixels of a view and, with ``shadowed``, its shadows ask for, the slowest to
    compile first."""
    glossy, bumpy = bool(setup.shiny.any()), bool(setup.bumpy.any())
    resolve, result = "optics/edge_pixels/resolve", []
    constants = setup.constants(setup.groups_present(), glossy, bumpy)
    if shadowed:
        result.append(kernel_key(resolve, "main", {**constants, "listing": 1.0}))
        result += [*_shadow_programs(setup), kernel_key(resolve, "light_pieces", constants)]
        relit = setup.light_constants(glossy, bumpy) | {"scaled": float(not glossy)}
        entries = ("main", "list_tiles", "count_tiles")
        result += [kernel_key("optics/shading/relighting", entry, relit) for entry in entries]
    elif not plate_border:
        result.append(kernel_key(resolve, "main", constants))
    return result


def _shadow_programs(setup: Setup) -> list[Key]:
    both = lens_constants(setup.view.camera)
    pixels, pieces = {**both, "listed": 0.0}, {**both, "listed": 1.0}
    search, groups = "optics/shadow/occluder_search", "optics/shadow/receiver_groups"
    refit = "optics/shadow/bvh_refit"
    mask, refinement = "optics/shadow/penumbra_mask", "optics/shadow/occluder_refinement"
    programs = [
        *((refit, entry, {}) for entry in ("gather", "leaves", "levels")),
        (mask, "mixed", both), (mask, "main", both), (refinement, "sift", both),
        (refinement, "main", both), (groups, "find_cells", pixels), (groups, "find_cells", pieces),
        (groups, "find_groups", pixels), (groups, "find_groups", pieces),
        (search, "coarse_tiles", pixels), (search, "tiles_of_pixels", pixels),
        (search, "listed_groups", pieces), (mask, "plain", both),
        *((search, f"count_{what}", both) for what in ("sifted", "refined", "penumbra", "mixed")),
    ]  # fmt: skip
    return [kernel_key(*program) for program in programs]
