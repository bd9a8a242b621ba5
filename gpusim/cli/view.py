"""``gpusim view``: the preview window."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from gpusim.choices import LengthUnit
from gpusim.cli.console import exit_codes, importing, out
from gpusim.errors import require
from gpusim.interrupts import INTERRUPTED
from gpusim.printable import printable

PORT = 60649

Legend = Annotated[
    tuple[float, float] | None,
    typer.Option(metavar="LOW HIGH", help="Of the field's legend, in its unit, held."),
]
Unit = Annotated[
    LengthUnit | None,
    typer.Option(help="Of a mesh file's coordinates: mm unless said, of glTF m."),
]


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)[x×](\d+)", str(text))  # noqa: RUF001
    size = (int(found[1]), int(found[2])) if found else (0, 0)
    fits = all(16 <= side <= 8192 for side in size)
    require(fits, "view --size", repr(text), "WIDTHxHEIGHT, 16 to 8192 px: 1280x800")
    return size


def view(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="SCENE|OUT|MESH", help="A scene, the folder of a run, a mesh or CAD file."
        ),
    ],
    screenshot: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Write what the window would show; no display."),
    ] = None,
    camera: Annotated[str | None, typer.Option(help="Look through this camera.")] = None,
    frame: Annotated[int | None, typer.Option(help="Show this frame, once it is solved.")] = None,
    field: Annotated[
        str | None, typer.Option(help="Colour by a field: von_mises, displacement …")
    ] = None,
    legend: Legend = None,
    keys: Annotated[str, typer.Option(help='Press these keys, once solved: "x g PageUp".')] = "",
    unit: Unit = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="Of the window, px.")] = "1280x800",
    serve: Annotated[
        bool, typer.Option("--serve", help="Show it in a browser on this machine.")
    ] = False,
    port: Annotated[int, typer.Option(help="Of --serve.")] = PORT,
) -> None:
    """Look at a scene while you write it, at a run's results, or at a mesh.

    h shows the keys. A scene is read again when its file changes.
    """
    with exit_codes():
        pixels = _size(size)
        with importing():
            from gpusim.gpu import default_device
            from gpusim.view import screenshot as pictures
            from gpusim.view import server, window
            from gpusim.view.viewer import Viewer

        if screenshot is not None:
            pictures.check_ending(screenshot)
        where = server.local_socket(port) if serve else None
        loaded = frame is not None or field is not None or bool(keys)
        solves = screenshot is None or loaded
        if screenshot is None:  # a CAD file takes seconds
            typer.echo(f"reading {printable(str(path))} …", err=True)
        viewer = Viewer(default_device(), path, pixels, solves, unit)
        try:
            if loaded:
                pictures.wait_for_solution(viewer)
            pictures.look_as_asked(viewer, camera, frame, field, legend=legend, keys=keys.split())
            if screenshot is not None:
                pictures.save_screenshot(viewer, screenshot)
                out(str(screenshot))
                return
            if where is None:
                window.open_window(viewer)
            else:
                out(f"http://127.0.0.1:{where.getsockname()[1]}/ shows {path}; Ctrl-C ends it")
                server.serve_view(viewer, where)
        except KeyboardInterrupt:
            raise typer.Exit(INTERRUPTED) from None
        finally:
            viewer.close()
