"""The displacements of one model, or of the one body of a scene: ``gs.solve``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gpusim import fem
from gpusim.gpu import Device
from gpusim.validation import require

if TYPE_CHECKING:
    from gpusim.scene import Scene


def solve(problem: fem.Model | Scene, device: Device | None = None, **options: Any) -> fem.Solution:
    """Solve K u = F for a `Model`, or for the one body of a `Scene` at load factor 1.

    Loads of a scene whose amplitudes aren't multiples of each other are separate load cases. A
    scene whose geometry is "nonlinear", or whose material needs that, has its frames as load
    ``steps``; one whose geometry is "auto" is solved by linear theory (its run looks further).

    ``options`` are those of `gpusim.fem.solve` (``tolerance``, ``geometry``, ``factors``,
    ``formulation``, ``backend``, ``max_iterations``, ``method``, ``start``, ``progress``); a scene
    brings its own, which they override.

    Raises
    ------
    InputError
        Neither a model nor a scene, or a scene without exactly one body; and what
        `gpusim.fem.solve` raises.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(4, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> forces = gs.fem.face_force(bar, gs.mesh.select_faces(bar, name="x_max"), total=(1e4, 0, 0))
    >>> solution = gs.solve(gs.Model(bar, [gs.Isotropic(210e9, 0.0)], fixed=fixed, forces=forces))
    >>> print(f"{1e6 * solution.u[:, 0].max():.3f} micrometres")
    4.762 micrometres
    """
    if isinstance(problem, fem.Model):
        return fem.solve(problem, device, **options)
    # a model needs none of what reads scenes: half of the package
    from gpusim.pipeline.scene_objects.modelling import build_model
    from gpusim.pipeline.scene_objects.surfaces import build_body
    from gpusim.scene import Scene
    from gpusim.scene.amplitudes import load_groups
    from gpusim.scene.frames import frame_table

    if not isinstance(problem, Scene):
        return fem.solve(problem, device, **options)  # which says what is wrong
    what, count = f"solve: scene {problem.name!r}", len(problem.bodies)
    require(count == 1, what, f"{count} bodies", "one (run the scene, or solve a Model per body)")
    body = problem.bodies[0]
    defaults = {**dict(problem.solver), "formulation": body.formulation}
    groups = load_groups(body, problem.analysis.load_factors)
    built = build_model(build_body(body, problem.input), groups)
    model = built.model
    if body.large_displacements(getattr(problem.analysis, "geometry", "auto")):
        states = [one.shown.states[0] for one in frame_table(problem)]
        steps = dict.fromkeys(state for state in states if state is not None)
        factors = [state[: len(groups)] for state in steps]
        defaults |= {"geometry": "nonlinear", "factors": factors}
        model = built.displaced
    return fem.solve(model, device, **{**defaults, **options})
