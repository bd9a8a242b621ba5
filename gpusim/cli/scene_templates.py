"""Commented scenes made from templates: of a part of the user's own, and of what is there."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
from collections.abc import Iterable
from pathlib import Path
from string import Template

import numpy as np

from gpusim.applications.part_outline import PartOutline, part_outline
from gpusim.arrays.array_types import Float
from gpusim.printable import printable
from gpusim.scene import load_scene
from gpusim.scene.description.measure_table import TABLES
from gpusim.scene.description.mesh import CAD_SUFFIXES

OWN = Path(__file__).parent / "templates"
_PIXELS, _FOCAL = (2448, 2048), 35.0 / 3.45e-3  # of the templates' cameras: px, focal length in px
_MARGIN, _HALF_ANGLE, _CELL = 1.15, 10.0, 90  # around the part; degrees; field of the board, px
_STRESS, _LISTED = 60.0, 40  # MPa in the mean section; faces that are listed
_PLATE = ((-0.05, -0.02, 0.0), (0.05, 0.02, 0.003))  # corners of plate_with_hole.toml's body, m
_TILTS = (
    [-14.0, 20.0, 12.0], [16.0, -12.0, -10.0], [-20.0, -5.0, 8.0], [12.0, 18.0, -14.0],
    [0.0, 0.0, 0.0], [-16.0, -20.0, 10.0], [22.0, 6.0, 15.0], [-6.0, 24.0, -9.0],
    [18.0, -18.0, 5.0], [-24.0, 10.0, -12.0], [8.0, -24.0, 14.0], [-10.0, -14.0, -15.0],
)  # fmt: skip
"""Of the board, degrees about x, y and z."""


def _filled(template: str, **values: str) -> str:
    """The text of a template; with a measurement, where there is a kind for that."""
    dic = (OWN / "dic.toml").read_text(encoding="utf-8") if "dic" in TABLES else ""
    text = (OWN / template).read_text(encoding="utf-8").replace("$dic", dic)
    comment = re.compile(r"^([^#\n]*?) +# (.*)$", re.MULTILINE)
    return comment.sub(lambda line: f"{line[1]:<35} # {line[2]}", Template(text).substitute(values))


def scene_of_template(path: Path, output: Path) -> str:
    """The text of a template; the files that an example needs are copied beside the scene."""
    text = path.read_text(encoding="utf-8")
    if path.parent == OWN:
        low, high, normal = np.array(_PLATE[0]), np.array(_PLATE[1]), np.eye(3)[2]
        return _filled(path.name, scene=shlex.quote(str(output)), **_rig(low, high, normal))
    for name, _ in load_scene(path).files:
        place = output.parent / Path(name).relative_to(path.parent)
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(name, place)
    return text.replace(f"examples/{path.name}", str(output))


def scene_of_part(path: Path, output: Path) -> str:
    """The text of a scene of a CAD or mesh file: held at one end, pulled at the other."""
    part = part_outline(path)
    meshing = 'unit = "mm" # of the file: m, cm, mm, um or in'
    if path.suffix.lower() in CAD_SUFFIXES:
        meshing = (f"size_mm = {_short(1e3 * part.element_size)} # greatest element\n"
                   "order = 2 # with midside nodes: bends well")  # fmt: skip
    force = [0.0, 0.0, 0.0]
    section = part.volume / (part.high - part.low)[part.axis]
    force[part.axis] = float(f"{_STRESS * 1e6 * section:.1g}")
    relative = Path(os.path.relpath(path.resolve(), output.parent.resolve())).as_posix()
    face = part.broadside()
    assert face.normal is not None  # broadsides have one
    name = json.dumps(face.name, ensure_ascii=False)
    curved = f'{{ normal = {name} }}\nmapping = "unfold" # round curved faces'
    return _filled(
        "part.toml", scene=shlex.quote(str(output)), file=printable(path.name),
        title=json.dumps(path.stem, ensure_ascii=False), name=output.stem,
        path=json.dumps(relative, ensure_ascii=False),
        meshing=meshing, low=_mm(part.low), high=_mm(part.high), axis="xyz"[part.axis],
        faces="\n".join(_face_lines(part)) or "#   (the file names none)",
        held=_end(part, -1), pulled=_end(part, 1), force=str(force),
        painted=curved if face in part.sides else f"{{ set = {name} }}",
        **_rig(part.low, part.high, face.normal),
    )  # fmt: skip


def _face_lines(part: PartOutline) -> Iterable[str]:
    wide = max((len(face.name) for face in part.faces), default=0)
    for face in part.faces[:_LISTED]:
        looks = "" if face.normal is None else f" that looks {_direction(face.normal)}"
        place = f"at {_mm(face.centre)}, {1e6 * face.area:.4g} mm2"
        yield f"#   {face.name:<{wide}}  {face.kind}{looks}, {place}"
    if len(part.faces) > _LISTED:
        yield f"#   and {len(part.faces) - _LISTED} smaller ones"


def _end(part: PartOutline, sign: int) -> str:
    """Where it is held or pulled: a plane that closes it there, or its last tenth."""
    face = part.end(sign)
    if face is not None:
        return f"{{ set = {json.dumps(face.name, ensure_ascii=False)} }}"
    low, high = (1e3 * float(end[part.axis]) for end in (part.low, part.high))
    axis = "xyz"[part.axis]
    if sign < 0:
        return f"{{ {axis}_max_mm = {low + 0.1 * (high - low):.6g} }}"
    return f"{{ {axis}_min_mm = {high - 0.1 * (high - low):.6g} }}"


def _rig(low: Float, high: Float, normal: Float) -> dict[str, str]:
    """Two cameras that see all of a box, its longer side level, from where ``normal`` points; the
    speckle for them, and a board with its poses to calibrate them."""
    sides, centre = high - low, 0.5 * (low + high)
    up = np.eye(3)[int(np.argmin(np.where(np.abs(normal) > 0.7, np.inf, sides)))]
    right = np.cross(up, normal) / np.linalg.norm(np.cross(up, normal))
    top = np.cross(normal, right)
    wide, tall, deep = (float(np.abs(way) @ sides) for way in (right, top, normal))
    pixel = _MARGIN * max(wide / _PIXELS[0], tall / _PIXELS[1])  # m
    away, angle = pixel * _FOCAL + 0.5 * deep, np.deg2rad(_HALF_ANGLE)
    left, other = (centre + away * (np.cos(angle) * normal + side * np.sin(angle) * right)
                   for side in (-1.0, 1.0))  # fmt: skip
    cell = float(_short(1e3 * _CELL * pixel)) * 1e-3
    poses = []
    for k, tilt in enumerate(_TILTS):
        shift = (
            300 * (k % 3 - 1) * right + 150 * (k // 3 % 3 - 1) * top + 250 * (k % 4 - 1) * normal
        )
        poses.append(f"  {{ position_mm = {_mm(centre + pixel * shift)}, rotation_deg = {tilt} }},")
    return {
        "left": _mm(left), "right": _mm(other), "target": _vector(1e3 * centre, 12),
        "up": _vector(up, 1),
        "pixel": f"{1e3 * pixel:.2g}", "speckle": _short(4e3 * pixel), "soft": _short(500 * pixel),
        "normal": _vector(normal, 12), "cell": _short(1e3 * cell), "poses": "\n".join(poses),
        "board": _mm(np.array([13.0, 10.0]) * cell),
        "corner": _vector(1e3 * (centre - cell * (6.0 * right + 4.5 * top)), 12),
    }  # fmt: skip


def _mm(place: Float) -> str:
    return _vector(1e3 * place, 5)


def _direction(normal: Float) -> str:
    axis = int(np.argmax(np.abs(normal)))
    if abs(normal[axis]) > 1.0 - 1e-6:
        return f"{'+' if normal[axis] > 0 else '-'}{'xyz'[axis]}"
    return _vector(normal, 3)


def _vector(values: Float, digits: int) -> str:
    """A list of floats as TOML has it; what is zero but for rounding is 0.0."""
    clean = np.where(np.abs(values) > 1e-9 * np.abs(values).max(), values, 0.0)
    return str([float(f"{value:.{digits}g}") for value in clean])


def _short(value: float) -> str:
    """Two digits are enough for what is to be changed."""
    return str(float(f"{value:.2g}"))
