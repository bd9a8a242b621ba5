"""``gpusim bench``: solver and images against other programs, and the stability suite."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from gpusim.cli.console import exit_codes, out

__all__ = ["bench_app"]

bench_app = typer.Typer(help="Measure speed and stability.", no_args_is_help=True)

Folder = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="Where tables and figures go.")
]


class Size(StrEnum):
    """How large the models get."""

    small = "small"
    standard = "standard"
    full = "full"


Peers = Annotated[
    list[str] | None,
    typer.Option(metavar="TEXT", help="Only peers whose name holds TEXT (repeatable)."),
]
NoPeers = Annotated[bool, typer.Option("--no-peers", help="Measure gpusim alone.")]
Cache = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="References and arrays for peers; default DIR/work."),
]


def _alone(scripts: Path | None, asked: list[str] | None) -> bool:
    """Whether there are no scripts of peers; says so. Raises InputError if peers are asked for."""
    from gpusim.bench.peers import NO_CHECKOUT
    from gpusim.errors import InputError

    if scripts is not None:
        return False
    if asked:
        raise InputError(f"bench: --peer; got {', '.join(asked)}; {NO_CHECKOUT}")
    out(NO_CHECKOUT)
    return True


@bench_app.command()
def solver(
    sizes: Annotated[
        Size, typer.Option(help="small: to 30k unknowns; standard: 350k; full: 3M.")
    ] = Size.small,
    case: Annotated[
        str | None, typer.Option("--case", metavar="NAME", help="One case, or family of cases.")
    ] = None,
    peer: Peers = None,
    no_peers: NoPeers = False,
    repeat: Annotated[
        int, typer.Option(min=1, metavar="N", help="Pairs of runs, one load case and two.")
    ] = 3,
    output: Folder = Path("bench"),
    cache: Cache = None,
) -> None:
    """Run time against displacement error, memory, bandwidth and scaling; peers beside it."""
    with exit_codes():
        from gpusim.bench.cases import find_cases
        from gpusim.bench.peers import PEERS, peer_folder
        from gpusim.bench.solver import SolverResult, run_solver_bench
        from gpusim.bench.tables import write_solver

        chosen = find_cases(sizes.value, case)
        alone = no_peers or _alone(peer_folder(), peer)
        wanted = [] if alone else [p for p in PEERS if any(t in p.name for t in peer or [""])]
        work = cache or output / "work"

        def save(result: SolverResult) -> None:
            write_solver(result, output)

        result = run_solver_bench(chosen, work, peers=wanted, repeat=repeat, tell=out, save=save)
        for path in write_solver(result, output):
            out(str(path))


@bench_app.command()
def render(
    size: Annotated[
        Size, typer.Option(help="small: up to 1.3 megapixels; standard: 5; full: 21.")
    ] = Size.small,
    case: Annotated[
        list[str] | None,
        typer.Option("--case", metavar="NAME", help="Cases that begin with NAME (repeatable)."),
    ] = None,
    peer: Peers = None,
    no_peers: NoPeers = False,
    output: Folder = Path("bench"),
    cache: Cache = None,
) -> None:
    """Run time against error of the image, lit and unlit; other renderers beside it."""
    with exit_codes():
        from gpusim.bench.images import find_image_cases
        from gpusim.bench.peers import peer_folder
        from gpusim.bench.render import IMAGE_PEERS, RenderResult, run_render_bench
        from gpusim.bench.render_tables import write_render

        names = [name for text in case or [""] for name in find_image_cases(text)]
        known = [p for p in IMAGE_PEERS if any(t.lower() in p.name.lower() for t in peer or [""])]
        if peer:
            known = [one.asked() for one in known]

        def save(result: RenderResult) -> None:
            write_render(result, output)

        result = run_render_bench(
            list(dict.fromkeys(names)), size.value, cache or output / "work",
            peers=[] if no_peers or _alone(peer_folder(), peer) else known, tell=out, save=save,
        )  # fmt: skip
        for path in write_render(result, output):
            out(str(path))


@bench_app.command()
def stability(
    only: Annotated[
        str, typer.Option("--case", metavar="TEXT", help="Cases whose name holds TEXT.")
    ] = "",
    quick: Annotated[bool, typer.Option("--quick", help="The cases of the test suite.")] = False,
    way: Annotated[
        list[str] | None,
        typer.Option(help="auto, multigrid, double-single, numpy (repeatable; default all)."),
    ] = None,
    output: Folder = Path("bench"),
) -> None:
    """Hard models: each is right within its stated error, or an error names the cause."""
    with exit_codes():
        from gpusim.bench.hard_cases import hard_cases
        from gpusim.bench.stability import SILENT, WAYS, describe, run_suite
        from gpusim.bench.tables import write_stability
        from gpusim.errors import InputError
        from gpusim.gpu import default_device

        ways = tuple(way or WAYS)
        for name in ways:
            if name not in WAYS:
                raise InputError(
                    f"bench stability: --way; got {name!r}; expected {', '.join(WAYS)}"
                )
        cases = [c for c in hard_cases() if only in c.name and (c.quick or not quick)]
        if not cases:
            raise InputError(f"bench stability: --case; got {only!r}; no case's name holds it")
        verdicts = run_suite(cases, ways, tell=lambda v: out(describe(v)))
        for path in write_stability(verdicts, output, default_device().name):
            out(str(path))
        silent = sum(v.verdict == SILENT for v in verdicts)
        out(f"{len(verdicts)} solves, {silent} silent failures")
        if silent:
            raise typer.Exit(1)
