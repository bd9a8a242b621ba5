"""Why measured fields differ from the truth: the parts of the error, as maps."""

from __future__ import annotations

from functools import partial
from os import PathLike
from typing import Any

import numpy as np

from gpusim.files.atomic_files import safe_name, write_text
from gpusim.files.output_folder import inside
from gpusim.pipeline.measurements.dic.error_parts import ErrorParts, error_parts, remarks
from gpusim.pipeline.measurements.results import PointTable, vector_columns
from gpusim.pipeline.pictures.file_names import image_path
from gpusim.pipeline.runner.effect_states import EffectStates, check_comparable, documents_of_states
from gpusim.pipeline.runner.execution import Execution
from gpusim.pipeline.runner.scene_report import read_results
from gpusim.pipeline.runner.stage_log import Progress
from gpusim.report import Drawing, Explanation, Link, Report
from gpusim.report.field_maps import draw_error_parts
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.scene.effects import active_effects, with_other_patterns
from gpusim.scene.tables.table import name_and_unit
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
        No measure of type "dic", variants, or settings that each state would choose anew.
    GpusimError
        As `gpusim.run`, for any of the states.

    Examples
    --------
    >>> gs.explain(gs.load_scene("bar.toml"), "out/why", backend="numpy")
    Traceback (most recent call last):
    ...
    gpusim.errors.InputError: explain: scene 'bar'; got 0 variants, 0 measures of type "dic"; ...
    """
    given = isinstance(scene, Scene)
    require(given, "explain: scene", type(scene).__name__, "a Scene (load_scene)")
    measures = [spec for spec in scene.measures if isinstance(spec, m.DicTable)]
    where, kind = f"explain: scene {scene.name!r}", ' of type "dic"'
    check_comparable(scene, where, measures, kind, " (or gpusim budget)")
    document = _with_true_cameras(scene.document)
    effects = [name for name in active_effects(document) if name != KEPT]
    documents = dict(documents_of_states(document, effects, [KEPT]))
    bare = documents["none", ""]
    if with_other_patterns(bare, 1) != bare:
        for number, name in enumerate(PATTERNS, 1):
            documents["none", name] = with_other_patterns(bare, number)
    states = EffectStates(FOLDER, effects, documents)
    execution = states.run(scene, out, backend, progress, draws=False)
    places = "", *(states.place(*key) for key in documents)
    explanations, links = [], [*execution.reports[""].links]
    for spec in measures:
        results: list[Any] = [
            read_results(execution.decision, place, spec.name)[0] for place in places
        ]
        found = error_parts(results[0], dict(zip(documents, results[1:], strict=True)))
        path = inside(execution.out, FOLDER, f"{safe_name(spec.name)}.csv")
        write_text(path, _table(found))
        explanations.append(_explanation(scene, execution, found))
        links.append(Link(f"Parts of the error of {spec.name}", path))
    return states.told(execution, explanations=tuple(explanations), links=tuple(links))


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


def _explanation(scene: Scene, execution: Execution, found: ErrorParts) -> Explanation:
    """Numbers, words and maps."""
    result = found.result
    return Explanation(
        result.name, result.table.frames[-1],
        {name: kind.unit for name, kind in found.kinds.items()}, found.sizes,
        tuple(remarks(found)), _figures(scene, execution, found),
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
    result = found.result
    picture = image_path(scene, execution.out, result.cameras[0], 0)
    points = np.stack([result.table[f"{axis}_px"][-1] for axis in "xy"], axis=1)
    maps = {"whole error": found.whole, **found.parts, "missing": found.missing}
    names = [name_and_unit(name)[0] for name in (*result.displacements, *result.strains)]
    return tuple(
        partial(
            draw_error_parts, picture, points,
            {name: kind.factor * one[:, kind.columns] for name, one in maps.items()},
            [f"{name} ({kind.unit})" for name in names[kind.columns]],
            f"{result.name}: parts of the error of {what}",
            inside(execution.out, "figures", f"{safe_name(result.name)}-parts-{what}.png"),
        )
        for what, kind in found.kinds.items()
    )  # fmt: skip
