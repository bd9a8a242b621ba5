"""``gpusim bench``: run time against error of the solver and of images on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from gpusim.cli.console import PrintableGroup, exit_codes, out
from gpusim.cli.help import CommandLine

bench_app = CommandLine(
    cls=PrintableGroup, help="Measure speed and accuracy on this machine.", no_args_is_help=True
)

Folder = Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Where tables go.")]
Cache = Annotated[
    Path | None, typer.Option(metavar="DIR", help="References; default DIR/work.")
]  # fmt: skip
Size = Literal["small", "standard", "full"]
"""How large the models get."""


@bench_app.command()
def solver(
    sizes: Annotated[
        Size, typer.Option(help="small: to 30k unknowns; standard: 350k; full: 3M.")
    ] = "small",
    case: Annotated[
        str | None, typer.Option("--case", metavar="NAME", help="One case, or family of cases.")
    ] = None,
    output: Folder = Path("bench"),
    cache: Cache = None,
) -> None:
    """Run time and memory against displacement error."""
    with exit_codes():
        from gpusim.bench.solver import run_solver_bench, write_solver
        from gpusim.bench.solver_cases import find_cases

        cases = find_cases(sizes, case)
        results = run_solver_bench(
            cases, cache or output / "work", out, lambda found: write_solver(found, output)
        )
        out(str(write_solver(results, output)))


@bench_app.command()
def render(
    size: Annotated[
        Size, typer.Option(help="small: up to 1.3 megapixels; standard: 5; full: 21.")
    ] = "small",
    case: Annotated[
        list[str] | None,
        typer.Option("--case", metavar="NAME", help="Cases that begin with NAME (repeatable)."),
    ] = None,
    output: Folder = Path("bench"),
    cache: Cache = None,
) -> None:
    """Run time against error of the image, lit and unlit."""
    with exit_codes():
        from gpusim.bench.image_cases import find_image_cases
        from gpusim.bench.images import run_image_bench, write_images

        names = dict.fromkeys(name for text in case or [""] for name in find_image_cases(text))
        results = run_image_bench(
            list(names), size, cache or output / "work", out,
            lambda found: write_images(found, output),
        )  # fmt: skip
        out(str(write_images(results, output)))
