"""``gpusim init``: a first scene, of a part of the user's own or from a template.

Templates are the files of `templates` beside this module, and the examples.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Iterable
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from gpusim.cli.console import definition_list, exit_codes, out
from gpusim.errors import InputError, nearest_name
from gpusim.validation import require

if TYPE_CHECKING:
    from gpusim.applications.part_outline import PartOutline
    from gpusim.arrays.array_types import Float

_OWN = Path(__file__).parent / "templates"
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


def templates() -> dict[str, Path]:
    """Scenes to start from, by name."""
    package = Path(__file__).parents[1]
    folder = next(one for one in (package / "examples", package.parent / "examples")
                  if one.is_dir())  # fmt: skip
    found = {"plate_with_hole": _OWN / "plate_with_hole.toml"}
    return found | {path.stem: path for path in sorted(folder.glob("*.toml"))}


def template_names(incomplete: str) -> list[str]:
    """Those that begin so, for the shell."""
    return [name for name in templates() if name.startswith(incomplete)]


def init(
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="PART|TEMPLATE",
            autocompletion=template_names,
            help="A CAD or mesh file (.step .stp .brep .stl .msh .inp ...), or a template's name.",
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE.toml", help="The scene to write.")
    ] = Path("scene.toml"),
    listed: Annotated[bool, typer.Option("--list", help="List the templates.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite what is there.")] = False,
) -> None:
    """Write a commented scene to start from: of your own part, or from a template.

    gpusim init part.step -o part.toml

    gpusim init plate_with_hole
    """
    with exit_codes():
        known = templates()
        if listed or source is None:
            from rich.console import Console

            rows = ((name, _about(path)) for name, path in known.items())
            Console(highlight=False).print(definition_list(rows))
            out("\n  gpusim init NAME, or of your own part: gpusim init part.step")
            return
        path = Path(source)
        if source not in known:
            expected = f"a CAD or mesh file, or one of {', '.join(known)}"
            hint = nearest_name(source, known)
            require(path.is_file(), "init: no such file or template", source, expected + hint)
        if output.exists() and not force:
            raise InputError(f"{output}: is there already; expected another -o, or --force")
        text = _of_template(known[source], output) if source in known else _of_part(path, output)
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_text(text, encoding="utf-8")
        out(f"{output} is written. Next:\n")
        for words in ("plan", "view", f"run  -o out/{output.stem}"):
            command, *rest = words.split("  ")
            out("  " + " ".join(["gpusim", command, str(output), *rest]))


def _about(path: Path) -> str:
    """The first sentence of a template."""
    head = path.read_text(encoding="utf-8").partition("\n#\n")[0]
    return re.split(r"(?<=[.?]) ", head.replace("\n# ", " ").removeprefix("# "))[0]


def _filled(template: str, **values: str) -> str:
    """The text of a template; with a measurement, where there is a kind for that."""
    from gpusim.scene.description.measure_table import TABLES

    dic = (_OWN / "dic.toml").read_text(encoding="utf-8") if "dic" in TABLES else ""
    text = (_OWN / template).read_text(encoding="utf-8").replace("$dic", dic)
    comment = re.compile(r"^([^#\n]*?) +# (.*)$", re.MULTILINE)
    return comment.sub(lambda line: f"{line[1]:<35} # {line[2]}", Template(text).substitute(values))


def _of_template(path: Path, output: Path) -> str:
    """The text of a template; the files that an example needs are copied beside the scene."""
    text = path.read_text(encoding="utf-8")
    if path.parent == _OWN:
        low, high, normal = np.array(_PLATE[0]), np.array(_PLATE[1]), np.eye(3)[2]
        return _filled(path.name, scene=str(output), **_rig(low, high, normal))
    from gpusim.scene import load_scene

    for name, _ in load_scene(path).files:
        place = output.parent / Path(name).relative_to(path.parent)
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(name, place)
    return text.replace(f"examples/{path.name}", str(output))


def _of_part(path: Path, output: Path) -> str:
    """The text of a scene of a CAD or mesh file: held at one end, pulled at the other."""
    from gpusim.applications.part_outline import part_outline
    from gpusim.scene.description.mesh import CAD_SUFFIXES

    part = part_outline(path)
    meshing = 'unit = "mm"'
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
        "part.toml", scene=str(output),
        file=path.name, name=path.stem, path=json.dumps(relative, ensure_ascii=False),
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
        "left": _mm(left), "right": _mm(other), "target": _mm(centre), "up": _vector(up, 1),
        "pixel": f"{1e3 * pixel:.2g}", "speckle": _short(4e3 * pixel), "soft": _short(500 * pixel),
        "normal": _vector(normal, 6), "cell": _short(1e3 * cell), "poses": "\n".join(poses),
        "board": _mm(np.array([13.0, 10.0]) * cell),
        "corner": _mm(centre - cell * (6.0 * right + 4.5 * top)),
    }  # fmt: skip


def _mm(place: Float) -> str:
    return _vector(1e3 * place, 5)


def _direction(normal: Float) -> str:
    axis = int(np.argmax(np.abs(normal)))
    if abs(normal[axis]) > 1.0 - 1e-6:
        return f"{'+' if normal[axis] > 0 else '-'}{'xyz'[axis]}"
    return _vector(normal, 3)


def _vector(values: Float, digits: int) -> str:
    """A list of floats as TOML has it, without minus zeros."""
    return str([float(f"{value:.{digits}g}") + 0.0 for value in values.round(4)])


def _short(value: float) -> str:
    """Two digits are enough for what is to be changed."""
    return str(float(f"{value:.2g}"))
