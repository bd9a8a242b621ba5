"""Preconditioned conjugate gradients: the loop, its NumPy twin and its driver.

Kernel: ``shaders/fem/krylov/cg.wgsl``. Both forms keep vectors and scalars in float64 (or
double-single) and write one history line per iteration: r.z before it, alpha, beta, p.q. On the
device the preconditioner works in float32: it gets r rounded and gives z. K p and r are pairs of
float32 textures. p is rounded to float32, which takes a seventh off a product: x and r are advanced
by the same p, so that only its conjugacy suffers, as from the rounding of z. Behind multigrid that
costs no iteration (105 of a beam 200 times as long as thick).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Real
from gpusim.fem.device.node_texels import Allocator, Pair, pair, vector_texels
from gpusim.fem.device.relaxation import relaxation
from gpusim.fem.device.tet_forces import DeviceOperator
from gpusim.gpu import Bindings, Kernel, Recording
from gpusim.gpu.buffer import RealBuffer
from gpusim.gpu.texture_array import Texels

_GROUPS = 128
_CAPACITY = 512


class Preconditioner:
    """z = M^-1 r with a symmetric positive definite M, zero on fixed unknowns, for (L,n) arrays.

    ``down`` tells r.z of some load cases, ``up`` gives their z where the iteration goes on, which
    may be the dearer half (see ``Multigrid``).
    """

    def __init__(self) -> None:
        self._z: dict[int, Float] = {}

    def apply(self, r: Float) -> Float:
        raise NotImplementedError

    def down(self, r: Float, cases: Sequence[int]) -> Float:
        z = self.apply(r)
        self._z.update(zip(cases, z, strict=True))
        return dot(r, z)

    def up(self, cases: Sequence[int]) -> Float:
        return np.stack([self._z[case] for case in cases])


class NumpyCG:
    """Conjugate gradients in NumPy for L load cases at once; ``apply`` is v -> K v. Load cases at
    rest take no time."""

    def __init__(self, apply: Any, preconditioner: Preconditioner) -> None:
        self._apply, self._precondition = apply, preconditioner

    def begin(self, residual: Float) -> Float:
        """Start from a zero correction; returns r.z per case (L,)."""
        self._r = residual.copy()
        self._x, self._p = np.zeros_like(residual), np.zeros_like(residual)
        self._beta, self._pq = np.zeros(len(residual)), np.zeros(len(residual))
        self._rz = self._precondition.down(self._r, range(len(residual)))
        self._z: dict[int, Float] = {}
        return np.array(self._rz)

    def run(self, count: int, active: Bool) -> Float:
        """``count`` iterations; history (count,L,4): r.z, alpha, beta, p.q."""
        history = np.empty((count, len(self._r), 4))
        on = np.flatnonzero(active).tolist()
        for line in history:
            line[:] = np.stack([self._rz, *np.zeros((2, len(line))), self._pq], axis=1)
            if on:
                line[on] = self._iterate(on)
        return history

    def _iterate(self, on: list[int]) -> Float:
        """One iteration of some load cases; their history (L,4)."""
        self._lift(on)
        for case in on:
            self._p[case] *= self._beta[case]
            self._p[case] += self._z.pop(case)
        every = len(on) == len(self._p)
        p, rz = self._p if every else self._p[on], self._rz[on]
        q = self._apply(p)
        pq = dot(p, q)
        alpha = np.divide(rz, pq, out=np.zeros_like(pq), where=pq > 0.0)
        for case, step, image in zip(on, alpha, q, strict=True):
            self._x[case] += step * self._p[case]
            image *= step
            self._r[case] -= image
        after = self._precondition.down(self._r if every else self._r[on], on)
        beta = np.divide(after, rz, out=np.zeros_like(rz), where=rz > 0.0)
        self._rz[on], self._beta[on], self._pq[on] = after, beta, pq
        return np.stack([rz, alpha, beta, pq], axis=1)

    def _lift(self, on: list[int]) -> None:
        """z of some load cases, once."""
        new = [case for case in on if case not in self._z]
        if new:
            self._z.update(zip(new, self._precondition.up(new), strict=True))

    def correction(self) -> Float:
        """The solution of this run so far, (L,n)."""
        return self._x.copy()

    def preconditioned(self) -> Float:
        """z = M^-1 r of what is left of the right-hand side, (L,n)."""
        every = list(range(len(self._r)))
        self._lift(every)
        return np.stack([self._z[case] for case in every])

    def keep(self) -> None:
        """The correction has been added to the solution."""

    def residual(self) -> Float | None:
        """What is left of the right-hand side by the recursion, (L,n)."""
        return self._r


class DeviceCG:
    """The same on a device; ``preconditioner`` has ``record(recording, r, z)`` for texels."""

    def __init__(
        self,
        device: Allocator,
        stiffness: DeviceOperator,
        preconditioner: Any,
        cases: int,
    ) -> None:
        self.device, self.cases, self.nodes = device, cases, stiffness.nodes
        self._stiffness, self._precondition = stiffness, preconditioner

        def vector(name: str, rounded: bool = False) -> Pair:
            return pair(device, cases, self.nodes, f"fem.cg.{name}", rounded=rounded)

        zeros = np.zeros((cases, 3 * self.nodes))
        self._x = device.real_buffer(zeros, label="fem.cg.x")
        self._z = vector_texels(device, cases, self.nodes, "fem.cg.z")
        # in use, and to be written next: a texture can't be read and written
        self._p, self._next_p = vector("p", True), vector("next_p", True)
        self._r, self._next_r = vector("r"), vector("next_r")
        self._q = vector("q")
        self._partial = device.real_buffer(np.zeros((cases, _GROUPS)), label="fem.cg.partial")
        self._scalars = device.real_buffer(np.zeros((cases, 4)), label="fem.cg.scalars")
        self._history = device.real_buffer(np.zeros((_CAPACITY, cases, 4)), label="fem.cg.history")
        self._state = device.buffer(np.zeros((cases, 2), dtype=np.uint32), label="fem.cg.state")
        self._bound: dict[object, Bindings] = {}
        self._blocks = max(1, min(65535, -(-self.nodes // 64)))

    @staticmethod
    def device_bytes(nodes: int, cases: int) -> int:
        """Bytes that this takes beside stiffness and preconditioner; never less."""
        vectors = 9 * Texels.footprint(cases * (nodes + 1))
        # buffers are rounded up to 16 bytes
        return vectors + 8 * cases * (3 * nodes + 4 * _CAPACITY + _GROUPS + 6) + 80

    def begin(self, residual: Float) -> Float:
        """Start from a zero correction; returns r.z per case (L,)."""
        self._r.write(residual.reshape(self.cases, self.nodes, 3))
        with self.device.recording("fem.cg") as recording:
            recording.clear(self._x)
            self._precondition.record(recording, self._r.high, self._z)
            self._dot_rz(recording)
            self._scalar(recording, "start")
            self._turn(recording)
        return self._scalars.read()[:, 0]

    def run(self, count: int, active: Bool) -> Float:
        """``count`` iterations in one submit per 512; history (count,L,4)."""
        parts = []
        for first in range(0, count, _CAPACITY):
            now = min(_CAPACITY, count - first)
            state = np.stack([active, np.zeros_like(active)], axis=1).astype(np.uint32)
            self._state.write(state)
            with self.device.recording("fem.cg") as recording:
                for _ in range(now):
                    self._iterate(recording)
            parts.append(self._history.read(shape=(now, self.cases, 4)))
        return np.concatenate(parts)

    def correction(self) -> Float:
        """The solution of this run so far, (L,n)."""
        return self._x.read()

    def preconditioned(self) -> Float:
        """z = M^-1 r of what is left of the right-hand side, (L,n)."""
        z = self._z.read().reshape(self.cases, self.nodes + 1, 4)
        return z[:, :-1, :3].reshape(self.cases, -1).astype(np.float64)

    def keep(self) -> None:
        """The correction has been added to the solution."""

    def residual(self) -> None:
        """Not told: reading it back costs as much as it saves."""

    def _iterate(self, recording: Recording) -> None:
        self._stiffness.record(recording, self._p, self._q)
        both = {"p_in": self._p.high, "q_high": self._q.high, "q_low": self._q.second}
        recording.dispatch(*self._bind("dot_pq", **both), groups=(_GROUPS, self.cases, 1))
        self._scalar(recording, "alpha")
        advance = self._bind(
            "advance", **both, solution=self._x, r_high_in=self._r.high, r_low_in=self._r.second,
            high_out=self._next_r.high, low_out=self._next_r.second,
        )  # fmt: skip
        recording.dispatch(*advance, groups=(self._blocks, self.cases, 1))
        self._r, self._next_r = self._next_r, self._r
        self._precondition.record(recording, self._r.high, self._z)
        self._dot_rz(recording)
        self._scalar(recording, "beta")
        self._turn(recording)

    def _dot_rz(self, recording: Recording) -> None:
        bound = self._bind("dot_rz", z_in=self._z, r_high_in=self._r.high, r_low_in=self._r.second)
        recording.dispatch(*bound, groups=(_GROUPS, self.cases, 1))

    def _scalar(self, recording: Recording, entry: str) -> None:
        # one workgroup per load case in y, as the kernels take their case from group.y
        recording.dispatch(*self._bind(entry), groups=(1, self.cases, 1))

    def _turn(self, recording: Recording) -> None:
        bound = self._bind("turn", p_in=self._p.high, z_in=self._z, high_out=self._next_p.high)
        recording.dispatch(*bound, groups=(self._blocks, self.cases, 1))
        self._p, self._next_p = self._next_p, self._p

    def _bind(self, entry: str, **vectors: RealBuffer | Texels) -> tuple[Kernel, Bindings]:
        kernel = self.device.kernel("fem/krylov/cg", entry=entry)
        key = (entry, *(id(vector) for vector in vectors.values()))
        if key not in self._bound:
            bound: dict[str, Any] = {
                "partial": self._partial,
                "scalars": self._scalars,
                "history": self._history,
                "state": self._state,
                "params": {"nodes": self.nodes, "capacity": _CAPACITY},
                **vectors,
            }
            self._bound[key] = kernel.bind_used(**bound)
        return kernel, self._bound[key]


def dot(a: Real, b: Real) -> Float:
    """(L,) products of rows (L, n), summed in float64."""
    return np.asarray(np.einsum("ln,ln->l", a, b, dtype=np.float64, casting="same_kind"))


class _BlockJacobi(Preconditioner):
    """z = D^-1 r with the 3x3 diagonal blocks of K; ``inverse`` (N,3,3), zero where fixed."""

    def __init__(self, inverse: Float) -> None:
        super().__init__()
        self._inverse = inverse

    def apply(self, r: Float) -> Float:
        return np.asarray(np.matmul(self._inverse, r.reshape(len(r), -1, 3, 1)).reshape(r.shape))

    def upload(self, device: Allocator, stiffness: Any, cases: int) -> _BlockJacobi:
        self._scaling = relaxation(device, stiffness.texels, self._inverse, cases, "fem.check")
        return self

    def record(self, recording: Recording, r: Texels, z: Texels) -> None:
        self._scaling.begin(recording, r, z, 1.0)
