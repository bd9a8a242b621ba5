"""Checks of scenes whose bodies vibrate or buckle: mass, and loads that mean something there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from gpusim.scene.description.analysis.analysis_table import ANALYSIS_TYPES
from gpusim.scene.tables.table import Words, tables_of

from .key_paths import Keys

VibrationFault = tuple[Keys, str, Any, str]
"""Of a key: the problem, what was got, and what was expected."""


def vibration_faults(document: Mapping[str, Any]) -> Iterator[VibrationFault]:
    """Of a plain document; few of one with another kind of analysis."""
    analysis = document.get("analysis")
    kind = str(analysis.get("type", "static")) if isinstance(analysis, Mapping) else ""
    if not isinstance(analysis, Mapping) or kind not in ANALYSIS_TYPES:
        return
    names: list[str] = []
    for index, body in tables_of(document, "body"):
        at: Keys = ("body", index)
        if ANALYSIS_TYPES[kind].vibrates:
            yield from _without_mass(document, body, at)
        for place, load in tables_of(body, "load"):
            names.append(str(load.get("name")))
            yield from _of_load(kind, load, (*at, "load", place))
            if kind == "transient":
                yield from _in_time(analysis, load, (*at, "load", place))
        if kind == "modal" and body.get("load") and analysis.get("prestress") is not True:
            yield ((*at, "load"), "modes without prestress don't feel loads", Words("loads"),
                   "analysis.prestress = true, or no load")  # fmt: skip
        yield from _of_supports(kind, body, at, analysis)
    yield from _of_analysis(kind, analysis, names)


def _without_mass(
    document: Mapping[str, Any], body: Mapping[str, Any], at: Keys
) -> Iterator[VibrationFault]:
    """Every material of a body has a density."""
    light = [
        one.get("name") for _, one in tables_of(document, "material")
        if one.get("density_kg_m3", 0) == 0
    ]  # fmt: skip
    parts = [((*at, "part", k), part) for k, part in tables_of(body, "part")]
    for keys, owner in [(at, body), *parts]:
        if owner.get("material") in light:
            yield ((*keys, "material"), "vibrates on a material without density",
                   owner["material"], "density_kg_m3 > 0")  # fmt: skip


def _of_load(kind: str, load: Mapping[str, Any], keys: Keys) -> Iterator[VibrationFault]:
    """One that has a meaning in this kind of analysis, and factors where these have one."""
    of = f'in an analysis of type "{kind}"'
    if "times_s" in load and kind != "transient":
        yield (*keys, "times_s"), of, load["times_s"], "none"
    if "amplitude" in load and kind in ("modal", "harmonic", "buckling"):
        problem = f"{of}, whose loads don't vary with frames"
        yield (*keys, "amplitude"), problem, load["amplitude"], "none"
    follows = load.get("follows") is True
    if kind in ("transient", "harmonic") and (follows or load.get("type") == "thermal"):
        yield keys, f"not known {of}", "follows" if follows else "thermal", "another load"


def _in_time(
    analysis: Mapping[str, Any], load: Mapping[str, Any], keys: Keys
) -> Iterator[VibrationFault]:
    """It varies while it is there, and while bodies are followed."""
    asked, times, end = (
        analysis.get("release"), load.get("times_s"), analysis.get("duration_s")
    )  # fmt: skip
    if "amplitude" in load and isinstance(asked, list) and load.get("name") in asked:
        yield ((*keys, "amplitude"), "of a load that is let go at time 0", load["amplitude"],
               "no amplitude, or the load not in analysis.release")  # fmt: skip
    numbers = [one for one in (times if isinstance(times, list) else ()) if _is_number(one)]
    if numbers and _is_number(end) and min(numbers) > end:
        yield ((*keys, "times_s"), "all after analysis.duration_s", times,
               f"times of which some are within {end:g} s, or a longer duration_s")  # fmt: skip


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)


def _of_supports(
    kind: str, body: Mapping[str, Any], at: Keys, analysis: Mapping[str, Any]
) -> Iterator[VibrationFault]:
    """They hold still, and are there if the ground is to move the body."""
    if "base_motion" in analysis and not body.get("support"):
        yield ((*at, "support"), "stands on no ground", Words("no support"),
               "a [[body.support]] that base_motion moves")  # fmt: skip
    for place, support in tables_of(body, "support"):
        moved = support.get("displacement_mm")
        still = kind in ("transient", "harmonic", "modal") and analysis.get("prestress") is not True
        if still and isinstance(moved, list) and any(moved):
            keys = (*at, "support", place, "displacement_mm")
            wanted = "zero; the ground moves by analysis.base_motion of a transient one"
            if kind == "modal":
                wanted = "zero, or analysis.prestress = true"
            yield keys, f'in an analysis of type "{kind}"', moved, wanted


def _of_analysis(
    kind: str, analysis: Mapping[str, Any], loads: list[str]
) -> Iterator[VibrationFault]:
    """Something that vibrations and buckling come from, and loads that are let go."""
    prestress = analysis.get("prestress") is True
    needed = kind in ("harmonic", "buckling") or (kind == "modal" and prestress)
    if not loads and (needed or (kind == "transient" and "base_motion" not in analysis)):
        key = "prestress" if prestress else "type"
        yield ("analysis", key), "nothing acts on bodies", Words("no load"), "a [[body.load]]"
    asked = analysis.get("release")
    for place, name in enumerate(asked if isinstance(asked, list) else ()):
        if name not in loads:
            expected = f"one of {', '.join(loads)}" if loads else "a [[body.load]]"
            yield ("analysis", "release", place), "no such load", name, expected
