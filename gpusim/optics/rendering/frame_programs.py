"""The programs of a frame that come after the first ones: compiled while those work.

A test holds this list against what frames ask for.
"""

from __future__ import annotations

from gpusim.gpu.programs import Key, program_key
from gpusim.optics.rendering.frame_plan import FramePlan
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shadow.receivers import lens_constants


def frame_programs(setup: Setup, plan: FramePlan) -> list[Key]:
    """What the edge pixels of a view and its shadows ask for: the slowest to compile, then the
    others in the order in which they run."""
    glossy, bumpy = setup.programs.looks
    resolve = setup.programs.name("optics/edge_pixels/resolve")
    constants = setup.programs.constants(setup.traits.groups_present(), glossy, bumpy)
    if not plan.shadowed:
        return [] if plan.plate_border else [program_key(resolve, "main", constants)]
    both = lens_constants(setup.view.camera)
    pixels, pieces = {**both, "listed": 0.0}, {**both, "listed": 1.0}
    relit = {**setup.programs.light_constants(glossy, bumpy), "scaled": float(not glossy)}
    search, groups = "optics/shadow/occluder_search", "optics/shadow/receiver_groups"
    mask, refinement = "optics/shadow/penumbra_mask", "optics/shadow/occluder_refinement"
    programs: list[tuple[str, str, dict[str, float]]] = [
        (resolve, "main", {**constants, "listing": 1.0}),
        *(("optics/shadow/bvh_refit", entry, {}) for entry in ("gather", "leaves", "levels")),
        (groups, "find_cells", pieces),
        (groups, "find_groups", pieces),
        (search, "listed_groups", pieces),
        (refinement, "sift", both),
        (refinement, "main", both),
        (mask, "mixed", both),
        (mask, "main", both),
        (mask, "plain", both),
        *((search, f"count_{what}", both) for what in ("sifted", "refined", "ends", "mixed")),
        (resolve, "light_pieces", constants),
        (groups, "find_cells", pixels),
        (groups, "find_groups", pixels),
        (search, "coarse_tiles", pixels),
        (search, "tiles_of_pixels", pixels),
        *(
            (setup.programs.name("optics/shading/relighting"), entry, relit)
            for entry in ("main", "list_tiles")
        ),
        (setup.programs.name("optics/shading/relighting"), "count_tiles", relit),
    ]
    return [program_key(*program) for program in programs]
