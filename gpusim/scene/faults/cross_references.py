"""Checks between tables of a scene: unique names, references that exist, physics that is complete.

They work on the plain document, before or without a full validation, so that their faults are told
together with the schema's. What isn't of the right shape is skipped here: the schema reports it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from gpusim.errors import Fault
from gpusim.scene.description.mesh import NOTCHABLE, SETS
from gpusim.scene.description.table import Words, norm

from .faults import value_text
from .key_paths import Keys, dotted, listed, nearest

__all__ = ["check_document"]

Found = list[tuple[Keys, Fault]]
Names = dict[str, None]  # in their order, and quick to look up
_BITS = 31  # of a truth layer
_HINTS = 50  # faults whose nearest word is looked for, which takes a while where there are many


def check_document(document: Mapping[str, Any]) -> Found:
    """Faults between tables, each with the keys it is about."""
    found: Found = []
    _unique_names(document, found)
    _references(document, found)
    _physics(document, found)
    _fields(document, found)
    _poses(document, found)
    _layers(document, found)
    _deflection_is_seen(document, found)
    _shutters(document, found)
    return found


def _items(table: Mapping[str, Any], key: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
    items = table.get(key)
    if isinstance(items, list):
        for index, item in enumerate(items):
            if isinstance(item, Mapping):
                yield index, item


def _add(
    found: Found, keys: Keys, problem: str, got: Any, expected: str, *, hint: str = ""
) -> None:
    found.append((keys, Fault(dotted(keys), problem, value_text(got), expected, hint)))


def _unique_names(document: Mapping[str, Any], found: Found) -> None:
    def unique(prefix: Keys, table: Mapping[str, Any], key: str, seen: dict[str, Keys]) -> None:
        for index, item in _items(table, key):
            name, keys = item.get("name"), (*prefix, key, index, "name")
            if not isinstance(name, str):
                continue
            first = seen.setdefault(name.casefold(), keys)  # names become file names
            if first != keys:
                _add(found, keys, "name used twice", name, f"another than {dotted(first)}")

    for key in ("material", "camera", "light", "measure", "variant"):
        unique((), document, key, {})
    things: dict[str, Keys] = {}  # bodies and props are both things in the picture,
    paints: dict[str, Keys] = {}  # and measurements know paints by their name alone
    for key in ("body", "prop"):
        unique((), document, key, things)
        for index, item in _items(document, key):
            unique((key, index), item, "paint", paints)
    for index, body in _items(document, "body"):
        for key in ("support", "load"):
            unique(("body", index), body, key, {})


def _references(document: Mapping[str, Any], found: Found) -> None:
    def refer(keys: Keys, value: Any, names: Names, what: str) -> None:
        if not isinstance(value, str) or value in names:
            return
        near = nearest(value, list(names)) if len(found) < _HINTS else ""
        expected = f"one of {listed(names)}" if names else f"a {what}, but there is none"
        hint = f"did you mean {near}?" if near else ""
        _add(found, keys, f"no such {what}", value, expected, hint=hint)

    keys: Keys
    materials = _names(document, "material")
    for index, body in _items(document, "body"):
        if materials is not None:
            refer(("body", index, "material"), body.get("material"), materials, "material")
            for place, part in _items(body, "part"):
                keys = ("body", index, "part", place, "material")
                refer(keys, part.get("material"), materials, "material")
        mesh = body.get("mesh")
        builder = str(mesh.get("builder")) if isinstance(mesh, Mapping) else ""
        notches = len(list(_items(body, "notch")))
        sets = SETS.get(builder)
        if sets is not None and notches:
            sets = (*sets, *(f"notch_{number}" for number in range(1, notches + 1)))
        for key in ("support", "load", "paint"):
            for place, entry in _items(body, key):
                where = entry.get("where")
                if sets is not None and isinstance(where, Mapping):
                    keys = ("body", index, key, place, "where", "set")
                    refer(keys, where.get("set"), dict.fromkeys(sets), "set of the mesh")
    cameras = _names(document, "camera")
    moving = _marker_names(document, "body")
    fixed = _marker_names(document, "prop")
    variants = _names(document, "variant")
    lines = {
        m["name"]: None
        for _, m in _items(document, "measure")
        if m.get("type") == "deflection" and isinstance(m.get("name"), str)
    }
    for index, measure in _items(document, "measure"):
        if cameras is not None:
            refer(("measure", index, "camera"), measure.get("camera"), cameras, "camera")
        refer(("measure", index, "of"), measure.get("of"), lines, "measure of a deflection")
        if variants is not None:
            keys = ("measure", index, "reference")
            refer(keys, measure.get("reference"), variants, "variant")
        if measure.get("type") == "stereo" and "calibration" not in document:
            _add(found, ("measure", index), "needs images of a target", Words("no [calibration]"),
                 "[calibration] of a checker or charuco")  # fmt: skip
        lists = (
            ("cameras", cameras, "camera"),
            ("groups", moving, "markers paint on a body"),
            ("static", fixed, "markers paint on a prop"),
        )
        for key, names, what in lists:
            values = measure.get(key)
            for place, value in enumerate(values if isinstance(values, list) else ()):
                if names is not None:
                    refer(("measure", index, key, place), value, names, what)


def _names(document: Mapping[str, Any], key: str) -> Names | None:
    """Names of the items; None if one has none, because a reference may mean that one."""
    names = [item.get("name") for _, item in _items(document, key)]
    texts = [name for name in names if isinstance(name, str)]
    return dict.fromkeys(texts) if len(texts) == len(names) else None


def _marker_names(document: Mapping[str, Any], key: str) -> Names | None:
    """Names of the markers paints; None if a paint lacks its name or type."""
    names: Names = {}
    for _, item in _items(document, key):
        for _, paint in _items(item, "paint"):
            name, kind = paint.get("name"), paint.get("type")
            if not isinstance(name, str) or not isinstance(kind, str):
                return None
            if kind == "markers":
                names[name] = None
    return names


def _deflection_is_seen(document: Mapping[str, Any], found: Found) -> None:
    """One camera can't measure along its own axis."""
    views = {}
    for _, camera in _items(document, "camera"):
        ends = [_numbers(camera.get(key)) for key in ("position_mm", "target_mm")]
        if ends[0] and ends[1]:
            views[str(camera.get("name"))] = [b - a for a, b in zip(*ends, strict=True)]
    for index, measure in _items(document, "measure"):
        view, direction = views.get(str(measure.get("camera"))), measure.get("direction")
        if view is None or direction not in ("+x", "-x", "+y", "-y", "+z", "-z"):
            continue
        along = abs(view["xyz".index(direction[1])])
        if along > 0.7 * norm(view):
            _add(found, ("measure", index, "direction"), "is along the camera's view", direction,
                 "a direction that its image shows")  # fmt: skip


def _numbers(value: Any) -> list[float] | None:
    """Three numbers that floats can hold, or None."""
    if not isinstance(value, list) or len(value) != 3:
        return None
    good = all(isinstance(v, int | float) and abs(v) < 1e300 for v in value)
    return [float(v) for v in value] if good else None


def _amplitudes(
    document: Mapping[str, Any], body: Mapping[str, Any], keys: Keys, found: Found
) -> None:
    """One factor per frame."""
    analysis = document.get("analysis", {})
    factors = analysis.get("load_factors", [0, 1]) if isinstance(analysis, Mapping) else None
    for place, entry in _items(body, str(keys[-1])):
        amplitude = entry.get("amplitude")
        if not isinstance(amplitude, list) or not isinstance(factors, list):
            continue
        if len(amplitude) != len(factors):
            expected = f"{len(factors)}, as many as analysis.load_factors"
            _add(found, (*keys, place, "amplitude"), "not one factor per frame",
                 Words(f"{len(amplitude)} factors"), expected)  # fmt: skip


_NEEDS = {
    "gravity": ("density_kg_m3", "gravity on a material without density"),
    "centrifugal": ("density_kg_m3", "rotation of a material without density"),
    "thermal": ("expansion_per_K", "heat on a material without thermal expansion"),
}


def _parts(body: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [part for _, part in _items(body, "part")]


def _fields(document: Mapping[str, Any], found: Found) -> None:
    """Displacements are given for every body, or for none."""
    analysis = document.get("analysis", {})
    kind = analysis.get("type", "static") if isinstance(analysis, Mapping) else None
    for index, body in _items(document, "body"):
        if kind == "field" and "field" not in body:
            _add(found, ("body", index, "field"), "missing", Words('analysis.type = "field"'),
                 "a field for every body, or type \"static\"")  # fmt: skip
        elif kind == "static" and "field" in body:
            _add(found, ("analysis", "type"), "of a scene whose displacements are given", kind,
                 f'"field", for body {value_text(body.get("name"))}')  # fmt: skip


def _poses(document: Mapping[str, Any], found: Found) -> None:
    """One pose per frame; a calibration's board, cameras and props exist."""
    analysis = document.get("analysis", {})
    frames = None
    if isinstance(analysis, Mapping):
        key = "times" if analysis.get("type") == "field" else "load_factors"
        frames = analysis.get(key, [0, 1])
    for index, prop in _items(document, "prop"):
        poses = prop.get("poses")
        if isinstance(poses, list) and isinstance(frames, list) and len(poses) != len(frames):
            got, wanted = (
                Words(f"{len(poses)} poses"),
                f"{len(frames)}, as many as frames in [analysis]",
            )
            _add(found, ("prop", index, "poses"), "not one pose per frame", got, wanted)
    calibration = document.get("calibration")
    if not isinstance(calibration, Mapping):
        return
    plates = {
        item["name"]: None
        for _, item in _items(document, "prop")
        if item.get("type") == "plate" and isinstance(item.get("name"), str)
    }
    known = {"board": plates, "cameras": _names(document, "camera"),
             "show": _names(document, "prop")}  # fmt: skip
    for key, names in known.items():
        value = calibration.get(key)
        for place, name in enumerate(value if isinstance(value, list) else [value]):
            keys: Keys = ("calibration", key)
            keys = (*keys, place) if isinstance(value, list) else keys
            if isinstance(name, str) and names is not None and name not in names:
                what = {"board": "prop of type plate", "cameras": "camera", "show": "prop"}[key]
                _add(found, keys, f"no such {what}", name,
                     f"one of {listed(names)}" if names else f"a {what}")  # fmt: skip
    if not list(_items(document, "camera")):
        _add(
            found, ("calibration",), "needs a camera", Words("no camera"), "at least one [[camera]]"
        )


def _layers(document: Mapping[str, Any], found: Found) -> None:
    output = document.get("output")
    layers = output.get("truth") if isinstance(output, Mapping) else None
    cameras = len(list(_items(document, "camera")))
    if isinstance(layers, list) and "cameras" in layers and cameras > _BITS:
        problem = 'layer "cameras" has a bit per camera'
        _add(found, ("output", "truth"), problem, Words(f"{cameras} cameras"), f"at most {_BITS}")


def _physics(document: Mapping[str, Any], found: Found) -> None:
    material = {str(m.get("name")): m for _, m in _items(document, "material")}
    for index, body in _items(document, "body"):
        mesh = body.get("mesh")
        builder = mesh.get("builder") if isinstance(mesh, Mapping) else None
        if body.get("notch") and isinstance(builder, str) and builder not in NOTCHABLE:
            _add(found, ("body", index, "notch"), "in a mesh that can't have one", builder,
                 "builder " + " or ".join(NOTCHABLE))  # fmt: skip
        loads = list(_items(body, "load"))
        if loads and not body.get("support"):
            _add(found, ("body", index, "support"), "loaded but not held", Words("no support"),
                 "at least one [[body.support]]")  # fmt: skip
        for place, load in loads:
            names = [str(entry.get("material")) for entry in (body, *_parts(body))]
            key, problem = _NEEDS.get(str(load.get("type")), ("", ""))
            known = key and all(name in material for name in names)
            if known and all(material[name].get(key, 0) in (0, [0, 0, 0]) for name in names):
                _add(found, ("body", index, "load", place), problem, names[0],
                     f"{key} {'!= 0' if key.startswith('expansion') else '> 0'}")  # fmt: skip
        for kind in ("load", "support"):
            _amplitudes(document, body, ("body", index, kind), found)
    if document.get("body", []) == [] and document.get("prop", []) == []:
        _add(
            found,
            ("body",),
            "nothing is there",
            Words("no body and no prop"),
            "at least one [[body]]",
        )
    analysis = document.get("analysis", {})
    for key, what in (("load_factors", "load factors"), ("times", "times")):
        factors = analysis.get(key) if isinstance(analysis, Mapping) else None
        if isinstance(factors, list) and len(factors) == 1 and document.get("measure"):
            _add(found, ("analysis", key), "nothing to compare", Words("one frame"),
                 f"two {what} or more, the first one the reference")  # fmt: skip
    if (
        isinstance(document.get("measure"), list)
        and document["measure"]
        and (document.get("camera", []) == [])
    ):
        _add(
            found,
            ("camera",),
            "needs images to measure in",
            Words("no camera"),
            "at least one [[camera]]",
        )


def _shutters(document: Mapping[str, Any], found: Found) -> None:
    """What moves while a shutter is open depends on how fast frames follow each other."""
    analysis = document.get("analysis", {})
    rate = analysis.get("frame_rate_Hz") if isinstance(analysis, Mapping) else None
    for index, camera in _items(document, "camera"):
        shutter = camera.get("shutter")
        if not isinstance(shutter, Mapping):
            continue
        if rate is None:
            problem, wanted = "without a time between frames", "analysis.frame_rate_Hz beside it"
            _add(found, ("camera", index, "shutter"), problem, Words("a shutter"), wanted)
            continue
        exposure = shutter.get("exposure_ms", 0)
        if isinstance(exposure, int | float) and isinstance(rate, int | float) and rate > 0:
            most = 1000.0 / rate
            if not exposure <= most * (1 + 1e-9):
                _add(found, ("camera", index, "shutter", "exposure_ms"), "longer than a frame",
                     exposure, f"at most {most:g}")  # fmt: skip
