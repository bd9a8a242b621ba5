"""Run time against error of the image, lit and unlit, other renderers beside it:
``python -m benchmarks.render``."""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.render.cases import IMAGE_CASES
from benchmarks.render.measure import IMAGE_PEERS, run_render_bench
from benchmarks.render.tables import write_render
from gpusim.bench.image_cases import SIZES, find_image_cases


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", choices=SIZES, default="small", help="1.3, 5, 21 megapixels")
    parser.add_argument("--case", metavar="NAME", action="append", help="cases that begin with it")
    parser.add_argument("--peer", metavar="TEXT", action="append", help="part of a peer's name")
    parser.add_argument("--no-peers", action="store_true", help="measure gpusim alone")
    parser.add_argument("-o", "--output", type=Path, default=Path("bench"), metavar="DIR")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="default DIR/work")
    given = parser.parse_args()
    texts = given.case or [""]
    names = dict.fromkeys(name for text in texts for name in find_image_cases(text, IMAGE_CASES))
    asked = [text.lower() for text in given.peer or [""]]
    peers = [p for p in IMAGE_PEERS if any(text in p.name.lower() for text in asked)]
    if given.peer:
        peers = [peer.asked() for peer in peers]
    result = run_render_bench(
        list(names), given.size, given.cache or given.output / "work",
        peers=[] if given.no_peers else peers,
        save=lambda found: write_render(found, given.output),
    )  # fmt: skip
    print(*write_render(result, given.output), sep="\n")


if __name__ == "__main__":
    main()
