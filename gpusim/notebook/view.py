"""``scene.view()``: the preview window in a notebook, or a still picture with its reason."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import GpusimError
from gpusim.export.images import encoded_picture
from gpusim.files.atomic_files import write_text
from gpusim.gpu import default_device
from gpusim.notebook.frame import toned
from gpusim.notebook.page import Picture, page
from gpusim.notebook.scene import scene_surfaces
from gpusim.notebook.shading import fitted_camera, painted, resized_camera, shaded
from gpusim.optics import render
from gpusim.pipeline.scene_objects.cameras import build_camera, grey_weights
from gpusim.pipeline.scene_objects.lights import build_lights
from gpusim.scene import Scene, load_scene
from gpusim.validation import require

INSTALL = 'a view that moves needs the extra: pip install "gpusim[notebook]"'
ELSEWHERE = "a view that moves needs a notebook; `gpusim view` opens a window"


@dataclass(frozen=True, eq=False)
class StillView:
    """A picture of a scene, ``pixels`` (H, W), (H, W, 3) or (H, W, 4) uint8, and why it is no more
    than that."""

    name: str
    pixels: npt.NDArray[np.uint8]
    reason: str

    def __repr__(self) -> str:
        height, width = self.pixels.shape[:2]
        return f"StillView({self.name!r}, {width} x {height} px; {self.reason})"

    def _repr_html_(self) -> str:
        picture = Picture(self.name, self.pixels, shown_width=self.pixels.shape[1])
        return page(self.name, [], [lambda: picture], [f"A still picture: {self.reason}."])

    def _repr_png_(self) -> bytes:
        return encoded_picture(self.pixels, ".png")


def view(scene: Scene, camera: str | None, size: tuple[int, int]) -> Any:
    """The live view where there can be one, else a still picture."""
    names = [one.name for one in scene.cameras]
    known = camera is None or camera in names
    require(known, "Scene.view: camera", repr(camera), f"one of {names}")
    whole = len(size) == 2 and all(isinstance(side, int) and side > 0 for side in size)
    require(whole, "Scene.view: size", repr(size), "width and height, px")
    if not in_notebook():
        return _still(scene, camera, size, ELSEWHERE)
    try:
        import anywidget  # noqa: F401 - rendercanvas's message would name no extra
        from rendercanvas import anywidget as canvases

    except ImportError:
        return _still(scene, camera, size, INSTALL)
    from gpusim.view.viewer import Viewer
    from gpusim.view.window import WindowView

    viewer = Viewer(default_device(), _file_of(scene), size)
    if camera is not None:
        viewer.look_through(names.index(camera))
    canvas = canvases.RenderCanvas(size=size)
    WindowView(viewer, canvas, canvases.loop, types=False)
    return canvas


def in_notebook() -> bool:
    """Whether this is the kernel of a notebook."""
    shell = sys.modules.get("IPython")
    return shell is not None and getattr(shell.get_ipython(), "kernel", None) is not None


def _file_of(scene: Scene) -> Path:
    """The file that a scene was read from, if it still says the same, so that it is followed;
    else one that says what the scene does."""
    source = Path(scene.source)
    try:
        if load_scene(source) == scene:
            return source
    except GpusimError:
        pass
    return write_text(Path(tempfile.mkdtemp(prefix="gpusim-view-")) / "scene.toml", scene.to_toml())


def _still(scene: Scene, camera: str | None, size: tuple[int, int], reason: str) -> StillView:
    """The scene unloaded, under its own light, through ``camera`` or one that fits."""
    built = scene_surfaces(scene)
    if camera is None:
        seen = resized_camera(fitted_camera(built.points), *size)
        bodies = built.bodies or built.props
        return StillView(scene.name, shaded(bodies, seen, painted(bodies, seen)), reason)
    described = next(one for one in scene.cameras if one.name == camera)
    seen = resized_camera(build_camera(described, scene.input), *size)
    frame = render(built.all, seen, build_lights(scene))
    weights = grey_weights(scene.sensor_of(described.name), described)
    grey = frame.coloured and weights is not None
    pixels = toned(frame.radiance @ np.array(weights, np.float32) if grey else frame.radiance)
    frame.release()
    return StillView(f"{scene.name}, camera {camera}", pixels, reason)
