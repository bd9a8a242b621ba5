"""The keys of a scene file table by table, in words: for docs/scene.md and ``gpusim schema TABLE``.

All is made from the JSON schema; kinds of measurement that are added are there too.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from gpusim.errors import nearest_name
from gpusim.validation import require

from .faults.schema_places import Node, cached_schema, expected, plain_node, table_kinds
from .tables.table import name_and_unit

_FRACTIONS = {
    "kg_m3": "kg/m3", "m_s2": "m/s2", "W_m2": "W/m2", "W_m2_sr": "W/(m2 sr)", "per_K": "1/K",
    "per_s": "1/s", "e_per_s": "e/s", "DN_per_e": "DN/e", "percent": "%",
}  # fmt: skip


@dataclass(frozen=True)
class KeyEntry:
    """A key: its name, what its ``value`` may be, the ``unit`` of that, what it is when it isn't
    given ("needed": it has to be), and what it is ``about``."""

    name: str
    value: str
    unit: str
    default: str
    about: str


@dataclass(frozen=True)
class TableEntry:
    """A table of the file, below its ``header``: ``[[body.load]]``.

    One with ``kinds``, which its key ``type`` or ``builder`` tells apart, has the ``keys`` that are
    the same in all of them; each kind has an entry of its own. ``name`` is that of the schema: the
    same table may stand at several places.
    """

    header: str
    name: str
    about: str
    keys: tuple[KeyEntry, ...]
    example: str = ""
    kinds: tuple[str, ...] = ()


def scene_tables() -> dict[str, TableEntry]:
    """Every table by its path, that of a kind with the kind as its last part; "": the file itself.

    Examples
    --------
    >>> from gpusim.scene.key_reference import scene_tables
    >>> table = scene_tables()["body.load.force"]
    >>> table.header, table.about
    ('[[body.load]]', 'A total force, spread evenly over the area of the faces.')
    >>> [(key.name, key.unit) for key in table.keys if key.unit]
    [('force_N', 'N')]
    """
    return dict(_tables(cached_schema(), "", ""))


def _tables(node: Node, path: str, header: str) -> Iterator[tuple[str, TableEntry]]:
    """The table of a node of the schema, and those within."""
    yield path, _entry(node, header)
    for key, value in node["properties"].items():
        inner, listed = plain_node(value), False
        if inner.get("type") == "array":
            inner, listed = plain_node(inner["items"]), True
        place = ".".join(filter(None, (path, key)))
        name = ".".join(filter(None, (header.strip("[]"), key)))
        head = f"[[{name}]]" if listed else f"[{name}]"
        kinds = {kind: dict(_tables(table, f"{place}.{kind}", head))
                 for kind, table in table_kinds(inner).items()}  # fmt: skip
        if kinds:
            first, *others = (entries[f"{place}.{kind}"].keys for kind, entries in kinds.items())
            shared = tuple(key for key in first if all(key in keys for keys in others))
            about = value.get("description", "")
            yield place, TableEntry(head, place, about, shared, kinds=tuple(kinds))
            for kind, entries in kinds.items():
                own = entries[f"{place}.{kind}"]
                keys = sorted(own.keys, key=lambda key: (key.default != "needed", key in shared))
                yield from {**entries, f"{place}.{kind}": replace(own, keys=tuple(keys))}.items()
        elif "properties" in inner:
            yield from _tables(inner, place, head)


def _entry(node: Node, header: str) -> TableEntry:
    """The table of a node, what has to be given first."""
    keys = []
    for name, value in node["properties"].items():
        _, unit = name_and_unit(name)
        said = _default(value.get("default"))
        about = " ".join(value.get("description", "").replace("``", "`").split())
        default = "needed" if name in node.get("required", ()) else said
        unit = "mm per px" if name == "mm_per_px" else _FRACTIONS.get(unit, unit)
        keys.append(KeyEntry(name, expected(value), unit, default, about))
    keys.sort(key=lambda key: key.default != "needed")
    # paragraphs stay, lines are the reader's own
    about = re.sub(r"(?<!\n)\n(?!\n)", " ", node.get("description", "").replace("``", "`"))
    text, inside = node.get("x-toml", ""), header.strip("[]")
    if inside:
        text = f"{header}\n" + re.sub(r"^(\[+)", rf"\1{inside}.", text, flags=re.MULTILINE)
    return TableEntry(header, node["title"], about, tuple(keys), text)


def _default(value: object) -> str:
    """In TOML; "" for what says nothing."""
    return "" if isinstance(value, dict) or value in (None, [], "") else json.dumps(value)


def find_tables(text: str) -> dict[str, TableEntry]:
    """What a path means, of which parts on the way may be left out: tables with all their keys, or
    with the one that is meant; what is the same at several places once.

    Raises InputError with the nearest name if there is no such table or key.

    Examples
    --------
    >>> from gpusim.scene.key_reference import find_tables
    >>> list(find_tables("focal_mm")), list(find_tables("load.pressure_MPa"))
    (['camera.focal_mm', 'camera.lens.focal_mm'], ['body.load.pressure.pressure_MPa'])
    """
    tables = scene_tables()
    places = dict(tables)
    for path, table in tables.items():
        for key in table.keys:
            alone = TableEntry(table.header, key.name, "", (key,))
            places.setdefault(f"{path}.{key.name}".lstrip("."), alone)
    if text in places:
        return {text: places[text]}
    meant: dict[object, tuple[str, TableEntry]] = {}
    for path, table in places.items():
        if _leads(text.split("."), path.split(".")):
            meant.setdefault(table.name if table.about else table.keys, (path, table))
    names = sorted({*places, *(path.rpartition(".")[2] for path in places)})
    wanted = f"camera, body.load.force, focal_mm …{nearest_name(text, names)}"
    require(bool(meant), "schema: no such table or key", text, wanted)
    return dict(meant.values())


def _leads(given: list[str], path: list[str]) -> bool:
    """Whether the given parts are in the path, in its order, the last one as its last."""
    steps = iter(path)
    return given[-1] == path[-1] and all(part in steps for part in given)
