"""Whether a scene's pictures are in colour, before anything of it is built."""

from __future__ import annotations

import io
from typing import Any

from gpusim.errors import InputError

from .scene import Scene
from .tables.colors import is_chromatic


def in_color(scene: Scene) -> bool:
    """Whether something has a colour, pictures included; those of a prop's own materials may."""
    paints = [paint for thing in (*scene.bodies, *scene.props) for paint in thing.paints]
    keys = ("albedo", "dark", "light", "dot", "line")
    said = [getattr(paint, key, None) for paint in paints for key in keys]
    said += [scene.render.background, *(light.color for light in scene.lights)]
    warm = any(light.temperature_K is not None for light in scene.lights)
    pictures = [thing for thing in (*paints, *scene.lights)
                if getattr(thing, "channels", "") == "rgb"]  # fmt: skip
    return warm or any(map(is_chromatic, said)) or any(_shows_color(p, scene) for p in pictures)


def _shows_color(picture: Any, scene: Scene) -> bool:
    """Whether the file of a paint or of surroundings isn't grey; unknown without a file of its own,
    by texture coordinates. What can't be read is refused elsewhere."""
    import numpy as np  # heavy, as what reads pictures is, and most plans have none

    from gpusim.files.picture_file import read_picture

    if picture.path is None:
        return getattr(picture, "mapping", "") == "uv"
    try:
        file = scene.input(picture.path)
        if picture.path.endswith(".npy"):
            return bool(np.load(io.BytesIO(file.data)).ndim == 3)
        values = read_picture(file)
    except (OSError, ValueError, InputError):
        return False
    return values.ndim == 3 and bool((values != values[..., :1]).any())
