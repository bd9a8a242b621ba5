"""Kalibr's camchain (YAML) and MatchID's .caldat (key;value)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.optics.calibration.common import angles_of, five, from_angles, make, number, relative
from gpusim.optics.calibration.document import Document, read_document
from gpusim.optics.camera.pinhole import Camera

__all__ = ["read_kalibr", "read_matchid", "write_kalibr", "write_matchid"]

Array = npt.NDArray[np.float64]
Size = tuple[int, int] | None
LONGEST_LABEL = 100


def read_kalibr(text: str, where: str, size: Size) -> list[Camera]:
    """cam0, cam1 … in the order of their numbers; cam0's frame is the world."""
    cameras: list[Camera] = []
    pose = np.eye(4)
    for name, values in _chain(read_document(text, where), where):
        key = f"{where}: {name}"
        if not isinstance(values, dict):
            raise InputError(f"{key}; got {str(values)[:60]!r}; expected a camera: camN: and keys")
        for model, allowed in (
            ("camera_model", ("pinhole",)),
            ("distortion_model", ("radtan", "none")),
        ):
            if values.get(model) not in allowed:
                got = values.get(model)
                raise InputError(f"{key}.{model}; got {got!r}; expected {' or '.join(allowed)}")
        fx, fy, cx, cy = _row(values, "intrinsics", 4, key)
        width, height = _row(values, "resolution", 2, key)
        bent = values["distortion_model"] == "radtan"
        coefficients = _row(values, "distortion_coeffs", 4, key) if bent else [0.0] * 4
        if cameras:
            step = np.array(_row(values, "T_cn_cnm1", 16, key)).reshape(4, 4)
            pose = step @ pose
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        shape = (int(width), int(height))
        cameras.append(make(key, name, shape, K, coefficients, pose[:3, :3], pose[:3, 3]))
    return cameras


def _chain(document: Document, where: str) -> list[tuple[str, Any]]:
    """The entries cam0, cam1 … by number: programs that write YAML put cam10 before cam2."""
    for name in document:
        if not re.fullmatch(r"cam(0|[1-9]\d{0,5})", name):
            raise InputError(f"{where}: {name[:60]}; got an unknown key; expected cam0, cam1 …")
    for index in range(max(1, len(document))):
        if f"cam{index}" not in document:
            raise InputError(
                f"{where}: cam{index}; got nothing; expected it: each camera stands by the one "
                "before it"
            )
    return [(f"cam{index}", document[f"cam{index}"]) for index in range(len(document))]


def _row(values: Document, key: str, count: int, where: str) -> list[float]:
    """Numbers in one list, or in a list of rows."""
    if key not in values:
        raise InputError(f"{where}.{key}; got nothing; expected {count} numbers")
    rows = values[key] if isinstance(values[key], list) else [values[key]]
    words = [word for row in rows for word in (row if isinstance(row, list) else [row])]
    found = [number(word, f"{where}.{key}") for word in words]
    if len(found) != count:
        raise InputError(f"{where}.{key}; got {len(found)} numbers; expected {count}")
    return found


def write_kalibr(cameras: Sequence[Camera], where: str) -> str:
    """The first camera becomes the world; no skew and no k3."""
    lines = ["# length_unit: m"]  # a key of its own would be taken for a camera
    for index, camera in enumerate(cameras):
        values = five(camera, where)
        if values[4] != 0.0 or camera.K[0, 1] != 0.0:
            raise InputError(
                f"{where}: camera {camera.name!r}; got k3 = {values[4]:g}, skew = "
                f"{camera.K[0, 1]:g}; expected 0, as Kalibr has neither"
            )
        K = camera.K
        inner = [K[0, 0], K[1, 1], K[0, 2], K[1, 2]]
        lines += [f"cam{index}:"]
        if index:
            rows = relative(camera, cameras[index - 1])
            lines += ["  T_cn_cnm1:", *(f"  - {_list(row)}" for row in rows)]
        lines += [
            "  camera_model: pinhole",
            f"  distortion_coeffs: {_list(values[:4])}",
            "  distortion_model: radtan",
            f"  intrinsics: {_list(inner)}",
            f"  resolution: [{camera.width}, {camera.height}]",
        ]
    return "\n".join(lines) + "\n"


def _list(values: Sequence[float] | Array) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def read_matchid(text: str, where: str, size: Size) -> list[Camera]:
    """Cam0 and Cam1 (or Cam1 and Cam2); the first camera's frame is the world, mm."""
    values: dict[str, float] = {}
    for line_number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        label, _, value = line.partition(";")
        label = label[:LONGEST_LABEL]
        unit = re.search(r"\[(.*?)\]", label)
        key = re.sub(r"\[.*?\]|\s", "", label).lower()
        if unit and unit.group(1).lower() not in ("pixels", "pixel", "mm", "deg"):
            raise InputError(
                f"{where} line {line_number}, {label.strip()}; got unit [{unit.group(1)}]; "
                "expected [pixels], [mm] or [deg]"
            )
        values[key] = number(value, f"{where} line {line_number}, {label.strip()}")
    numbers = sorted({int(m.group(1)) for k in values if (m := re.match(r"cam(\d+)_fx$", k))})
    if not 1 <= len(numbers) <= 2:
        raise InputError(f"{where}: Cam0_Fx, Cam1_Fx; got {len(numbers)} cameras; expected 1 or 2")
    cameras = []
    for index, camera in enumerate(numbers):
        own = {k.split("_", 1)[1]: v for k, v in values.items() if k.startswith(f"cam{camera}_")}
        for needed in ("fx", "fy", "cx", "cy"):
            if needed not in own:
                raise InputError(f"{where}: Cam{camera}_{needed.capitalize()}; got nothing")
        K = np.array([[own["fx"], own.get("fs", 0.0), own["cx"]], [0.0, own["fy"], own["cy"]],
                      [0.0, 0.0, 1.0]])  # fmt: skip
        coefficients = [own.get(k, 0.0) for k in ("kappa1", "kappa2", "p1", "p2", "kappa3")]
        R, T = np.eye(3), np.zeros(3)
        if index:
            R = from_angles(*(values.get(k, 0.0) for k in ("theta", "phi", "psi")))
            T = np.array([values.get(k, 0.0) for k in ("tx", "ty", "tz")])
        name = f"Cam{camera}"
        cameras.append(make(f"{where}: {name}", name, size, K, coefficients, R, T))
    return cameras


def write_matchid(cameras: Sequence[Camera], where: str) -> str:
    """One or two cameras; the first one's frame becomes the world."""
    if len(cameras) > 2:
        raise InputError(f"{where}: cameras; got {len(cameras)}; expected one or two for MatchID")
    lines = []
    for index, camera in enumerate(cameras):
        k1, k2, p1, p2, k3 = five(camera, where)
        K = camera.K
        for label, value in (
            ("Fx [pixels]", K[0, 0]), ("Fy [pixels]", K[1, 1]), ("Fs [pixels]", K[0, 1]),
            ("Kappa 1", k1), ("Kappa 2", k2), ("Kappa 3", k3), ("P1", p1), ("P2", p2),
            ("Cx [pixels]", K[0, 2]), ("Cy [pixels]", K[1, 2]),
        ):  # fmt: skip
            lines.append(f"Cam{index}_{label};{float(value)!r}")
    if len(cameras) == 2:
        pose = relative(cameras[1], cameras[0])
        lines += [f"T{k} [mm];{float(v)!r}" for k, v in zip("xyz", pose[:3, 3], strict=True)]
        angles = zip(("Theta", "Phi", "Psi"), angles_of(pose[:3, :3]), strict=True)
        lines += [f"{label} [deg];{angle!r}" for label, angle in angles]
    return "\n".join(lines) + "\n"
