"""The steps of an input deck solved, written and reported."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
import numpy.typing as npt

from gpusim._version import __version__
from gpusim.applications.deck_results import arrays, nodal_fields, summary
from gpusim.arrays.array_types import Float
from gpusim.deck import Deck, Step, load_deck
from gpusim.deck.procedures import MASS, Static
from gpusim.deck.step import Result
from gpusim.errors import GpusimError
from gpusim.export import atomic_stream, write_pvd, write_vtu
from gpusim.fem import Solution, von_mises
from gpusim.field_summary import field_summary
from gpusim.files.atomic_files import PathLike, write_text
from gpusim.files.output_folder import claim, delete, inside

_SCHEMA = 1
_OF_SOLUTIONS = ("u", "reactions")


@dataclass(frozen=True)
class DeckOutput:
    """The results of a deck's steps, and the files that were written.

    Attributes
    ----------
    deck : as it was read.
    solutions : the result of each step, see `gpusim.deck.Deck.solve`.
    report : what report.json holds.
    files : the VTU of each step, solution.pvd, displacements.npz, further arrays, report.json.
    failure : which step didn't converge, and why; "" if all did.

    Examples
    --------
    >>> done = gs.applications.solve_deck("bricks.inp", "solved", backend="numpy")
    >>> [step["converged"] for step in done.report["steps"]], done.failure
    ([True], '')
    """

    deck: Deck
    solutions: Sequence[Result]
    report: dict[str, Any]
    files: Sequence[Path]
    failure: str
    __repr__ = field_summary


def solve_deck(
    path: PathLike,
    output: PathLike,
    *,
    backend: str = "auto",
    tolerance: float = 1e-6,
    stress: bool = False,
    progress: Callable[[str, float, str], None] | None = None,
) -> DeckOutput:
    """Solve the steps of an input deck; write displacements and reactions.

    Written are ``solution_<step>.vtu`` (displacement ``u``, ``reaction``, ``temperature_change``
    where there is one; with ``stress`` the mean ``stress`` of each element over its
    integration points, xx yy zz xy yz zx, and its ``von_mises``; of a nonlinear step what
    `gpusim.fem.Stress.results` has), ``solution.pvd``,
    ``displacements.npz`` (``node_labels`` (N,), ``points`` (N,3), ``u`` and ``reactions``
    (S,N,3) of the static steps) and ``report.json``, which also tells of an error. Units are those
    of the deck. Of other steps the VTU shows modes, the last state of a history, or the greatest
    response; ``step_<step>.npz`` has all there is.

    Parameters
    ----------
    path : an Abaqus or CalculiX deck.
    output : a folder, made if need be.
    backend, tolerance : as in ``fem.solve``.
    stress : write stresses, too.
    progress : called with ("solve", how much is done 0..1, a text).

    Raises
    ------
    InputError
        As ``load_deck`` and ``Deck.solve``. A step that doesn't converge is told in the output.

    Examples
    --------
    >>> done = gs.applications.solve_deck("bricks.inp", "out", backend="numpy")
    >>> [file.name for file in done.files][:2], done.solutions[0].u.shape
    (['solution_0001.vtu', 'solution.pvd'], (12, 3))
    """
    with claim(output):
        start, folder, path = time.perf_counter(), Path(output), Path(path)
        report: dict[str, Any] = {"schema": _SCHEMA, "version": __version__, "deck": str(path)}
        try:
            deck = load_deck(path)
            read = time.perf_counter() - start
            report |= _described(deck) | {"seconds": {"read": read}}
            solutions = _solve_steps(deck, backend, tolerance, progress)
        except GpusimError as error:
            _write_report(folder, report | {"status": "failed", "error": str(error)})
            raise
        stresses = [
            deck.point_stress(step.number, one) if stress and _reached(one, deck) else {}
            for step, one in zip(deck.steps, solutions, strict=True)
        ]
        files = _write_solutions(deck, solutions, stresses, folder)
        report["seconds"]["total"] = time.perf_counter() - start
        rows = zip(deck.steps, solutions, files, stresses, strict=False)
        report["steps"] = [
            _of_step(deck, step, result) | {"file": file.name} | _greatest_stress(deck, stress)
            for step, result, file, stress in rows
        ]
        texts = (text for one in solutions for text in getattr(one, "warnings", ()))
        report["warnings"] = list(dict.fromkeys(texts))
        failed = (step for step in report["steps"] if not step["converged"])
        failure = next(
            (
                f"{path}: step {step['number']}: {step['message']}; estimated error "
                f"{step['error_estimate']:.2g}; expected {tolerance:g}"
                for step in failed
            ),
            "",
        )
        report["status"] = "not converged" if failure else "ok"
        files.append(_write_report(folder, report))
        return DeckOutput(deck, solutions, report, files, failure)


def _reached(result: Result, deck: Deck) -> TypeGuard[Solution]:
    """Whether it is of statics, and the analysis came to the end of its step."""
    if not isinstance(result, Solution):
        return False
    found = result.steps
    return not deck.nonlinear or bool(found and found[-1].stress is not None)


def _solve_steps(
    deck: Deck,
    backend: str,
    tolerance: float,
    progress: Callable[[str, float, str], None] | None,
) -> tuple[Result, ...]:
    equilibria = 0

    def note(iterations: int, error: float) -> None:
        nonlocal equilibria
        if progress is None:
            return
        if deck.nonlinear:
            # steps that fail are made anew, halved: the number of equilibria isn't known
            equilibria += iterations == 1
            static = (step for step in deck.steps if isinstance(step.procedure, Static))
            wanted = sum(len(step.increments) for step in static)
            text = f"equilibrium {equilibria} of {wanted} or more, iteration {iterations}, "
            progress("solve", min(0.99, (equilibria - 1) / wanted), f"{text}{error:.1e}")
        else:
            # half a decade of error is worth as much as the next one
            done = np.log(max(error, 1e-300)) / np.log(tolerance) if error < 1.0 else 0.0
            progress("solve", min(float(done), 0.99), f"{iterations} iterations, {error:.1e}")

    solutions = deck.solve(backend=backend, tolerance=tolerance, progress=note)
    if progress is not None:
        errors = [one.error_estimate for one in solutions if isinstance(one, Solution)]
        told = f", estimated error {max(errors):.1e}" if errors else ""
        progress("solve", 1.0, f"{len(solutions)} steps{told}")
    return solutions


def _described(deck: Deck) -> dict[str, Any]:
    return {
        "nodes": deck.mesh.node_count,
        "cells": {kind: len(block) for kind, block in deck.mesh.cells.items()},
        "formulation": dict(deck.formulation),
        "materials": len(deck.materials),
        "ignored": list(deck.ignored),
        # of steps that aren't static
        "mass_rule": MASS,
    }


def _write_solutions(
    deck: Deck,
    results: Sequence[Result],
    stresses: Sequence[Mapping[str, Float]],
    folder: Path,
) -> list[Path]:
    names = [f"solution_{step.number:04d}.vtu" for step in deck.steps]
    # what an earlier deck left here must not be taken for results of this one
    earlier = (file.name for file in folder.glob("solution_[0-9]*.vtu"))
    stale = [file for file in earlier if file not in names]
    stale += [file.name for file in folder.glob("step_[0-9]*.npz")]
    for file in ("report.json", *stale):
        delete(folder, file)
    for step, result, stress, name in zip(deck.steps, results, stresses, names, strict=True):
        fields: dict[str, npt.NDArray[np.generic]] = (
            {"u": result.u, "reaction": result.reactions}
            if isinstance(result, Solution)
            else nodal_fields(result)
        )
        fields["node_label"] = deck.node_labels
        if step.temperature is not None:
            fields["temperature_change"] = step.temperature
        of_cell: dict[str, npt.NDArray[np.generic]] = {
            "element_label": deck.cell_labels,
            "material": deck.material_of_cell,
        }
        if stress:
            mean = np.concatenate([points.mean(axis=1) for points in stress.values()])
            of_cell |= {"stress": mean, "von_mises": von_mises(mean)}
            recovered = (
                result.steps[-1].stress if isinstance(result, Solution) and result.steps else None
            )
            if recovered is not None:
                fields |= recovered.nodal_results
        write_vtu(
            inside(folder, name),
            deck.mesh.points,
            deck.mesh.cells,
            point_data=fields,
            cell_data=of_cell,
        )
    solutions = [one for one in results if isinstance(one, Solution)]
    files = [inside(folder, name) for name in (*names, "solution.pvd")]
    steps = [(float(step.number), path) for step, path in zip(deck.steps, files, strict=False)]
    write_pvd(files[-1], steps)
    kept = {f"step_{k:04d}.npz": arrays(one) for k, one in enumerate(results, 1)}
    if solutions:
        both: dict[str, Any] = {
            name: np.stack([getattr(one, name) for one in solutions]) for name in _OF_SOLUTIONS
        }
        kept = {"displacements.npz": both, **kept}
    for name, values in kept.items():
        if values:
            files.append(inside(folder, name))
            with atomic_stream(files[-1]) as stream:
                np.savez_compressed(
                    stream, node_labels=deck.node_labels, points=deck.mesh.points, **values
                )
    return files


def _of_step(deck: Deck, step: Step, result: Result) -> dict[str, Any]:
    found = (
        _step_report(deck, step, result) if isinstance(result, Solution) else summary(result, deck)
    )
    return {"number": step.number, "name": step.name, "time": step.time} | found


def _step_report(deck: Deck, step: Step, solution: Solution) -> dict[str, Any]:
    size, stored = np.linalg.norm(solution.u, axis=1), float(solution.strain_energy[0])
    return {
        "kind": "static",
        "unknowns": solution.unknowns,
        "iterations": solution.iterations,
        "load_steps": len(solution.steps),
        "newton_iterations": sum(len(one.iterations) for one in solution.steps),
        "converged": solution.converged,
        "error_estimate": solution.error_estimate,
        "message": solution.message,
        "largest_displacement": float(size.max()),
        "largest_displacement_node": int(deck.node_labels[np.argmax(size)]),
        "force": step.forces_at(deck.mesh.points + solution.u).sum(axis=0).tolist(),
        "reaction": solution.reactions.sum(axis=0).tolist(),
        "strain_energy": stored if np.isfinite(stored) else None,
        "external_work": float(solution.external_work[0]),
        "energy_balance": solution.energy_balance if np.isfinite(stored) else None,
        "seconds": sum(solution.timings.values()),
        "backend": solution.backend,
        "method": solution.method,
    }


def _greatest_stress(deck: Deck, stress: Mapping[str, Float]) -> dict[str, Any]:
    if not stress:
        return {}
    greatest = np.concatenate([von_mises(points).max(axis=1) for points in stress.values()])
    return {
        "largest_von_mises": float(greatest.max()),
        "largest_von_mises_element": int(deck.cell_labels[np.argmax(greatest)]),
    }


def _write_report(folder: Path, report: dict[str, Any]) -> Path:
    return write_text(inside(folder, "report.json"), json.dumps(report, indent=2) + "\n")
