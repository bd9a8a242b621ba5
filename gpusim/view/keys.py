"""What keys and the mouse do, in one table: the window's help and docs/view.md say what stands
here."""

from __future__ import annotations

from typing import Any, NamedTuple


class Key(NamedTuple):
    """A key as it is typed or named, the method of `gpusim.view.viewer.Viewer` that it calls, its
    help, and the call's arguments; of keys that are told of together the first one has the help."""

    key: str
    action: str
    help: str = ""
    arguments: tuple[Any, ...] = ()


KEYS = (
    Key("1", "look_along", "look from the front (along +y), the right, the top", ("front",)),
    Key("3", "look_along", "", ("right",)),
    Key("7", "look_along", "", ("top",)),
    Key("0", "next_camera", "through the next camera of the scene"),
    Key("Home", "frame_all", "everything in view"),
    Key(".", "frame_selection", "the selection in view"),
    Key("r", "reset", "reset the view"),
    Key("c", "write_camera", "copy this view as a [[camera]] of a scene"),
    Key("ArrowLeft", "step_frame", "previous, next frame", (-1,)),
    Key("ArrowRight", "step_frame", "", (1,)),
    Key("+", "deform", "deformation twice, half as large", (2.0,)),
    Key("-", "deform", "", (0.5,)),
    Key(" ", "play", "play the frames, stop"),
    Key("f", "step_field", "colours of the next field, the one before; paint is one", (1,)),
    Key("d", "step_field", "", (-1,)),
    Key("t", "switch", "the list of fields", ("fields",)),
    Key("n", "step_range", "legend of each frame, held, of all frames"),
    Key("<", "widen_range", "legend half, twice as wide", (0.5,)),
    Key(">", "widen_range", "", (2.0,)),
    Key("x", "switch", "smallest and largest value, undeformed shape", ("extremes",)),
    Key("g", "switch", "", ("undeformed",)),
    Key("k", "next_cut", "cut across x, y, z; show its other side"),
    Key("j", "turn_cut"),
    Key("PageUp", "move_cut", "move the cut", (0.05,)),
    Key("PageDown", "move_cut", "", (-0.05,)),
    Key("p", "switch", "paint, or plain grey", ("paint",)),
    Key("l", "switch", "the scene's lamps, or a headlight", ("light",)),
    Key("m", "switch", "mesh lines, supports, loads", ("mesh",)),
    Key("u", "switch", "", ("supports",)),
    Key("o", "switch", "", ("loads",)),
    Key("v", "switch", "cameras; in one: distortion, what is sharp", ("cameras",)),
    Key("[", "brighten", "darker, brighter", (0.5**0.5,)),
    Key("]", "brighten", "", (2.0**0.5,)),
    Key("s", "save_picture", "save a screenshot"),
    Key("h", "switch", "this help", ("help",)),
)

ALIASES = {"=": "+", "_": "-", "ArrowDown": "f", "ArrowUp": "d"}
"""Keys that are as good as others."""

MOUSE = (
    ("left drag", "orbit"),
    ("middle drag, Shift + left drag", "pan"),
    ("wheel", "zoom to the cursor"),
    ("click", "select: element, node, set, value, pixel"),
    ("drag the bar below", "frame"),
)

SHOWN = {"ArrowLeft": "←", "ArrowRight": "→", " ": "space"}


def help_lines() -> list[tuple[str, str]]:
    """Keys and mouse, each with what it does.

    Examples
    --------
    >>> from gpusim.view.keys import help_lines
    >>> help_lines()[0]
    ('1 3 7', 'look from the front (along +y), the right, the top')
    """
    lines: list[tuple[str, str]] = []
    for key in KEYS:
        name = SHOWN.get(key.key, key.key)
        if not key.help:
            together, key_help = lines.pop()
            lines.append((f"{together} {name}", key_help))
        else:
            lines.append((name, key.help))
    return [*lines, *MOUSE]
