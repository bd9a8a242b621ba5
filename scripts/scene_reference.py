"""Writes docs/scene.md: every table and key of a scene file, made from the JSON schema.

python scripts/scene_reference.py
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(CHECKOUT))  # its tables, not those of a wheel that is installed

from gpusim.scene.key_reference import KeyEntry, TableEntry, scene_tables  # noqa: E402

OUT = CHECKOUT / "docs" / "scene.md"
HEAD = """# The scene file: every table and key

<!-- Made by `python scripts/scene_reference.py` from gpusim/scene/description: edit there. -->

A scene is a [TOML](https://toml.io) file. `[table]` is there once, `[[table]]` as often as you
like. Units are in the names of the keys: `size_mm`, `force_N`, `youngs_modulus_GPa`. Numbers stand
without quotes. Unknown keys, wrong types and numbers out of range are told all at once, with the
nearest key, before anything is computed. On the command line:

```sh
gpusim init --list                        # scenes to start from
gpusim init part.step                     # a commented scene of a CAD part of your own
gpusim schema camera                      # what this page says of a camera
gpusim schema focal_mm                    # where there is such a key
gpusim schema > scene.schema.json         # JSON Schema, for editors
gpusim plan scene.toml                    # is the file right, and what would a run do?
gpusim run scene.toml -o out --set camera.front.focal_mm=35
```

`gpusim --install-completion` lets the shell complete commands, options, tables and templates.

A path, as in `--set` and in messages, is keys joined by dots; items of a list go by their name or
number. Behind the keys: [axes, signs and units](conventions.md), [meshes](meshes.md),
[mechanics](mechanics.md), [paint](paint.md), [light](light.md), [lenses and sensors](lenses.md),
[measurement](measuring.md), [variants and error budgets](variants.md),
[what a run writes](output.md).
"""
TOPICS = {
    "": "The file", "material": "Structure", "analysis": "Computation", "camera": "Pictures",
    "calibration": "Calibration", "measure": "Measurement and results",
}  # fmt: skip
"""The first table of each chapter; those after it in this order belong to it."""
ORDER = (
    "", "material", "body", "prop", "analysis", "solver", "camera", "light", "sensor", "render",
    "calibration", "measure", "variant", "output",
)  # fmt: skip


def anchor(heading: str) -> str:
    """What a link to a heading ends with, as on GitHub."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def title(path: str, table: TableEntry, kind_of: TableEntry | None) -> str:
    """Of a table's section."""
    if kind_of is None:
        return f"`{table.header}`" if path else "Top of the file"
    key = "builder" if path.startswith("body.mesh") else "type"
    return f'`{table.header}` {key} = "{path.rpartition(".")[2]}"'


def identity(table: TableEntry) -> object:
    """What is equal of one table at several places."""
    return table.kinds or table.name


def key_row(key: KeyEntry, inner: str | None) -> str:
    """A key's line in the Markdown table; ``inner``: the anchor of the table that it is."""
    value = f"[{key.value}](#{inner})" if inner else key.value
    if key.unit and "number" in value:
        value = f"{value}, {key.unit}"
    default = {"needed": "**needed**", "": ""}.get(key.default, f"`{key.default}`")
    return f"| `{key.name}` | {value} | {default} | {key.about} |".replace("  ", " ")


def sections(tables: dict[str, TableEntry]) -> Iterator[str]:
    """Each table once, in the order of the chapters."""
    first: dict[object, str] = {}  # table -> path of its section
    for path, table in tables.items():
        first.setdefault(identity(table), path)
    parents = {f"{path}.{kind}": table for path, table in tables.items() for kind in table.kinds}
    titles = {path: title(path, table, parents.get(path)) for path, table in tables.items()}
    told = Counter(titles[path] for path in first.values())
    for path in first.values():
        if told[titles[path]] > 1:  # tables of two kinds, one key
            titles[path] += f' of type "{path.split(".")[-2]}"'
    for section in ORDER:
        if section in TOPICS:
            yield f"\n## {TOPICS[section]}\n"
        for path, table in tables.items():
            if path.split(".")[0] != section or first[identity(table)] != path:
                continue
            depth = 3 if path.count(".") < 1 else 4
            yield f"\n{'#' * depth} {titles[path]}\n\n{table.about}\n"
            same = {one.header for one in tables.values() if identity(one) == identity(table)}
            if others := sorted(same - {table.header}):
                yield f"\nThe same in {', '.join(f'`{header}`' for header in others)}.\n"
            shared = parents[path].keys if path in parents else ()
            keys = [key for key in table.keys if key not in shared]
            if table.kinds:
                links = (f"[{kind}](#{anchor(titles[f'{path}.{kind}'])})" for kind in table.kinds)
                yield f"\nKinds: {', '.join(links)}.\n"
                yield "\nKeys of all kinds:\n" if keys else ""
            if keys:
                yield "\n| key | value | default | what it is |\n|---|---|---|---|\n"
            for key in keys:
                place = f"{path}.{key.name}".lstrip(".")
                if table.kinds:  # a key that all have, of the first one
                    place = f"{path}.{table.kinds[0]}.{key.name}"
                inside = tables.get(place)
                target = None if inside is None else anchor(titles[first[identity(inside)]])
                yield key_row(key, target) + "\n"
            if table.example:
                yield f"\n```toml\n{table.example}\n```\n"


def page() -> str:
    """The text of docs/scene.md."""
    return HEAD + "".join(sections(scene_tables()))


if __name__ == "__main__":
    OUT.write_text(page(), encoding="utf-8")
    print(OUT)
