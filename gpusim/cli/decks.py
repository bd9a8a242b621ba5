"""``gpusim solve``: the steps of an input deck solved, written and reported."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim._version import __version__
from gpusim.cli.console import Destination, out
from gpusim.deck import Deck, Step, load_deck
from gpusim.errors import GpusimError, NotConverged
from gpusim.export import atomic_stream, write_pvd, write_vtu
from gpusim.fem import Solution, von_mises
from gpusim.files.atomic_files import write_text
from gpusim.files.output_folder import delete, inside

__all__ = ["solve_deck"]

Float = npt.NDArray[np.float64]

_SCHEMA = 1


def solve_deck(
    path: Path, destination: Destination, backend: str, tolerance: float, with_stress: bool
) -> None:
    """Solve every step of ``path``; write ``folder``; print a table, or the report as JSON.

    Written are ``solution_<step>.vtu`` (displacement ``u``, ``reaction``, ``temperature_change``
    where there is one; with ``with_stress`` the mean ``stress`` of each element over its
    integration points, xx yy zz xy yz zx, and its ``von_mises``), ``solution.pvd``,
    ``displacements.npz`` (``node_labels`` (N,), ``points`` (N,3), ``u`` and ``reactions``
    (S,N,3)) and ``report.json``, which also tells of a failure.

    Raises InputError as ``load_deck``, NotConverged after everything has been written.
    """
    start, folder = time.perf_counter(), destination.folder
    report: dict[str, Any] = {"schema": _SCHEMA, "version": __version__, "deck": str(path)}
    try:
        deck = load_deck(path)
        read = time.perf_counter() - start
        report |= _described(deck) | {"seconds": {"read": read}}
        solutions = _solve_steps(deck, backend, tolerance, destination)
    except GpusimError as error:
        _write_report(folder, report | {"status": "failed", "error": str(error)})
        raise
    loose = [
        step.number for step, one in zip(deck.steps, solutions, strict=True) if not one.converged
    ]
    stresses = [
        deck.point_stress(step.number, one.u) if with_stress else {}
        for step, one in zip(deck.steps, solutions, strict=True)
    ]
    files = _write_solutions(deck, solutions, stresses, folder)
    report["seconds"]["total"] = time.perf_counter() - start
    report["steps"] = [
        _step_report(deck, step, solution, file) | _greatest_stress(deck, stress)
        for step, solution, file, stress in zip(deck.steps, solutions, files, stresses, strict=True)
    ]
    report["warnings"] = list(dict.fromkeys(text for one in solutions for text in one.warnings))
    report["status"] = "not converged" if loose else "ok"
    _write_report(folder, report)
    if destination.as_json:
        out(json.dumps(report, indent=2))
    elif not destination.quiet:
        _print(report, folder)
    if loose:
        first = solutions[loose[0] - 1]
        raise NotConverged(
            f"{path}: step {loose[0]}: {first.message}; estimated error "
            f"{first.error_estimate:.2g}; expected {tolerance:g}"
        )


def _solve_steps(
    deck: Deck, backend: str, tolerance: float, destination: Destination
) -> tuple[Solution, ...]:
    with destination.progress() as display:

        def progress(iterations: int, error: float) -> None:
            # half a decade of error is worth as much as the next one
            done = np.log(max(error, 1e-300)) / np.log(tolerance) if error < 1.0 else 0.0
            display("solve", min(float(done), 0.99), f"{iterations} iterations, {error:.1e}")

        solutions = deck.solve(backend=backend, tolerance=tolerance, progress=progress)
        worst = max(one.error_estimate for one in solutions)
        display("solve", 1.0, f"{len(solutions)} steps, estimated error {worst:.1e}")
    return solutions


def _described(deck: Deck) -> dict[str, Any]:
    return {
        "nodes": deck.mesh.node_count,
        "cells": {kind: len(block) for kind, block in deck.mesh.cells.items()},
        "formulation": dict(deck.formulation),
        "materials": len(deck.materials),
        "ignored": list(deck.ignored),
    }


def _write_solutions(
    deck: Deck,
    solutions: Sequence[Solution],
    stresses: Sequence[Mapping[str, Float]],
    folder: Path,
) -> list[str]:
    names = [f"solution_{step.number:04d}.vtu" for step in deck.steps]
    # what an earlier deck left here must not be taken for results of this one
    earlier = (file.name for file in folder.glob("solution_[0-9]*.vtu"))
    stale = [file for file in earlier if file not in names]
    for file in ("report.json", *stale):
        delete(folder, file)
    for step, solution, stress, name in zip(deck.steps, solutions, stresses, names, strict=True):
        fields: dict[str, npt.NDArray[np.generic]] = {
            "u": solution.u,
            "reaction": solution.reactions,
            "node_label": deck.node_labels,
        }
        if step.temperature is not None:
            fields["temperature_change"] = step.temperature
        of_cell: dict[str, npt.NDArray[np.generic]] = {
            "element_label": deck.cell_labels,
            "material": deck.material_of_cell,
        }
        if stress:
            mean = np.concatenate([points.mean(axis=1) for points in stress.values()])
            of_cell |= {"stress": mean, "von_mises": von_mises(mean)}
        write_vtu(
            inside(folder, name),
            deck.mesh.points,
            deck.mesh.cells,
            point_data=fields,
            cell_data=of_cell,
        )
    steps = [
        (float(step.number), inside(folder, name))
        for step, name in zip(deck.steps, names, strict=True)
    ]
    write_pvd(inside(folder, "solution.pvd"), steps)
    with atomic_stream(inside(folder, "displacements.npz")) as stream:
        np.savez_compressed(
            stream,
            node_labels=deck.node_labels,
            points=deck.mesh.points,
            u=np.stack([one.u for one in solutions]),
            reactions=np.stack([one.reactions for one in solutions]),
        )
    return names


def _step_report(deck: Deck, step: Step, solution: Solution, file: str) -> dict[str, Any]:
    size = np.linalg.norm(solution.u, axis=1)
    return {
        "number": step.number,
        "name": step.name,
        "time": step.time,
        "unknowns": solution.unknowns,
        "iterations": solution.iterations,
        "converged": solution.converged,
        "error_estimate": solution.error_estimate,
        "message": solution.message,
        "largest_displacement": float(size.max()),
        "largest_displacement_node": int(deck.node_labels[np.argmax(size)]),
        "force": step.forces.sum(axis=0).tolist(),
        "reaction": solution.reactions.sum(axis=0).tolist(),
        "strain_energy": float(solution.strain_energy[0]),
        "external_work": float(solution.external_work[0]),
        "energy_balance": solution.energy_balance,
        "seconds": sum(solution.timings.values()),
        "backend": solution.backend,
        "method": solution.method,
        "file": file,
    }


def _greatest_stress(deck: Deck, stress: Mapping[str, Float]) -> dict[str, Any]:
    if not stress:
        return {}
    greatest = np.concatenate([von_mises(points).max(axis=1) for points in stress.values()])
    return {
        "largest_von_mises": float(greatest.max()),
        "largest_von_mises_element": int(deck.cell_labels[np.argmax(greatest)]),
    }


def _write_report(folder: Path, report: dict[str, Any]) -> None:
    write_text(inside(folder, "report.json"), json.dumps(report, indent=2) + "\n")


def _print(report: dict[str, Any], folder: Path) -> None:
    cells = ", ".join(
        f"{count} {kind} ({report['formulation'][kind]})" for kind, count in report["cells"].items()
    )
    out(f"{report['deck']}: {report['nodes']} nodes, {cells}")
    out()
    out(
        f"{'step':<6}{'unknowns':>10}{'iterations':>12}{'error':>10}"
        f"{'largest u':>14}{'at node':>10}{'energy':>14}  reaction"
    )
    for step in report["steps"]:
        reaction = ", ".join(f"{value:.6g}" for value in step["reaction"])
        out(
            f"{step['number']:<6}{step['unknowns']:>10}{step['iterations']:>12}"
            f"{step['error_estimate']:>10.1e}{step['largest_displacement']:>14.6g}"
            f"{step['largest_displacement_node']:>10}{step['strain_energy']:>14.6g}  {reaction}"
        )
        if "largest_von_mises" in step:
            out(
                f"      largest von Mises stress {step['largest_von_mises']:.6g} in element "
                f"{step['largest_von_mises_element']}"
            )
    for warning in report["warnings"]:
        out(f"warning: {warning}")
    if report["ignored"]:
        out(f"read over: {', '.join(report['ignored'])}")
    out()
    out(f"Results: {folder / 'solution.pvd'}, {folder / 'displacements.npz'}")
