"""Valid .inp meshes, decks and .bdf files, and seeded mutations of them."""

from __future__ import annotations

import random
import re

from tests.support.deck_texts import FIXED, MATERIAL, MODEL, deck, step

BDF = """SOL 101
CEND
BEGIN BULK
CORD2R,5,0,1.,0.,0.,1.,0.,1.,+
+,2.,0.,0.
GRDSET,,5
GRID    1               0.0     0.0     0.0
GRID*   2                               1.0             0.0
*       0.0
GRID,3,,1.0,1.0,0.0
GRID    4               0.0     1.+0    0.0
GRID    11      0       1.0     0.0     2.0
GRID    12              1.0     0.0     20.-1
GRID    13              1.0     1.0     2.0D0
GRID    14              0.0     1.0     2.0
PSOLID,7,1
CHEXA   1       7       1       2       3       4       11      12      +
+       13      14
CQUAD4,2,3,1,2,12,11
ENDDATA
"""
GENERATED = """*SYSTEM
1., 0., 0., 2., 1., 0.
0., 3., 1.
*NODE
1, 0., 0., 0.
5, 4., 0., 0.
101, 0., 0., 5.
105, 4., 0., 5.
31, 0., 6., 0.
35, 4., 6., 0.
131, 0., 6., 5.
135, 4., 6., 5.
*NGEN, NSET=NEAR
1, 5, 2
101, 105, 2
*NGEN, NSET=FAR
31, 35, 2
131, 135, 2
*NFILL, NSET=ALL
NEAR, FAR, 3, 10
*ELEMENT, TYPE=C3D8, ELSET=ONE
1, 1, 3, 13, 11, 101, 103, 113, 111
*ELGEN, ELSET=BRICKS
1, 2, 2, 1, 3, 10, 100
*NSET, NSET=LEFT, GENERATE
1, 131, 10
"""
ASSEMBLY = f"""*PART, NAME=P
{MODEL}*SOLID SECTION, ELSET=BRICKS, MATERIAL=STEEL
*END PART
*ASSEMBLY, NAME=A
*INSTANCE, NAME=P-1, PART=P
*END INSTANCE
*INSTANCE, NAME=P-2, PART=P
0., 9., 0.
0., 0., 0., 0., 0., 1., 30.
*END INSTANCE
*NSET, NSET=BOTH
P-1.LEFT, P-2.LEFT
*END ASSEMBLY
*MATERIAL, NAME=STEEL
*ELASTIC
200., 0.25
*BOUNDARY
BOTH, 1, 3
"""
_MORE = """*AMPLITUDE, NAME=A, TIME=TOTAL TIME
0., 0., 2., 1.
*ORIENTATION, NAME=O
1., 1., 0., 0., 1., 0.
*TRANSFORM, NSET=RIGHT
0., 1., 0., 0., 0., 1.
*EQUATION
2
13, 1, 1., 22, 1, -1.
*INITIAL CONDITIONS, TYPE=TEMPERATURE
ALL, 10.
"""
_CARDS = ["*CLOAD, AMPLITUDE=A", "RIGHT, 2, 1.", "*DLOAD", "BRICKS, P1, 2.",
          "BRICKS, GRAV, 9.81, 0., 0., -1.", "*DSLOAD", "END, P, 1.", "*TEMPERATURE", "ALL, 30.",
          "*BOUNDARY", "13, 3, 3, 0.01"]  # fmt: skip
_RECORD = "*AMPLITUDE, NAME=A\n0., 0., 1., 2.\n"
_DAMPED = MATERIAL.replace("*DENSITY", "*DAMPING, ALPHA=0.1, BETA=0.01\n*DENSITY")
_VIBRATION = "".join([
    step("*CLOAD", "22, 1, 1."),
    step("2, 0., 9.", static="*FREQUENCY"),
    step("*CLOAD, AMPLITUDE=A", "22, 2, 1.", "*MODAL DAMPING", "1, 2, 0.1",
         static="*MODAL DYNAMIC\n0.1, 0.5"),
    step("*MODAL DAMPING, RAYLEIGH", ",, 0.1, 0.2", "*CLOAD, LOAD CASE=2", "22, 3, 1.",
         "*BASE MOTION, DOF=1, AMPLITUDE=A", static="*STEADY STATE DYNAMICS\n0.1, 2., 5, 3."),
    step("*CLOAD", "22, 1, -1.", static="*BUCKLE\n2, 0.01"),
])  # fmt: skip
_THROWN = "*INITIAL CONDITIONS, TYPE=VELOCITY\nRIGHT, 3, -1.\n"
_FLIGHT = step("*DLOAD", "BRICKS, GRAV, 9.81, 0., 0., -1.", static="*DYNAMIC, ALPHA=-0.1\n0.1, 1.")
SEEDS: dict[str, str] = {
    "deck.inp": deck(_MORE, step(*_CARDS), step("*CLOAD, OP=NEW", "22, 1, 1.")),
    "generated.inp": deck(step("*CLOAD", "135, 3, 1."), model=GENERATED, material=MATERIAL,
                          fixed=FIXED),
    "vibration.inp": deck(_VIBRATION, model=MODEL + _RECORD, material=_DAMPED),
    "flight.inp": deck(_THROWN, _FLIGHT),
    "assembly.inp": ASSEMBLY + step("*CLOAD", "P-2.22, 1, 1."),
    "brick.bdf": BDF,
}  # fmt: skip

_NUMBERS = ["0", "-1", "1", "2", "99", "nan", "inf", "1e308", "-1e308", "1e-320", "1_0", "", "x",
            "9999999999", "9223372036854775807", "99999999999999999999", "1.5", "0x10", "\u0663",
            "4000000000", "1.+300", "5000000", "1D400"]  # fmt: skip
_WORDS = [
    "*NODE",
    "*ELEMENT, TYPE=C3D8",
    "*ELEMENT, TYPE=C3D20R",
    "*NGEN",
    "*ELGEN",
    "*NFILL",
    "*SYSTEM",
    "*STEP",
    "*END STEP",
    "*STATIC",
    "*FREQUENCY",
    "*MODAL DYNAMIC",
    "*DYNAMIC",
    "*PART, NAME=Q",
    "*END PART",
    "*EQUATION",
    "*INSTANCE, NAME=P-1, PART=P",
    "*END ASSEMBLY",
    "*INCLUDE, INPUT=/dev/zero",
    "*",
    "*INCLUDE, INPUT=self",
    "INCLUDE '/dev/urandom'",
    "INCLUDE 'self'",
    "INCLUDE '",
    "GRDSET,,9",
    "CORD2C,9,9,0.,0.,0.,0.,0.,1.",
    "=,=,*(1),==",
    "BEGIN BULK",
    "ENDDATA",
    "*NSET, NSET=ALL",
    "*SURFACE, NAME=END",
    "*TIE, NAME=T",
    "*ELSET, ELSET=BRICKS, GENERATE",
    "*NODE,",
]


def mutated(text: str, chance: random.Random, name: str) -> bytes:
    """One to four mutations of numbers, words, lines, letters and bytes."""
    for _ in range(chance.randint(1, 4)):
        lines = text.split("\n")
        at = chance.randrange(len(lines))
        kind = chance.randrange(8)
        if kind == 0:
            numbers = list(re.finditer(r"[-+]?\d[\d.]*", text))
            one = chance.choice(numbers) if numbers else None
            if one:
                text = text[: one.start()] + chance.choice(_NUMBERS) + text[one.end() :]
            continue
        if kind == 1:
            del lines[at]
        elif kind == 2:
            lines.insert(at, lines[chance.randrange(len(lines))])
        elif kind == 3:
            lines.insert(at, chance.choice(_WORDS).replace("self", name))
        elif kind == 4:
            other = chance.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
        elif kind == 5:
            lines[at] = lines[at].replace(chance.choice(",=*. "), chance.choice(",=*. \t\"'"), 1)
        elif kind == 6:
            lines[at] = lines[at][: chance.randrange(len(lines[at]) + 1)]
        else:
            place = chance.randrange(len(text) + 1)
            text = text[:place] + chr(chance.choice([0, 9, 13, 27, 133, 255, 8238])) + text[place:]
            continue
        text = "\n".join(lines)
    data = text.encode()
    if chance.random() < 0.1 and data:
        place = chance.randrange(len(data))
        data = data[:place] + bytes([chance.randrange(256)]) + data[place + 1 :]
    return data[: chance.randrange(len(data) + 1)] if chance.random() < 0.05 else data
