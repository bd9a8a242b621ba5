"""Input decks of Abaqus and CalculiX: linear static analyses of solid elements."""

from __future__ import annotations

from gpusim.deck.deck import Deck, Step
from gpusim.deck.load import load_deck

__all__ = ["Deck", "Step", "load_deck"]


def __dir__() -> list[str]:
    return sorted(__all__)
