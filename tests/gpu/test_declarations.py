"""Types named in wgpu's header, parsed behind the declarations that a name mentions."""

from __future__ import annotations

from typing import Any

import pytest
from cffi import FFI

from gpusim.gpu.declarations import parse_names_alone

_HEADER = """
typedef unsigned int Flags;
typedef struct Chain { struct Chain *next; Flags kind; } Chain;
typedef struct Limits { Chain chain; double most; uint64_t count; } Limits;
typedef void (*Done)(Limits const *limits, Flags status, void *user);
"""
_NAMES = [
    "Limits *", "Chain[3]", "Done", "void(*)(Flags, Limits const *)", "struct Chain *", "char []",
    "uint64_t *", "Flags",
]  # fmt: skip


def _library() -> Any:
    ffi = FFI()
    ffi.cdef(_HEADER)
    return ffi


@pytest.mark.parametrize("name", _NAMES)
def test_types_are_the_same(name: str) -> None:
    lean, whole = _library(), _library()
    parse_names_alone(lean)
    assert str(lean.typeof(name)) == str(whole.typeof(name))


def test_only_the_words_of_a_name_are_declared() -> None:
    ffi = _library()
    seen = []
    parse = ffi._parser._parse
    ffi._parser._parse = lambda source: (
        seen.append(sorted(ffi._parser._declarations)),
        parse(source),
    )[1]
    parse_names_alone(ffi)
    every = dict(ffi._parser._declarations)
    ffi.new("Limits *", {"most": 2.5})
    assert seen == [["struct Limits", "typedef Limits"]]
    assert ffi._parser._declarations == every


def test_a_bad_name_is_still_a_fault_and_later_names_still_work() -> None:
    ffi = _library()
    parse_names_alone(ffi)
    with pytest.raises(Exception, match="Unknown"):
        ffi.typeof("Unknown *")
    assert ffi.new("Limits *").chain.kind == 0
    ffi.cdef("typedef struct { Limits inner; } More;")
    assert ffi.typeof("More *").item.fields[0][1].type.cname == "Limits"


def test_a_parser_of_another_kind_is_left_alone() -> None:
    class Other:
        _parser = object()

    parse_names_alone(Other())
    parse_names_alone(object())
