"""Type names of wgpu's C header, read without reading the whole header again for each.

wgpu makes its structs by name, and cffi parses each name that it meets for the first time behind
one line for every type in the header, in case the name mentions it: 30 ms a name, 2 s in a process
that draws one picture. The name mentions only the types whose words it contains.
"""

from __future__ import annotations

import re
from typing import Any

_DONE = "_gpusim_parses_names_alone"


def parse_names_alone(ffi: Any) -> None:
    """Let ``ffi`` (a `cffi.FFI`) parse a type's name behind the declarations of its words only.

    The types are the same. Where cffi's parser isn't what is known here nothing is changed.
    """
    parser: Any = getattr(ffi, "_parser", None)
    parse = getattr(parser, "_parse", None)
    known = getattr(parser, "_declarations", None)
    if parse is None or not isinstance(known, dict) or getattr(parser, _DONE, False):
        return

    def lean(source: str) -> Any:
        # cffi holds its lock here; the types behind the names are looked up afterwards, in all
        every = parser._declarations
        words = set(re.findall(r"\w+", source))
        parser._declarations = {
            name: kind for name, kind in every.items() if name.rpartition(" ")[2] in words
        }
        try:
            return parse(source)
        finally:
            parser._declarations = every

    parser._parse = lean
    setattr(parser, _DONE, True)
