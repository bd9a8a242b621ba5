"""Messages about a mesh, in the numbers of the file that it comes from."""

from __future__ import annotations

import re
from collections.abc import Callable

__all__ = ["in_numbers_of_file"]

_CELLS = re.compile(r"(?<=got )(?:for example )?(?:faces of )?cells? (\d+(?:(?:, | and )\d+)*)")


def in_numbers_of_file(message: str, named: Callable[[int], str]) -> str:
    """A mesh counts cells from 0: their numbers in what it says are replaced by ``named`` ones.

    Examples
    --------
    >>> in_numbers_of_file("Mesh.cells: 2 inverted cells; got cells 0, 3 (J < 0)", "e{}".format)
    '2 inverted cells; got e0 and e3 (J < 0)'
    """

    def replaced(found: re.Match[str]) -> str:
        return " and ".join(named(int(number)) for number in re.findall(r"\d+", found[1]))

    return _CELLS.sub(replaced, message.replace("Mesh.cells: ", ""))
