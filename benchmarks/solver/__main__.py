"""Run time against displacement error, memory, bandwidth and growth, other solvers beside it:
``python -m benchmarks.solver``."""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.solver.cases import CASES
from benchmarks.solver.measure import run_peer_bench
from benchmarks.solver.peers import PEERS
from benchmarks.solver.tables import write_solver
from gpusim.bench.solver_cases import SIZES, find_cases


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", choices=SIZES, default="small", help="30k, 350k, 3M unknowns")
    parser.add_argument("--case", metavar="NAME", help="one case, or family of cases")
    parser.add_argument("--peer", metavar="TEXT", action="append", help="part of a peer's name")
    parser.add_argument("--no-peers", action="store_true", help="measure gpusim alone")
    parser.add_argument("--repeat", type=int, default=3, help="pairs, one load case and two")
    parser.add_argument("-o", "--output", type=Path, default=Path("bench"), metavar="DIR")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="default DIR/work")
    given = parser.parse_args()
    peers = [p for p in PEERS if any(text in p.name for text in given.peer or [""])]
    result = run_peer_bench(
        find_cases(given.sizes, given.case, CASES), given.cache or given.output / "work",
        peers=[] if given.no_peers else peers, repeat=given.repeat,
        save=lambda found: write_solver(found, given.output),
    )  # fmt: skip
    print(*write_solver(result, given.output), sep="\n")


if __name__ == "__main__":
    main()
