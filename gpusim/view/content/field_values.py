"""Fields of a content by name: of its bodies as they were solved, of the truth as a camera has it,
of what was measured on them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gpusim.arrays.array_types import Float
from gpusim.export.field_catalogue import BODY, TRUTH, Field
from gpusim.motion import Stepped
from gpusim.optics.camera.pinhole import Camera
from gpusim.validation import require_one_of
from gpusim.view.content.content import Content
from gpusim.view.content.measured_points import MeasuredPoints

STORED = ("displacement", "von_mises", "stress_", "principal_stress_")
"""How names of fields begin that need no model where the stress at nodes was written."""
KINDS = ("measured", "true", "levelled")
"""How names of measured fields begin that share a legend."""
LAYERS = ("depth", "flow", "displacement", "reference")
"""Truth that nodes have, whether or not a camera sees them."""
SEEN = [name for layer in LAYERS for name in TRUTH if name.split("_")[1] == layer]


@dataclass(frozen=True, eq=False)
class FieldValues:
    """A field in a frame: ``values`` of each body at its nodes or elements, or of ``points`` alone.

    ``legend``: values that the legend reaches over.
    """

    field: Field
    values: list[Float]
    legend: list[Float]
    points: MeasuredPoints | None = None


def field_names(content: Content | None) -> list[str]:
    """All that can be shown now."""
    if content is None or not content.skins or not content.moves or content.objects is None:
        return []
    solved = content.is_solvable and not content.unloaded
    displaced = any(isinstance(motion, Stepped) for motion in content.objects.motions)
    if displaced:  # their stress is what was written of it
        solved = content.stresses is not None
    without = {"element_von_mises"} if displaced else {"plastic_strain"}
    names = [name for name in BODY if solved or name.startswith("displacement")]
    names = [name for name in names if name not in without]
    if content.cameras:
        names += SEEN
    return [*names, *(f"{one.name}/{name}" for one in content.measured for name in one.fields)]


def field_of(content: Content, name: str, camera: int = 0) -> tuple[Field, MeasuredPoints | None]:
    """A field, whose title says what it is of, and the measurement if it is of one.

    ``camera``: whose truth it is.

    Raises
    ------
    InputError
        There is no such field.
    """
    measure, _, column = name.rpartition("/")
    points = next((one for one in content.measured if one.name == measure), None)
    if points is not None and column in points.fields:
        return _named(points.fields[column], measure), points
    if name in SEEN and content.cameras:
        return _named(replace(TRUTH[name], place="nodes"), content.cameras[camera].name), None
    require_one_of("field", name, dict.fromkeys([*BODY, *field_names(content)]))
    return BODY[name], None


def _named(field: Field, of: str) -> Field:
    return replace(field, title=f"{of}: {field.title}")


def field_values(content: Content, name: str, frame: int, camera: int = 0) -> FieldValues:
    """A field in a frame.

    Raises
    ------
    InputError
        There is no such field, or a body hasn't it.
    """
    field, points = field_of(content, name, camera)
    if points is not None:
        column = name.rpartition("/")[2]
        kind, _, quantity = column.partition("_")
        alike = [f"{one}_{quantity}" for one in KINDS] if kind in KINDS else [column]
        legend = [points.values(one, frame) for one in alike if one in points.fields]
        return FieldValues(field, [points.values(column, frame)], legend, points)
    bodies = range(len(content.skins))
    if name in SEEN:
        seen = content.cameras[camera]
        values = [field.values(_layers(content, body, frame, seen)) for body in bodies]
    else:
        solved = not name.startswith(STORED)
        values = [field.values(content.state(body, frame, solved)) for body in bodies]
    return FieldValues(field, values, values)


def _layers(content: Content, body: int, frame: int, camera: Camera) -> dict[str, Float]:
    """Layers of the truth at a body's nodes."""
    rest, u = content.skins[body].mesh.points, content.displacement(body, frame)
    flow = camera.project(rest) - camera.project(rest + u)
    depth = camera.to_camera(rest + u)[:, 2]
    return {"reference": rest, "displacement": u, "depth": depth, "flow": flow}
