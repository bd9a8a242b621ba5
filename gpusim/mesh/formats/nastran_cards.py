"""Nastran's bulk data as a list of cards: a name and its fields, and the numbers in them.

Continuations are joined, included files in place. Which cards make a mesh, which can't change it,
and which are refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError, nearest_name
from gpusim.files.input_file import InputFile
from gpusim.mesh.file_content.text import Includes, text_lines
from gpusim.mesh.formats.abaqus.cards import LARGEST, is_plain

_EXPECTED = "Nastran bulk data"
# a line of text: file, number, text without its comment
_Line = tuple[str, int, str]


@dataclass(eq=False, slots=True)
class BdfCard:
    """``name`` in upper case, ``fields`` after it as written; ``mark`` is that of its last line,
    by which a continuation may be known."""

    name: str
    fields: list[str]
    file: str
    line: int
    mark: str = ""

    def fail(self, problem: str) -> NoReturn:
        raise InputError(f"{self.where}: {problem}")

    @property
    def where(self) -> str:
        return f"{self.file}: line {self.line}: {self.name}"

    def field(self, number: int) -> str:
        """Field after the name, counted from 0; "" where there is none."""
        return self.fields[number] if number < len(self.fields) else ""


def read_bdf_cards(file: InputFile) -> list[BdfCard]:
    """The cards of the bulk data, included files in place, up to ENDDATA.

    ENDDATA may be absent where the last line is whole. A file without BEGIN BULK and CEND is bulk
    data from its first line. Raises InputError with file and line.
    """
    lines = list(_lines(file, Includes(file, _EXPECTED)))
    cards: list[BdfCard] = []
    for path, number, text in lines[_start(file, lines) :]:
        name, fields, mark = _fields(text)
        if name[:1] in ("", "+", "*"):
            if not cards:
                raise InputError(f"{path}: line {number}: continues nothing; expected a card")
            _continue(cards[-1], name, fields, mark, f"{path}: line {number}")
            continue
        name = name.rstrip("*").strip().upper()
        if name == "ENDDATA":
            return cards
        cards.append(BdfCard(name, fields, path, number, mark))
    if not file.data.endswith((b"\n", b"\r")):
        raise InputError(f"{file.path}: no ENDDATA; expected one at the end: cut off?")
    return cards


def _continue(card: BdfCard, name: str, fields: list[str], mark: str, where: str) -> None:
    own, wanted = name.lstrip("+*").strip(), card.mark.lstrip("+*").strip()
    if own and wanted and own != wanted:
        raise InputError(
            f"{where}: continuation {name} after a line marked {card.mark}; expected lines in "
            "their order"
        )
    card.fields.extend(fields)
    card.mark = mark


def _start(file: InputFile, lines: list[_Line]) -> int:
    """Where the bulk data begins: executive and case control come before it."""
    start, control = -1, ""
    for place, (path, number, text) in enumerate(lines):
        word = text.lstrip()[:5].upper()
        if word not in ("BEGIN", "CEND"):
            continue
        word = text.strip().upper()
        if re.match(r"BEGIN\b", word):
            if word.replace("=", " ").split()[1:] not in ([], ["BULK"]):
                raise InputError(
                    f"{path}: line {number}: got {word[:40]!r}: one of several models in a file; "
                    "expected a single BEGIN BULK"
                )
            start = place + 1
        elif word == "CEND" and not control:
            control = f"{path}: line {number}"
    if start < 0 and control:
        raise InputError(f"{control}: CEND without BEGIN BULK after it; is {file.path} cut off?")
    return max(start, 0)


def _lines(file: InputFile, includes: Includes) -> Iterator[_Line]:
    path, kept = str(file.path), ""
    for number, whole in enumerate(text_lines(file, _EXPECTED), start=1):
        text = kept + whole.split("$", 1)[0].rstrip()
        if not text.strip():
            continue
        start = text.lstrip()[:7].upper()
        found = start == "INCLUDE" and re.match(r"\s*INCLUDE\b[\s=]*(.*)", text, re.IGNORECASE)
        if not found:
            yield path, number, text
            continue
        target = found[1].strip()
        # a name in quotes may go on in further lines
        kept = text if target[:1] in ("'", '"') and target.count(target[0]) < 2 else ""
        if not kept:
            where = f"{path}: line {number}: INCLUDE"
            with includes.included(target.strip("'\" "), file, where) as child:
                yield from _lines(child, includes)
    if kept:
        raise InputError(f"{path}: INCLUDE: the file's name doesn't end; expected a quote after it")


def _fields(text: str) -> tuple[str, list[str], str]:
    """Name, data fields and mark of a line, in free, small or large fields."""
    if "\t" in text:
        text = text.expandtabs(8)
    if "," in text:
        words = [word.strip() for word in text.split(",")]
        return words[0], *_free(words[1:], 4 if "*" in words[0] else 8)
    name = text[:8].strip()
    size = 16 if "*" in name else 8
    return name, [text[at : at + size].strip() for at in range(8, 72, size)], text[72:80].strip()


def _free(words: list[str], width: int) -> tuple[list[str], str]:
    """Fields of a free line. One that is longer than a line has fields goes on by itself, with or
    without the marks that would end and begin lines."""
    fields: list[str] = []
    while True:
        fields += words[:width]
        words = words[width:]
        if len(words) <= 1:
            return fields + [""] * (-len(fields) % width), words[0] if words else ""
        if words[0][:1] in ("", "+", "*"):
            words = words[1:]


NASTRAN_ELEMENTS: dict[str, dict[int, str]] = {
    "CTETRA": {4: "tet4", 10: "tet10"},
    "CHEXA": {8: "hex8", 20: "hex20"},
    "CPENTA": {6: "wedge6", 15: "wedge15"},
    "CPYRAM": {5: "pyramid5", 13: "pyramid13"},
    "CPYRA": {5: "pyramid5", 13: "pyramid13"},
    "CTRIA3": {3: "tri3"},
    "CTRIAR": {3: "tri3"},
    "CTRIA6": {6: "tri6"},
    "CQUAD4": {4: "quad4"},
    "CQUADR": {4: "quad4"},
    "CQUAD8": {8: "quad8"},
}
"""Card -> number of nodes -> kind of cell."""

SYSTEMS = ("CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S")

_REFUSED = {
    "=": "repeats the card before it with other numbers",
    "/": "deletes cards",
    **dict.fromkeys(
        ["SEBULK", "SELOC", "SEMPLN", "SEELT", "SESET", "CSUPER", "CSUPEXT", "SECONCT", "SEEXCLD"],
        "parts the model into superelements, or moves one",
    ),
    **dict.fromkeys(
        ["GRIDB", "GRIDF", "GRIDS", "RINGAX", "RINGFL", "POINTAX", "AXIC", "AXIF"],
        "gives nodes around an axis or in a fluid",
    ),
    **dict.fromkeys(["EGRID", "GRIDG", "CGEN", "SPCG", "PLOTG"], "generates nodes and elements"),
    **dict.fromkeys(["FEEDGE", "FEFACE", "GMCURV", "GMSURF", "GMCORD"], "bends edges and faces"),
    **dict.fromkeys(
        ["CIHEX1", "CIHEX2", "CIHEX3", "CRAC3D", "CHEX8", "CHEX20"],
        "is a solid that gpusim doesn't have",
    ),
}

# Materials, properties, loads, supports, constraints, elements that aren't solids, tables, sets,
# output: nothing of it moves, makes, scales or selects the nodes and solids of a mesh.
_HARMLESS = frozenset(
    """
    PARAM SPOINT EPOINT SEQGP POINT ECHOON ECHOOFF SNORM CORD3G CONM1 CONM2 CMASS1 CMASS2 CMASS3
    CMASS4 PMASS CELAS1 CELAS2 CELAS3 CELAS4 PELAS PELAST CBUSH CBUSH1D CBUSH2D PBUSH PBUSH1D
    PBUSH2D PBUSHT CDAMP1 CDAMP2 CDAMP3 CDAMP4 CDAMP5 PDAMP PDAMP5 PDAMPT CVISC PVISC CGAP PGAP
    CFAST PFAST CWELD PWELD CSEAM PSEAM CWSEAM PWSEAM GENEL CBAR CBARAO BAROR PBAR PBARL PBRSECT
    CBEAM CBEAM3 BEAMOR PBEAM PBEAM3 PBEAML PBCOMP PBMSECT CBEND PBEND CROD PROD CONROD CTUBE
    PTUBE PLOTEL PLOTEL3 PLOTEL4 PLOTEL6 PLOTEL8 PLOTTET PLOTHEX PLOTPEN PLOTPYR CSHEAR PSHEAR
    CQUAD CQUADX CQUADX4 CQUADX8 CTRIAX CTRIAX6 CTRAX3 CTRAX6 CPLSTN3 CPLSTN4 CPLSTN6 CPLSTN8
    CPLSTS3 CPLSTS4 CPLSTS6 CPLSTS8 CCONEAX PCONEAX CRAC2D PRAC2D PRAC3D PSHELL PSHEARN PCOMP
    PCOMPG PCOMPS PCOMPLS PCOMPP PLPLANE PPLANE PSOLID PLSOLID PIHEX PSLDN1 PSHLN1 PTRSHL PMREBAR
    PAABSF PACABS PACBAR CAABSF CHACAB CHACBR CIFHEX CIFPENT CIFQUAD PCOHE CHBDYE CHBDYG CHBDYP
    PHBDY CONV CONVM PCONV PCONVM RADBC RADM RADMT RADSET RADLST RADMTX RADBND RADCAV VIEW VIEW3D
    VIEWEX QBDY1 QBDY2 QBDY3 QHBDY QVECT QVOL RBAR RBAR1 RBE1 RBE2 RBE2GS RBE3 RROD RJOINT RSPLINE
    RSSCON RTRPLT RTRPLT1 RBAX3D RGYRO MPC MPCADD MPCY SPC SPC1 SPCADD SPCAX SPCD SPCR SPCOFF
    SPCOFF1 SUPORT SUPORT1 SUPAX SESUP GMSPC GMBC GMLOAD GMBNDC GMBNDS GMINTC GMINTS ASET ASET1
    BSET BSET1 CSET CSET1 OMIT OMIT1 QSET QSET1 USET USET1 BNDFIX BNDFIX1 BNDFREE BNDFRE1 BNDGRID
    SENQSET SEBSET SEBSET1 SECSET SECSET1 SEQSET SEQSET1 SEUSET SEUSET1 SEQSEP SETREE SEBNDRY
    SELABEL SELOAD SEDRSP2 SEDRSP3 SET1 SET2 SET3 SET4 SETOP SETADD ELIST PANEL LOAD LOADCYN
    LOADCYH LOADCYT LOADT LSEQ FORCE FORCE1 FORCE2 FORCEAX MOMENT MOMENT1 MOMENT2 MOMAX PLOAD
    PLOAD1 PLOAD2 PLOAD3 PLOAD4 PLOADX PLOADX1 PLOADB3 PLOADFP PRESAX PRESPT GRAV ACCEL ACCEL1
    ACCEL2 RFORCE RFORCE1 RFORCE2 SLOAD DEFORM DLOAD RLOAD1 RLOAD2 TLOAD1 TLOAD2 DAREA DELAY
    DPHASE TIC TF TSTEP TSTEP1 TSTEPNL TTEMP NOLIN1 NOLIN2 NOLIN3 NOLIN4 NLRGAP NLFREQ NLFREQ1
    NLHARM NLPARM NLPCI NLSTEP NLCNTL NLCNTL2 NLCNTLG NLOUT NLPERF NLPKGRP NLMOPTS NLADAPT NLAUTO
    NLSTRAT NXSTRAT ROTORG ROTORD ROTORSE UNBALNC DYNRED CYAX CYJOIN CYSUP CYSYM CYCLIC CYCSET
    MODTRAK MFLUID ACSRCE ACMODL ACPLNW AMLREG ALOAD IPSTRAIN ITER CREEP EQUIV CYCADD EIGB EIGC
    EIGP EIGR EIGRL EIGD RANDPS RANDT1 GUST GUST2 UXVEC FLSYM FREEPT FSLIST BDYLIST BDYOR DMI
    DMIAX DMIG DMIGOUT DMIGROT DMIJ DMIJI DMIK DMIR DTI DTABLE DTABLE2 DEQATN DCONADD DCONSTR
    DDVAL DESVAR DLINK DOPTPRM DSCONS DSCREEN DVAR DVBSHAP DVSET DVSHAP DVGRID DVGEOM DVCREL1
    DVCREL2 DVMREL1 DVMREL2 DVPREL1 DVPREL2 DREPADD DREPEAT DTPG DSHAPE TOPVAR BEADVAR DMNCON
    MONDSP1 MONPNT1 MONPNT2 MONPNT3 MONSUM MONCNCM MONGRP OUTPUT OUTRCV HYBDAMP FBODYLD FBODYSB
    FBADLAY BOLT BOLTFOR BOLTLD BOLTSEQ STRAIN ADAPT EFFIC VCEV MARCIN MARCOUT PSET PVAL FTGDEF
    FTGEVNT FTGLOAD FTGPARM FTGSEQ SWLDPRM PARAMARC RESTART TIM2PSD TOMVAR
    """.split()
)
# Families: MAT1, MATT9, MATHP; TABLED1, TABDMP1; DRESP2; aerodynamics; contact; temperatures.
_FAMILIES = (
    "MAT", "TAB", "DRESP", "FREQ", "TEMP", "NSM", "CAERO", "PAERO", "SPLINE", "AE", "FL", "MKAERO",
    "TRIM", "DIVERG", "CSSCHD", "BC", "BSURF", "BCONP", "BLSEG", "BFRIC", "BOUTPUT", "BGSET",
    "BGADD", "BEDGE", "BSQUEAL", "CONCT", "FRF",
)  # fmt: skip

_READ = {"GRID", "GRDSET", *SYSTEMS, *NASTRAN_ELEMENTS}


def check_card(card: BdfCard) -> None:
    """Raises InputError for a card that is refused, or isn't known."""
    name = card.name
    if name in _READ:
        return
    reason = _REFUSED.get(name[:1] if name[:1] in "=/" else name, "")
    if reason:
        card.fail(f"not supported: it {reason}; expected all nodes and elements as they are")
    if name not in _HARMLESS and not name.startswith(_FAMILIES):
        hint = nearest_name(name, [*_READ, *_HARMLESS])
        card.fail(f"unknown card; expected Nastran bulk data{hint}")


_INTEGER = re.compile(r"[+-]?\d{1,15}", re.ASCII)
# 1.5-3 and 1.5D-3 stand for 1.5e-3
_REAL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[ED]?([+-]?\d+))?", re.ASCII | re.IGNORECASE)


def integer(word: str, card: BdfCard) -> int:
    """A whole number. Raises InputError."""
    if not _INTEGER.fullmatch(word):
        card.fail(f"got {word!r}; expected a whole number")
    return int(word)


def real(word: str, card: BdfCard) -> float:
    """A coordinate; an empty field is zero. Raises InputError."""
    if not word:
        return 0.0
    found = _REAL.fullmatch(word)
    value = float(f"{found[1]}e{found[2] or 0}") if found else math.nan
    if not abs(value) <= LARGEST:
        card.fail(f"got {word!r}; expected a coordinate, at most {LARGEST:g}")
    return value


def integers(rows: Sequence[Sequence[str]], cards: Sequence[BdfCard]) -> Long:
    """(N,k) whole numbers of rows of words, one row of each card. Raises InputError."""
    return _table(rows, cards, integer, np.dtype(np.int64))


def reals(rows: Sequence[Sequence[str]], cards: Sequence[BdfCard]) -> Float:
    """(N,k) coordinates of rows of words, one row of each card. Raises InputError."""
    return _table(rows, cards, real, np.dtype(np.float64))


def _table(
    rows: Sequence[Sequence[str]], cards: Sequence[BdfCard],
    one: Callable[[str, BdfCard], float], kind: np.dtype[Any],
) -> npt.NDArray[Any]:  # fmt: skip
    """All words as numbers at once, or ``one`` by one where that fails."""
    if is_plain("".join(word for row in rows for word in row)):
        with suppress(ValueError, OverflowError):
            quick = np.array(rows, dtype=kind)
            if (np.abs(quick) <= LARGEST).all():
                return quick
    each = zip(rows, cards, strict=True)
    return np.array([[one(word, card) for word in row] for row, card in each], dtype=kind)
