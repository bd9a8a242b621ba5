"""Bodies of a scene solved, and their stress by frame: recovered, kept in the output folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZipFile

import numpy as np
import numpy.typing as npt

from gpusim import fem
from gpusim.errors import InputError, NotConverged
from gpusim.files.atomic_files import atomic_stream
from gpusim.files.input_file import open_input
from gpusim.pipeline.build.modelling import temperature
from gpusim.pipeline.build.surfaces import BodyParts
from gpusim.plan.stages import RunOptions
from gpusim.report import StressPeak
from gpusim.scene.amplitudes import LoadHistory
from gpusim.scene.description import model as m

__all__ = ["Stresses", "solve_bodies", "write_stresses"]


def solve_bodies(
    solver: m.Solver,
    bodies: Sequence[BodyParts],
    models: Sequence[fem.Model],
    options: RunOptions,
    progress: Callable[[float, str], None],
) -> list[fem.Solution]:
    """Solve each body's model; ``progress`` is called with (done 0..1, text).

    Raises
    ------
    NotConverged
        Naming the body; and what `gpusim.fem.solve` raises.
    """
    solutions = []
    for parts, model in zip(bodies, models, strict=True):

        def note(iterations: int, estimate: float, name: str = parts.body.name) -> None:
            done = min(0.99, max(0.0, np.log(max(estimate, 1e-300)) / np.log(solver.tolerance)))
            progress(done, f"{name}: iteration {iterations}, {estimate:.1e}")

        solution = fem.solve(
            model,
            tolerance=solver.tolerance,
            formulation=parts.body.formulation,
            max_iterations=solver.max_iterations,
            method=solver.method,
            progress=note,
            **options.for_solver(),
        )
        if not solution.converged:
            raise NotConverged(
                f"solve, body {parts.body.name!r}: stopped after {solution.iterations} "
                f"iterations at an estimated displacement error of "
                f"{solution.error_estimate:.2e}; expected {solver.tolerance:.1e}: "
                f"{solution.message}"
            )
        solutions.append(solution)
    return solutions


Array = npt.NDArray[np.float64]


class Stresses:
    """Nodal stress (N, 6) Pa and the share of the error (M,) of each cell, from a file.

    A frame in which nothing has moved has none. See ``gpusim.fem.Stress`` for what they are.
    """

    def __init__(self, source: Path | BinaryIO) -> None:
        self._source = open_input(source) if isinstance(source, Path) else source
        try:
            self._stored = np.load(self._source, allow_pickle=False)  # arrays as they are needed
        except BaseException:
            self._source.close()
            raise
        try:
            rows = json.loads(str(self._stored["peaks"]))
            self.peaks = tuple(
                StressPeak(**{**row, "position": tuple(row["position"])}) for row in rows
            )
            """Of each body, in the last frame in which something has moved."""
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let go of the file; `peaks` stay."""
        self._stored.close()
        self._source.close()

    def fields(
        self, body: int, frame: int, parts: BodyParts
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Point data and cell data for ParaView; zero in a frame without."""
        nodal, share = f"stress{body}_{frame}", f"error{body}_{frame}"
        stress, error = np.zeros((parts.mesh.node_count, 6)), np.zeros(parts.mesh.cell_count)
        if nodal in self._stored:
            found, of_cells = self._stored[nodal], self._stored[share]
            if found.shape != stress.shape or of_cells.shape != error.shape:
                raise InputError(
                    f"stress of body {parts.body.name!r}: got shape {found.shape}; expected "
                    f"{stress.shape}: delete the output folder's solution/stress.npz"
                )
            stress, error = found, of_cells
        return {"stress": stress, "von_mises": fem.von_mises(stress)}, {"error_share": error}


def write_stresses(
    path: Path,
    bodies: Sequence[BodyParts],
    models: Sequence[fem.Model],
    history: LoadHistory,
    displacement: Callable[[int, int], Array],
    *,
    progress: Callable[[float, str], None],
) -> Stresses:
    """Recover the stress of every body in every frame that moves, and keep it.

    A body with one load group has the same stress in all frames, but for a factor.
    """
    frames = [frame for frame in range(history.frames) if not history.still(frame)]
    peaks = []
    with atomic_stream(path) as stream, ZipFile(stream, "w") as archive:
        for number, (parts, model) in enumerate(zip(bodies, models, strict=True)):
            recovery = _Recovery(number, parts, model, history, displacement)
            for step, frame in enumerate(frames):
                done = (number + step / len(frames)) / len(bodies)
                progress(done, f"{parts.body.name}: frame {frame}")
                found, factor = recovery.frame(frame)
                _store(archive, f"stress{number}_{frame}", factor * found.nodal)
                _store(archive, f"error{number}_{frame}", found.error_share)
            if frames:
                peaks.append(asdict(_peak(parts, found, factor)))
        _store(archive, "peaks", np.array(json.dumps(peaks)))
    return Stresses(path)


class _Recovery:
    """Stress of one body by frame, recovered again only where it isn't a multiple."""

    def __init__(
        self,
        number: int,
        parts: BodyParts,
        model: fem.Model,
        history: LoadHistory,
        displacement: Callable[[int, int], Array],
    ) -> None:
        self.number, self.parts, self.model = number, parts, model
        self.history, self.displacement = history, displacement
        self._last: tuple[float, fem.Stress] | None = None

    def frame(self, frame: int) -> tuple[fem.Stress, float]:
        """A stress, and the factor with which this frame has it."""
        weights = self.history.weights(frame)[self.number]
        if self._last is not None and len(weights) == 1 and self.history.scaled:
            return self._last[1], weights[0] / self._last[0]
        body = self.parts.body
        change = temperature(body, frame)
        found = fem.stress(
            self.model,
            self.displacement(self.number, frame),
            body.formulation,
            temperature=change if change else None,
        )
        if weights[0]:
            self._last = weights[0], found
        return found, 1.0


def _peak(parts: BodyParts, found: fem.Stress, factor: float) -> StressPeak:
    node = int(np.argmax(found.von_mises))
    x, y, z = parts.mesh.points[node].tolist()
    most = abs(factor) * float(found.von_mises[node])
    return StressPeak(parts.body.name, most, (x, y, z), found.error_relative)


def _store(archive: ZipFile, name: str, values: npt.NDArray[Any]) -> None:
    """One array of an .npz file, written as soon as it is there."""
    with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
        np.lib.format.write_array(entry, values, allow_pickle=False)
