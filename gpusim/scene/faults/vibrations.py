"""Checks of scenes whose bodies vibrate or buckle: mass, and loads that mean something there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from gpusim.scene.description.analysis import ANALYSIS_TYPES
from gpusim.scene.description.table import Words, tables_of

from .key_paths import Keys

VibrationFault = tuple[Keys, str, Any, str]
"""Of a key: the problem, what was got, and what was expected."""


def vibration_faults(document: Mapping[str, Any]) -> Iterator[VibrationFault]:
    """Of a plain document; nothing of one with another kind of analysis."""
    analysis = document.get("analysis")
    if not isinstance(analysis, Mapping):
        return
    kind, loads = str(analysis.get("type", "static")), 0
    known = ANALYSIS_TYPES.get(kind)
    if known is None:
        return
    for index, body in tables_of(document, "body"):
        at: Keys = ("body", index)
        if known.vibrates:
            yield from _without_mass(document, body, at)
        yield from _of_loads(analysis, kind, body, at)
        loads += len(list(tables_of(body, "load")))
        if "base_motion" in analysis and not body.get("support"):
            yield ((*at, "support"), "stands on no ground", Words("no support"),
                   "a [[body.support]] that base_motion moves")  # fmt: skip
    yield from _without_cause(analysis, kind, bool(loads))
    yield from _released(document, analysis)


def _without_mass(
    document: Mapping[str, Any], body: Mapping[str, Any], at: Keys
) -> Iterator[VibrationFault]:
    """Every material of a body has a density."""
    density = {
        str(one.get("name")): one.get("density_kg_m3", 0)
        for _, one in tables_of(document, "material")
    }
    named = [((*at, "material"), body.get("material"))]
    named += [((*at, "part", k, "material"), part.get("material"))
              for k, part in tables_of(body, "part")]  # fmt: skip
    for keys, name in named:
        if density.get(str(name)) == 0:
            yield keys, "vibrates on a material without density", name, "density_kg_m3 > 0"


def _of_loads(
    analysis: Mapping[str, Any], kind: str, body: Mapping[str, Any], at: Keys
) -> Iterator[VibrationFault]:
    """Loads and moving supports where they have a meaning, and factors where there are frames."""
    forced = kind in ("transient", "harmonic")
    scaled = {"load_factors", "duration_s"} & {*ANALYSIS_TYPES[kind].keys}
    loads = list(tables_of(body, "load"))
    if loads and kind == "modal" and analysis.get("prestress") is not True:
        yield ((*at, "load"), "modes without prestress don't feel loads",
               Words(f"{len(loads)} load{'s' * (len(loads) > 1)}"),
               "analysis.prestress = true, or no load")  # fmt: skip
    for place, load in loads:
        keys: Keys = (*at, "load", place)
        if "times_s" in load and kind != "transient":
            yield (*keys, "times_s"), f'in an analysis of type "{kind}"', load["times_s"], "none"
        if forced and (load.get("type") == "thermal" or load.get("follows") is True):
            got = load.get("type") if load.get("type") == "thermal" else "follows = true"
            yield keys, f'not known in an analysis of type "{kind}"', got, "another load"
        if "amplitude" in load and not scaled:
            yield ((*keys, "amplitude"), f'in an analysis of type "{kind}", whose loads don\'t '
                   "vary with frames", load["amplitude"], "none")  # fmt: skip
    for place, support in tables_of(body, "support"):
        moved = support.get("displacement_mm")
        if forced and isinstance(moved, list) and any(moved):
            yield ((*at, "support", place, "displacement_mm"),
                   f'in an analysis of type "{kind}"', moved,
                   "zero; the ground moves by analysis.base_motion of a transient one")  # fmt: skip


def _without_cause(
    analysis: Mapping[str, Any], kind: str, loaded: bool
) -> Iterator[VibrationFault]:
    """Something that vibrations and buckling come from."""
    prestress = analysis.get("prestress") is True
    needed = kind in ("harmonic", "buckling") or (kind == "modal" and prestress)
    if kind == "transient" and "base_motion" not in analysis:
        needed = True
    if needed and not loaded:
        key = "prestress" if prestress else "type"
        yield ("analysis", key), "nothing acts on bodies", Words("no load"), "a [[body.load]]"


def _released(document: Mapping[str, Any], analysis: Mapping[str, Any]) -> Iterator[VibrationFault]:
    """Loads that are let go are loads."""
    names = {
        str(load.get("name"))
        for _, body in tables_of(document, "body")
        for _, load in tables_of(body, "load")
    }
    asked = analysis.get("release")
    for place, name in enumerate(asked if isinstance(asked, list) else ()):
        if name not in names:
            expected = f"one of {', '.join(sorted(names))}" if names else "a [[body.load]]"
            yield ("analysis", "release", place), "no such load", name, expected
