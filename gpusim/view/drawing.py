"""How what is looked at is drawn, into whatever window."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpusim.view.camera_marks import defocus_tint
from gpusim.view.picture.neutral import HEADLIGHT_WHITE
from gpusim.view.view_state import ViewState
from gpusim.visualization.field_colors import corner_values, draw_field_colors
from gpusim.visualization.overlay import Overlay
from gpusim.visualization.placement import Placement

TINT = 0.4
"""Opacity of the tint on what isn't sharp."""

EXPOSED = 0.995
"""Share of a lit picture's pixels that aren't white."""


class ViewDrawing(ViewState):
    """Draws what is looked at, a part of it after another."""

    def _exposed(self) -> None:
        """Choose what is white from the first picture of a scene's lamps."""
        base = self.picture.base
        lamps = self.content is not None and self.content.lights is not None
        if not (lamps and self.shown["light"]):
            self._white = HEADLIGHT_WHITE
        elif self._white is None and base is not None and self.picture.shot is not None:
            radiance, weights = base.radiance, self.picture.shot.weights
            if base.coloured and weights is not None:
                radiance = radiance @ np.array(weights, np.float32)
            high = float(np.quantile(radiance, EXPOSED))
            self._white = high if high > 0.0 else 1.0
            self.changed()

    def draw(self, target: Any, whole: bool = False) -> bool:
        """Draw it over a `gpusim.visualization.overlay.Target`; ``whole``: at full quality.

        Whether there is more to be drawn, as soon as keys and the mouse have been heard.
        """
        if self.size != (target.width, target.height):
            self.size = target.width, target.height
            if self.through is not None or self.view is self._framed:  # else it is the user's
                self._white = None
        layout = self.size, self.taken()
        if self._layout != layout:
            self._layout = layout
            self._frame_again()
        more = False
        with self.faults_shown():
            more = self.picture.step()
            self._exposed()
            if whole:
                self.picture.finish()
            self._draw(target)
            return more
        self._draw(target, with_picture=False)  # what is seen now can't be shown
        return more

    def _draw(self, target: Any, with_picture: bool = True) -> None:
        _, left, top = self.camera()
        overlay, base = self.overlay, self.picture.base
        overlay.clear()
        with self.device.recording("view") as recording:
            if with_picture and base is not None:
                self.picture.draw(recording, target, left, top, 1.0 / self.white)
                if self.field_values is not None:
                    self._draw_field(target, recording)
                elif self.sharp is not None and self.shown["cameras"]:
                    colored = defocus_tint(self.sharp, base.view)
                    self._draw_colors(target, recording, *colored, shade=1.0, opacity=TINT)
            else:
                overlay.rectangle(0, 0, target.width, target.height, "#23292f")
            self.draw_over(overlay)
            overlay.draw(target, recording)

    def draw_over(self, overlay: Overlay) -> None:
        """Collect what stands over the picture."""

    def _draw_field(self, target: Any, recording: Any) -> None:
        """The colours of a field of the bodies over the picture."""
        base, scale = self.picture.base, self.color_scale
        assert base is not None
        values = corner_values(base.view, self.surfaces(), self.surface_fields())
        self._draw_colors(target, recording, values, scale.limits, scale.colors)

    def _draw_colors(self, target: Any, recording: Any, *colored: Any, **look: Any) -> None:
        """Values, limits and colours over the picture."""
        picture, place = self.picture, self.place
        assert picture.base is not None
        draw_field_colors(
            self.device, target, picture.base, *colored, white=self.white, recording=recording,
            place=Placement(place.x, place.y, picture.coarseness),
            samples=1 if picture.waits else 2, **look,
        )  # fmt: skip
