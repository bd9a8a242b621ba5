"""What keys and the mouse do, in one table: the window's help and docs/view.md say what stands
here."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["KEYS", "MOUSE", "Key", "help_lines"]


class Key(NamedTuple):
    """A key as it is typed or named, what `gpusim.view.viewer.Viewer` calls it, and its help."""

    key: str
    action: str
    help: str


KEYS = (
    Key("1", "front", "front: look along +y"),
    Key("3", "right", "right: look along -x"),
    Key("7", "top", "top: look down"),
    Key("0", "next_camera", "through the next camera of the scene"),
    Key("Home", "frame_all", "everything in view"),
    Key(".", "frame_selection", "the selection in view"),
    Key("r", "reset", "reset the view"),
    Key("c", "write_camera", "print this view as a [[camera]] to copy"),
    Key("ArrowLeft", "previous_frame", "previous frame"),
    Key("ArrowRight", "next_frame", "next frame"),
    Key("+", "larger", "deformation twice as large"),
    Key("-", "smaller", "deformation half as large"),
    Key("f", "next_field", "colours of the next field, then paint"),
    Key("p", "paint", "paint, or plain grey"),
    Key("l", "light", "the scene's lamps, or a headlight"),
    Key("m", "mesh", "mesh lines"),
    Key("u", "supports", "supports"),
    Key("o", "loads", "loads"),
    Key("v", "cameras", "the scene's cameras"),
    Key("[", "darker", "darker"),
    Key("]", "brighter", "brighter"),
    Key("s", "save", "save a screenshot"),
    Key("h", "help", "this help"),
)

MOUSE = (
    ("left drag", "orbit"),
    ("middle drag, Shift + left drag", "pan"),
    ("wheel", "zoom to the cursor"),
    ("click", "select: element, node, value, pixel"),
    ("drag the bar below", "frame"),
)

SHOWN = {"ArrowLeft": "←", "ArrowRight": "→"}


def help_lines() -> list[tuple[str, str]]:
    """Keys and mouse, each with what it does.

    Examples
    --------
    >>> from gpusim.view.keys import help_lines
    >>> help_lines()[0]
    ('1', 'front: look along +y')
    """
    return [*((SHOWN.get(key.key, key.key), key.help) for key in KEYS), *MOUSE]
