"""Checks of scenes whose bodies vibrate or buckle: mass, loads that mean something there, and what
is only known in time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from gpusim.scene.description.analysis.analysis_table import TABLES
from gpusim.scene.tables.table import Words, table_of, tables_of

from .key_paths import Keys

VibrationFault = tuple[Keys, str, Any, str]
"""Of a key: the problem, what was got, and what was expected."""
_UNVARIED = ("modal", "harmonic", "buckling")
"""Types whose loads don't vary with frames."""


def vibration_faults(document: Mapping[str, Any]) -> Iterator[VibrationFault]:
    """Of a plain document; few of one with another kind of analysis."""
    analysis = table_of(document, "analysis")
    kind = str(analysis.get("type", "static"))
    if kind not in TABLES:
        return
    yield from _of_instants(document, kind, analysis)
    names: list[str] = []
    for index, body in tables_of(document, "body"):
        at: Keys = ("body", index)
        if TABLES[kind].vibrates:
            yield from _of_materials(document, body, at, analysis)
        for place, load in tables_of(body, "load"):
            names.append(str(load.get("name")))
            yield from _of_load(kind, analysis, load, (*at, "load", place))
        if kind == "modal" and body.get("load") and analysis.get("prestress") is not True:
            yield ((*at, "load"), "modes without prestress don't feel loads", Words("loads"),
                   "analysis.prestress = true, or no load")  # fmt: skip
        yield from _of_supports(kind, analysis, body, at)
    yield from _of_analysis(kind, analysis, names)


def _of_instants(
    document: Mapping[str, Any], kind: str, analysis: Mapping[str, Any]
) -> Iterator[VibrationFault]:
    """Lamps flicker where frames are in time; cameras are late where motions are known then."""
    video, got = document.get("video"), Words(f'analysis.type "{kind}"')
    said = [analysis, video] if isinstance(video, Mapping) else [analysis]
    timed = any(table.get("frame_rate_Hz") is not None for table in said)
    if not timed or "frame_rate_Hz" not in TABLES[kind].model_fields:
        for index, light in tables_of(document, "light"):
            if light.get("flicker") is not None:
                wanted = "frame_rate_Hz of an analysis whose frames are instants"
                yield ("light", index, "flicker"), "frames aren't in time", got, wanted
    posed = any(prop.get("poses") for _, prop in tables_of(document, "prop"))
    if posed or not TABLES[kind].vibrates:
        for index, camera in tables_of(document, "camera"):
            if camera.get("trigger") is not None:
                wanted = "a motion that is known at any instant, and no poses of props"
                yield ("camera", index, "trigger"), "nothing is known between frames", got, wanted


def _of_materials(
    document: Mapping[str, Any], body: Mapping[str, Any], at: Keys, analysis: Mapping[str, Any]
) -> Iterator[VibrationFault]:
    """They have a density; and no history before the motion begins."""
    materials = {one.get("name"): one for _, one in tables_of(document, "material")}
    places = [at, *((*at, "part", k) for k, _ in tables_of(body, "part"))]
    owners = [body, *(part for _, part in tables_of(body, "part"))]
    begun = analysis.get("geometry") == "nonlinear" and "release" in analysis
    for keys, owner in zip(places, owners, strict=True):
        material = materials.get(owner.get("material"), {"density_kg_m3": 1.0})
        if material.get("density_kg_m3", 0) == 0:
            yield ((*keys, "material"), "vibrates on a material without density",
                   owner["material"], "density_kg_m3 > 0")  # fmt: skip
        if begun and material.get("type") == "j2":
            problem = "of metal that yields, whose history before its release isn't known"
            wanted = "no analysis.release, or a material of another type"
            yield (*keys, "material"), problem, owner["material"], wanted


def _of_load(
    kind: str, analysis: Mapping[str, Any], load: Mapping[str, Any], keys: Keys
) -> Iterator[VibrationFault]:
    """It has a meaning in this kind of analysis; it varies while it is there, and while bodies are
    followed."""
    of, times = f'in an analysis of type "{kind}"', load.get("times_s")
    if "times_s" in load and kind != "transient":
        yield (*keys, "times_s"), of, times, "none"
    if "amplitude" in load and kind in _UNVARIED:
        problem = f"{of}, whose loads don't vary with frames"
        yield (*keys, "amplitude"), problem, load["amplitude"], "none"
    large, follows = analysis.get("geometry") == "nonlinear", load.get("follows") is True
    if kind in ("transient", "harmonic") and not large:
        if follows or load.get("type") == "thermal":
            wanted = 'another load, or of a transient one geometry = "nonlinear"'
            yield keys, f"not known {of}", "follows" if follows else "thermal", wanted
    if kind != "transient":
        return
    asked, end = analysis.get("release"), analysis.get("duration_s")
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
    kind: str, analysis: Mapping[str, Any], body: Mapping[str, Any], at: Keys
) -> Iterator[VibrationFault]:
    """They hold still, and are there if the ground is to move the body."""
    if "base_motion" in analysis and not body.get("support"):
        yield ((*at, "support"), "stands on no ground", Words("no support"),
               "a [[body.support]] that base_motion moves")  # fmt: skip
    if not TABLES[kind].vibrates or analysis.get("prestress") is True:
        return
    wanted = "analysis.prestress = true" if kind == "modal" else "a ground, analysis.base_motion"
    for place, support in tables_of(body, "support"):
        moved = support.get("displacement_mm")
        if isinstance(moved, list) and any(moved):
            keys = (*at, "support", place, "displacement_mm")
            yield keys, f'in an analysis of type "{kind}"', moved, f"zero, or {wanted}"


def _of_analysis(
    kind: str, analysis: Mapping[str, Any], loads: list[str]
) -> Iterator[VibrationFault]:
    """Something that vibrations and buckling come from, and loads that are let go."""
    prestress = analysis.get("prestress") is True
    needed = prestress or kind in ("transient", "harmonic", "buckling")
    if needed and not loads and "base_motion" not in analysis:
        key = "prestress" if prestress else "type"
        yield ("analysis", key), "nothing acts on bodies", Words("no load"), "a [[body.load]]"
    asked = analysis.get("release")
    for place, name in enumerate(asked if isinstance(asked, list) else ()):
        if name not in loads:
            expected = f"one of {', '.join(loads)}" if loads else "a [[body.load]]"
            yield ("analysis", "release", place), "no such load", name, expected
