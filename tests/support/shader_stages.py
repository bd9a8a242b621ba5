"""The shader files that are stages."""

from __future__ import annotations

import re

from gpusim.gpu.wgsl import shader_folder

_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)


def stages() -> list[str]:
    """Stems (``fem/krylov/cg``) of gpusim's own shader files that have an entry point."""
    folder = shader_folder()
    return [
        path.relative_to(folder).with_suffix("").as_posix()
        for path in sorted(folder.rglob("*.wgsl"))
        if re.search(
            r"@(compute|vertex|fragment)\b", _COMMENT.sub("", path.read_text(encoding="utf-8"))
        )
    ]
