"""What tests of the repository ask of a module's source, from one pass over its syntax tree: to
parse the whole package takes seconds, and five of them would do it.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache


@dataclass(frozen=True)
class Outline:
    """Imports, classes and functions of a module, at any depth of its code."""

    imports: tuple[ast.Import | ast.ImportFrom, ...]
    imports_when_run: tuple[ast.Import | ast.ImportFrom, ...]
    """Without those that stand below ``if TYPE_CHECKING``."""
    classes: tuple[str, ...]
    functions: tuple[tuple[str, int, int], ...]
    """Of each its name and its lines: without its docstring, and with it."""


def _nodes(tree: ast.AST, for_types: bool = False) -> Iterator[tuple[ast.AST, bool]]:
    """All below a node, and whether it is there for types alone."""
    left = [(tree, for_types)]
    while left:
        parent, for_types = left.pop()
        for node in ast.iter_child_nodes(parent):
            test = node.test if isinstance(node, ast.If) else None
            name = getattr(test, "id", None) or getattr(test, "attr", None)
            left.append((node, for_types or name == "TYPE_CHECKING"))
            yield left[-1]


def _lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> tuple[str, int, int]:
    first, documented = node.body[0], ast.get_docstring(node) is not None
    whole = (node.end_lineno or 0) - node.lineno + 1
    docstring = (first.end_lineno or 0) - first.lineno + 1 if documented else 0
    return node.name, whole - docstring, whole


@cache
def outline(text: str) -> Outline:
    """Of a module's text, once for all tests of a process."""
    nodes = [*_nodes(ast.parse(text))]
    imports = [(one, types) for one, types in nodes if isinstance(one, ast.Import | ast.ImportFrom)]
    return Outline(
        imports=tuple(one for one, _ in imports),
        imports_when_run=tuple(one for one, for_types in imports if not for_types),
        classes=tuple(one.name for one, _ in nodes if isinstance(one, ast.ClassDef)),
        functions=tuple(
            _lines(one)
            for one, _ in nodes
            if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef)
        ),
    )
