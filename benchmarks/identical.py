"""Whether the product still does the same, bit by bit, after code was moved, renamed or rewritten.

Before the change::

    python -m benchmarks.identical --write before.json [--keep before]

and after it::

    python -m benchmarks.identical --against before.json [--keep before]

The file holds SHA-256 hashes of what every case of `benchmarks.identical_cases` gives (images,
truth, displacements, measurements, files of the examples), and of the text of every shader module
that the run compiles. The second command lists what differs and ends with 1 if anything does.
With ``--keep`` the arrays themselves lie in that folder, and it says how far they are apart.
Hashes hold on one machine with one driver and one set of packages, so they aren't committed.

A module's text counts without comments, and without regard to the order of its declarations or to
its file's name: shader files may be moved. They are compared as a set.
"""

from __future__ import annotations

import argparse
import fnmatch
import hashlib
import json
import os
import platform
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
import numpy.typing as npt
import wgpu.backends.wgpu_native as native

from benchmarks import identical_cases

Hashes = dict[str, dict[str, str]]
"""Case -> array -> SHA-256."""

_NOT_CODE = re.compile(r"//[^\n]*|/\*.*?\*/|^#import[^\n]*", re.DOTALL | re.MULTILINE)


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit status: 1 where something differs or a case raises."""
    os.environ["GPUSIM_NO_CACHE"] = "1"  # programs of earlier runs would be compiled beforehand
    cases = identical_cases.CASES
    asked = _parsed(arguments)
    stored = json.loads(asked.against.read_text(encoding="utf-8")) if asked.against else None
    chosen = [name for name in cases if fnmatch.fnmatch(name, asked.only)]
    hashes: Hashes = {}
    faults: list[str] = []
    start = time.perf_counter()
    with compiled_modules() as programs:
        for name in chosen:
            begun = time.perf_counter()
            try:
                arrays = cases[name]()
            except Exception as error:
                faults.append(f"{name}: raised {type(error).__name__}: {error}")
                continue
            hashes[name] = {key: digest(values) for key, values in arrays.items()}
            print(f"{name}: {time.perf_counter() - begun:.2f} s", flush=True)
            if stored is not None:
                faults += differences(name, arrays, hashes[name], stored["cases"], asked.keep)
            elif asked.keep:
                path = asked.keep / f"{name}.npz"
                path.parent.mkdir(parents=True, exist_ok=True)
                np.savez(path, **_as_keys(arrays))
    if stored is not None:
        faults += changed_programs(programs, stored["programs"], complete=asked.only == "*")
        if asked.only == "*":
            faults += [f"{name}: gone" for name in stored["cases"] if name not in cases]
        if stored["machine"] != machine():
            print(f"hashes of another machine: {stored['machine']}; this one: {machine()}")
    elif not faults:
        found = {"machine": machine(), "cases": hashes, "programs": programs}
        asked.write.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    count = sum(len(arrays) for arrays in hashes.values())
    print(f"{len(hashes)} cases, {count} arrays, {len(programs)} shader modules: "
          f"{time.perf_counter() - start:.0f} s")  # fmt: skip
    print("\n".join(faults) or ("the same" if stored is not None else f"written: {asked.write}"))
    return 1 if faults or not chosen else 0


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.identical", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--write", type=Path, metavar="FILE.json", help="compute hashes, write them")
    what.add_argument("--against", type=Path, metavar="FILE.json", help="compute and compare")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="of the arrays, as .npz")
    parser.add_argument("--only", default="*", metavar="PATTERN", help="cases, such as 'fem/*'")
    return parser.parse_args(arguments)


def digest(values: npt.NDArray[Any]) -> str:
    """SHA-256 of an array's type, shape and bytes."""
    values = np.asarray(values)
    head = f"{values.dtype.str} {values.shape}".encode()
    return hashlib.sha256(head + np.ascontiguousarray(values).tobytes()).hexdigest()


def differences(
    name: str, arrays: Mapping[str, npt.NDArray[Any]], hashes: Mapping[str, str], stored: Hashes,
    keep: Path | None,
) -> list[str]:  # fmt: skip
    """A line for each array of a case that isn't as stored."""
    if name not in stored:
        return [f"{name}: new"]
    kept = {}
    if keep is not None and (keep / f"{name}.npz").is_file():
        with np.load(keep / f"{name}.npz") as file:
            kept = {key: file[_key(key)] for key in stored[name]}
    lines = []
    for key in {**stored[name], **hashes}:
        if key not in hashes or key not in stored[name]:
            lines.append(f"{name} {key}: {'new' if key in hashes else 'gone'}")
        elif hashes[key] != stored[name][key]:
            apart = f"; {distance(kept[key], arrays[key])}" if key in kept else ""
            lines.append(f"{name} {key}: differs{apart}")
    return lines


def distance(before: npt.NDArray[Any], after: npt.NDArray[Any]) -> str:
    """How far two arrays are apart, in words."""
    before, after = np.asarray(before), np.asarray(after)
    if (before.shape, before.dtype) != (after.shape, after.dtype):
        return f"was {before.shape} {before.dtype}, is {after.shape} {after.dtype}"
    if before.dtype.kind not in "biuf":
        return "another text"
    before, after = before.astype(np.float64), after.astype(np.float64)
    wide = np.where(np.isnan(before) & np.isnan(after), 0.0, after - before)
    rms, scale = np.sqrt(np.mean(wide**2)), np.abs(np.nan_to_num(before)).max(initial=0.0)
    return (
        f"{np.count_nonzero(wide)} of {wide.size} values, max {np.abs(wide).max(initial=0.0):.3g}, "
        f"RMS {rms:.3g} (largest value {scale:.3g})"
    )


def changed_programs(
    programs: Mapping[str, str], stored: Mapping[str, str], complete: bool
) -> list[str]:
    """Shader modules that weren't compiled before and, of a ``complete`` run, that no more are."""
    new = [f"shader module {label}: new text" for key, label in programs.items()
           if key not in stored]  # fmt: skip
    gone = [f"shader module {label}: text is gone" for key, label in stored.items()
            if key not in programs]  # fmt: skip
    return new + (gone if complete else [])


@contextmanager
def compiled_modules() -> Iterator[dict[str, str]]:
    """Hash of its text -> label, of every shader module that is compiled meanwhile."""
    found: dict[str, str] = {}
    create = native.GPUDevice.create_shader_module

    def noted(device: Any, **options: Any) -> Any:
        text = canonical(options["code"])
        found.setdefault(hashlib.sha256(text.encode()).hexdigest(), options["label"])
        return create(device, **options)

    with mock.patch.object(native.GPUDevice, "create_shader_module", noted):
        yield found


def canonical(code: str) -> str:
    """WGSL as sorted declarations without comments, imports and line breaks.

    Order doesn't count in WGSL, and files that are imported in the order of their names change it
    when they move.
    """
    declarations, start, depth = [], 0, 0
    plain = _NOT_CODE.sub("", code)
    for mark in re.finditer(r"[{};]", plain):
        depth += {"{": 1, "}": -1, ";": 0}[mark.group()]
        if depth == 0:
            declarations.append(" ".join(plain[start : mark.end()].split()))
            start = mark.end()
    return "\n".join(sorted([*declarations, " ".join(plain[start:].split())]))


def machine() -> dict[str, str]:
    """What hashes depend on beside the code."""
    adapter = native.gpu.request_adapter_sync(power_preference="high-performance")
    return {
        "adapter": " ".join(str(adapter.info[key]) for key in ("device", "description")),
        "processor": platform.processor() or platform.machine(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def _key(name: str) -> str:
    """A name in an .npz file: slashes would make folders in it."""
    return name.replace("/", "|")


def _as_keys(arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, Any]:
    return {_key(name): values for name, values in arrays.items()}


if __name__ == "__main__":
    cv2.setNumThreads(1)  # with more, the last digits of a calibration change from run to run
    raise SystemExit(main())
