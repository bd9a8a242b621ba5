"""How objects show themselves in notebooks, and draw themselves with matplotlib.

What does it is in `gpusim.notebook`, a module for each kind of object, and is imported when it is
asked for: nothing of it costs anything before.
"""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def notebook_html(kind: str, thing: object) -> str | None:
    """The ``_repr_html_`` of a ``thing``, by the module ``kind``; None where there is none.

    Showing a result must not fail: a notebook then shows its text.
    """
    html: str | None = _shown(kind, "html", thing)
    return html


def notebook_png(kind: str, thing: object) -> bytes | None:
    """The ``_repr_png_``, as `notebook_html`."""
    png: bytes | None = _shown(kind, "png", thing)
    return png


def plotted(kind: str, thing: object, ax: Axes | None, **options: Any) -> Axes:
    """The ``plot`` of a ``thing``, by the module ``kind``. Raises what that raises."""
    axes: Axes = _module(kind).plot(thing, ax, **options)
    return axes


def notebook_view(scene: object, camera: str | None, size: tuple[int, int]) -> Any:
    """The view of a ``scene`` that a notebook shows. Raises what that raises."""
    return _module("view").view(scene, camera, size)


def _module(kind: str) -> Any:
    return import_module(f"gpusim.notebook.{kind}")


def _shown(kind: str, form: str, thing: object) -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return getattr(_module(kind), form)(thing)
    except Exception:
        return None
