"""Vibration against published values and dense algebra, and its time beside SciPy, SLEPc and
CalculiX: ``python -m benchmarks.vibration``."""

from __future__ import annotations

import argparse

from benchmarks.nonlinear.__main__ import print_table
from benchmarks.vibration import accuracy, dense, speed
from benchmarks.vibration.speed import SIZES


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", default="", metavar="TEXT", help="part of the cases' names")
    parser.add_argument("--only", choices=("accuracy", "dense", "speed", "steps"),
                        help="one table of these; default all")  # fmt: skip
    parser.add_argument(
        "--size",
        choices=SIZES,
        action="append",
        help="unknowns of the tables of speed; repeatable, default small",
    )
    parser.add_argument("--modes", type=int, default=10, metavar="N", help="modes to find")
    parser.add_argument("--steps", type=int, default=200, metavar="N", help="steps of time")
    parser.add_argument("--repeat", type=int, default=2, help="runs of which the best counts")
    parser.add_argument("--no-peers", action="store_true", help="measure gpusim alone")
    parser.add_argument("--limit", type=float, default=1800.0, metavar="S",
                        help="seconds after which a peer is stopped")  # fmt: skip
    given = parser.parse_args()
    sizes, peers = given.size or ["small"], not given.no_peers
    if given.only in (None, "accuracy"):
        print_table(accuracy.HEADINGS, accuracy.accuracy(given.case))
    if given.only in (None, "dense"):
        print_table(dense.HEADINGS, dense.beside_dense(given.case))
    for size in sizes if given.only in (None, "speed") else ():
        print_table(speed.MODES_HEADINGS, speed.modes_speed(
            size, given.case, given.modes, given.repeat, peers, given.limit))  # fmt: skip
    for size in sizes if given.only in (None, "steps") else ():
        print_table(speed.STEPS_HEADINGS, speed.steps_speed(
            size, given.case, given.steps, peers, given.limit))  # fmt: skip


if __name__ == "__main__":
    main()
