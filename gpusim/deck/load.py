"""Reading a deck."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from gpusim.deck.constraints import Axes
from gpusim.deck.deck import Deck
from gpusim.deck.keywords import FORMULATIONS, check_keywords
from gpusim.deck.materials import Sections
from gpusim.deck.steps import Body, History
from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.mesh.formats.abaqus.cards import Card, Source, read_cards
from gpusim.mesh.formats.abaqus.content import InpContent
from gpusim.mesh.formats.abaqus.element_types import SOLID_TYPES
from gpusim.mesh.formats.abaqus.geometry import read_content
from gpusim.mesh.formats.abaqus.keywords import fail_together
from gpusim.mesh.formats.abaqus.reader import label_mesh

__all__ = ["load_deck"]


def load_deck(source: Source) -> Deck:
    """A linear static analysis from an Abaqus or CalculiX input file.

    Read are solid elements (C3D4, C3D6, C3D8, C3D8I, C3D10, C3D15, C3D20, C3D20R) with the
    integration rules that CalculiX has for them, elastic materials (isotropic, orthotropic,
    anisotropic) with rectangular orientations, sets and surfaces, supports, prescribed
    displacements, equations, ties, turned axes, nodal forces, pressures, gravity, rotation,
    temperatures, initial stress, amplitudes, and any number of *STATIC steps. Output requests are
    listed in ``Deck.ignored``.

    Raises InputError that lists, with file and line, every keyword, parameter and element type
    that would change the answer and isn't supported; and then every wrong number and unknown name.

    Examples
    --------
    >>> deck = gs.load_deck("bricks.inp")
    >>> print(f"{gs.solve(deck.model(1)).u[:, 0].max():.5f}")
    0.00000
    """
    cards = read_cards(source)
    path = str(source.path if isinstance(source, InputFile) else source)
    ignored = check_keywords(cards)
    content = read_content(cards)
    labelled = label_mesh(content, path)
    sections, axes = Sections(content), Axes(content)
    _read_all(content.history, {**sections.readers(), "TRANSFORM": axes.read})
    materials, of_cell = sections.resolve(labelled)
    formulation = _formulation(content)
    history = History(Body(content, labelled, materials, of_cell, formulation), axes)
    _read_all(content.history, history.readers())
    if history.open is not None:
        raise InputError(
            f"{history.open.card.where()}: the step doesn't end; expected *END STEP "
            "(is the file cut off?)"
        )
    if not history.steps:
        raise InputError(f"{path}: no step; got a deck without *STEP; expected at least one")
    return Deck(
        path=path,
        mesh=labelled.mesh,
        node_labels=labelled.node_labels,
        cell_labels=labelled.cell_labels,
        materials=tuple(materials),
        material_of_cell=of_cell,
        formulation=formulation,
        steps=tuple(history.steps),
        node_axes=axes.rows,
        initial_stress=history.stress.values,
        ignored=ignored,
    )


def _read_all(cards: Sequence[Card], readers: Mapping[str, Callable[[Card], None]]) -> None:
    """Every card that has a reader; faults of all cards in one InputError."""
    faults: list[str] = []
    for card in cards:
        if card.keyword in readers:
            try:
                readers[card.keyword](card)
            except InputError as error:
                faults.append(str(error))
    if faults:
        fail_together(faults, cards[0].file)


def _formulation(content: InpContent) -> dict[str, str]:
    return {SOLID_TYPES[block.type]: FORMULATIONS[block.type] for block in content.blocks}
