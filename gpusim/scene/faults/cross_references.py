"""Checks between tables of a scene: unique names, references that exist, physics that is complete.

They work on the plain document, before or without a full validation, so that their faults are told
together with the schema's. What isn't of the right shape is skipped here: the schema reports it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gpusim.errors import Fault, similar_name
from gpusim.scene.description.analysis.analysis_table import TABLES as ANALYSES
from gpusim.scene.description.analysis.analysis_table import frame_count
from gpusim.scene.description.material import FINITE_STRAIN, FLOWING, NO_FLOW
from gpusim.scene.description.measure_table import TABLES
from gpusim.scene.description.mesh import NOTCHABLE, SETS
from gpusim.scene.description.video import VideoTable, frame_rate_in, unknown_keys
from gpusim.scene.tables.table import Words, table_of, tables_of

from .faults import value_text
from .key_paths import Keys, dotted, listed
from .vibrations import vibration_faults

Found = list[tuple[Keys, Fault]]
Names = dict[str, None]  # in their order, and quick to look up
Item = tuple[int, dict[str, Any]]
_BITS = 31  # of a truth layer
_DICE = 10  # cameras in a file of DICe's
_OF_TYPE = "measure of a "
_SHADOWS = 32  # lamps that the renderer looks for shadows of
_HINTS = 50  # faults whose nearest word is looked for, which takes a while where there are many
_NEEDS = {
    "gravity": ("density_kg_m3", "gravity on a material without density"),
    "centrifugal": ("density_kg_m3", "rotation of a material without density"),
    "thermal": ("expansion_per_K", "heat on a material without thermal expansion"),
}


def check_document(document: Mapping[str, Any]) -> Found:
    """Faults between tables, each with the keys it is about."""
    checks = _Checks(document)
    checks.unique_names()
    checks.references_of_bodies()
    checks.references_of_measures()
    checks.loads()
    checks.geometry()
    checks.what_is_there()
    checks.fields()
    checks.poses()
    checks.calibration()
    checks.outputs()
    checks.films()
    checks.shutters()
    checks.shadows()
    for keys, *fault in vibration_faults(document):
        checks.add(keys, *fault)
    return checks.found


def _names(items: list[Item]) -> Names | None:
    """Names of the items; None if one has none, because a reference may mean that one."""
    names = [item.get("name") for _, item in items]
    texts = [name for name in names if isinstance(name, str)]
    return dict.fromkeys(texts) if len(texts) == len(names) else None


def _names_of_type(items: list[Item], kind: str) -> Names:
    """Names of the items of one type, as far as they have one."""
    return {
        item["name"]: None
        for _, item in items
        if item.get("type") == kind and isinstance(item.get("name"), str)
    }


def _marker_names(things: list[Item]) -> Names | None:
    """Names of the markers paints; None if a paint lacks its name or type."""
    paints = [paint for _, item in things for paint in tables_of(item, "paint")]
    texts = [(paint.get("name"), paint.get("type")) for _, paint in paints]
    if not all(isinstance(text, str) for pair in texts for text in pair):
        return None
    return _names_of_type(paints, "markers")


class _Checks:
    """A document, its lists of tables, and the faults that were found in it."""

    def __init__(self, document: Mapping[str, Any]) -> None:
        self.document, self.found = document, Found()
        self.analysis = table_of(document, "analysis")
        self.analysis_type = ANALYSES.get(str(self.analysis.get("type", "static")))
        self.rate = frame_rate_in(document)
        timed = {} if self.rate is None else {"frame_rate_Hz": self.rate}
        self.frames = frame_count({**self.analysis, **timed})
        self.frames_key = self.analysis_type.frames_key if self.analysis_type else "type"
        lists = ("material", "body", "prop", "camera", "measure", "variant")
        self.materials, self.bodies, self.props, self.cameras, self.measures, self.variants = (
            list(tables_of(document, key)) for key in lists
        )

    def add(self, keys: Keys, problem: str, got: Any, expected: str, hint: str = "") -> None:
        self.found.append((keys, Fault(dotted(keys), problem, value_text(got), expected, hint)))

    def refer(self, keys: Keys, value: Any, names: Names | None, what: str) -> None:
        """A reference to one of ``names``, which may be unknown (None)."""
        if names is None or not isinstance(value, str) or value in names:
            return
        near = similar_name(value, list(names)) if len(self.found) < _HINTS else ""
        expected = f"one of {listed(names)}" if names else f"a {what}, but there is none"
        hint = f"did you mean {near}?" if near else ""
        self.add(keys, f"no such {what}", value, expected, hint)

    def refer_each(self, keys: Keys, value: Any, names: Names | None, what: str) -> None:
        """The same of a key that may be a list."""
        for place, one in enumerate(value if isinstance(value, list) else ()):
            self.refer((*keys, place), one, names, what)
        self.refer(keys, value, names, what)

    def unique_names(self) -> None:
        def unique(prefix: Keys, table: Mapping[str, Any], key: str, seen: dict[str, Keys]) -> None:
            for index, item in tables_of(table, key):
                name, keys = item.get("name"), (*prefix, key, index, "name")
                if not isinstance(name, str):
                    continue
                first = seen.setdefault(name.casefold(), keys)  # names become file names
                if first != keys:
                    self.add(keys, "name used twice", name, f"another than {dotted(first)}")

        for key in ("material", "camera", "light", "measure", "variant"):
            unique((), self.document, key, {})
        self.files_of_measures()
        things: dict[str, Keys] = {}  # bodies and props are both things in the picture,
        paints: dict[str, Keys] = {}  # and measurements know paints by their name alone
        for key, items in (("body", self.bodies), ("prop", self.props)):
            unique((), self.document, key, things)
            for index, item in items:
                unique((key, index), item, "paint", paints)
        for index, body in self.bodies:
            for key in ("support", "load"):
                unique(("body", index), body, key, {})

    def files_of_measures(self) -> None:
        """No measure has the name of another one's files."""
        files = {
            f"{measure.get('name')}{ending}".casefold(): measure.get("name")
            for _, measure in self.measures
            for table in [TABLES.get(str(measure.get("type")))] if table
            for ending in table.endings
        }  # fmt: skip
        for index, measure in self.measures:
            name = measure.get("name")
            if isinstance(name, str) and name.casefold() in files:
                of = value_text(files[name.casefold()])
                self.add(("measure", index, "name"), f"files of measure {of} are called so", name,
                         "another name")  # fmt: skip

    def references_of_bodies(self) -> None:
        materials = _names(self.materials)
        for index, body in self.bodies:
            at: Keys = ("body", index)
            self.refer((*at, "material"), body.get("material"), materials, "material")
            for place, part in tables_of(body, "part"):
                keys = (*at, "part", place, "material")
                self.refer(keys, part.get("material"), materials, "material")
            mesh = body.get("mesh")
            sets = SETS.get(str(mesh.get("builder")) if isinstance(mesh, Mapping) else "")
            if sets is None:
                continue
            notches = len(list(tables_of(body, "notch")))
            names = dict.fromkeys([*sets, *(f"notch_{n}" for n in range(1, notches + 1))])
            for key in ("support", "load", "paint"):
                for place, entry in tables_of(body, key):
                    where = entry.get("where")
                    if isinstance(where, Mapping):
                        keys = (*at, key, place, "where", "set")
                        self.refer(keys, where.get("set"), names, "set of the mesh")

    def references_of_measures(self) -> None:
        """What the tables of each kind say that they name, and need."""
        names = {
            "camera": _names(self.cameras),
            "body": _names(self.bodies),
            "prop": _names(self.props),
            "variant": _names(self.variants),
            "paint": _names(
                [
                    paint
                    for _, thing in (*self.bodies, *self.props)
                    for paint in tables_of(thing, "paint")
                ]
            ),
            "markers paint on a body": _marker_names(self.bodies),
            "markers paint on a prop": _marker_names(self.props),
        }
        for index, measure in self.measures:
            table, at = TABLES.get(str(measure.get("type"))), ("measure", index)
            if table is None:
                continue
            for key, what in table.references.items():
                named: Names | None
                if what.startswith(_OF_TYPE):
                    named = _names_of_type(self.measures, what.removeprefix(_OF_TYPE))
                else:
                    named = names[what]
                *outer, last = key.split(".")
                holder = table_of(measure, outer[0]) if outer else measure
                self.refer_each((*at, *outer, last), holder.get(last), named, what)
            for keys, *fault in table.faults(measure, self.document):
                self.add((*at, *keys), *fault)

    def loads(self) -> None:
        """Held where they pull, on materials that feel them, with one factor per frame."""
        material = {str(m.get("name")): m for _, m in self.materials}
        for index, body in self.bodies:
            at: Keys = ("body", index)
            mesh = body.get("mesh")
            builder = mesh.get("builder") if isinstance(mesh, Mapping) else None
            if body.get("notch") and isinstance(builder, str) and builder not in NOTCHABLE:
                self.add((*at, "notch"), "in a mesh that can't have one", builder,
                         "builder " + " or ".join(NOTCHABLE))  # fmt: skip
            loads = list(tables_of(body, "load"))
            if loads and not body.get("support"):
                self.add((*at, "support"), "loaded but not held", Words("no support"),
                         "at least one [[body.support]]")  # fmt: skip
            parts = [part for _, part in tables_of(body, "part")]
            names = [str(entry.get("material")) for entry in (body, *parts)]
            for place, load in loads:
                key, problem = _NEEDS.get(str(load.get("type")), ("", ""))
                known = key and all(name in material for name in names)
                if known and all(material[name].get(key, 0) in (0, [0, 0, 0]) for name in names):
                    wanted = f"{key} {'!= 0' if key.startswith('expansion') else '> 0'}"
                    self.add((*at, "load", place), problem, names[0], wanted)
            for kind in ("load", "support"):
                for place, entry in tables_of(body, kind):
                    if "times_s" not in entry and self.frames_key != "type":
                        self._one_per_frame(
                            (*at, kind, place, "amplitude"), entry.get("amplitude"), "factor",
                            "frames in [analysis]",
                        )  # fmt: skip

    def geometry(self) -> None:
        """Nothing that linear theory doesn't know where that is asked for; no metal in elements
        that can't flow."""
        types = {str(one.get("name")): str(one.get("type")) for _, one in self.materials}
        linear = self.analysis.get("geometry") == "linear"
        for index, body in self.bodies:
            at: Keys = ("body", index)
            named = [((*at, "material"), body.get("material"))]
            named += [
                ((*at, "part", place, "material"), part.get("material"))
                for place, part in tables_of(body, "part")
            ]
            mesh = table_of(body, "mesh")
            for keys, name in named:
                kind = types.get(str(name))
                if linear and kind in FINITE_STRAIN:
                    self.add(keys, "of a type that linear theory doesn't know", kind,
                             'analysis.geometry = "nonlinear", or "auto"')  # fmt: skip
                if kind == "j2" and mesh.get("cells") == "tet4":
                    self.add((*at, "mesh", "cells"), NO_FLOW, "tet4", FLOWING)
            for place, load in tables_of(body, "load"):
                if linear and load.get("follows") is True:
                    self.add((*at, "load", place, "follows"), "in linear theory nothing turns",
                             True, 'analysis.geometry = "nonlinear", or "auto"')  # fmt: skip

    def _one_per_frame(self, keys: Keys, values: Any, what: str, of: str) -> None:
        if isinstance(values, list) and self.frames and len(values) != self.frames:
            self.add(keys, f"not one {what} per frame", Words(f"{len(values)} {what}s"),
                     f"{self.frames}, as many as {of}")  # fmt: skip

    def what_is_there(self) -> None:
        """Something to see, and to measure and compare, if it is to be measured."""
        document = self.document
        if document.get("body", []) == [] and document.get("prop", []) == []:
            got, wanted = Words("no body and no prop"), "at least one [[body]]"
            self.add(("body",), "nothing is there", got, wanted)
        kinds = [TABLES.get(str(measure.get("type"))) for _, measure in self.measures]
        least = max((kind.least_frames for kind in kinds if kind), default=0)
        if self.frames and self.frames < least:
            got = Words(f"{self.frames} frame{'s' * (self.frames > 1)}")
            self.add(("analysis", self.frames_key), "too few frames to measure in", got,
                     f"{least} or more, the first one the reference")  # fmt: skip
        measures = document.get("measure")
        if isinstance(measures, list) and measures and document.get("camera", []) == []:
            got, wanted = Words("no camera"), "at least one [[camera]]"
            self.add(("camera",), "needs images to measure in", got, wanted)

    def fields(self) -> None:
        """Displacements are given for every body, or for none."""
        if self.analysis_type is None:
            return
        kind = self.analysis.get("type", "static")
        for index, body in self.bodies:
            if self.analysis_type.given and "field" not in body:
                self.add(("body", index, "field"), "missing", Words(f'analysis.type = "{kind}"'),
                         "a field for every body, or type \"static\"")  # fmt: skip
            elif not self.analysis_type.given and "field" in body:
                self.add(("analysis", "type"), "of a scene whose displacements are given", kind,
                         f'"field", for body {value_text(body.get("name"))}')  # fmt: skip

    def poses(self) -> None:
        for index, prop in self.props:
            keys = ("prop", index, "poses")
            self._one_per_frame(keys, prop.get("poses"), "pose", "frames in [analysis]")

    def calibration(self) -> None:
        """Board, cameras and props exist."""
        calibration = self.document.get("calibration")
        if not isinstance(calibration, Mapping):
            return
        known = (
            ("board", _names_of_type(self.props, "plate"), "prop of type plate"),
            ("cameras", _names(self.cameras), "camera"),
            ("show", _names(self.props), "prop"),
        )
        for key, names, what in known:
            self.refer_each(("calibration", key), calibration.get(key), names, what)
        if not self.cameras:
            got, wanted = Words("no camera"), "at least one [[camera]]"
            self.add(("calibration",), "needs a camera", got, wanted)

    def outputs(self) -> None:
        """Cameras for those that are of cameras, and not more than they take."""
        output, cameras = table_of(self.document, "output"), len(self.cameras)
        if output.get("calibration") and not cameras:
            got, wanted = Words("no camera"), "at least one [[camera]]"
            self.add(("output", "calibration"), "needs a camera", got, wanted)
        for key, one, most, why in (
            ("truth", "cameras", _BITS, 'layer "cameras" has a bit per camera'),
            ("calibration", "dice", _DICE, '"dice" is a file of few cameras'),
        ):
            asked = output.get(key)
            if isinstance(asked, list) and one in asked and cameras > most:
                got, wanted = Words(f"{cameras} cameras"), f"at most {most}"
                self.add(("output", key), why, got, wanted)

    def films(self) -> None:
        """There are cameras that film, and one frame rate."""
        video, own = table_of(self.document, "video"), self.analysis.get("frame_rate_Hz")
        where = "video" if "video" in self.document else "analysis"
        self.refer_each(("video", "cameras"), video.get("cameras"), _names(self.cameras), "camera")
        if where == "video" and not self.cameras:
            got, wanted = Words("no camera"), "at least one [[camera]]"
            self.add(("video",), "needs a camera", got, wanted)
        rate = video.get("frame_rate_Hz", own)
        asked = where == "video" or "duration_s" in self.analysis
        if rate is self.rate is None and asked and not unknown_keys(video, VideoTable):
            got, wanted = Words("no frame_rate_Hz"), "frames per second, in [video] or [analysis]"
            self.add((where, "frame_rate_Hz"), "missing", got, wanted)
        if own not in (None, rate):
            wanted = f"{value_text(own)}, which analysis.frame_rate_Hz says, or one of them"
            self.add(("video", "frame_rate_Hz"), "said twice", rate, wanted)

    def shadows(self) -> None:
        """Every lamp casts shadows unless it says that it doesn't; surroundings cast none."""
        casting = [
            index
            for index, light in tables_of(self.document, "light")
            if light.get("type") in ("point", "spot", "area", "sun") and light.get("shadows", True)
        ]
        if len(casting) > _SHADOWS:
            self.add(
                ("light", casting[_SHADOWS]), "too many lamps that cast shadows",
                Words(str(len(casting))), f"at most {_SHADOWS}",
                "set shadows = false for lamps whose shadows don't matter",
            )  # fmt: skip

    def shutters(self) -> None:
        """What moves while a shutter is open depends on how fast frames follow each other."""
        rate, kind, video = self.rate, self.analysis_type, table_of(self.document, "video")
        shutters: list[tuple[Keys, Mapping[str, Any], str, float]] = [
            (("camera", index, "shutter"), table_of(camera, "shutter"), "exposure_ms", 1e3)
            for index, camera in self.cameras if "shutter" in camera
        ]  # fmt: skip
        shutters += [(("video",), video, "exposure_us", 1e6)] * ("exposure_us" in video)
        for at, shutter, key, per_second in shutters:
            if rate is None and not (kind and kind.vibrates):
                got, wanted = Words("a shutter"), "analysis.frame_rate_Hz beside it"
                if kind and "frame_rate_Hz" not in kind.model_fields:
                    wanted = "no shutter: frames show shapes, and nothing moves from one to another"
                self.add(at, "without a time between frames", got, wanted)
                continue
            exposure = shutter.get(key, 0)
            if isinstance(exposure, int | float) and isinstance(rate, int | float) and rate > 0:
                if not exposure <= per_second / rate * (1 + 1e-9):
                    wanted = f"at most {per_second / rate:g}"
                    self.add((*at, key), "longer than a frame", exposure, wanted)
