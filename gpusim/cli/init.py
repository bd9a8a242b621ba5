"""``gpusim init``: a first scene, of a part of the user's own or from a template.

Templates are the files of `templates` beside this module, and the examples.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Annotated

import typer

from gpusim.cli.console import exit_codes, importing, out
from gpusim.cli.help import definition_list
from gpusim.errors import InputError, nearest_name, require
from gpusim.files.atomic_files import write_text
from gpusim.printable import printable

PLATE = "plate_with_hole.toml"


def templates() -> dict[str, Path]:
    """Scenes to start from, by name."""
    package = Path(__file__).parents[1]
    places = (folder.joinpath("examples") for folder in (package, package.parent))
    folder = next(one for one in places if one.is_dir())
    found = {"plate_with_hole": Path(__file__).with_name("templates") / PLATE}
    scenes = (path for path in folder.glob("*.toml") if not path.name.startswith("study_"))
    return found | {path.stem: path for path in sorted(scenes)}


def template_names(incomplete: str) -> list[str]:
    """Those that begin so, for the shell."""
    return [name for name in templates() if name.startswith(incomplete)]


def init(
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="PART|TEMPLATE",
            autocompletion=template_names,
            help="A CAD or mesh file (.step .stp .brep .stl .msh .inp ...), or a template's name.",
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE.toml", help="The scene to write.")
    ] = Path("scene.toml"),
    listed: Annotated[bool, typer.Option("--list", help="List the templates.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite what is there.")] = False,
) -> None:
    """Write a commented scene to start from: of your own part, or from a template.

    gpusim init part.step -o part.toml

    gpusim init plate_with_hole
    """
    with exit_codes():
        known = templates()
        if listed or source is None:
            from rich.console import Console

            rows = ((name, _about(path)) for name, path in known.items())
            Console(highlight=False).print(definition_list(rows))
            out("\n  gpusim init NAME, or of your own part: gpusim init part.step")
            return
        path = Path(source)
        if source not in known and not path.is_file():
            expected = f"a CAD or mesh file, or one of {', '.join(known)}"
            hint = nearest_name(source, known)
            raise InputError(
                f"init: no such file or template; got {source}; expected {expected}{hint}"
            )
        name = printable(str(output))
        require(name == str(output), "-o: control characters", name, "a name without them")
        if output.exists() and not force:
            raise InputError(f"{output}: is there already; expected another -o, or --force")
        with importing():
            from gpusim.cli.scene_templates import scene_of_part, scene_of_template

        make = scene_of_template if source in known else scene_of_part
        text = make(known.get(source, path), output)
        write_text(output, text)
        out(f"{output} is written. Next:\n")
        scene = str(output)
        for words in (["plan", scene], ["view", scene], ["run", scene, "-o", f"out/{output.stem}"]):
            out("  " + shlex.join(["gpusim", *words]))


def _about(path: Path) -> str:
    """The first sentence of a template."""
    head = path.read_text(encoding="utf-8").partition("\n#\n")[0]
    return re.split(r"(?<=[.?]) ", head.replace("\n# ", " ").removeprefix("# "))[0]
