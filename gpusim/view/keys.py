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
    Key("f", "next_field", "colours of the next field, then paint"),
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

MOUSE = (
    ("left drag", "orbit"),
    ("middle drag, Shift + left drag", "pan"),
    ("wheel", "zoom to the cursor"),
    ("click", "select: element, node, set, value, pixel"),
    ("drag the bar below", "frame"),
)

SHOWN = {"ArrowLeft": "←", "ArrowRight": "→"}


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
