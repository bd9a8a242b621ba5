"""Pictures taken one after the other, each written and looked at while the next ones are taken."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Self

from gpusim.pipeline.notes import StageResult
from gpusim.pipeline.stages.images import CapturedImage, FrameCapture
from gpusim.scene.description import model as m

__all__ = ["CaptureQueue"]

AHEAD = 2
"""Pictures that are taken before the one that is asked for is whole."""


class CaptureQueue:
    """Photographs, in the order in which `take` will be called: ``wanted`` cameras and frames.

    ``look``: what else is found in one, and its files.
    """

    def __init__(
        self,
        capture: FrameCapture,
        wanted: Iterable[tuple[m.Camera, int]],
        look: Callable[[CapturedImage], list[Path]] | None = None,
    ) -> None:
        self.capture, self.look = capture, look
        self._wanted = deque(wanted)
        self._coming: deque[Future[StageResult]] = deque()
        self._pool = ThreadPoolExecutor(AHEAD, thread_name_prefix="gpusim.capture")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown()

    def take(self) -> StageResult:
        """Take the next picture; returns its files, and what is said of it."""
        while self._wanted and len(self._coming) <= AHEAD:
            self._coming.append(self._begin())
        return self._coming.popleft().result()

    def _begin(self) -> Future[StageResult]:
        camera, frame = self._wanted.popleft()
        try:
            shot = self.capture.take(camera, frame)
        except Exception as error:  # it belongs to the picture that it happened to
            failed: Future[StageResult] = Future()
            failed.set_exception(error)
            self._wanted.clear()
            return failed
        return self._pool.submit(self._end, shot)

    def _end(self, shot: CapturedImage) -> StageResult:
        return StageResult(shot.write() + (self.look(shot) if self.look else []), shot.notes)
