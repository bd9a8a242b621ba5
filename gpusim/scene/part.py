"""Parts of a scene: a scene that has nothing but what a stage's key names.

A stage gets such a part in place of the scene, so that it can't depend on what its key doesn't
hold: to read anything else is an AttributeError.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from gpusim.scene.description.mesh import CAD_SUFFIXES
from gpusim.scene.description.model import (
    Body,
    CameraTable,
    OutputTable,
    SensorTable,
    TransientTable,
)
from gpusim.scene.scene import SECTIONS, Scene
from gpusim.scene.shared_tables import Digests, SharedTables

_OF_BODY = {
    "mesh": ("mesh",),
    "paint": ("paints",),
    "name": (),
    "formulation": ("formulation",),
    "solid": ("material", "parts", "formulation", "supports", "ties", "loads"),
    "mechanics": ("material", "parts", "formulation", "supports", "ties", "loads"),
}
"""Sections of a body, and its attributes; the name always goes with them. "solid": without the
factors by which loads and supports vary from frame to frame, "mechanics": with them."""


@dataclass(frozen=True)
class Part:
    """A ``scene`` with some sections alone, and a digest of each that tells whether it is the same,
    the content of its files included."""

    scene: Scene
    digests: Mapping[str, str]


class SceneParts:
    """Cuts parts out of a scene, one of those whose tables are ``known``."""

    def __init__(self, scene: Scene, known: SharedTables | None = None) -> None:
        self._scene = scene
        self._hashes = {
            json.dumps(path)[1:-1]: f"{sha256}{Path(path).suffix}{_mesher(path)}"
            for path, sha256 in scene.files
        }
        # files that the files name, by these names; the scene's own are what they hold
        self._included = "".join(
            f"{Path(path).name}: {one};" for path, one in self._hashes.items()
            if path not in scene.content
        )  # fmt: skip
        digests = {} if known is None else known.digests
        self._digests: Digests = digests.setdefault((scene.files, self._included), {})

    def of(self, *sections: str) -> Part:
        """The part with these sections: "light", "camera.front", "body.bar.mesh", "body.*.paint".

        ``"sensor.response"`` is the sensor without what makes its noise vary, ``"prop.still"``
        props without their poses; without a section of sensors, cameras have none of their own.
        Raises KeyError for an unknown section.
        """
        electric = next((one for one in sections if one.startswith("sensor")), "")
        values = {section: self._value(section, electric) for section in sections}
        digests = {one: self._digest(one, electric, value) for one, value in values.items()}
        is_read = any(reads for _, reads in digests.values())
        part = object.__new__(Scene)
        known: dict[str, Any] = {"source": self._scene.source}
        known["files"] = self._scene.files if is_read else ()
        for section, value in values.items():
            head = section.split(".")[0]
            _enter(known, SECTIONS[head], value)
        for name, value in known.items():
            object.__setattr__(part, name, value)
        return Part(part, {section: digest for section, (digest, _) in digests.items()})

    def _digest(self, section: str, electric: str, value: Any) -> tuple[str, bool]:
        """Of a section's text, in which a file is what it holds, wherever it lies, and whether
        there is one; made once for the same tables."""
        tables = self._tables(section)
        key = section, electric if section.startswith("camera") else "", *map(id, tables)
        if key not in self._digests:
            text = _encoded(value)
            named = [path for path in self._hashes if path in text]
            for path in sorted(named, key=len, reverse=True):
                text = text.replace(path, self._hashes[path])
            if named:  # it may name others
                text += self._included
            digest = hashlib.sha256(text.encode()).hexdigest()[:16]
            self._digests[key] = tables, digest, bool(named)
        _, digest, reads = self._digests[key]
        return digest, reads

    def _tables(self, section: str) -> list[Any]:
        """What a section is cut from."""
        head, *rest = section.split(".")
        whole = getattr(self._scene, SECTIONS[head])
        if head != "body":
            return [*whole] if isinstance(whole, tuple) else [whole]
        names = ("name", *_OF_BODY[rest[1]]) if rest[1:] else [one.name for one in fields(Body)]
        return [getattr(body, name) for body in _named(whole, rest[:1]) for name in names]

    def _value(self, section: str, electric: str) -> Any:
        head, *rest = section.split(".")
        whole = getattr(self._scene, SECTIONS[head])
        if section == "sensor.response":
            return _response(whole)
        if section == "prop.still":
            return tuple(prop.model_copy(update={"poses_": None}) for prop in whole)
        if section == "analysis.base_motion":
            known: dict[str, Any] = {"type": "transient", "duration_s": 1.0, "frame_rate_Hz": 1.0}
            return TransientTable.model_construct(**known, base_motion=whole.base_motion)
        if section == "output.truth":
            return OutputTable.model_construct(truth=whole.truth)
        if section == "output.calibration":
            return OutputTable.model_construct(calibration=whole.calibration)
        if section == "output.meshes":
            return OutputTable.model_construct(vtu=whole.vtu, stl=whole.stl, stress=whole.stress)
        if head == "camera":
            return tuple(_equipped(camera, electric) for camera in _named(whole, rest))
        if head == "body" and len(rest) == 2:
            return tuple(_cut(body, rest[1]) for body in _named(whole, rest[:1]))
        return _named(whole, rest) if rest else whole


def _mesher(path: str) -> str:
    """What a CAD file's mesh depends on beside the file: another Gmsh makes other nodes."""
    is_cad = Path(path).suffix.lower() in CAD_SUFFIXES
    with suppress(PackageNotFoundError):  # some other Gmsh, of which nothing is known, or none
        return version("gmsh") if is_cad else ""
    return ""


def _named(tables: tuple[Any, ...], names: list[str]) -> tuple[Any, ...]:
    """The tables of a name; all for none or "*". Raises KeyError if there is none."""
    if not names or names == ["*"]:
        return tables
    (name,) = names
    found = tuple(table for table in tables if table.name == name)
    if not found:
        raise KeyError(name)
    return found


def _enter(known: dict[str, Any], name: str, value: Any) -> None:
    """Enter a section; bodies of which several sections are named become one each."""
    if name == "bodies" and name in known:
        by_name = {body.name: body for body in known[name]}
        for body in value:
            if body.name in by_name:
                for attribute, own in vars(body).items():
                    object.__setattr__(by_name[body.name], attribute, own)
            else:
                by_name[body.name] = body
        value = tuple(by_name.values())
    known[name] = value


def _cut(body: Body, section: str) -> Body:
    """A body with one section alone."""
    part = object.__new__(Body)
    for name in ("name", *_OF_BODY[section]):
        value = getattr(body, name)
        if section == "solid" and name in ("supports", "loads"):
            value = tuple(driven.undriven() for driven in value)
        object.__setattr__(part, name, value)
    return part


def _equipped(camera: CameraTable, sensor: str) -> CameraTable:
    """A camera with its own sensor as the section ``sensor`` has it, or without."""
    if camera.electronics is None and camera.own_sensor is None:
        return camera
    part = camera.model_copy(update={"own_sensor": None})
    electronics = camera.electronics if sensor else None
    if electronics is not None and sensor == "sensor.response":
        electronics = _response(electronics)
    part._electronics = electronics
    return part


def _response(sensor: SensorTable) -> SensorTable:
    defaults = type(sensor).model_fields
    names = ("seed", "series", "drift_percent")
    return sensor.model_copy(update={name: defaults[name].default for name in names})


def _plain(value: object) -> Any:
    """Plain data of a table: all that anybody can read of it."""
    if isinstance(value, BaseModel):
        own = {name: value.__dict__[name] for name in type(value).model_fields}
        return [type(value).__name__, own, value.__pydantic_private__ or {}]
    if is_dataclass(value) and not isinstance(value, type):
        present = [one.name for one in fields(value) if one.name in vars(value)]
        return [type(value).__name__, {name: vars(value)[name] for name in present}]
    raise TypeError(f"{type(value).__name__}: no plain data")


_encoded = json.JSONEncoder(default=_plain, sort_keys=True).encode
