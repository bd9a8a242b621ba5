"""Small input decks for the tests: two bricks, and the cards around them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

# Two bricks along x, 2 x 3 x 5 and 4 x 3 x 5; node 11 is the first one's origin.
_X, _Y, _Z = (0.0, 2.0, 6.0), (0.0, 3.0), (0.0, 5.0)
POINTS = np.array([[x, y, z] for z in _Z for y in _Y for x in _X])
LABELS = np.arange(11, 23)
NODE_LINES = "\n".join(
    f"{label}, {x}, {y}, {z}" for label, (x, y, z) in zip(LABELS, POINTS, strict=True)
)
ELEMENT_LINES = "7, 11, 12, 15, 14, 17, 18, 21, 20\n9, 12, 13, 16, 15, 18, 19, 22, 21"

MODEL = f"""*HEADING
two bricks
*NODE, NSET=ALL
{NODE_LINES}
*ELEMENT, TYPE=C3D8, ELSET=BRICKS
{ELEMENT_LINES}
*NSET, NSET=LEFT
11, 14, 17, 20
*NSET, NSET=RIGHT
13, 16, 19, 22
*SURFACE, NAME=END
9, S4
"""
MATERIAL = """*MATERIAL, NAME=STEEL
*ELASTIC
200., 0.25
*DENSITY
3.
*EXPANSION
2.E-3
*SOLID SECTION, ELSET=BRICKS, MATERIAL=STEEL
"""
METAL = MATERIAL.replace("*DENSITY", "*PLASTIC\n1., 0.\n2., 0.1\n*DENSITY")
FIXED = """*BOUNDARY
LEFT, 1, 3
"""


def step(*cards: str, static: str = "*STATIC") -> str:
    """A step of these cards."""
    return "\n".join(["*STEP", static, *cards, "*END STEP"]) + "\n"


def deck(*parts: str, model: str = MODEL, material: str = MATERIAL, fixed: str = FIXED) -> str:
    """A deck of these parts after the two bricks."""
    return model + material + fixed + "".join(parts)


def write(folder: Path, text: str, name: str = "two.inp") -> Path:
    """The text as a file."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def line_of(text: str, part: str) -> int:
    """Number of the first line that holds ``part``."""
    return next(k for k, line in enumerate(text.splitlines(), start=1) if part in line)
