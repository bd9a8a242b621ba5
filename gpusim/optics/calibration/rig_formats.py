"""Files of whole rigs: Kalibr's camchain, MatchID's .caldat, VIC-3D's and DICe's XML."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.optics.calibration.document import (
    Document,
    angles_of,
    coefficients,
    from_angles,
    make,
    number,
    pose_of,
    read_document,
    relative,
    xml_root,
)
from gpusim.optics.camera.pinhole import Camera
from gpusim.validation import require

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
            got = values.get(model)
            require(got in allowed, f"{key}.{model}", repr(got), " or ".join(allowed))
        fx, fy, cx, cy = _row(values, "intrinsics", 4, key)
        width, height = _row(values, "resolution", 2, key)
        bent = values["distortion_model"] == "radtan"
        coefficients = _row(values, "distortion_coeffs", 4, key) if bent else [0.0] * 4
        if cameras:
            step = np.array(_row(values, "T_cn_cnm1", 16, key)).reshape(4, 4)
            pose = step @ pose
        K, shape = _intrinsics(fx, fy, cx, cy), (int(width), int(height))
        cameras.append(make(key, name, shape, K, coefficients, pose[:3, :3], pose[:3, 3]))
    return cameras


def _intrinsics(fx: float, fy: float, cx: float, cy: float, skew: float = 0.0) -> Float:
    return np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _chain(document: Document, where: str) -> list[tuple[str, Any]]:
    """The entries cam0, cam1 … by number: programs that write YAML put cam10 before cam2."""
    for name in document:
        known = re.fullmatch(r"cam(0|[1-9]\d{0,5})", name) is not None
        require(known, f"{where}: {name[:60]}", "an unknown key", "cam0, cam1 …")
    names = [f"cam{index}" for index in range(max(1, len(document)))]
    for name in names:
        expected = "it: each camera stands by the one before it"
        require(name in document, f"{where}: {name}", "nothing", expected)
    return [(name, document[name]) for name in names]


def _row(values: Document, key: str, count: int, where: str) -> list[float]:
    """Numbers in one list, or in a list of rows."""
    require(key in values, f"{where}.{key}", "nothing", f"{count} numbers")
    rows = values[key] if isinstance(values[key], list) else [values[key]]
    words = [word for row in rows for word in (row if isinstance(row, list) else [row])]
    found = [number(word, f"{where}.{key}") for word in words]
    require(len(found) == count, f"{where}.{key}", f"{len(found)} numbers", f"{count}")
    return found


def write_kalibr(cameras: Sequence[Camera], unit: str, comments: Sequence[str]) -> str:
    """The first camera becomes the world. What isn't a camera is a comment: a key of its own would
    be taken for one."""
    lines = [f"# {text}" for text in (f"length_unit: {unit}", *comments)]
    for index, camera in enumerate(cameras):
        K, values = camera.K, coefficients(camera)
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


def _list(values: Sequence[float] | Float) -> str:
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
        named = unit[1] if unit else "mm"
        key = re.sub(r"\[.*?\]|\s", "", label).lower()
        place = f"{where} line {line_number}, {label.strip()}"
        known = named.lower() in ("pixels", "pixel", "mm", "deg")
        require(known, place, f"unit [{named}]", "[pixels], [mm] or [deg]")
        values[key] = number(value, place)
    numbers = sorted({int(m.group(1)) for k in values if (m := re.match(r"cam(\d+)_fx$", k))})
    got = f"{len(numbers)} cameras"
    require(1 <= len(numbers) <= 2, f"{where}: Cam0_Fx, Cam1_Fx", got, "1 or 2")
    cameras = []
    for index, camera in enumerate(numbers):
        own = {k.split("_", 1)[1]: v for k, v in values.items() if k.startswith(f"cam{camera}_")}
        for needed in ("fx", "fy", "cx", "cy"):
            label = f"{where}: Cam{camera}_{needed.capitalize()}"
            require(needed in own, label, "nothing", "a number")
        K = _intrinsics(own["fx"], own["fy"], own["cx"], own["cy"], own.get("fs", 0.0))
        coefficients = [own.get(k, 0.0) for k in ("kappa1", "kappa2", "p1", "p2", "kappa3")]
        R, T = np.eye(3), np.zeros(3)
        if index:
            R = from_angles(*(values.get(k, 0.0) for k in ("theta", "phi", "psi")))
            T = np.array([values.get(k, 0.0) for k in ("tx", "ty", "tz")])
        name = f"Cam{camera}"
        cameras.append(make(f"{where}: {name}", name, size, K, coefficients, R, T))
    return cameras


def write_matchid(cameras: Sequence[Camera], unit: str, comments: Sequence[str]) -> str:
    """One or two cameras; the first one's frame becomes the world. There is no place for
    ``unit`` and ``comments``."""
    lines = []
    for index, camera in enumerate(cameras):
        k1, k2, p1, p2, k3 = coefficients(camera)[:5]
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


_DICE = ("K1", "K2", "P1", "P2", "K3", "K4", "K5", "K6", "S1", "S2", "S3", "S4", "T1", "T2")
_VIC = "cx cy fx fy fs k1 k2 k3 alpha beta gamma tx ty tz"


def read_vic(text: str, where: str, size: Size) -> list[Camera]:
    """<camera id="…">: cx cy fx fy fs k1 k2 k3, then alpha beta gamma tx ty tz.

    The last six follow in the same text or in an <orientation> element within it. Distortion is
    x (1 + k1 r^2 + k2 r^4 + k3 r^6) on the plane at unit distance. A comment may say
    ``image_size: 640 x 480`` for each camera.
    """
    cameras: list[Camera] = []
    sizes = [(int(w), int(h)) for w, h in re.findall(r"image_size: (\d{1,6}) x (\d{1,6})", text)]
    for element in xml_root(text, where).iter():
        if element.tag.lower() != "camera":
            continue
        name = element.get("id") or element.get("ID") or str(len(cameras))
        key = f"{where}: camera {name}"
        words = (element.text or "").split()
        for child in element:
            if child.tag.lower() == "orientation":
                words = [*words[:8], *(child.text or "").split()]
        values = [number(word, key) for word in words]
        if len(values) < 14 or any(values[14:]):
            raise InputError(f"{key}; got {len(values)} numbers; expected 14: {_VIC}")
        cx, cy, fx, fy, fs, k1, k2, k3 = values[:8]
        K = _intrinsics(fx, fy, cx, cy, fs)
        R, T = from_angles(*values[8:11]), np.array(values[11:14])
        shape = sizes[len(cameras)] if len(cameras) < len(sizes) else size
        cameras.append(make(key, f"camera {name}", shape, K, [k1, k2, 0.0, 0.0, k3], R, T))
    require(len(cameras) > 0, f"{where}: <camera>", "none", "at least one")
    return cameras


def write_vic(cameras: Sequence[Camera], unit: str, comments: Sequence[str]) -> str:
    """As `read_vic` reads them."""
    root = ET.Element("calibration")
    _remark(root, [f"length_unit: {unit}", *comments])
    for index, camera in enumerate(cameras):
        root.append(ET.Comment(f" image_size: {camera.width} x {camera.height} "))
        k1, k2, _, _, k3 = coefficients(camera)[:5]
        K, (R, T) = camera.K, pose_of(camera)
        inner = [K[0, 2], K[1, 2], K[0, 0], K[1, 1], K[0, 1], k1, k2, k3]
        element = ET.SubElement(root, "camera", id=str(index))
        element.text = _words(inner)
        ET.SubElement(element, "orientation").text = _words([*angles_of(R), *T])
    return _pretty(root)


def read_dice(text: str, where: str, size: Size) -> list[Camera]:
    """<ParameterList name="CAMERA n">: X_camera = R X + T with the file's world.

    DICe's template calls FS an angle, its projection adds FS * Y in px, and so does this.
    """
    cameras = []
    for block in xml_root(text, where).iter("ParameterList"):
        name = block.get("name", "")
        if not name.upper().startswith("CAMERA "):
            continue
        key = f"{where}: {name}"
        words = {p.get("name", "").upper(): p.get("value", "") for p in block.findall("Parameter")}
        model = words.get("LENS_DISTORTION_MODEL", "OPENCV_LENS_DISTORTION").strip().upper()
        known = model in ("OPENCV_LENS_DISTORTION", "NO_LENS_DISTORTION", "NONE")
        expected = "OPENCV_LENS_DISTORTION or NO_LENS_DISTORTION"
        require(known, f"{key} LENS_DISTORTION_MODEL", model, expected)
        for needed in ("FX", "FY", "CX", "CY"):
            require(needed in words, f"{key} {needed}", "nothing", "a number")
        values = {k: number(words.get(k, 0.0), f"{key} {k}")
                  for k in (*_DICE, "FX", "FY", "CX", "CY", "FS", "TX", "TY", "TZ",
                            "ALPHA", "BETA", "GAMMA")}  # fmt: skip
        K = _intrinsics(*(values[key] for key in ("FX", "FY", "CX", "CY", "FS")))
        R = from_angles(values["ALPHA"], values["BETA"], values["GAMMA"])
        for matrix in block.findall("ParameterList"):
            if matrix.get("name") == "rotation_3x3_matrix":
                rows = {p.get("name"): _braces(p.get("value", ""), f"{key} rotation_3x3_matrix", 3)
                        for p in matrix.findall("Parameter")}  # fmt: skip
                three = set(rows) == {"ROW 0", "ROW 1", "ROW 2"}
                got = sorted(map(str, rows))
                require(three, f"{key} rotation_3x3_matrix", got, "ROW 0, ROW 1 and ROW 2")
                R = np.array([rows[f"ROW {i}"] for i in range(3)])
        shape = size
        if "IMAGE_HEIGHT_WIDTH" in words:
            height, width = _braces(words["IMAGE_HEIGHT_WIDTH"], f"{key} IMAGE_HEIGHT_WIDTH", 2)
            shape = int(width), int(height)
        bent = [values[k] if "OPENCV" in model else 0.0 for k in _DICE]
        T = np.array([values["TX"], values["TY"], values["TZ"]])
        label = words.get("CAMERA_ID", "").strip() or name
        cameras.append(make(key, label, shape, K, bent, R, T))
    require(len(cameras) > 0, f"{where}: CAMERA 0", "none", "at least one camera")
    return cameras


def write_dice(cameras: Sequence[Camera], unit: str, comments: Sequence[str]) -> str:
    """A camera system of type OPENCV with rotation matrices."""
    root = ET.Element("ParameterList")
    _remark(root, [f"length_unit: {unit}", *comments])

    def put(parent: ET.Element, name: str, kind: str, value: str) -> None:
        ET.SubElement(parent, "Parameter", name=name, type=kind, value=value)

    put(root, "xml_file_format", "string", "DICe_xml_camera_system_file")
    put(root, "system_type_3D", "string", "OPENCV")
    put(root, "extrinsics_relative_camera_to_camera", "bool", "false")
    for index, camera in enumerate(cameras):
        block = ET.SubElement(root, "ParameterList", name=f"CAMERA {index}")
        values = coefficients(camera)
        K, (R, T) = camera.K, pose_of(camera)
        put(block, "CAMERA_ID", "string", camera.name)
        pairs = [("CX", K[0, 2]), ("CY", K[1, 2]), ("FX", K[0, 0]), ("FY", K[1, 1]),
                 ("FS", K[0, 1]), *zip(_DICE, values, strict=True),
                 ("TX", T[0]), ("TY", T[1]), ("TZ", T[2])]  # fmt: skip
        for name, value in pairs:
            put(block, name, "double", repr(float(value)))
        put(block, "LENS_DISTORTION_MODEL", "string", "OPENCV_LENS_DISTORTION")
        put(block, "IMAGE_HEIGHT_WIDTH", "string", f"{{ {camera.height}, {camera.width} }}")
        matrix = ET.SubElement(block, "ParameterList", name="rotation_3x3_matrix")
        for row in range(3):
            entries = ", ".join(repr(float(value)) for value in R[row])
            put(matrix, f"ROW {row}", "string", f"{{ {entries} }}")
    return _pretty(root)


def _braces(text: str, where: str, count: int) -> list[float]:
    values = [number(word, where) for word in text.strip().strip("{}").split(",")]
    require(len(values) == count, where, repr(text), f"{count} numbers in braces")
    return values


def _words(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _remark(root: ET.Element, comments: Sequence[str]) -> None:
    for text in comments:
        root.append(ET.Comment(f" {text.replace('--', '- -')} "))  # XML's own end of a comment


def _pretty(root: ET.Element) -> str:
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"
