"""Tables and keys of the scene file on a terminal, for ``gpusim schema``."""

from __future__ import annotations

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from gpusim.cli.help import definition_list


def table_names(incomplete: str) -> list[str]:
    """Paths of tables that begin so, for the shell."""
    from gpusim.scene.key_reference import scene_tables

    return [path for path in scene_tables() if path and path.startswith(incomplete)]


def print_tables(text: str) -> None:
    """The tables or keys that a path, or a part of one, means: what it is, kinds, keys, an example.

    Raises InputError if there is none.
    """
    from gpusim.scene.key_reference import find_tables, scene_tables

    console, tables = Console(highlight=False), scene_tables()
    for path, table in find_tables(text).items():
        console.print(Text.assemble((path, "bold"), "  ", (table.header, "cyan")), soft_wrap=True)
        if table.about:
            console.print(Padding(Text(table.about), (0, 0, 0, 2)))
        console.print()
        if table.kinds:
            about = {kind: tables[f"{path}.{kind}"].about for kind in table.kinds}
            console.print(
                definition_list((one, text.split("\n")[0]) for one, text in about.items())
            )
            console.print(f"\n  Each has more keys: gpusim schema {path}.{table.kinds[0]}\n")
        rows = definition_list(())
        for key in table.keys:
            unit = f", {key.unit}" if "number" in key.value and key.unit else ""
            said = {"": "", "needed": "; needed"}.get(key.default, f"; without it {key.default}")
            rows.add_row(key.name, Text(key.about))
            rows.add_row("", Text(f"{key.value}{unit}{said}", "dim"))
        console.print(rows)
        if table.example:
            console.print(Padding(Text(f"\n{table.example}", "green"), (0, 0, 0, 2)))
            console.print()
