"""Compute programs and their bindings: compiled once, bound by name, checked once."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import wgpu

from gpusim.errors import DeviceError, InputError
from gpusim.gpu.buffer import Buffer
from gpusim.gpu.context import DeviceContext
from gpusim.gpu.texture_array import Texels
from gpusim.gpu.uniform import Uniform
from gpusim.gpu.wgsl import Binding, Module, type_layout
from gpusim.validation import require

_STORED = re.compile(r"texture_storage_2d<\s*(\w+)\s*,\s*(read|write)\s*>")
_SAMPLE = {"u32": "uint", "i32": "sint", "f32": "unfilterable-float"}


class Layout:
    """Bind group and pipeline layouts of an entry point, made from reflection.

    Groups: 0 the stage's own resources, 1 the double-single guard.
    """

    def __init__(self, device: DeviceContext, module: Module, entries: tuple[str, ...]) -> None:
        self.device, self.module = device, module
        visibility = 0
        for entry in entries:
            stage = module.entries[entry].stage
            visibility |= getattr(wgpu.ShaderStage, stage.upper())
        used = {name for entry in entries for name in module.entries[entry].bindings}
        self.bindings = {n: b for n, b in module.bindings.items() if n in used}
        self._sampled = any(b.type == "sampler" for b in self.bindings.values())
        self.groups: list[Any] = []
        count = 1 + max((b.group for b in self.bindings.values()), default=-1)
        label = f"gpusim.{module.name}"
        with device.guard(f"layout of {module.name}"):
            for group in range(count):
                kinds = [
                    {"binding": b.index, "visibility": visibility, **self._resource_kind(b)}
                    for b in self._of_group(group)
                ]
                layout = device.gpu.create_bind_group_layout(label=label, entries=kinds)
                self.groups.append(layout)
            self.pipeline = device.gpu.create_pipeline_layout(
                label=label, bind_group_layouts=self.groups
            )

    def _of_group(self, group: int) -> list[Binding]:
        return [b for b in self.bindings.values() if b.group == group]

    def _resource_kind(self, b: Binding) -> dict[str, Any]:
        if b.space == "uniform":
            return {"buffer": {"type": "uniform"}}
        if b.space == "storage":
            return {"buffer": {"type": "storage" if b.writable else "read-only-storage"}}
        if b.type.startswith("texture_depth_2d"):
            return {"texture": {"sample_type": "depth", "view_dimension": "2d"}}
        if b.type == "sampler":
            return {"sampler": {"type": "filtering"}}
        if b.type.startswith("texture_2d<"):
            sample = _SAMPLE[b.type[len("texture_2d<") : -1].strip()]
            if sample == "unfilterable-float" and self._sampled:
                sample = "float"
            return {"texture": {"sample_type": sample, "view_dimension": "2d"}}
        stored = _STORED.fullmatch(b.type)
        if stored:
            kind = {"access": f"{stored.group(2)}-only", "format": stored.group(1)}
            return {"storage_texture": {**kind, "view_dimension": "2d"}}
        raise InputError(f"{self.module.name}: binding {b.name} of type {b.type} isn't covered")

    def bind(self, values: dict[str, Any]) -> Bindings:
        """Check ``values`` against the reflected bindings and make the bind groups."""
        where = f"binding {self.module.name}"
        own = {name for name, b in self.bindings.items() if b.group == 0}
        if set(values) != own:
            missing, extra = sorted(own - set(values)), sorted(set(values) - own)
            raise InputError(f"{where}; missing {missing}; unknown {extra}; expected {sorted(own)}")

        def resource(binding: Binding) -> Any:
            if binding.group == 1:
                return {"buffer": self.device.opaque_zero}
            return self._resource(binding, values[binding.name], f"{where}.{binding.name}")

        with self.device.guard(where):
            return Bindings(self, self.bind_groups(resource), values)

    def _resource(self, binding: Binding, value: Any, where: str) -> Any:
        if binding.space == "uniform":
            return {"buffer": self._uniform(binding, value, where)}
        if binding.space == "storage":
            require(isinstance(value, Buffer), where, type(value).__name__, "a Buffer")
            self._check_device(value, "a buffer", where)
            gpu = value.live(f"{where}:")
            limit = self.device.limits["max-storage-buffer-binding-size"]
            if gpu.size > limit:
                expected = f"expected at most {limit} in one binding"
                raise DeviceError(f"{where}; got {gpu.size} bytes; {expected}")
            return {"buffer": gpu}
        if binding.type == "sampler":
            return value
        require(hasattr(value, "view"), where, type(value).__name__, "a Texture")
        if isinstance(value, Texels):
            value.live(f"{where}:")
            self._check_device(value, "texels", where)
            words = {"rgba32float": "f32", "rgba32uint": "u32"}[value.format]
            fits = f"<{words}>" in binding.type or value.format in binding.type
            require(fits, where, f"{value.format} ({value.label})", binding.type)
        return value.view

    def _uniform(self, binding: Binding, value: Any, where: str) -> Any:
        label = f"{self.module.name}.{binding.name}"
        uniform = value if isinstance(value, Uniform) else Uniform(self.device, value, label)
        self._check_device(uniform, "a uniform", where)
        dtype, _ = type_layout(binding.type, self.module.structs, where)
        return uniform.live(dtype, where)

    def _check_device(self, value: Buffer | Texels | Uniform, what: str, where: str) -> None:
        got = f"{what} of another device ({value.label})"
        require(value.device is self.device, where, got, f"one of {self.device.name}")

    def bind_groups(self, resource: Callable[[Binding], Any]) -> tuple[Any, ...]:
        """Bind groups 0 and 1, of the ``resource`` of each binding."""
        result, label = [], f"gpusim.{self.module.name}"
        for group, layout in enumerate(self.groups):
            entries = [{"binding": b.index, "resource": resource(b)} for b in self._of_group(group)]
            result.append(
                self.device.gpu.create_bind_group(label=label, layout=layout, entries=entries)
            )
        return tuple(result)


@dataclass(eq=False)
class Bindings:
    """Resources checked against a program once; can be dispatched any number of times."""

    layout: Layout
    groups: tuple[Any, ...]
    values: dict[str, Any]

    def check_live(self) -> None:
        """Raise `InputError` if a bound buffer was released since: submitting would end the
        process."""
        for name, value in self.values.items():
            if isinstance(value, Buffer | Texels):
                value.live(f"{self.layout.module.name}.{name}:")


def _check_workgroup(size: tuple[int, int, int], limits: dict[str, int], where: str) -> None:
    """wgpu 0.32 doesn't look at sizes that come from override constants."""
    largest = [limits[f"max-compute-workgroup-size-{axis}"] for axis in "xyz"]
    total = limits["max-compute-invocations-per-workgroup"]
    fits = all(1 <= n <= most for n, most in zip(size, largest, strict=True))
    fits = fits and size[0] * size[1] * size[2] <= total
    expected = f"1 to {tuple(largest)}, {total} invocations at most"
    require(fits, f"{where}: workgroup size", size, expected)


class Program:
    """Entry points of a shader file with their override constants.

    ``entries``: those of each stage ("compute", "vertex", "fragment").
    """

    def __init__(
        self,
        device: DeviceContext,
        module: Module,
        entries: dict[str, str],
        constants: dict[str, float],
    ) -> None:
        for stage, entry in entries.items():
            where = f"program {module.name}.{entry}"
            known = sorted(module.entries)
            if entry not in known:
                raise InputError(f"{where}: no such entry; expected one of {known}")
            own = module.entries[entry].stage
            require(own == stage, where, f"a {own} entry", f"@{stage}")
            unknown = sorted(set(constants) - set(module.overrides))
            needed = sorted(n for n, default in module.overrides.items() if not default)
            if unknown or not set(needed) <= set(constants):
                got = f"got {sorted(constants)}; needed {needed}, unknown {unknown}"
                raise InputError(f"{where} constants; {got}")
        self.layout = Layout(device, module, tuple(entries.values()))

    def bind(self, **values: Any) -> Bindings:
        """Bind buffers, textures and uniform dicts by their WGSL names."""
        return self.layout.bind(values)

    def bind_used(self, **values: Any) -> Bindings:
        """The same with values that several programs share: those that this one doesn't use are
        left out."""
        return self.bind(**{n: value for n, value in values.items() if n in self.layout.bindings})


class Kernel(Program):
    """An immutable compute program: one entry point with its override constants.

    ``compiled`` gives the wgpu module of a shader file.
    """

    def __init__(
        self,
        device: DeviceContext,
        module: Module,
        entry: str,
        constants: dict[str, float],
        compiled: Callable[[Module], Any],
    ) -> None:
        self.name = f"{module.name}.{entry}"
        super().__init__(device, module, {"compute": entry}, constants)
        self.workgroup = module.workgroup_size(entry, constants)
        _check_workgroup(self.workgroup, device.limits, f"kernel {self.name}")
        with device.guard(f"kernel {self.name}"):
            shader = compiled(module)
            compute = {"module": shader, "entry_point": entry, "constants": constants}
            self.pipeline = device.gpu.create_compute_pipeline(
                label=f"gpusim.{self.name}", layout=self.layout.pipeline, compute=compute
            )
