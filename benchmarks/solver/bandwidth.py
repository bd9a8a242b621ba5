"""Bandwidth: what a copy reaches on this device and in NumPy, and what the operator reaches."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.solver.operator import host_probe, operator_probe
from gpusim.bench.solver_cases import Case
from gpusim.gpu import Device, default_device
from gpusim.parallel.blas_threads import one_blas_thread

__all__ = ["device_copy_bandwidth", "host_copy_bandwidth", "measure_operator"]

_COPY_BYTES = 1 << 27


def device_copy_bandwidth(device: Device, nbytes: int = _COPY_BYTES) -> float:
    """Bytes per second, read and written, of a copy between two buffers; best of seven."""
    source, target = (device.empty(nbytes, f"copy.{name}") for name in ("source", "target"))

    def copy() -> None:
        encoder = device.gpu.create_command_encoder()
        encoder.copy_buffer_to_buffer(source.gpu, 0, target.gpu, 0, nbytes)
        device.submit(encoder.finish(), "copy")
        device.sync()

    seconds = best_of(copy, 7)
    source.release()
    target.release()
    return 2.0 * nbytes / seconds


def host_copy_bandwidth(nbytes: int = _COPY_BYTES) -> float:
    """The same of ``numpy.copyto``, on one core."""
    source = np.ones(nbytes // 8)
    target = np.zeros_like(source)
    return 2.0 * nbytes / best_of(lambda: np.copyto(target, source), 7)


def best_of(work: Callable[[], object], times: int) -> float:
    """Least seconds of ``times`` runs after one that isn't counted."""
    work()
    best = np.inf
    for _ in range(times):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return float(best)


def measure_operator(case: Case) -> dict[str, Any]:
    """Time and bytes of y = K u on the device and on the host, each beside a copy."""
    model, device = case.model(), default_device()
    copy = device_copy_bandwidth(device)
    probe = operator_probe(case, model, device)
    seconds = best_of(probe.apply, 9) / probe.repeat
    host_copy = host_copy_bandwidth()
    host = host_probe(case, model)
    with one_blas_thread():
        host_seconds = best_of(host.apply, 9)
    return {
        "device": device.name,
        "copy_bytes_per_s": copy,
        "host_copy_bytes_per_s": host_copy,
        "host_operator_seconds": host_seconds,
        "host_bytes": host.nbytes,
        "host_share": host.nbytes / host_seconds / host_copy,
        "host_assembled_share": host.assembled / host_seconds / host_copy,
        "operator_seconds": seconds,
        "operator_bytes": probe.nbytes,
        "stored_bytes": probe.stored,
        "assembled_bytes": probe.assembled,
        "unknowns": probe.unknowns,
        "share": probe.nbytes / seconds / copy,
        "assembled_share": probe.assembled / seconds / copy,
    }
