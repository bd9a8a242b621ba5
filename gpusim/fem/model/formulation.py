"""Which formulation each cell type takes."""

from __future__ import annotations

from collections.abc import Mapping

from gpusim.errors import InputError
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.model.model import Model

__all__ = ["resolve_formulation"]


def resolve_formulation(
    model: Model, formulation: str | Mapping[str, str] | None
) -> dict[str, str]:
    """Formulation per cell type of the mesh; the element's first one where nothing is said.

    One name for all types counts where a type has it (tet4 has no "bbar"). Raises InputError for
    a type or name that no element has, also if the mesh has no such cells, and for one name that
    no cell of the mesh has, unless it is a default: that asks for nothing unusual.
    """
    if isinstance(formulation, str):
        known = dict.fromkeys(name for e in ELEMENTS.values() for name in e.formulations)
        if formulation not in known:
            raise InputError(
                f"formulation: unknown; got {formulation!r}; expected one of {', '.join(known)}"
            )
        wanted = {k: formulation for k, e in ELEMENTS.items() if formulation in e.formulations}
        usual = any(formulation == e.formulations[0] for e in ELEMENTS.values())
        if not usual and not any(kind in wanted for kind in model.mesh.cells):
            raise InputError(
                f"formulation: no cell of the mesh has it; got {formulation!r} for "
                f"{', '.join(model.mesh.cells)}; it is known for {', '.join(wanted)}"
            )
    elif formulation is None or isinstance(formulation, Mapping):
        wanted = dict(formulation or {})
    else:
        raise InputError(
            f"formulation: got {formulation!r}; expected a name, or a mapping from cell type to one"
        )
    for kind, name in wanted.items():
        if kind not in ELEMENTS:
            raise InputError(
                f"formulation: unknown cell type; got {kind!r}; "
                f"expected keys among {', '.join(ELEMENTS)}"
            )
        if name not in ELEMENTS[kind].formulations:
            raise InputError(
                f"formulation: not available for {kind}; got {name!r}; "
                f"expected one of {', '.join(ELEMENTS[kind].formulations)}"
            )
    return {kind: wanted.get(kind, ELEMENTS[kind].formulations[0]) for kind in model.mesh.cells}
