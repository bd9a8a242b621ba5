"""VIC-3D's <camera> elements and DICe's camera system file."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from gpusim.errors import InputError
from gpusim.optics.calibration.common import angles_of, five, from_angles, make, number, pose_of
from gpusim.optics.calibration.document import xml_root
from gpusim.optics.camera.pinhole import Camera

__all__ = ["read_dice", "read_vic", "write_dice", "write_vic"]

Size = tuple[int, int] | None

_DICE = ("K1", "K2", "P1", "P2", "K3", "K4", "K5", "K6", "S1", "S2", "S3", "S4", "T1", "T2")
_VIC = "cx cy fx fy fs k1 k2 k3 alpha beta gamma tx ty tz"


def read_vic(text: str, where: str, size: Size) -> list[Camera]:
    """<camera id="…">: cx cy fx fy fs k1 k2 k3, then alpha beta gamma tx ty tz.

    The last six follow in the same text or in an <orientation> element within it. Distortion is
    x (1 + k1 r^2 + k2 r^4 + k3 r^6) on the plane at unit distance.
    """
    cameras: list[Camera] = []
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
        K = np.array([[fx, fs, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        R, T = from_angles(*values[8:11]), np.array(values[11:14])
        cameras.append(make(key, f"camera {name}", size, K, [k1, k2, 0.0, 0.0, k3], R, T))
    if not cameras:
        raise InputError(f"{where}: <camera>; got none; expected at least one")
    return cameras


def write_vic(cameras: Sequence[Camera], where: str) -> str:
    """As `read_vic` reads them; no tangential distortion."""
    root = ET.Element("calibration")
    root.append(ET.Comment(" length_unit: mm "))
    for index, camera in enumerate(cameras):
        k1, k2, _, _, k3 = five(camera, where, tangential=False)
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
        if model not in ("OPENCV_LENS_DISTORTION", "NO_LENS_DISTORTION", "NONE"):
            raise InputError(
                f"{key} LENS_DISTORTION_MODEL; got {model}; expected OPENCV_LENS_DISTORTION or "
                "NO_LENS_DISTORTION"
            )
        for needed in ("FX", "FY", "CX", "CY"):
            if needed not in words:
                raise InputError(f"{key} {needed}; got nothing; expected a number")
        values = {k: number(words.get(k, 0.0), f"{key} {k}")
                  for k in (*_DICE, "FX", "FY", "CX", "CY", "FS", "TX", "TY", "TZ",
                            "ALPHA", "BETA", "GAMMA")}  # fmt: skip
        K = np.array([[values["FX"], values["FS"], values["CX"]],
                      [0.0, values["FY"], values["CY"]], [0.0, 0.0, 1.0]])  # fmt: skip
        R = from_angles(values["ALPHA"], values["BETA"], values["GAMMA"])
        for matrix in block.findall("ParameterList"):
            if matrix.get("name") == "rotation_3x3_matrix":
                rows = {p.get("name"): _braces(p.get("value", ""), f"{key} rotation_3x3_matrix", 3)
                        for p in matrix.findall("Parameter")}  # fmt: skip
                if set(rows) != {"ROW 0", "ROW 1", "ROW 2"}:
                    raise InputError(f"{key} rotation_3x3_matrix; got {sorted(map(str, rows))}")
                R = np.array([rows[f"ROW {i}"] for i in range(3)])
        shape = size
        if "IMAGE_HEIGHT_WIDTH" in words:
            height, width = _braces(words["IMAGE_HEIGHT_WIDTH"], f"{key} IMAGE_HEIGHT_WIDTH", 2)
            shape = int(width), int(height)
        bent = [values[k] if "OPENCV" in model else 0.0 for k in _DICE]
        T = np.array([values["TX"], values["TY"], values["TZ"]])
        label = words.get("CAMERA_ID", "").strip() or name
        cameras.append(make(key, label, shape, K, bent, R, T))
    if not cameras:
        raise InputError(f"{where}: CAMERA 0; got none; expected at least one camera")
    return cameras


def write_dice(cameras: Sequence[Camera], where: str) -> str:
    """A camera system of type OPENCV with rotation matrices."""
    root = ET.Element("ParameterList")
    root.append(ET.Comment(" length_unit: mm "))

    def put(parent: ET.Element, name: str, kind: str, value: str) -> None:
        ET.SubElement(parent, "Parameter", name=name, type=kind, value=value)

    put(root, "xml_file_format", "string", "DICe_xml_camera_system_file")
    put(root, "system_type_3D", "string", "OPENCV")
    put(root, "extrinsics_relative_camera_to_camera", "bool", "false")
    for index, camera in enumerate(cameras):
        block = ET.SubElement(root, "ParameterList", name=f"CAMERA {index}")
        values = np.zeros(14)
        if camera.distortion is not None:
            values[: len(camera.distortion)] = camera.distortion
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
    if len(values) != count:
        raise InputError(f"{where}; got {text!r}; expected {count} numbers in braces")
    return values


def _words(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _pretty(root: ET.Element) -> str:
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"
