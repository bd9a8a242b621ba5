"""What docs/conventions.md says of the tables that runs write."""

from __future__ import annotations

from pathlib import Path


def documented_columns(checkout: Path, table: str) -> str:
    """The head of a table's CSV as the page has it, such as of "measure/<deflection>.csv"."""
    start = f"| `{table}` | "
    lines = (checkout / "docs" / "conventions.md").read_text(encoding="utf-8").splitlines()
    (row,) = [line for line in lines if line.startswith(start)]
    return row.removeprefix(start).removesuffix(" |").replace(", ", ",")


def head(path: Path) -> str:
    """The first line of a file."""
    return path.read_text(encoding="utf-8").splitlines()[0]
