"""The newest picture of a view: coarse at once, then finer in steps short enough that keys and the
mouse are heard between them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gpusim.gpu import Device, Recording
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.frame import Frame
from gpusim.optics.light.lights import Light
from gpusim.optics.rendering.renderer import render
from gpusim.optics.sensor.channels import Weights
from gpusim.surface.color import Color
from gpusim.surface.surface import Surface
from gpusim.view.picture.display import draw_enlarged, draw_frame
from gpusim.view.picture.moving_picture import moving_picture, unshadowed
from gpusim.visualization.placement import Placement

STILL = 0.15
"""s without a change, after which the picture gets finer."""

ROWS = 160
"""Of a step at full quality: fewer take longer in all, more let wait."""

COARSENESS = (1, 2, 3, 4, 6)
"""Pixels of the target for one of a picture that moves, along each side."""

FIRST_LEVEL = 2
"""Of a picture of another size, on whatever machine: its white is chosen from that."""

SLOW, QUICK = 0.048, 0.034
"""s that a moving picture takes, above and below which the next one is coarser or finer."""


class Shot(NamedTuple):
    """What a picture is of; ``camera``: of the size that the picture has in the end; ``weights``:
    of red, green and blue in a grey picture of what has colours; None: these are shown."""

    surfaces: Sequence[Surface]
    camera: Camera
    lights: Sequence[Light] | None
    background: Color
    weights: Weights | None = None


def coarser(camera: Camera, factor: int) -> Camera:
    """The camera with pixels ``factor`` times as wide and high, over all of the image at least."""
    if factor == 1:
        return camera
    width, height = -(-camera.width // factor), -(-camera.height // factor)
    return camera.reframed(width, height, scale=(1.0 / factor, 1.0 / factor))


def rows_of(camera: Camera, first: int, count: int) -> Camera:
    """The camera whose image is ``count`` rows of another's, from row ``first``."""
    return camera.reframed(camera.width, count, (0, first))


class ProgressivePicture:
    """Makes the picture of a `Shot`, and draws as much of it as there is."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.shot: Shot | None = None
        self.base: Frame | None = None
        """The latest picture of all of it, each pixel ``coarseness`` wide and high."""
        self.coarseness = 1
        self.parts: list[tuple[int, Frame]] = []
        """Rows at full quality: the first one's number, and the rows."""
        self.level = FIRST_LEVEL
        """Of `COARSENESS`."""
        self._changed = -np.inf
        self._sharp = self._made = False
        self._lights: tuple[Sequence[Light] | None, list[Light] | None] = (None, None)

    def begin(self, shot: Shot) -> None:
        """Show something else from now on."""
        before, now = self.shot.camera if self.shot is not None else None, shot.camera
        if before is not None and (before.width, before.height) != (now.width, now.height):
            self.level = FIRST_LEVEL
        self.shot, self._changed = shot, time.monotonic()
        self._sharp = self._made = False
        self._release(self.parts)

    def finish(self) -> None:
        """All that is left, at once, as if nothing had moved."""
        self._changed = -np.inf
        while self.step():
            pass

    @property
    def complete(self) -> bool:
        """Whether it is of full quality."""
        rows = sum(frame.height for _, frame in self.parts)
        return self.shot is not None and rows == self.shot.camera.height

    @property
    def waits(self) -> bool:
        """Whether there is nothing to do yet, because the view may still be moving."""
        return self._made and time.monotonic() - self._changed < STILL

    def step(self) -> bool:
        """Do what comes next; whether there is more to do, now or soon.

        Raises
        ------
        InputError, DeviceError
            What is seen can't be rendered. It isn't tried again.
        """
        if self.shot is None or self.complete:
            return False
        if not self._made:
            self._made = True  # if it fails, once is enough
            self._moving(COARSENESS[self.level])
        elif self.waits:
            pass
        elif not self._sharp and not self.parts:
            self._sharp = True
            self._moving(1)
        else:
            shot, first = self.shot, sum(frame.height for _, frame in self.parts)
            count = min(ROWS, shot.camera.height - first)
            camera = rows_of(shot.camera, first, count)
            part = render(shot.surfaces, camera, shot.lights, background=shot.background,
                          device=self.device)  # fmt: skip
            self.parts.append((first, part))
        return not self.complete

    def took(self, seconds: float) -> None:
        """Say how long the latest picture took to get to the screen: that decides how coarse the
        next one is that moves."""
        if self.waits and self.coarseness == COARSENESS[self.level]:
            finer = -1 if seconds < QUICK else 1 if seconds > SLOW else 0
            self.level = min(max(self.level + finer, 0), len(COARSENESS) - 1)

    def draw(self, recording: Recording, target: Any, left: int, top: int, exposure: float) -> None:
        """Draw what there is on a target, from a corner on."""
        if self.shot is None or self.base is None:
            return
        to, weights = (self.device, recording, target), self.shot.weights
        if self.coarseness == 1:
            draw_frame(*to, left, top, self.base, exposure, weights=weights)
        else:
            place = Placement(left, top, self.coarseness)
            draw_enlarged(*to, place, self.base, exposure, weights)
        for first, part in self.parts:
            draw_frame(*to, left, top + first, part, exposure, weights=weights, clear=False)

    def release(self) -> None:
        """Give the device's memory back."""
        self._release(self.parts)
        if self.base is not None:
            self.base.release()
        self.base = self.shot = None

    def _moving(self, coarseness: int) -> None:
        assert self.shot is not None
        surfaces, camera, lights, background, _ = self.shot
        if lights is not self._lights[0]:
            self._lights = lights, None if lights is None else unshadowed(lights)
        frame = moving_picture(
            self.device, surfaces, coarser(camera, coarseness), self._lights[1], background
        )
        if self.base is not None:
            self.base.release()
        self.base, self.coarseness = frame, coarseness

    @staticmethod
    def _release(parts: list[tuple[int, Frame]]) -> None:
        for _, frame in parts:
            frame.release()
        parts.clear()
