"""``scene.toml`` of an output folder; what somebody has edited there isn't lost."""

from __future__ import annotations

import os
import warnings
from contextlib import suppress
from itertools import count
from pathlib import Path
from zlib import crc32

from gpusim.errors import InputError
from gpusim.files.atomic_files import write_text
from gpusim.files.input_file import read_input
from gpusim.files.output_folder import inside

_MARK = "# checksum of what is above: "


def write_scene(folder: Path, text: str) -> None:
    """Write the scene that is run into ``folder``.

    One there that gpusim didn't write so (the user's own, or edited since) stays as scene-1.toml,
    scene-2.toml, ..., of which a warning tells.
    """
    path = inside(folder, "scene.toml")
    if os.path.lexists(path) and not _is_ours(path):
        free = (inside(folder, f"scene-{number}.toml") for number in count(1))
        kept = next(one for one in free if not os.path.lexists(one))
        path.rename(kept)
        warnings.warn(f"{path}: not as a run wrote it, kept as {kept.name}", stacklevel=2)
    write_text(path, _signed(text))


def _signed(text: str) -> str:
    return f"{text}{_MARK}{crc32(text.encode()):08x}\n"


def _is_ours(path: Path) -> bool:
    with suppress(InputError):
        text = read_input(path).text()
        return text == _signed(text.rpartition(_MARK)[0])
    return False
