"""Which variable of a file is the displacement."""

from __future__ import annotations

from collections.abc import Sequence

from gpusim.errors import InputError

__all__ = ["scalar_names", "vector_name"]

_VECTORS = ("displacement", "displacements", "disp", "displ", "u", "dis", "depl", "def")
_SCALARS = ("disp", "displ", "displacement", "d", "u", "dis")
_ENDINGS = (("x", "y", "z"), ("1", "2", "3"))


def vector_name(known: Sequence[str], wanted: str | None) -> str | None:
    """The name among ``known`` that is ``wanted``, or a usual one for displacements; else None."""
    if wanted is not None:
        return wanted if wanted in known else None
    by_fold = {name.casefold(): name for name in reversed(known)}
    return next((by_fold[usual] for usual in _VECTORS if usual in by_fold), None)


def scalar_names(known: Sequence[str], wanted: str | None) -> tuple[str, str, str]:
    """Three names that are one scalar per axis: ``disp_x``, ``disp_y``, ``disp_z`` or the like.

    Raises InputError listing what there is.
    """
    by_fold = {name.casefold(): name for name in reversed(known)}
    for start in _SCALARS if wanted is None else (wanted.casefold(),):
        for between in ("", "_", "-", " ", "."):
            for x, y, z in _ENDINGS:
                names = [f"{start}{between}{end}" for end in (x, y, z)]
                if all(name in by_fold for name in names):
                    return by_fold[names[0]], by_fold[names[1]], by_fold[names[2]]
    if wanted in known:
        raise InputError(f"{wanted!r} has one number per node; expected a vector of three")
    raise InputError(
        f"no displacement among the nodal variables; got {', '.join(known) or 'none'}; expected "
        + (repr(wanted) if wanted is not None else "one called displacement, disp, U …: say which")
    )
