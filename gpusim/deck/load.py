"""Reading a deck: which keywords and parameters are read, ignored or refused; then each card."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from gpusim.deck.constraints import Axes
from gpusim.deck.deck import Deck
from gpusim.deck.materials import Sections
from gpusim.deck.steps import History
from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, results_hint
from gpusim.mesh.formats.abaqus.assembly import read_content
from gpusim.mesh.formats.abaqus.cards import Card, Source, nearest, read_cards
from gpusim.mesh.formats.abaqus.elements import SOLID_TYPES
from gpusim.mesh.formats.abaqus.keywords import (
    MESH_KEYWORDS,
    fail_together,
    parameter_faults,
    read_parameters,
)
from gpusim.mesh.formats.abaqus.reader import label_mesh
from gpusim.validation import require

# Element type -> formulation of its integration rule, as CalculiX integrates it.
FORMULATIONS = {
    "C3D8": "full",
    "C3D8I": "incompatible",
    "C3D20": "full",
    "C3D20R": "reduced",
    "C3D4": "full",
    "C3D10": "full",
    "C3D6": "full",
    "C3D15": "full",
}

_REFUSED_ELEMENTS = {
    "C3D8R": "one integration point with hourglass control; expected C3D8 or C3D8I",
    "C3D10M": "a modified tetrahedron; expected C3D10",
    "C3D10T": "a C3D10 with linear temperature; expected C3D10",
}

# Keyword -> the parameters, and values, that are read or can't change a static solution.
_READ = MESH_KEYWORDS | read_parameters(
    {
        "MATERIAL": "NAME",
        "ELASTIC": "TYPE",
        "DENSITY": "",
        "DAMPING": "ALPHA BETA STRUCTURAL",
        "EXPANSION": "TYPE ZERO",
        "PLASTIC": "HARDENING=ISOTROPIC",
        "HYPERELASTIC": "NEOHOOKE",
        "ORIENTATION": "NAME SYSTEM DEFINITION=COORDINATES/",
        "SOLIDSECTION": "ELSET MATERIAL ORIENTATION CONTROLS",
        "AMPLITUDE": "NAME TIME DEFINITION=TABULAR/ VALUE=RELATIVE",
        "TRANSFORM": "NSET TYPE",
        "EQUATION": "",
        "TIE": "NAME POSITIONTOLERANCE ADJUST=YES/NO",
        "INITIALCONDITIONS": "TYPE",
        "STEP": "NAME INC AMPLITUDE NLGEOM UNSYMM PERTURBATION",
        "STATIC": "SOLVER DIRECT TIMERESET TOTALTIMEATSTART",
        "FREQUENCY": "SOLVER STORAGE GLOBAL",
        "BUCKLE": "SOLVER",
        "MODALDYNAMIC": "SOLVER DIRECT=YES/",
        "STEADYSTATEDYNAMICS": "SOLVER HARMONIC=YES",
        "DYNAMIC": "SOLVER DIRECT ALPHA",
        "MODALDAMPING": "RAYLEIGH",
        "BASEMOTION": "DOF AMPLITUDE TYPE=DISPLACEMENT/ACCELERATION",
        "ENDSTEP": "",
        "BOUNDARY": "OP=NEW/MOD AMPLITUDE TYPE=DISPLACEMENT",
        "CLOAD": "OP=NEW/MOD AMPLITUDE LOADCASE",
        "DLOAD": "OP=NEW/MOD AMPLITUDE LOADCASE",
        "DSLOAD": "OP=NEW/MOD AMPLITUDE LOADCASE",
        "TEMPERATURE": "OP=NEW/MOD AMPLITUDE",
    }
)

# Output requests, and what can't change the displacements of a static step.
_IGNORED = frozenset(
    """
    HEADING PREPRINT RESTART OUTPUT NODEFILE NODEPRINT NODEOUTPUT ELFILE ELPRINT ELEMENTOUTPUT
    ENERGYOUTPUT CONTACTOUTPUT CONTACTFILE CONTACTPRINT FACEPRINT SECTIONPRINT FILEFORMAT
    FILEOUTPUT MONITOR PRINT TIMEPOINTS CONTROLS CONDUCTIVITY SPECIFICHEAT
    PHYSICALCONSTANTS SURFACEINTERACTION SURFACEBEHAVIOR FRICTION SECTIONCONTROLS
    """.split()
)

# Sections of other element types; harmless, for such elements are refused.
_OTHER_SECTIONS = frozenset(
    ["MEMBRANE", "MEMBRANESECTION", "SHELLSECTION", "BEAMSECTION", "BEAMGENERALSECTION"]
)


def check_keywords(cards: Sequence[Card]) -> tuple[str, ...]:
    """What is ignored (``"*EL PRINT"``, …), each once.

    Raises one InputError that lists every keyword, parameter and element type that would change
    the answer and isn't supported, with file and line.
    """
    faults: list[str] = []
    ignored: dict[str, None] = {}
    types: dict[str, str] = {}
    for card in cards:
        if card.keyword in _IGNORED or card.keyword in _OTHER_SECTIONS:
            if card.keyword == "RESTART" and "READ" in card.parameters:
                faults.append(f"{card.where()}: READ isn't supported; expected a complete deck")
            ignored[card.shown] = None
        elif card.keyword not in _READ:
            known = [*_READ, *_IGNORED]
            faults.append(
                f"{card.where()}: not supported; expected a deck of *STATIC steps or "
                f"of vibration on solid elements{nearest(card.keyword, known)}"
            )
        else:
            faults.extend(parameter_faults(card, _READ))
            if card.keyword == "ELEMENT":
                faults.extend(_element_faults(card, types))
    fail_together(faults, cards[0].file)
    return tuple(ignored)


def _element_faults(card: Card, types: dict[str, str]) -> list[str]:
    """``types`` collects our cell type -> element type of the deck, one for each."""
    written = card.parameters.get("TYPE", "").upper()
    if written in _REFUSED_ELEMENTS:
        return [f"{card.where()}: {written} is {_REFUSED_ELEMENTS[written]}"]
    if written not in FORMULATIONS:
        return [
            f"{card.where()}: element type {written or '(none)'} isn't supported; "
            f"expected one of {', '.join(FORMULATIONS)}"
        ]
    first = types.setdefault(SOLID_TYPES[written], written)
    if first != written:
        return [
            f"{card.where()}: {written} beside {first}; got two integration rules for one cell "
            "type; expected one"
        ]
    return []


def _deflects(cards: Sequence[Card]) -> bool:
    """Whether the steps have NLGEOM: the first one, and with it all as in CalculiX.

    Raises InputError for linear steps beside such ones.
    """
    steps = [card for card in cards if card.keyword == "STEP"]
    given = [card.parameters.get("NLGEOM", "-").upper() for card in steps]
    if not set(given) - {"-", "NO"}:
        return False
    linear = given.index("NO") if "NO" in given else 0
    if given[linear] in ("-", "NO"):
        steps[linear].fail(
            "linear, beside steps with NLGEOM; expected NLGEOM in the first step, and so in all"
        )
    return True


def load_deck(source: Source) -> Deck:
    """An analysis of statics, vibration or buckling from an Abaqus or CalculiX input file.

    Read are solid elements (C3D4, C3D6, C3D8, C3D8I, C3D10, C3D15, C3D20, C3D20R) with the
    integration rules that CalculiX has for them, elastic materials (isotropic, orthotropic,
    anisotropic) with rectangular orientations, plasticity, neo-Hookean rubber, sets and surfaces,
    supports, prescribed displacements, equations, ties, turned axes, nodal forces, pressures,
    gravity, rotation, temperatures, initial stress and motion, damping, amplitudes, and any number
    of steps with *STATIC, *FREQUENCY, *BUCKLE, *MODAL DYNAMIC, *STEADY STATE DYNAMICS and *DYNAMIC,
    with NLGEOM or without. Output requests are listed in ``Deck.ignored``.

    Raises InputError that lists, with file and line, every keyword, parameter and element type
    that would change the answer and isn't supported; and then every wrong number and unknown name.

    Examples
    --------
    >>> deck = gs.load_deck("bricks.inp")
    >>> print(f"{gs.solve(deck.model(1)).u[:, 0].max():.5f}")
    0.00000
    """
    path = str(source.path if isinstance(source, InputFile) else source)
    hint = results_hint(path)
    require(not hint, path, "a file of results", f"an input deck{hint}")
    cards = read_cards(source)
    ignored = check_keywords(cards)
    content = read_content(cards)
    labelled = label_mesh(content, path)
    sections, axes = Sections(content), Axes(content)
    _read_all(content.history, {**sections.readers(), "TRANSFORM": axes.read})
    formulation = {SOLID_TYPES[block.type]: FORMULATIONS[block.type] for block in content.blocks}
    body = sections.resolve(labelled, formulation, _deflects(cards))
    history = History(body, axes)
    _read_all(content.history, history.readers())
    if history.open is not None:
        history.open.card.fail("the step doesn't end; expected *END STEP (is the file cut off?)")
    require(bool(history.steps), f"{path}: no step", "a deck without *STEP", "at least one")
    return Deck(
        path=path,
        mesh=labelled.mesh,
        node_labels=labelled.node_labels,
        cell_labels=labelled.cell_labels,
        materials=tuple(body.materials),
        material_of_cell=body.material_of_cell,
        formulation=formulation,
        steps=tuple(history.steps),
        node_axes=axes.rows,
        initial_stress=history.stress.values,
        initial_motion=(history.motion.u, history.motion.v),
        damping=body.damping,
        loss_factor=body.loss_factor,
        nonlinear=body.nonlinear,
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
