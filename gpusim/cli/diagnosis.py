"""``gpusim doctor`` and ``gpusim check``: is the machine fit, do kernels agree with NumPy?"""

from __future__ import annotations

import platform
import time
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Literal

from gpusim._version import __version__
from gpusim.cli.console import size_text
from gpusim.errors import (
    DeviceError,
    GpusimError,
    InputError,
    NoAdapter,
    TwinMismatch,
    nearest_name,
)

_PACKAGES = ("wgpu", "numpy", "scipy", "opencv-contrib-python-headless", "h5py")
_LIMITS = (
    "max-storage-buffers-per-shader-stage",
    "max-storage-buffer-binding-size",
    "max-buffer-size",
    "max-compute-invocations-per-workgroup",
    "max-compute-workgroups-per-dimension",
    "max-texture-dimension-2d",
)
_ADVICE = (
    "Install a Vulkan driver: on Debian/Ubuntu `apt-get install mesa-vulkan-drivers libvulkan1` "
    "works on every machine, without a GPU too; a GPU's own driver is faster. "
    "`--backend numpy` runs without any."
)


@dataclass(frozen=True)
class CheckResult:
    """One kernel against its NumPy twin."""

    stage: str
    verdict: Literal["ok", "mismatch", "failed"]
    seconds: float
    message: str
    exit_code: int


@dataclass(frozen=True)
class Diagnosis:
    """What was found; ``exit_code`` is 0, 4 (no adapter) or 5 (a kernel disagrees)."""

    facts: dict[str, str]
    limits: dict[str, int]
    features: tuple[str, ...]
    checks: tuple[CheckResult, ...]
    advice: tuple[str, ...]
    exit_code: int

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**asdict(self), "features": list(self.features), "advice": list(self.advice)}

    def lines(self) -> list[str]:
        """Text for a reader."""
        wide = max(len(name) for name in (*self.facts, *self.limits)) + 2
        text = [f"{name:<{wide}}{value}" for name, value in self.facts.items()]
        if self.limits:
            text += ["", "Limits in use"]
            for name, value in self.limits.items():
                text.append(f"{name:<{wide}}{size_text(value) if 'size' in name else value}")
        if self.features:
            text += ["", f"{'features':<{wide}}{', '.join(self.features)}"]
        if self.checks:
            text += ["", "Kernels against their NumPy twins"]
            long = max(len(check.stage) for check in self.checks) + 2
            for check in self.checks:
                line = f"{check.stage:<{long}}{check.verdict:<10}{check.seconds:6.2f} s"
                text.append(f"{line}  {check.message}".rstrip())
        return text + [line for advice in self.advice for line in ("", advice)]


def diagnose(stage: str | None = None) -> Diagnosis:
    """Look at the machine and run every twin check, or that of ``stage`` only.

    Raises InputError if there is no such stage. What is wrong with the machine is not raised: it is
    in the diagnosis.
    """
    facts = {"gpusim": __version__, "python": platform.python_version()}
    facts |= {name: _version(name) for name in _PACKAGES}
    facts["system"] = platform.platform()
    try:
        from gpusim.gpu import Device, twin_checks
        from gpusim.gpu.adapter import is_processor

        checks = twin_checks()
        if stage is not None and stage not in checks:
            of_scene = "; `gpusim plan` checks a scene file"
            hint = of_scene if stage.endswith(".toml") else nearest_name(stage, checks)
            expected = f"one of {', '.join(checks)}{hint}"
            raise InputError(f"check: no such stage; got {stage}; expected {expected}")
        device = Device()
    except NoAdapter as error:
        facts["adapter"] = f"none: {error}"
        return Diagnosis(facts, {}, (), (), (_ADVICE,), NoAdapter.exit_code)
    info = device.info
    facts["adapter"] = device.name
    for key in ("vendor", "architecture", "adapter_type", "backend_type"):
        if info.get(key):
            facts[key.replace("_", " ")] = str(info[key])
    facts["real numbers"] = {
        "f64": "64-bit floats on the device",
        "double_single": "pairs of 32-bit floats (the adapter has no 64-bit ones)",
    }.get(device.real, device.real)
    if device.memory_limit is not None:
        facts["memory"] = size_text(device.memory_limit)
    limits = {name: int(device.limits[name]) for name in _LIMITS if name in device.limits}
    wanted = checks if stage is None else {stage: checks[stage]}
    results = tuple(_run(name, check, device) for name, check in wanted.items())
    advice = []
    if is_processor(info):
        advice.append("This is a software adapter: results are the same as on a GPU, only slower.")
    if any(result.verdict == "mismatch" for result in results):
        advice.append("A kernel disagrees with NumPy: update the driver, or use --backend numpy.")
    code = max((result.exit_code for result in results), default=0)
    return Diagnosis(facts, limits, tuple(sorted(device.features)), results, tuple(advice), code)


def _run(name: str, check: Any, device: Any) -> CheckResult:
    start = time.perf_counter()
    verdict: Literal["ok", "mismatch", "failed"] = "ok"
    message, code = "", 0
    try:
        check(device)
    except TwinMismatch as error:
        verdict, message, code = "mismatch", str(error), error.exit_code
    except DeviceError as error:
        verdict, message, code = "failed", str(error), error.exit_code
    except GpusimError as error:
        verdict, message, code = "failed", str(error), 1
    except Exception as error:  # one broken check must not hide the others
        verdict, message, code = "failed", f"{type(error).__name__}: {error}", 1
    return CheckResult(name, verdict, time.perf_counter() - start, message, code)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
