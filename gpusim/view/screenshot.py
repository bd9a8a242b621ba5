"""The window's picture without a window: no display, no X server, and none of the extra
``[view]``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError, NotConverged
from gpusim.export.images import write_image
from gpusim.validation import require, require_one_of
from gpusim.view.keys import ALIASES, KEYS
from gpusim.view.legend_range import APART, FAR, is_range
from gpusim.view.viewer import Viewer
from gpusim.visualization.overlay import pixels_of

FORMAT = "rgba8unorm"


def screenshot(viewer: Viewer, size: tuple[int, int] | None = None) -> npt.NDArray[np.uint8]:
    """(H, W, 3) uint8: what the window would show at full quality; ``size``: (W, H) px.

    Examples
    --------
    >>> from gpusim.view.screenshot import screenshot
    >>> from gpusim.view.viewer import Viewer
    >>> viewer = Viewer(gs.Device(), Path("bar.toml"), (160, 100), solve=False)
    >>> screenshot(viewer).shape
    (100, 160, 3)
    """
    width, height = size or viewer.size
    device = viewer.device
    target = device.texture(width, height, FORMAT, "view.screenshot")
    viewer.draw(target, whole=True)
    return np.ascontiguousarray(pixels_of(device, target)[..., :3])


def check_ending(path: Path) -> None:
    """Raises InputError for another than that of a PNG."""
    png = path.suffix.lower() == ".png"
    require(png, "view: screenshot", path, "a name that ends with .png")


def save_screenshot(viewer: Viewer, path: Path) -> None:
    """Write it as PNG.

    Raises
    ------
    InputError
        Another ending, or a place that can't be written to.
    """
    check_ending(path)
    write_image(path, screenshot(viewer))


def wait_for_solution(viewer: Viewer) -> None:
    """Until a scene that is being solved is shown loaded.

    Raises
    ------
    NotConverged
        It can't be solved.
    """
    while viewer.solver is not None:
        viewer.tick()
        if viewer.solver is not None:
            time.sleep(0.05)
    if viewer.fault:
        raise NotConverged(f"view {viewer.path}: {viewer.fault}")


def look_as_asked(
    viewer: Viewer,
    camera: str | None,
    frame: int | None,
    field: str | None,
    *,
    legend: tuple[float, float] | None = None,
    keys: Sequence[str] = (),
) -> None:
    """Show a camera of the scene, a frame and a field, its ``legend`` from one value to another,
    and what ``keys`` do.

    Raises
    ------
    InputError
        There is no such camera, frame, field or key, or the content can't be shown at all.
    """
    content = viewer.content
    if content is None:
        raise InputError(viewer.fault)
    if camera is not None:
        names = [own.name for own in content.cameras]
        require(camera in names, "view --camera", repr(camera), f"one of {names}")
        viewer.look_through(names.index(camera))
    if frame is not None:
        last = content.frames - 1
        require(0 <= frame <= last, "view --frame", frame, f"0 to {last}")
        viewer.show_frame(frame)
    if field is not None:
        viewer.show_field(field)
    if legend is not None:
        expected = f"LOW HIGH, growing by {APART:g} of the larger one at least, up to {FAR:g}"
        require(is_range(*legend), "view --legend", "{!r} {!r}".format(*legend), expected)
        require(field is not None, "view --legend", "no --field", "one that it is of")
        viewer.hold_range(*legend)
    known = [*(one.key.replace(" ", "space") for one in KEYS), *ALIASES]
    for key in keys:
        require_one_of("view --keys", key, known)
        viewer.key(" " if key == "space" else key)
        viewer.message = ""  # of what is seen now
