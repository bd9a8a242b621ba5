"""What the stages of a scene are made with: its parts, its frames, and how it is run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gpusim.graph.stage import Stage, Which, first
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene
from gpusim.scene.frames import frame_table
from gpusim.scene.part import SceneParts
from gpusim.scene.shared_tables import SharedTables

Needs = dict[str, Which | None]


class StageBuilder:
    """Makes stages of a ``scene``, one of those whose tables are ``known``. ``bodies``: their
    names; ``frames``: the table of frames."""

    def __init__(
        self, scene: Scene, options: RunOptions, known: SharedTables | None = None
    ) -> None:
        self.scene, self.options = scene, options
        self.frames = frame_table(scene, options.skip)
        self.bodies = tuple(body.name for body in scene.bodies)
        self._parts = SceneParts(scene, known)

    def stage(
        self,
        name: str,
        work: str,
        sections: Sequence[str] = (),
        needs: Mapping[str, Which | None] | None = None,
        rows: Sequence[Any] = (None,),
        public: str = "",
        *,
        on_device: bool = False,
        **more: Any,
    ) -> Stage:
        """A stage whose function ``work`` of `gpusim.pipeline.stages` ("images:radiance"), or of a
        module that is named whole ("my_package.swing:motion"), gets the ``sections`` of the scene
        (`SceneParts.of`), and nothing else of it.

        ``public``: the stage as people know it; "{}" in it becomes the record's number. A
        stage ``on_device`` depends on the backend. ``more``: as `Stage` has it.
        """
        part = self._parts.of(*sections)
        digests = dict(part.digests)
        if on_device:
            digests["backend"] = self.options.backend
        if not self.options.skip:  # its results round otherwise
            digests["shortcuts"] = "none"
        whole = work if "." in work else f"gpusim.pipeline.stages.{work}"
        return Stage(
            name, whole, part.scene, digests, needs or {}, rows,
            public=lambda record: public.format(record), on_device=on_device, **more,
        )  # fmt: skip

    def of_bodies(self, kind: str) -> Needs:
        """What is made of every body, as a need."""
        return {f"{kind}/{name}": first for name in self.bodies}

    def surfaces(self) -> Needs:
        """Everything that cameras may see, as a need."""
        return self.of_bodies("surface") | ({"props": first} if self.scene.props else {})
