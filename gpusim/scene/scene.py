"""``Scene``: everything a run needs, validated, in SI, and able to say what it was read from; and
how its file is read."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from gpusim.display import notebook_html, notebook_view, plotted
from gpusim.errors import Fault, InputError, SceneError
from gpusim.field_summary import field_summary
from gpusim.files.input_file import InputFile, read_input
from gpusim.scene.faults.cross_references import check_document
from gpusim.scene.faults.faults import MOST, faults_of, unread, with_origin
from gpusim.scene.faults.key_paths import (
    Keys,
    Origins,
    key_lines,
    overridden,
    pick,
    put,
    with_names,
)

from .camera_tables import CameraTables
from .description import model
from .description.measure_table import TABLES
from .description.scene_table import SceneTable
from .files import find_files
from .measure_kinds import load_kinds
from .shared_tables import SharedTables
from .toml_text import document_fault, parse_toml, size_fault, toml_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTIONS = {
    "name": "name", "description": "description", "material": "materials", "body": "bodies",
    "prop": "props", "analysis": "analysis", "solver": "solver", "camera": "cameras",
    "light": "lights", "render": "render", "sensor": "sensor", "measure": "measures",
    "variant": "variants", "output": "output", "calibration": "calibration",
    "video": "video",
}  # fmt: skip
"""Sections of the file, and what a `Scene` calls them."""


@dataclass(frozen=True)
class Scene:
    """A validated scene. All values are SI; ``content`` is the resolved file (JSON) behind them,
    ``files`` those that it needs, and those which they name: (absolute path, SHA-256).

    Two scenes are equal if they say the same; where they were read from doesn't matter.

    Examples
    --------
    >>> scene = gs.load_scene("bar.toml")
    >>> [camera.name for camera in scene.cameras]
    ['side']
    """

    name: str
    description: str
    materials: tuple[model.MaterialTable, ...]
    bodies: tuple[model.Body, ...]
    props: tuple[model.Prop, ...]
    analysis: model.AnalysisTable
    solver: model.SolverTable
    cameras: CameraTables
    lights: tuple[model.Light, ...]
    render: model.RenderTable
    sensor: model.SensorTable
    measures: tuple[model.MeasureTable, ...]
    variants: tuple[model.VariantTable, ...]
    output: model.OutputTable
    calibration: model.CalibrationTable | None
    video: model.VideoTable | None
    content: str = field(repr=False)
    source: str = field(default="scene", compare=False)
    files: tuple[tuple[str, str], ...] = ()
    __repr__ = field_summary

    def __post_init__(self) -> None:
        tables = CameraTables(self.cameras)
        tables.read = self.input
        object.__setattr__(self, "cameras", tables)

    def __getstate__(self) -> dict[str, Any]:
        """Without what was made of it."""
        return {name: value for name, value in vars(self).items() if not name.startswith("_")}

    @classmethod
    def from_document(
        cls,
        document: Mapping[str, Any],
        *,
        source: str = "scene",
        origins: Origins | None = None,
        overrides: Mapping[str, Any] | None = None,
        folder: str | Path = ".",
        files: Iterable[tuple[str, str]] = (),
        resolved: bool = False,
        known: SharedTables | None = None,
    ) -> Scene:
        """Validate a plain document (nested dicts and lists, keys as in the file).

        ``origins`` tells the line of each key for messages. ``overrides`` (dotted path -> value)
        come first; mesh files are looked for in ``folder``. ``files``: what is known of them; one
        that was changed since is a fault. ``resolved``: it is a scene's `document`, and those are
        its files; ``known``: tables of others that were made of it. Raises SceneError with every
        fault of document and overrides.
        """
        origins = origins or {}
        for given in (*([] if resolved else [document]), overrides or {}):
            if wrong := document_fault(given):
                raise SceneError(source, [wrong])
        plain = dict(document) if resolved else copy.deepcopy(dict(document))
        faults: list[Fault] = []
        changed: list[Keys] = []
        for path, value in (overrides or {}).items():
            done = put(plain, path, value)
            if isinstance(done, Fault):
                faults.append(done)
            else:
                changed.append(done)
        origins = overridden(origins, changed)
        unread, hashes = find_files(plain, Path(folder), dict(files), resolved)
        load_kinds(plain)
        table, more = None, 0
        try:
            table = known.validated(plain) if known else SceneTable.model_validate(plain)
        except ValidationError as error:
            found, more = faults_of(error, origins)
            faults += found
        between = [*unread, *check_document(plain)]
        faults += [with_origin(fault, keys, origins) for keys, fault in between]
        if not faults and table is not None:
            faults += variant_faults(plain, folder, hashes)
        if faults or table is None:
            more += max(len(faults) - MOST, 0)
            named = ((one.place or with_names(plain, one.key), one) for one in faults[:MOST])
            raise SceneError(source, [replace(one, place=place) for place, one in named], more)
        return cls._of_table(table, source, hashes)

    @classmethod
    def _of_table(cls, table: SceneTable, source: str, files: tuple[tuple[str, str], ...]) -> Scene:
        """What a table without faults says, bodies with the materials that they name, frames and
        cameras with the rate and the exposure of [video]."""
        materials = {entry.name: entry for entry in table.material}
        factors = table.analysis.load_factors
        said = {name: getattr(table, section) for section, name in SECTIONS.items()}
        said["analysis"], said["cameras"] = table.filmed()
        said["bodies"] = tuple(entry.resolved(materials, factors) for entry in table.body)
        content = table.model_dump(mode="json", by_alias=True, exclude_none=True)
        return cls(**said, content=json.dumps(content), source=source, files=files)

    def _repr_html_(self) -> str | None:
        return notebook_html("scene", self)

    def plot(self, ax: Axes | None = None, *, plane: str = "xy", **style: Any) -> Axes:
        """Draw bodies, props, lamps, and cameras with what they see, in matplotlib's axes, in mm.

        ``plane``: "xy" from above, "xz" from the front, "yz" from the right. ``style``: ``color``
        of the bodies, and what ``Axes.plot`` takes for cameras. Returns the axes.
        """
        return plotted("scene", self, ax, plane=plane, **style)

    def view(self, camera: str | None = None, size: tuple[int, int] = (960, 600)) -> Any:
        """A widget of the notebook that shows the scene as `gpusim view` does, to be turned with
        the mouse; a still picture where there is no notebook, or the extra ``[notebook]`` is
        missing.

        ``camera``: looked through; by default one that bodies just fill. ``size``: px, at most.
        """
        return notebook_view(self, camera, size)

    def surfaces(self, frame: int | None = None) -> list[Any]:
        """Bodies and props in a frame (None: unloaded), deformed and painted, as `gs.render` takes
        them, made once. Raises InputError, and what a run raises.

        Examples
        --------
        >>> scene = gs.load_scene("bar.toml")
        >>> gs.render(scene.surfaces(1), scene.cameras()["side"], backend="numpy").radiance.shape
        (120, 450)
        """
        surfaces: list[Any] = self._contents.surfaces(frame)
        return surfaces

    def motion(self) -> Any:
        """What is true of material points, at any places of a camera's picture
        (`gpusim.pipeline.measurements.material_points.TrueMotion`)."""
        places = import_module("gpusim.pipeline.measurements.material_points")
        return places.TrueMotion(self._contents)

    def solution(self) -> dict[str, Any]:
        """By body: ``mesh``, and ``displacement`` and ``reactions`` in a frame
        (`gpusim.pipeline.runner.scene_contents.BodySolution`); solved, or read from its field.

        Examples
        --------
        >>> gs.load_scene("bar.toml").solution()["bar"].displacement(1).shape
        (78, 3)
        """
        solutions: dict[str, Any] = self._contents.body_solutions()
        return solutions

    @cached_property
    def _contents(self) -> Any:
        # what reads scenes knows no numerics
        return import_module("gpusim.pipeline.runner.scene_contents").scene_contents(self)

    @property
    def measures_space(self) -> bool:
        """Whether something is measured with the cameras that [calibration] calibrates."""
        return any(one.uses_calibration for one in self.measures)

    @property
    def reads_files(self) -> bool:
        """Whether there is something in files, or in a lens, that only the numerics can check."""
        paints = [paint for thing in (*self.bodies, *self.props) for paint in thing.paints]
        return (
            any(camera.calibration or camera.distortion for camera in self.cameras)
            or any(_is_read(body.mesh) for body in self.bodies)
            or self.analysis.moves_ground
            or any(isinstance(paint, model.PictureTable) for paint in paints)
            or any(
                isinstance(light, model.EnvironmentTable) and light.path for light in self.lights
            )
        )

    def input(self, path: str) -> InputFile:
        """One of `files`, read. Raises InputError if it isn't what it was when the scene was made,
        and for a file that isn't the scene's."""
        known = dict(self.files)
        if path not in known:
            raise InputError(f"{path}: no file of {self.source}; expected one of {list(known)}")
        return read_input(path, sha256=known[path], known=known)

    def sensor_of(self, camera: str) -> model.SensorTable:
        """The sensor of the camera of that name: its own, or that of all. Raises KeyError."""
        for one in self.cameras:
            if one.name == camera:
                return one.electronics or self.sensor
        raise KeyError(camera)

    @property
    def document(self) -> dict[str, Any]:
        """A fresh copy of the resolved document, defaults filled in, units as in the file."""
        content: dict[str, Any] = json.loads(self.content)
        return content

    def replace(self, path: str, value: Any) -> Scene:
        """A new scene with one key changed: ``replace("camera.front.focal_mm", 35.0)``.

        List items go by index or by their name. Raises SceneError like a file with that value.
        """
        own, given = self.document, {path: value}
        return Scene.from_document(own, source=self.source, overrides=given, files=self.files)

    def with_effects(self, only: Sequence[str] | str = (), no: Sequence[str] | str = ()) -> Scene:
        """The scene with ``only`` these effects of `gpusim.scene.effects` (none given: all), and
        without those in ``no``. Raises InputError for an unknown effect, or a distortion that a
        calibration file would undo all the same."""
        from .effects import lenses_of_files, with_only, without_effects

        only, no = ([one] if isinstance(one, str) else one for one in (only, no))
        document = self.document
        for camera, measure in lenses_of_files(document).items() if "distortion" in no else ():
            raise InputError(
                f"--no distortion; got camera {camera!r}, whose lens measure {measure!r} undoes "
                f"by its calibration file; expected measure.{measure}.calibration=true"
            )
        if only:
            document = with_only(document, only)
        document = without_effects(document, no)
        if not only and not no:
            return self
        return Scene.from_document(document, source=self.source, files=self.files)

    def variant(self, name: str) -> Scene:
        """The scene in the state of one variant, without variants and their comparison.

        Raises SceneError if there is no such variant.
        """
        for index, entry in enumerate(self.variants):
            if entry.name == name:
                own = without_variants(self.document)
                source = f"{self.source}, variant {name}"
                # noise that states share would cancel in their difference
                changes = {"sensor.series": self.sensor.series + index, **entry.changes}
                return Scene.from_document(own, source=source, overrides=changes, files=self.files)
        names = ", ".join(entry.name for entry in self.variants) or "none"
        raise SceneError(self.source, [Fault("variant", "no such variant", name, names)])

    def to_toml(self) -> str:
        """The resolved scene as a TOML text that reads back to an equal scene."""
        return self._toml

    @cached_property
    def _toml(self) -> str:
        return toml_text(self.document)

    def digest(self, *sections: str) -> str:
        """SHA-256 over the resolved content of ``sections`` (dotted paths; none: the whole scene).

        ``"body.*.mesh"`` covers every body's mesh, ``"camera.front"`` one camera. Comments, the
        order of keys, how a number is written, and what a section doesn't hold don't matter.
        """
        document = self.document
        parts = {path: pick(document, path) for path in sections} if sections else document
        if not sections or any(_holds_mesh(path.split(".")) for path in sections):
            parts["mesh files"] = [content for _, content in self.files]
        text = json.dumps(parts, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()


def load_scene(
    path: str | PathLike[str] | InputFile, overrides: Mapping[str, Any] | None = None
) -> Scene:
    """Read, validate and resolve a TOML scene file.

    ``overrides`` maps dotted key paths to values ("solver.tolerance": 1e-9) and wins over the
    file. Raises SceneError with every fault: an unreadable, too large or too deeply nested file,
    TOML syntax, unknown or missing keys, wrong types and ranges, references that don't fit.

    Examples
    --------
    >>> scene = gs.load_scene("bar.toml", {"solver.tolerance": 1e-4})
    >>> scene.name, scene.solver.tolerance
    ('bar', 0.0001)
    """
    place = path.path if isinstance(path, InputFile) else Path(path)
    source = str(place)
    if fault := size_fault(place):
        raise SceneError(source, [fault])
    try:
        text = read_input(path, "a scene file").text("TOML in UTF-8")
    except InputError as error:
        raise SceneError(source, [unread(error, "file", place)]) from None
    document = parse_toml(text)
    if isinstance(document, Fault):
        raise SceneError(source, [document])
    if isinstance(document.get("scene"), str) and "schema" not in document:
        expected = "a scene, or gpusim study in place of this"
        raise SceneError(source, [Fault("scene", "is that of a study", expected=expected)])
    return Scene.from_document(
        document, source=source, origins=key_lines(text), overrides=overrides, folder=place.parent
    )


def without_variants(document: Mapping[str, Any]) -> dict[str, Any]:
    """A document less its variants and what compares them."""
    plain = copy.deepcopy({key: value for key, value in document.items() if key != "variant"})
    measures = plain.get("measure")
    if isinstance(measures, list):
        plain["measure"] = [m for m in measures if not TABLES[m["type"]].compares_variants]
    return plain


def variant_faults(
    document: Mapping[str, Any], folder: str | Path, files: Iterable[tuple[str, str]] = ()
) -> list[Fault]:
    """What is wrong with the states that the variants describe, if the scene itself is right."""
    faults = []
    for index, entry in enumerate(document.get("variant", [])):
        try:
            Scene.from_document(
                without_variants(document), overrides=entry.get("set", {}), folder=folder,
                files=files,
            )  # fmt: skip
        except SceneError as error:
            for one in error.faults:
                ends = f"variant.{index}.set", f"variant.{entry['name']}.set"
                key, place = (f"{ends[k]} -> {(one.key, one.place)[k]}" for k in (0, 1))
                faults.append(replace(one, key=key, place=place))
    return faults


def _is_read(mesh: model.MeshRecipe) -> bool:
    """Whether it is in a file that is read as it is; a CAD file is meshed, which takes longer."""
    if isinstance(mesh, model.FileMeshTable):
        return mesh.size is None
    return isinstance(mesh, model.FieldMeshTable)


def _holds_mesh(keys: list[str]) -> bool:
    """Whether a section has a body's mesh, its field, or a prop's file in it."""
    return keys[0] == "prop" or (
        keys[0] == "body" and (len(keys) < 3 or keys[2] in ("mesh", "field"))
    )
