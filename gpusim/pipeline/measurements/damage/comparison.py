"""Deflection lines of several states compared: difference curves, and where their slope changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.files.atomic_files import safe_name
from gpusim.files.output_folder import inside
from gpusim.pipeline.measurements.deflection.result import DeflectionResult
from gpusim.pipeline.measurements.kinds import Kind, register
from gpusim.pipeline.measurements.results import PointTable, Reported, Result, csv_text, rms
from gpusim.report import Drawing, Link, Measurement
from gpusim.report.measurement_figures import StateCurve, draw_deflections, draw_differences
from gpusim.scene import Scene
from gpusim.scene.description import model as m

LEAST_POINTS = 8
_NONE = np.zeros(0)
NO_CHANGES = measure.SlopeChanges(
    _NONE, _NONE, _NONE, _NONE, _NONE, _NONE, _NONE, residual=np.nan, offset=np.nan, slope=np.nan
)
"""Of the reference, and of too few points."""
CURVE_POINTS = 400


@dataclass(frozen=True, eq=False)
class DamageLine:
    """One group of markers in one state, against the reference; (M,) along the member, mm.

    ``position_mm`` on the member's axis (x, y or z); ``deflection_mm`` across it, ``true_mm`` its
    truth; ``difference_mm``, ``true_difference_mm`` those less the reference's. ``notches_mm``:
    where the scene has notches that the reference doesn't have. ``found``: slope changes of the
    measured difference; ``true_found``: those of its truth, which no image has touched.
    """

    state: str
    group: str
    axis: str
    across: str
    position_mm: Float
    deflection_mm: Float
    true_mm: Float
    difference_mm: Float
    true_difference_mm: Float
    mm_per_px: float
    notches_mm: tuple[float, ...]
    found: measure.SlopeChanges
    true_found: measure.SlopeChanges

    @property
    def noise_px(self) -> float:
        """RMS of measured minus true difference, px."""
        return rms((self.difference_mm - self.true_difference_mm) / self.mm_per_px)

    @property
    def fitted_mm(self) -> Float:
        """The measured difference as the broken line that was fitted; NaN without one."""
        return self.found.at(self.position_mm)

    def nearest(self, notch_mm: float) -> tuple[float, float]:
        """Where the difference and its truth change their slope by a notch; NaN where they don't.

        A change belongs to the notch that is nearest to it.
        """
        found, true = (
            [at for at in changes.position if self.owner(at) == notch_mm]
            for changes in (self.found, self.true_found)
        )
        return _nearest(found, notch_mm), _nearest(true, notch_mm)

    def owner(self, position_mm: float) -> float:
        """The notch that a change of slope belongs to; NaN without any."""
        return _nearest(self.notches_mm, position_mm)


def _nearest(places: Sequence[float], to: float) -> float:
    return float(min(places, key=lambda place: abs(place - to), default=np.nan))


@dataclass(frozen=True, eq=False)
class DamageResult(Result):
    """All states of one comparison; the reference's lines have differences of zero. Points of the
    table are those of all lines, named by their state."""

    reference: str
    tolerance_mm: float
    lines: tuple[DamageLine, ...]

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        count = sum(len(line.found.position) for line in self.lines)
        return f"{count} changes of slope"

    def tables(self) -> dict[str, str]:
        """``.csv``: every point of every line; ``-breaks.csv``: changes of slope."""
        breaks = [row for line in self.lines for row in _breaks(line)]
        return {"": self.table.csv(), "-breaks": csv_text(_BREAKS, breaks)}

    def report(self, scene: Scene, out: Path) -> Reported:
        """Places of notches, noise, lines and differences."""
        links = [
            Link(label, inside(out, "measure", f"{safe_name(self.name)}{ending}.csv"))
            for label, ending in (
                ("Deflection and difference curves", ""), ("Changes of slope", "-breaks"),
            )
        ]  # fmt: skip
        figures = self._figures(inside(out, "figures"))
        return Reported(self._measurements(), figures=figures, links=links)

    def _measurements(self) -> list[Measurement]:
        """Each notch beside the slope change nearest to it, what of it the structure does, and what
        the images do; then the noise of each difference."""
        rows = []
        changed = [line for line in self.lines if line.state != self.reference]
        for line in changed:
            for number, place in enumerate(line.notches_mm, start=1):
                name = f"{line.state}: notch {number} of {line.group}"
                limit = self.tolerance_mm / abs(place) if place else None
                found, true = line.nearest(place)
                rows += [
                    Measurement.compare(
                        f"{name}, by the change of slope", "mm", found, place,
                        tolerance_relative=limit,
                    ),
                    Measurement(
                        f"{name}, of it the structure", "mm", true, place, true - place, np.nan
                    ),
                    Measurement(
                        f"{name}, of it the images", "mm", found, true, found - true, np.nan
                    ),
                ]  # fmt: skip
        for line in changed:
            name = f"{line.state}: RMS error of the difference, {line.group}"
            rows.append(Measurement.noise(name, "px", line.noise_px))
        return rows

    @property
    def warnings(self) -> list[str]:
        """Lines in which not as many changes were found as there are notches."""
        texts = []
        for line in self.lines:
            count = len(line.found.position)
            if line.state != self.reference and count != len(line.notches_mm):
                texts.append(
                    f"measure {self.name!r}: {line.state}, {line.group}: {count} changes of "
                    f"slope found for {len(line.notches_mm)} notches"
                )
        return texts

    def _figures(self, folder: Path) -> list[Drawing]:
        """Differences and lines of each group, to be drawn into ``folder``."""
        figures: list[Drawing] = []
        for group in dict.fromkeys(line.group for line in self.lines):
            lines = [line for line in self.lines if line.group == group]
            lines.sort(key=lambda line: line.state != self.reference)
            along = f"position along the {group}, {lines[0].axis} (mm)"
            across = f"deflection along {lines[0].across} (mm)"
            stem = f"{self.name}-{group}"
            whole = [_curve(line, line.deflection_mm, line.true_mm) for line in lines]
            changed = [
                _curve(line, line.difference_mm, line.true_difference_mm)
                for line in lines
                if line.state != self.reference
            ]
            if changed:
                labels = along, f"difference along {lines[0].across} (mm)"
                path = inside(folder, f"{stem}-differences.png")
                scale = lines[0].mm_per_px
                figures.append(partial(draw_differences, changed, labels, scale, path))
            path = inside(folder, f"{stem}-lines.png")
            figures.append(partial(draw_deflections, whole, (along, across), path))
        return figures


def compare_states(
    spec: m.DamageTable, scene: Scene, read: Callable[[str, str], Any]
) -> DamageResult:
    """Compare the deflection ``spec.of`` of every variant with that of the reference.

    ``read(variant, measure)`` gives a variant's result. Raises GpusimError if the reference's line
    has too few measured points.
    """
    own: dict[str, DeflectionResult] = {v.name: read(v.name, spec.of) for v in scene.variants}
    base = own[spec.reference]
    at_rest = {notch[:2] for notch in _notches(scene.variant(spec.reference))}
    lines = []
    for state, result in own.items():
        notches = [n for n in _notches(scene.variant(state)) if n[:2] not in at_rest]
        for group in dict.fromkeys(result.group):
            lines.append(_line(spec, group, _State(state, result, notches), base))
    table = _table(lines, base.table.frames[-1])
    return DamageResult(spec.name, table, spec.reference, 1e3 * spec.tolerance, tuple(lines))


class _State(NamedTuple):
    """A variant: its deflections, and its notches (axis, place, depth) that the reference lacks."""

    name: str
    result: DeflectionResult
    notches: Sequence[tuple[str, float, float]]


def _line(spec: m.DamageTable, group: str, variant: _State, base: DeflectionResult) -> DamageLine:
    state, result, notches = variant
    rows, base_rows = (np.flatnonzero(np.array(r.group) == group) for r in (result, base))
    own = result.position_mm[rows]
    along = int(np.argmax(np.ptp(own, axis=0)))
    across = _across(result, along)
    x, x0 = own[:, along], base.position_mm[base_rows, along]
    values, truth = result.measured_mm[rows, across], result.true_mm[rows, across]
    before, true_before = base.measured_mm[base_rows, across], base.true_mm[base_rows, across]
    count = np.count_nonzero(np.isfinite(before))
    if count < LEAST_POINTS:
        where = f"measure {spec.name!r}: group {group!r} of {spec.reference!r}"
        raise GpusimError(f"{where}: got {count} measured markers; expected {LEAST_POINTS}")
    difference = measure.difference_curve(x, values, x0, before)
    true_difference = measure.difference_curve(x, truth, x0, true_before)
    axis = "xyz"[along]
    own_notches = [notch for notch in notches if notch[0] == axis]
    clearance = spec.clearance
    if clearance is None:
        clearance = max((depth for _, _, depth in own_notches), default=0.0)

    def changes(curve: Float) -> measure.SlopeChanges:
        if state == spec.reference or np.count_nonzero(np.isfinite(curve)) < LEAST_POINTS:
            return NO_CHANGES
        return measure.slope_changes(
            x, curve, most=spec.most, significance=spec.significance, clearance=1e3 * clearance
        )

    return DamageLine(
        state, group, axis, result.axes[across], x, values, truth, difference, true_difference,
        result.mm_per_px, tuple(sorted(1e3 * place for _, place, _ in own_notches)),
        changes(difference), changes(true_difference),
    )  # fmt: skip


def _across(result: DeflectionResult, along: int) -> int:
    """Which of the image's two axes the deflection is along: not the member's, else the measure's
    own direction."""
    free = [k for k, axis in enumerate(result.axes) if axis[1] != "xyz"[along]]
    asked = [k for k in free if result.axes[k][1] == result.direction[1]]
    return (asked or free)[0]


def _notches(scene: Scene) -> list[tuple[str, float, float]]:
    """Axis, position (m) of every notch, and the depth of its member (m)."""
    return [
        (notch.axis, notch.position, _size(body.mesh)["xyz".index(notch.side[1])])
        for body in scene.bodies
        if isinstance(body.mesh, m.BeamMeshTable | m.BoxMeshTable)
        for notch in body.mesh.notches
    ]


def _size(mesh: m.BeamMeshTable | m.BoxMeshTable) -> tuple[float, float, float]:
    return mesh.size if isinstance(mesh, m.BoxMeshTable) else (mesh.length, mesh.width, mesh.height)


_BREAKS = (
    "state", "group", "position_mm", "sigma_mm", "slope_change_mrad", "slope_change_sigma_mrad",
    "p_value", "notch_mm", "true_position_mm",
)  # fmt: skip


def _table(lines: Sequence[DamageLine], frame: int) -> PointTable:
    """Every point of every line, in the last frame."""
    names = ("position_mm", "deflection_mm", "true_mm", "difference_mm", "true_difference_mm",
             "fitted_mm")  # fmt: skip
    points = [line for line in lines for _ in line.position_mm]
    columns = {name: np.concatenate([getattr(line, name) for line in lines]) for name in names}
    groups = {"group": np.array([line.group for line in points])}
    return PointTable.of("state", [line.state for line in points], {frame: groups | columns})


def _breaks(line: DamageLine) -> list[list[Any]]:
    found = line.found
    columns = (
        found.position, found.sigma, 1e3 * found.change, 1e3 * found.change_sigma, found.p_value,
    )  # fmt: skip
    rows = []
    for values in np.column_stack(columns).tolist():
        notch = line.owner(values[0])
        rows.append([line.state, line.group, *values, notch, line.nearest(notch)[1]])
    return rows


def _curve(line: DamageLine, measured: Float, true: Float) -> StateCurve:
    x = np.linspace(line.position_mm.min(), line.position_mm.max(), CURVE_POINTS)
    return StateCurve(
        name=line.state,
        x=line.position_mm,
        measured=measured,
        true=true,
        breaks=line.found.position,
        sigma=line.found.sigma,
        damage=np.array(line.notches_mm),
        fitted_x=x,
        fitted_y=line.found.at(x),
    )


register(Kind(m.DamageTable, DamageResult, compare=compare_states))
