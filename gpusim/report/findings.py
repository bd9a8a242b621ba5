"""Parts of a report: a body's mesh, forces and stress, errors beside others' and by effect."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class BodyForce:
    """A force (N) on a body: of the support ``name``, or of all its loads together."""

    body: str
    name: str
    force: Triple


@dataclass(frozen=True)
class StressPeak:
    """The greatest von Mises stress (Pa) of a body, and the node where it is (m).

    ``error_relative`` estimates the stress error of the whole body (Zienkiewicz-Zhu, energy norm);
    at a re-entrant corner or a point load the peak grows without bound as the mesh gets finer.
    """

    body: str
    von_mises: float
    position: Triple
    error_relative: float


@dataclass(frozen=True)
class FieldPicture:
    """A picture of the bodies in the colours of a ``field`` (its name, and a ``title`` for people)
    in ``frame``, displacements ``factor`` times as large: ``file``, in the output folder.

    ``largest``: the value, in ``unit``, that is the farthest from zero; it is of ``body``, at
    ``position_mm`` of the undeformed body. ``shown``: what the frame shows, where pictures are of
    several frames.
    """

    field: str
    title: str
    unit: str
    largest: float
    body: str
    position_mm: Triple
    frame: int
    factor: float
    file: str
    shown: str = ""


@dataclass(frozen=True)
class LoadStepRow:
    """An equilibrium of a ``body`` at large displacements, in ``frame``, and what Newton's method
    took: ``iterations``, those of the linear solver in them, in how many ``substeps``.

    ``moved_mm``: greatest displacement, ``linear_mm``: by linear theory; ``error_estimate``:
    relative, of the greatest displacement; ``stored_J``: energy in the material, ``work_J``: of
    loads and supports from frame to frame (trapezoidal rule).
    """

    body: str
    frame: int
    factor: float
    moved_mm: float
    linear_mm: float
    iterations: int
    solver_iterations: int
    substeps: int
    error_estimate: float
    stored_J: float
    work_J: float


@dataclass(frozen=True)
class LoadPath:
    """How the node of ``body`` that moves most, at ``position_mm``, goes with the load: in each of
    ``frames`` the load ``factors`` (what they are: ``word``), its ``displacement_mm`` along the way
    that it moves, and the resultant ``reaction_N`` in the body's supports, or that of the
    ``support`` which moves it; ``linear_mm``, ``linear_N``: by linear theory, of a body that isn't
    solved by it."""

    body: str
    position_mm: Triple
    word: str
    frames: tuple[int, ...]
    factors: tuple[float, ...]
    displacement_mm: tuple[float, ...]
    reaction_N: tuple[float, ...]
    linear_mm: tuple[float, ...] = ()
    linear_N: tuple[float, ...] = ()
    support: str = ""

    @property
    def held(self) -> bool:
        """Whether the supports take a force, beyond what is rounded off."""
        return max(map(abs, self.reaction_N), default=0.0) > _NO_FORCE

    @property
    def stiffness(self) -> float:
        """N/mm, in the last frame in which it has moved; NaN where there is none."""
        rows = zip(self.displacement_mm, self.reaction_N, strict=True)
        moved = [(u, force) for u, force in rows if u != 0.0]
        return moved[-1][1] / moved[-1][0] if moved and self.held else math.nan


_NO_FORCE = 1e-6
"""N."""


@dataclass(frozen=True)
class Mechanics:
    """Forces and stress in ``frame``; ``energy_balance`` compares work and strain energy.

    ``stresses`` is empty where the scene doesn't ask for stress, ``load_steps`` where all bodies
    are solved by linear theory.
    """

    frame: int
    energy_balance: float
    reactions: tuple[BodyForce, ...] = ()
    loads: tuple[BodyForce, ...] = ()
    stresses: tuple[StressPeak, ...] = ()
    load_steps: tuple[LoadStepRow, ...] = ()

    def content(self) -> dict[str, Any]:
        """For report.json."""
        steps = {"load_steps": [asdict(one) for one in self.load_steps]} if self.load_steps else {}
        content = {
            "frame": self.frame,
            "energy_balance": self.energy_balance,
            "reactions": [
                {"body": f.body, "support": f.name, "force_N": f.force} for f in self.reactions
            ],
            "loads": [{"body": f.body, "force_N": f.force} for f in self.loads],
            "stress": [
                {
                    "body": peak.body,
                    "von_mises_Pa": peak.von_mises,
                    "position_m": peak.position,
                    "error_relative": peak.error_relative,
                }
                for peak in self.stresses
            ],
        }
        return content | steps


@dataclass(frozen=True)
class MeshSummary:
    """Counts and quality of a body's mesh.

    ``cells`` is cell type -> number. ``least_jacobian`` is the least scaled Jacobian (1 for a
    brick, <= 0 inverted), ``greatest_aspect`` the greatest ratio of a cell's edges. ``bad_cells``
    are the numbers of the worst cells outside the usual limits, ``bad_count`` how many there are,
    and ``remark`` says it all in one line.
    """

    body: str
    nodes: int
    cells: Mapping[str, int]
    least_jacobian: float
    greatest_aspect: float
    bad_count: int
    bad_cells: tuple[int, ...]
    remark: str
    extent: float = 0.0
    """Diagonal of the box around the nodes, m."""

    def content(self) -> dict[str, Any]:
        """For report.json."""
        return {
            "body": self.body,
            "nodes": self.nodes,
            "cells": self.cells,
            "least_scaled_jacobian": self.least_jacobian,
            "greatest_aspect": self.greatest_aspect,
            "bad_cells": {"count": self.bad_count, "worst": self.bad_cells},
            "remark": self.remark,
        }


@dataclass(frozen=True)
class Published:
    """The relative error (1) of ``name`` in this run beside one from ``source``."""

    name: str
    error_relative: float
    published_relative: float
    source: str

    @property
    def better(self) -> bool:
        """Whether this run's error is the smaller one; not if it wasn't measured."""
        return abs(self.error_relative) <= self.published_relative


@dataclass(frozen=True)
class BudgetRow:
    """Errors of one state of the images, in the order of the budget's quantities.

    ``state``: "all" effects, "none" of them, "only" the one of the name ``source``, or all but it
    ("no"). NaN where a quantity wasn't measured.
    """

    state: Literal["all", "none", "only", "no"]
    source: str
    errors: tuple[float, ...]


@dataclass(frozen=True)
class Budget:
    """What each effect adds to the measured errors.

    ``quantities``: name and unit of each error. Differences between rows are exact: each state is
    rendered and measured anew, with the same seeds. ``remarks``: what no state is without.
    """

    quantities: tuple[tuple[str, str], ...]
    rows: tuple[BudgetRow, ...]
    remarks: tuple[str, ...] = ()

    @property
    def sources(self) -> tuple[str, ...]:
        """The effects, in the order of their rows."""
        return tuple(row.source for row in self.rows if row.state == "only")

    def row(self, state: str, source: str = "") -> BudgetRow:
        """The row of a state. Raises KeyError."""
        for row in self.rows:
            if (row.state, row.source) == (state, source):
                return row
        raise KeyError(f"{state} {source}")

    def added(self, source: str) -> tuple[float, ...]:
        """How much each error grows if this effect alone is added to perfect images."""
        return _differences(self.row("only", source).errors, self.row("none").errors)

    def removed(self, source: str) -> tuple[float, ...]:
        """How much each error falls if this effect alone is taken away."""
        return _differences(self.row("all").errors, self.row("no", source).errors)

    def content(self) -> dict[str, Any]:
        """For report.json."""
        quantities = [{"name": name, "unit": unit} for name, unit in self.quantities]
        return {"quantities": quantities, "rows": self.rows, "remarks": self.remarks}


@dataclass(frozen=True)
class PartSize:
    """RMS of a part of an error, also in percent of that of the whole, and its share of the whole:
    the part's projection on it, so that shares add up."""

    rms: float
    rms_percent: float
    share_percent: float

    @property
    def share(self) -> str:
        """The share as a reader sees it; nothing where there is no error to have a share of."""
        return f"{self.share_percent:z.1f} %" if math.isfinite(self.share_percent) else ""


@dataclass(frozen=True)
class Explanation:
    """What the error of a measured field is made of, in a ``frame``.

    ``units``: of the RMS, by kinds of quantities ("displacements", and "strains" if there are any).
    ``parts``: by their names and by kinds; then "missing", what the parts don't add up to, and
    "measured less true", the error. ``remarks``: what it says in words; ``figures``: maps, to be
    drawn.
    """

    measure: str
    frame: int
    units: Mapping[str, str]
    parts: Mapping[str, Mapping[str, PartSize]]
    remarks: tuple[str, ...] = ()
    figures: tuple[Any, ...] = field(default=(), repr=False)

    def content(self) -> dict[str, Any]:
        """For report.json."""
        return {key: value for key, value in vars(self).items() if key != "figures"}


def _differences(one: Sequence[float], other: Sequence[float]) -> tuple[float, ...]:
    pairs = zip(one, other, strict=True)
    return tuple(a - b if math.isfinite(a) and math.isfinite(b) else math.nan for a, b in pairs)
