"""Modules and classes are named by nouns of the field: the words that docs/renderer.md bans."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import gpusim
from tests.support.source_outline import outline

PACKAGE = Path(gpusim.__file__).parent

BANNED = frozenset(
    """album alone apart around aside balls beforehand begun bottom chain copies dealt doubt doubts
    drawn early facets filed followed following found glance held kept known late likely looks made
    near once openness piles resident seen settled sight some steady sunk sure taken tear things
    told unsure usable waiting wishes work""".split()
)


def words(name: str) -> list[str]:
    """``LateSight`` and ``late_sight`` are late and sight."""
    parts = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z0-9]+|[A-Z]+", name)
    return [part.lower() for part in parts]


def named(path: Path) -> Iterator[tuple[str, str]]:
    """A module's own name and those of its classes, each with where it stands."""
    where = path.relative_to(PACKAGE).with_suffix("").as_posix().removesuffix("/__init__")
    yield where, where.rpartition("/")[2]
    for name in outline(path.read_text(encoding="utf-8")).classes:
        yield f"{where}:{name}", name


def with_banned_words(paths: Iterable[Path]) -> set[str]:
    return {
        where for path in paths for where, name in named(path) if BANNED.intersection(words(name))
    }


def test_no_module_or_class_is_named_by_a_banned_word() -> None:
    assert sorted(with_banned_words(PACKAGE.rglob("*.py"))) == []


def test_a_banned_name_is_seen() -> None:
    assert [word for word in ("LateSight", "kept", "DICResult") if BANNED & {*words(word)}] == [
        "LateSight",
        "kept",
    ]


def test_the_glossary_names_the_same_words(checkout: Path) -> None:
    text = (checkout / "docs" / "renderer.md").read_text(encoding="utf-8")
    (listed,) = re.findall(
        r"^Words that modules and classes may not.*?\n\n\*(.*?)\*\.", text, re.M | re.S
    )
    assert set(re.findall(r"\w+", listed)) == BANNED
