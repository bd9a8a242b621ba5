"""What keys and the mouse do, in one table: the window's help and docs/view.md say what stands
here."""

from __future__ import annotations

from typing import NamedTuple


class Key(NamedTuple):
    """A key as it is typed or named, what `gpusim.view.viewer.Viewer` calls it, and its help; of
    keys that are told of together the first one has it."""

    key: str
    action: str
    help: str = ""


KEYS = (
    Key("1", "front", "look from the front (along +y), the right, the top"),
    Key("3", "right"),
    Key("7", "top"),
    Key("0", "next_camera", "through the next camera of the scene"),
    Key("Home", "frame_all", "everything in view"),
    Key(".", "frame_selection", "the selection in view"),
    Key("r", "reset", "reset the view"),
    Key("c", "write_camera", "copy this view as a [[camera]] of a scene"),
    Key("ArrowLeft", "previous_frame", "previous, next frame"),
    Key("ArrowRight", "next_frame"),
    Key("+", "larger", "deformation twice, half as large"),
    Key("-", "smaller"),
    Key("f", "next_field", "colours of the next field, then paint"),
    Key("p", "paint", "paint, or plain grey"),
    Key("l", "light", "the scene's lamps, or a headlight"),
    Key("m", "mesh", "mesh lines, supports, loads"),
    Key("u", "supports"),
    Key("o", "loads"),
    Key("v", "cameras", "cameras; in one: distortion, what is sharp"),
    Key("[", "darker", "darker, brighter"),
    Key("]", "brighter"),
    Key("s", "save_picture", "save a screenshot"),
    Key("h", "help", "this help"),
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
