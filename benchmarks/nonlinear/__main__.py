"""Large displacements against references, and time beside CalculiX and torch-fem:
``python -m benchmarks.nonlinear``."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence

from benchmarks.nonlinear import accuracy, speed, stretch


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", default="", metavar="TEXT", help="part of the cases' names")
    parser.add_argument("--only", choices=("accuracy", "speed", "stretch"), help="default all")
    parser.add_argument("--repeat", type=int, default=2, help="runs of which the best counts")
    parser.add_argument("--no-peers", action="store_true", help="measure gpusim alone")
    given = parser.parse_args()
    if given.only in (None, "accuracy"):
        print_table(accuracy.HEADINGS, accuracy.accuracy(given.case))
    if given.only in (None, "speed"):
        print_table(speed.HEADINGS, speed.speed(given.case, given.repeat, not given.no_peers))
    if given.only in (None, "stretch"):
        print_table(stretch.HEADINGS, stretch.stretch(not given.no_peers))


def print_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """A table, row by row as these are measured."""
    for line in markdown(headings, rows):
        print(line, flush=True)
    print()


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield "| " + " | ".join(headings) + " |"
    yield "|" + "---|" * len(headings)
    for row in rows:
        yield "| " + " | ".join(text.replace("|", "/") for text in row) + " |"


if __name__ == "__main__":
    main()
