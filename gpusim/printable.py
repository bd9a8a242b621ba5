"""Texts of other people (names, values, file names) shown without what commands a terminal.

A control character can recolour, overwrite or retitle a terminal, and a bidirectional one turns the
order of what is read. Everything that is printed, or put on a page, goes through `printable`.
"""

from __future__ import annotations

import json
import unicodedata

_SEPARATORS = ("Zl", "Zp")  # line and paragraph: a page or an editor may break the line there


def printable(text: str, keep: str = "") -> str:
    r"""``text`` with every control, format, private and unassigned character as its escape.

    Those in ``keep`` stay ("\n" for messages of several lines). Letters of all scripts, accents,
    symbols and spaces stay.

    Examples
    --------
    >>> printable("Größe \x1b[31m 5\u202e mm")
    'Größe \\u001b[31m 5\\u202e mm'
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(one if one in keep or _shows(one) else _escape(one) for one in text)


def _shows(character: str) -> bool:
    kind = unicodedata.category(character)
    return kind[0] != "C" and kind not in _SEPARATORS


def _escape(character: str) -> str:
    # as in JSON, so that a JSON text made printable still means the same
    text = json.dumps(character)[1:-1]
    return text if text != character else f"\\u{ord(character):04x}"
