"""Why measured fields differ from the truth: each source of error's part, as maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from os import PathLike
from typing import Any

import numpy as np

from gpusim.files.atomic_files import safe_name, write_text
from gpusim.files.output_folder import inside
from gpusim.pipeline.measurements.dic.error_parts import ErrorParts, error_parts, remarks
from gpusim.pipeline.measurements.results import PointTable, vector_columns
from gpusim.pipeline.pictures.file_names import image_path
from gpusim.pipeline.runner.error_budget import State, place_of, run_states, states_of_effects
from gpusim.pipeline.runner.execution import Execution
from gpusim.pipeline.runner.scene_report import read_results
from gpusim.pipeline.runner.stage_log import Progress
from gpusim.report import Drawing, Explanation, Link, Report, write_report
from gpusim.report.field_maps import draw_error_parts
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.scene.description.table import name_and_unit
from gpusim.scene.effects import active_effects, with_only, with_other_patterns
from gpusim.validation import require

FOLDER = "explain"
KEPT = "distortion"
"""Isn't switched off: it would move all points. What it does is known from the cameras."""
PATTERNS = ("pattern 1", "pattern 2")
"""Other drawings of random patterns that are measured."""


def explain(
    scene: Scene,
    out: str | PathLike[str],
    *,
    backend: str = "auto",
    progress: Progress | None = None,
) -> Report:
    """Run ``scene`` into ``out``, then without its effects, in ``out/explain``: the report has what
    each of them does to the fields of measures of type "dic", as maps and numbers.

    Raises
    ------
    InputError
        No measure of type "dic", or variants.
    GpusimError
        As `gpusim.run`, for any of the states.

    Examples
    --------
    >>> gs.explain(gs.load_scene("bar.toml"), "out/why", backend="numpy")
    Traceback (most recent call last):
    ...
    gpusim.errors.InputError: explain: scene 'bar'; got 0 variants, 0 measures of type "dic"; ...
    """
    measures = [spec for spec in scene.measures if isinstance(spec, m.DicTable)]
    where = f"explain: scene {scene.name!r}"
    got = f'{len(scene.variants)} variants, {len(measures)} measures of type "dic"'
    fits = bool(measures) and not scene.variants
    require(fits, where, got, '[[measure]] of type "dic", no [[variant]] (or gpusim budget)')
    # each state's pictures would choose other points
    fixed = all(spec.settings is None for spec in measures)
    require(fixed, where, 'settings = "best"', "the subset and the others that its report names")
    document = _with_true_cameras(scene.document)
    effects = [name for name in active_effects(document) if name != KEPT]
    states = dict(states_of_effects(document, effects, [KEPT]))
    if with_other_patterns(document, 1) != document:
        bare = with_only(document, [KEPT])
        for number, name in enumerate(PATTERNS, 1):
            states["none", name] = with_other_patterns(bare, number)
    execution = run_states(scene, out, FOLDER, states, backend, progress, draws=False)
    report = execution.reports[""]
    for spec in measures:
        found = _parts(execution, spec.name, effects, ("none", PATTERNS[0]) in states)
        path = inside(execution.out, FOLDER, f"{safe_name(spec.name)}.csv")
        write_text(path, _table(found))
        report = replace(
            report,
            explanations=(*report.explanations, _explanation(scene, execution, found)),
            links=(*report.links, Link(f"Parts of the error of {spec.name}", path)),
        )
    write_report(report, execution.out)
    execution.log.tell(FOLDER, 1.0, f"{len(states) + 1} states of {len(effects)} effects")
    return report


def _with_true_cameras(document: dict[str, Any]) -> dict[str, Any]:
    """The document with fields alone, of pairs whose calibration is perfect: what the real one does
    is known from it, and its pictures needn't be made again."""
    measures = [one for one in document["measure"] if one["type"] == m.DicTable.kind()]
    for one in measures:
        if one.get("cameras"):
            one["calibration"] = "true"
    result = document | {"measure": measures}
    if all(one.get("plane_pose") is None for one in measures):
        board = (result.pop("calibration", None) or {}).get("board")
        result["prop"] = [one for one in result.get("prop", []) if one["name"] != board]
    return result


def _parts(execution: Execution, measure: str, effects: Sequence[str], redrawn: bool) -> ErrorParts:
    """Of one measure."""

    def read(place: str) -> Any:
        (found,) = read_results(execution.decision, place, measure)
        return found

    def states(state: State, names: Sequence[str]) -> dict[str, Any]:
        return {name: read(place_of(FOLDER, state, name)) for name in names}

    others = states("none", PATTERNS if redrawn else ()).values()
    none = read(place_of(FOLDER, "none", ""))
    return error_parts(read(""), none, states("only", effects), states("no", effects), [*others])


def _explanation(scene: Scene, execution: Execution, found: ErrorParts) -> Explanation:
    """Numbers, words and maps."""
    result = found.result
    return Explanation(
        result.name, result.table.frames[-1], name_and_unit(result.displacements[0])[1],
        found.sizes(), tuple(remarks(found)), _figures(scene, execution, found),
    )  # fmt: skip


def _table(found: ErrorParts) -> str:
    """A row for each point, a column for each part of each quantity."""
    result, maps = found.result, {"error": found.whole, **found.parts}
    columns = {f"{axis}_px": result.table[f"{axis}_px"][-1] for axis in "xy"}
    for part, values in maps.items():
        head = f"{part.replace(' ', '-')}_{{}}"
        columns |= vector_columns(head, [*result.displacements, *result.strains], values)
    table = result.table
    return PointTable.of(table.what, table.points, {table.frames[-1]: columns}).csv()


def _figures(scene: Scene, execution: Execution, found: ErrorParts) -> tuple[Drawing, ...]:
    """Maps of displacements and of strains."""
    result, count = found.result, found.lengths
    picture = image_path(scene, execution.out, result.cameras[0], 0)
    points = np.stack([result.table[f"{axis}_px"][-1] for axis in "xy"], axis=1)
    maps = {"whole error": found.whole, **found.parts, "missing": found.missing}
    units = [name_and_unit(name) for name in result.displacements]
    kinds = {
        "displacements": (slice(None, count), 1.0, [f"{name} ({unit})" for name, unit in units]),
        "strains": (slice(count, None), 1e6, [f"{name} (1e-6)" for name in result.strains]),
    }
    return tuple(
        partial(
            draw_error_parts, picture, points,
            {name: factor * one[:, columns] for name, one in maps.items()}, titles,
            f"{result.name}: parts of the error of {what}",
            inside(execution.out, "figures", f"{safe_name(result.name)}-parts-{what}.png"),
        )
        for what, (columns, factor, titles) in kinds.items() if titles
    )  # fmt: skip
