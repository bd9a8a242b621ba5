"""What stands in front of the cameras, where it is in each frame, and the bodies' solution."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int
from gpusim.graph.runner import Inputs
from gpusim.motion import Motion
from gpusim.pipeline.build.surfaces import BodyParts, MeshedBody, posed
from gpusim.report import SolutionSummary
from gpusim.scene import Scene
from gpusim.scene.frames import Shown
from gpusim.surface import Surface

if TYPE_CHECKING:
    from gpusim.fem import Model, Solution

_ARRAYS = ("u", "reactions", "applied")


@dataclass(frozen=True, eq=False)
class SceneSolution:
    """Displacements per body, (L, N, 3) float64 m, L its load groups, and how the solves ended.

    ``reactions``: per body (L, S, 3) the force of each support (N), ``applied``: (L, 3) the sum of
    the loads.
    """

    u: tuple[Float, ...]
    reactions: tuple[Float, ...]
    applied: tuple[Float, ...]
    unknowns: int
    iterations: int
    converged: bool
    error_estimate: float
    residuals: tuple[float, ...]
    facts: dict[str, str]
    energy_balance: float
    warnings: tuple[str, ...]

    @staticmethod
    def of(
        solutions: Sequence[Solution], models: Sequence[Model], held: Sequence[Int]
    ) -> SceneSolution:
        """Bodies in order; the summary adds unknowns and takes the worst of the rest.

        ``held`` (N, 3) per body is the number of the support that holds a degree of freedom.
        """
        worst = max(solutions, key=lambda s: s.iterations)
        balance = max(s.energy_balance for s in solutions)
        facts = {
            "method": worst.method,
            "choices of the solver": "; ".join(worst.reasons),
            "solver arithmetic": worst.real,
            "distinct element matrices": str(sum(s.element_classes for s in solutions)),
            "energy balance": f"{balance:.1e}",
        }
        return SceneSolution(
            tuple(_cases(s.u) for s in solutions),
            tuple(_sums(s, own) for s, own in zip(solutions, held, strict=True)),
            tuple(model.load_cases.sum(axis=1) for model in models),
            sum(s.unknowns for s in solutions),
            worst.iterations,
            all(s.converged for s in solutions),
            max(s.error_estimate for s in solutions),
            tuple(float(r) for r in worst.residuals[:, 0]) if worst.residuals.size else (),
            facts,
            balance,
            tuple(dict.fromkeys(text for s in solutions for text in s.warnings)),
        )

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """What ``np.savez`` keeps: ``u<body>`` and the like, and a JSON summary."""
        summary = {
            "unknowns": self.unknowns,
            "iterations": self.iterations,
            "converged": self.converged,
            "error_estimate": self.error_estimate,
            "residuals": self.residuals,
            "facts": self.facts,
            "energy_balance": self.energy_balance,
            "warnings": self.warnings,
            "bodies": len(self.u),
        }
        arrays: dict[str, npt.NDArray[Any]] = {}
        for name in _ARRAYS:
            arrays |= {f"{name}{i}": array for i, array in enumerate(getattr(self, name))}
        return {**arrays, "summary": np.array(json.dumps(summary))}

    @staticmethod
    def from_arrays(arrays: Mapping[str, npt.NDArray[Any]]) -> SceneSolution:
        """The inverse of `arrays`. Raises KeyError, TypeError or ValueError for damage."""
        summary = json.loads(str(arrays["summary"]))
        count = summary.pop("bodies")
        for name in ("residuals", "warnings"):
            summary[name] = tuple(summary[name])
        for name in _ARRAYS:
            summary[name] = tuple(arrays[f"{name}{i}"] for i in range(count))
        return SceneSolution(**summary)

    def said(self) -> dict[str, Any]:
        """What a report says of it, as plain data."""
        return {
            "summary": asdict(self.summary()),
            "residuals": self.residuals,
            "energy_balance": self.energy_balance,
            "reactions": [values.tolist() for values in self.reactions],
            "applied": [values.tolist() for values in self.applied],
        }

    def summary(self) -> SolutionSummary:
        """How the solve ended, for the report."""
        return SolutionSummary(
            self.unknowns,
            self.iterations,
            self.converged,
            self.error_estimate,
            self.facts["method"],
        )

    def check(self, groups: Sequence[int], nodes: Sequence[int] | None) -> None:
        """Raises ValueError if this isn't of bodies with so many load groups and ``nodes`` (None:
        not known)."""
        if len(self.u) != len(groups):
            raise ValueError(f"{len(self.u)} bodies, expected {len(groups)}")
        for i, cases in enumerate(groups):
            u, reactions, applied = self.u[i], self.reactions[i], self.applied[i]
            wanted = (cases, u.shape[1] if nodes is None and u.ndim == 3 else (nodes or [0])[i], 3)
            if u.shape != wanted:
                raise ValueError(f"displacements of shape {u.shape}, expected {wanted}")
            if reactions.ndim != 3 or reactions.shape[::2] != (cases, 3):
                raise ValueError(f"reactions of shape {reactions.shape}")
            if applied.shape != (cases, 3):
                raise ValueError(f"loads of shape {applied.shape}")
            for values in (u, reactions, applied):
                if values.dtype != np.float64 or not np.isfinite(values).all():
                    raise ValueError("values that are no finite float64")


def solver_seconds(solutions: Sequence[Solution]) -> dict[str, str]:
    """How long the parts of the longest solve took, for the report of the run that solved."""
    worst = max(solutions, key=lambda s: s.iterations)
    return {f"solver: {part}": f"{seconds:.2f} s" for part, seconds in worst.timings.items()}


def _cases(values: Float) -> Float:
    """(L,N,3), also for one load case."""
    return values if values.ndim == 3 else values[None]


def _sums(solution: Solution, held: Int) -> Float:
    """(L,S,3) reactions added up over the degrees of freedom of each support.

    S ends with the last support that holds something.
    """
    reactions = _cases(solution.reactions)
    count = int(held.max()) + 1
    sums = np.zeros((len(reactions), count, 3))
    for axis in range(3):
        mine = held[:, axis] >= 0
        for case, values in enumerate(reactions):
            sums[case, :, axis] = np.bincount(held[mine, axis], values[mine, axis], minlength=count)
    return sums


@dataclass
class MovingBodies:
    """Bodies as they were meshed, and how they move. ``frames``: what stands where. ``motions``: of
    the bodies, None where there is none (yet)."""

    scene: Scene
    frames: Sequence[Shown]
    bodies: Sequence[MeshedBody] = ()
    motions: Sequence[Motion | None] = ()

    def displacement(self, body: int, frame: int | None) -> Float:
        """Nodal displacements (N, 3) m of a body in a frame; None: unloaded."""
        state = None if frame is None else self.frames[frame].states[body]
        motion = self.motions[body] if self.motions else None
        if state is None or motion is None:
            return np.zeros((self.bodies[body].mesh.node_count, 3))
        return motion.displacement(state)


@dataclass
class SceneObjects(MovingBodies):
    """Bodies and props as they were built, and where they are in each frame. ``board``: a prop
    that no frame shows."""

    bodies: Sequence[BodyParts] = ()
    props: Sequence[Surface] = ()
    board: str = ""

    def surfaces(self, frame: int | None) -> list[Surface]:
        """Every surface in a frame, bodies first; for None unloaded, and props as they stand."""
        bodies = []
        for number, parts in enumerate(self.bodies):
            moves = frame is not None and self.frames[frame].states[number] is not None
            bodies.append(
                parts.skin.moved(parts.surface, self.displacement(number, frame))
                if moves else parts.surface
            )  # fmt: skip
        places = None if frame is None else self.frames[frame].places
        props = [
            posed(surface, prop, None if places is None else places[number])
            for number, (prop, surface) in enumerate(zip(self.scene.props, self.props, strict=True))
            if prop.name != self.board
        ]
        return bodies + props


def scene_objects(scene: Scene, inputs: Inputs, frames: Sequence[Shown]) -> SceneObjects:
    """What a stage was given of bodies, props and motions; ``scene`` names the bodies."""
    bodies = [replace(inputs[f"surface/{body.name}"], body=body) for body in scene.bodies]
    return SceneObjects(scene, frames, bodies, _motions(scene, inputs), inputs.get("props") or ())


def moving_bodies(scene: Scene, inputs: Inputs, frames: Sequence[Shown]) -> MovingBodies:
    """The same of bodies alone, without their surfaces."""
    bodies = [replace(inputs[f"mesh/{body.name}"], body=body) for body in scene.bodies]
    return MovingBodies(scene, frames, bodies, _motions(scene, inputs))


def _motions(scene: Scene, inputs: Inputs) -> list[Motion | None]:
    return [inputs.get(f"motion/{body.name}") for body in scene.bodies]
