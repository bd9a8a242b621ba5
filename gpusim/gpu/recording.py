"""A recording: dispatches and draws collected in order, sent to the device in one submit."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Any

import wgpu

from gpusim.errors import InputError
from gpusim.gpu.buffer import Buffer
from gpusim.gpu.context import DeviceContext
from gpusim.gpu.faults import translate
from gpusim.gpu.kernel import Bindings, Kernel
from gpusim.gpu.raster import Raster, Texture
from gpusim.validation import require


class Recording:
    """Use as a context manager: the submit happens when the block ends without an error."""

    def __init__(self, device: DeviceContext, stage: str) -> None:
        self.device, self.stage = device, stage
        with device.guard(stage):
            self._encoder = device.gpu.create_command_encoder(label=f"gpusim.{stage}")
        self._pass: Any = None
        # what the open pass draws into; None: it computes
        self._drawn: tuple[Any, ...] | None = None
        self._bindings: dict[int, Bindings] = {}
        self._buffers: list[Buffer] = []
        self._slots: list[int] = []

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self.device.timer.drop(self._slots)
            if isinstance(error, wgpu.GPUError):
                raise translate(error, self.stage) from error
            return
        try:
            # wgpu ends the process when a submit refers to something that is gone
            for bindings in self._bindings.values():
                bindings.check_live()
            for buffer in self._buffers:
                buffer.live(f"{self.stage}:")
            with self.device.guard(self.stage):
                self._end_pass()
                commands = self._encoder.finish()
            self.device.submit(commands, self.stage)
        except BaseException:
            self.device.timer.drop(self._slots)
            raise
        self.device.timer.submitted(self._slots)

    def begin(self, stage: str) -> None:
        """Name what follows, for its time and in errors."""
        self._end_pass()
        self.stage = stage

    def dispatch(
        self,
        kernel: Kernel,
        bindings: Bindings,
        *,
        threads: tuple[int, ...] | None = None,
        groups: tuple[int, ...] | None = None,
        counted: Buffer | None = None,
    ) -> None:
        """Run ``kernel`` over ``threads`` (rounded up to workgroups), over ``groups``, or over as
        many groups (three uint32) as the device finds in ``counted``.

        One-dimensional ``threads`` beyond what one grid dimension takes are folded into two; the
        kernel recovers the index with ``linear_id`` and guards it.
        """
        if bindings.layout is not kernel.layout:
            raise InputError(f"dispatch of {kernel.name}: the bindings were made for another one")
        if [threads, groups, counted].count(None) != 2:
            raise InputError(f"dispatch of {kernel.name}: give one of threads, groups, counted")
        given = next(sizes for sizes in (threads, groups, (1,)) if sizes is not None)
        if not 1 <= len(given) <= 3 or any(n < 0 for n in given):
            raise InputError(f"dispatch of {kernel.name}; got {given}; expected 1 to 3 sizes >= 0")
        self._begin_computing(kernel, bindings)
        if counted is not None:
            self._pass.dispatch_workgroups_indirect(counted.live(f"{self.stage}: counting"), 0)
            self._buffers.append(counted)
            return
        grid = self._grid(kernel, threads, groups)
        if all(n > 0 for n in grid):
            self._pass.dispatch_workgroups(*grid)

    def _begin_computing(self, kernel: Kernel, bindings: Bindings) -> None:
        self._bindings[id(bindings)] = bindings
        if self._pass is None or self._drawn is not None:
            self._end_pass()
            self._pass = self._encoder.begin_compute_pass(
                label=f"gpusim.{self.stage}", **self._timing()
            )
        self._pass.set_pipeline(kernel.pipeline)
        self._set_groups(bindings)

    def _set_groups(self, bindings: Bindings) -> None:
        for index, group in enumerate(bindings.groups):
            self._pass.set_bind_group(index, group)

    def _grid(
        self, kernel: Kernel, threads: tuple[int, ...] | None, groups: tuple[int, ...] | None
    ) -> tuple[int, ...]:
        limit = self.device.limits["max-compute-workgroups-per-dimension"]
        counts = list(groups or ())
        if threads is not None:
            counts = [-(-n // w) for n, w in zip(threads, kernel.workgroup, strict=False)]
            if len(counts) == 1 and counts[0] > limit:
                rows = -(-counts[0] // limit)
                counts = [-(-counts[0] // rows), rows]
        if any(n > limit for n in counts):
            raise InputError(f"dispatch of {kernel.name}; got {counts} groups; limit {limit}")
        return tuple(counts)

    def _timing(self) -> dict[str, Any]:
        slot, arguments = self.device.timer.writes(self.stage)
        if slot is not None:
            self._slots.append(slot)
        return arguments

    def draw(
        self,
        raster: Raster,
        bindings: Bindings,
        *,
        colors: tuple[Texture, ...],
        depth: Texture | None,
        vertices: int,
        size: tuple[int, int],
        clear: float | Sequence[float] | None = 0.0,
        keep_depth: bool = False,
    ) -> None:
        """Draw a triangle list into the top-left ``size`` (w, h) pixels.

        The targets are set to ``clear``, one value or one for each of the first of them (those of
        integers to 0), and the depth to far before; with
        None both are kept, and the list adds to what an earlier draw left. ``keep_depth``: the
        depth is kept in any case. ``depth`` is None for programs without.
        """
        if bindings.layout is not raster.layout:
            raise InputError(f"draw of {raster.name}: the bindings were made for another program")
        self._bindings[id(bindings)] = bindings
        drawn = (colors, depth, size)
        if self._pass is None or clear is not None or self._drawn != drawn:
            # one pass for all draws that add to each other: its targets are read and written once
            self._begin_drawing(colors, depth, clear, keep_depth)
            self._drawn = drawn
        render = self._pass
        render.set_pipeline(raster.pipeline)
        self._set_groups(bindings)
        render.set_viewport(0, 0, size[0], size[1], 0, 1)
        render.set_scissor_rect(0, 0, size[0], size[1])
        if vertices:
            render.draw(vertices)

    def _begin_drawing(
        self,
        colors: tuple[Texture, ...],
        depth: Texture | None,
        clear: float | Sequence[float] | None,
        keep_depth: bool,
    ) -> None:
        self._end_pass()
        compared = None
        if depth is not None:
            compared = {
                "view": depth.view,
                "depth_load_op": "load" if keep_depth or clear is None else "clear",
                "depth_store_op": "store",
                "depth_clear_value": 0.0,
            }
        values = dict(enumerate(clear)) if isinstance(clear, Sequence) else {}
        kept = {"load_op": "clear" if clear is not None else "load", "store_op": "store"}
        attachments = []
        for k, texture in enumerate(colors):
            value = 0 if texture.format.endswith("int") else values.get(k, clear) or 0.0
            attachments.append({"view": texture.view, "clear_value": (value, 0, 0, 0), **kept})
        self._pass = self._encoder.begin_render_pass(
            label=f"gpusim.{self.stage}",
            color_attachments=attachments,
            depth_stencil_attachment=compared,
            **self._timing(),
        )

    def copy_texture(self, texture: Texture, target: Buffer, rows: int) -> None:
        """Copy the top ``rows`` of a texture to ``target``, ``texture.stride`` bytes a row."""
        needed = texture.stride * rows
        fits = 0 < rows <= texture.height and needed <= target.nbytes
        what = f"copying {rows} rows of a texture to {target.label}"
        expected = f"{needed} for at most {texture.height} rows"
        require(fits, what, f"{target.nbytes} bytes", expected)
        self._end_pass()
        self._encoder.copy_texture_to_buffer(
            {"texture": texture.gpu, "mip_level": 0, "origin": (0, 0, 0)},
            {
                "buffer": target.live(f"copying to {target.label}"),
                "offset": 0,
                "bytes_per_row": texture.stride,
                "rows_per_image": rows,
            },
            (texture.width, rows, 1),
        )

    def clear(self, buffer: Buffer) -> None:
        """Fill a buffer with zeros."""
        self._end_pass()
        self._encoder.clear_buffer(buffer.live(f"{self.stage}: clearing"))
        self._buffers.append(buffer)

    def _end_pass(self) -> None:
        if self._pass is not None:
            self._pass.end()
            self._pass = self._drawn = None
