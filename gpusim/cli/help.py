"""What the help of commands says of options and of effects, and how words are listed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import typer
from rich.console import Console
from rich.table import Column, Table
from rich.text import Text
from typer.core import TyperCommand

_Command = TypeVar("_Command", bound=Callable[..., Any])


class FlagsWithoutType:
    """Shows no type behind options that are on or off."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Arguments and options, for parsing and help."""
        found: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for option in found:
            if getattr(option, "is_bool_flag", False):
                option.metavar = ""
        return found


class FlagCommand(FlagsWithoutType, TyperCommand):
    """A command whose help shows no type behind options that are on or off."""


class CommandLine(typer.Typer):
    """Commands of which each is a `FlagCommand`, unless it is another one."""

    def command(self, *names: Any, **options: Any) -> Callable[[_Command], _Command]:
        """As typer's."""
        return super().command(*names, **{"cls": FlagCommand, **options})


class EffectCommand(FlagCommand):
    """A command whose help says what the effects are that --only and --no name."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print it; what the effects are is read when somebody asks."""
        from gpusim.scene.effects import EFFECTS

        super().format_help(ctx, formatter)
        effects = definition_list((name, one.about) for name, one in EFFECTS.items())
        Console(highlight=False).print(" Effects, for --only and --no:", effects, "")


def effect_names(incomplete: str) -> list[str]:
    """Effects that begin so, for the shell."""
    from gpusim.scene.effects import EFFECTS

    return [name for name in EFFECTS if name.startswith(incomplete)]


def definition_list(rows: Iterable[tuple[str, str]]) -> Table:
    """Words and what they mean, in two columns."""
    table = Table.grid(Column(style="bold", no_wrap=True), padding=(0, 0, 0, 2), pad_edge=True)
    for word, meaning in rows:
        table.add_row(Text(word), Text(meaning))
    return table
