"""mypy's plugin for a scene's tables: ``size`` is of the type of ``size_mm``, and what is neither a
key nor a key without its unit is an error."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from mypy.nodes import Var
from mypy.plugin import AttributeContext, Plugin
from mypy.typeops import make_simplified_union
from mypy.types import Instance, Type, UnionType, get_proper_type

sys.path.insert(1, str(Path(__file__).parents[1]))
from gpusim.scene.tables.table import name_and_unit

_GETATTR = "gpusim.scene.tables.table.Table."


def _of_key(table: Instance, name: str) -> Type | None:
    for owner in table.type.mro:
        for key, symbol in owner.names.items():
            stem, unit = name_and_unit(key)
            if unit and stem == name and isinstance(symbol.node, Var):
                return symbol.node.type
    return None


def _type_of(name: str, context: AttributeContext) -> Type:
    table = context.type  # or several, of which mypy asks for one after the other
    several = table.items if isinstance(table, UnionType) else [table]
    instances = [one for one in map(get_proper_type, several) if isinstance(one, Instance)]
    found = [_of_key(one, name) for one in instances if one.type.get(name) is None]
    known = [one for one in found if one is not None]
    if known and len(known) == len(found):
        return make_simplified_union(known)
    context.api.fail(f'"{table}" has no attribute "{name}"', context.context)
    return context.default_attr_type


class UnitsPlugin(Plugin):
    """Looks into what `Table.__getattr__` would answer."""

    def get_attribute_hook(self, fullname: str) -> Callable[[AttributeContext], Type] | None:
        """For every attribute that a table's class doesn't have."""
        if not fullname.startswith(_GETATTR) or "__" in fullname:
            return None
        name = fullname.removeprefix(_GETATTR)
        return lambda context: _type_of(name, context)


def plugin(version: str) -> type[Plugin]:
    """Where mypy begins."""
    return UnitsPlugin
