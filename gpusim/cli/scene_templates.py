"""Commented scenes made from templates: of a part of the user's own, and of what is there."""

from __future__ import annotations

import json
import os
import shlex
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from gpusim.arrays.array_types import Float
from gpusim.errors import require
from gpusim.files.atomic_files import write_bytes
from gpusim.files.input_file import read_input
from gpusim.mesh import Mesh, read_mesh
from gpusim.mesh.formats.cad_cache import cached_cad_mesh
from gpusim.mesh.part_outline import part_outline, piece_count
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.camera.standpoint import Side
from gpusim.printable import printable
from gpusim.scene import load_scene
from gpusim.scene.description.mesh import CAD_SUFFIXES

OWN = Path(__file__).with_name("templates")
_LENS = Camera(2448, 2048, np.diag([35.0 / 3.45e-3, 35.0 / 3.45e-3, 1.0]))  # of the templates
_FILLED, _HALF_ANGLE = 1.0 / 1.15, 10.0  # of a picture; degrees from the middle to a camera
_COARSE, _ROUND = 1e3, 24  # m, and elements around a circle: few, so that a look is quick
_STRESS = 60e6  # Pa in the mean section
_PLATE = np.array([[-0.05, -0.02, 0.0], [0.05, 0.02, 0.003]])  # corners of plate_with_hole, m


def stereo_rig(low: Float, high: Float, normal: Float) -> dict[str, Float | float]:
    """Where two cameras stand, ``left`` and ``right`` of its ``normal``, that see all of a box (m),
    its longer side level; their ``target`` (m), ``across`` and ``up`` of the pictures, and the side
    of a ``pixel`` there (m)."""
    # the shorter one of the axes that aren't along the view
    up = np.eye(3)[int(np.argmin(np.where(np.abs(normal) > 0.7, np.inf, high - low)))]
    side = Side.of([np.array(list(product(*zip(low, high, strict=True))))], normal, up)
    across, down, _ = side.axes
    away, angle = side.distance(_LENS, _FILLED), np.deg2rad(_HALF_ANGLE)
    middle, aside = side.middle + away * np.cos(angle) * normal, away * np.sin(angle) * across
    return {
        "left": middle - aside, "right": middle + aside, "target": side.middle, "normal": normal,
        "across": across, "up": -down, "pixel": side.pixel(_LENS, _FILLED),
    }  # fmt: skip


def coarse_mesh(path: Path) -> Mesh:
    """Of a CAD file, or a mesh file whose coordinates are millimetres, of one piece.

    Raises InputError for a file that can't be read or meshed, and where Gmsh is missing.
    """
    file, suffix = read_input(path, "a CAD or mesh file"), path.suffix.lower()
    if suffix in CAD_SUFFIXES:
        around = 0 if suffix == ".stl" else _ROUND
        mesh = cached_cad_mesh(file, size=_COARSE, curvature=around, scale=1e-3)
    else:
        mesh = read_mesh(file, scale=1e-3)
    pieces, what = piece_count(mesh), f"{path}: pieces that share no nodes"
    require(pieces == 1, what, pieces, "one: join them, or make a file and a [[body]] of each")
    return mesh


def scene_of_template(path: Path, output: Path) -> str:
    """The text of a template; the files that an example needs are copied beside the scene."""
    if path.parent == OWN:
        return _filled(path.name, output, rig=stereo_rig(_PLATE[0], _PLATE[1], np.eye(3)[2]))
    new = {}
    for name, _ in load_scene(path).files:
        place = output.parent / Path(name).relative_to(path.parent)
        content = Path(name).read_bytes()
        if not place.exists():
            new[place] = content
            continue
        what, got = f"{place}: is there already, and not the template's", "another content"
        same = read_input(place).data == content
        require(same, what, got, f"another folder: -o NEW/{output.name}")
    for place, content in new.items():
        write_bytes(place, content)
    return path.read_text(encoding="utf-8").replace(f"examples/{path.name}", str(output))


def scene_of_part(path: Path, output: Path) -> str:
    """The text of a scene of a CAD or mesh file: held at one end, pulled at the other."""
    part = part_outline(coarse_mesh(path))
    seen, force = part.broadside(), np.zeros(3)
    assert seen.normal is not None  # broadsides have one
    section = part.volume / (part.high - part.low)[part.axis]
    force[part.axis] = float(f"{_STRESS * section:.1g}")
    relative = Path(os.path.relpath(path.resolve(), output.parent.resolve())).as_posix()
    return _filled(
        "part.toml", output, part=part, file=relative, cad=path.suffix.lower() in CAD_SUFFIXES,
        seen=seen, force=force, rig=stereo_rig(part.low, part.high, seen.normal),
    )  # fmt: skip


def _filled(template: str, output: Path, **values: Any) -> str:
    """The text of a template, with a measurement where there is a kind for that."""
    made = Environment(
        loader=FileSystemLoader(OWN), undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    made.filters |= {
        "mm": lambda place: _vector(1e3 * place), "vector": _vector, "short": _short,
        "quoted": lambda text: json.dumps(text, ensure_ascii=False), "printable": printable,
    }  # fmt: skip
    values |= {"scene": shlex.quote(str(output)), "name": output.stem}
    return made.get_template(template).render(values)


def _vector(values: Float) -> str:
    """A list of floats as TOML has it; what is zero but for rounding is 0.0."""
    clean = np.where(np.abs(values) > 1e-6 * np.abs(values).max(), values, 0.0)
    return str([float(f"{value:.9g}") for value in clean])


def _short(value: float) -> str:
    """Two digits are enough for what is to be changed."""
    return str(float(f"{value:.2g}"))
