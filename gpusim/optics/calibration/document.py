"""The trees of keys, lists and numbers that calibration files are: YAML, JSON and OpenCV's XML.

PyYAML reads YAML as events, without making anything of them: tags are passed over, aliases refused,
decimal numbers become floats, and all else stays text, "no", 010 and 1:30 of YAML 1.1 too.
"""

from __future__ import annotations

import json
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from typing import Any, cast

import numpy as np
import yaml

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.validation import require

Document = dict[str, Any]

DEEPEST = 20
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")


def read_document(text: str, where: str) -> Document:
    """The map that a file's ``text`` holds.

    Raises
    ------
    InputError
        Not well-formed (with the line), deeper than 20 levels, or no map.
    """
    begin = text.lstrip()[:1]
    # OpenCV writes ' as \', which neither YAML nor JSON knows
    plain = re.sub(r"(\\\\)|\\'", lambda found: found[1] or "'", text)
    if begin == "<":
        found = _from_xml(xml_root(text, where), where, 0)
    elif begin == "{":
        try:
            found = json.loads(plain, parse_int=float)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{where}; got {error}; expected well-formed JSON") from None
    else:
        found = _from_yaml(plain, where)
    require(isinstance(found, dict), where, "no keys", "a calibration's")
    return cast(Document, found)


def xml_root(text: str, where: str) -> ET.Element:
    """The root of an XML text. Raises InputError if it isn't well-formed, or declares entities."""
    plain = "<!DOCTYPE" not in text and "<!ENTITY" not in text
    require(plain, where, "a document type", "XML without one")
    try:
        return ET.fromstring(text)
    except (ET.ParseError, ValueError) as error:  # ValueError: an unknown encoding
        raise InputError(f"{where}; got {error}; expected well-formed XML") from None


def _from_xml(element: ET.Element, where: str, depth: int) -> Any:
    """Children by name, a list of those named "_", or numbers and words between blanks."""
    require(depth <= DEEPEST, where, f"more than {DEEPEST} levels", "a calibration")
    if not len(element):
        text = (element.text or "").strip()
        words = [_scalar(word) for word in text.split()]
        if not all(isinstance(word, float) for word in words):
            return text.strip('"')
        return words[0] if len(words) == 1 else words
    if all(child.tag == "_" for child in element):
        return [_from_xml(child, where, depth + 1) for child in element]
    return {child.tag: _from_xml(child, where, depth + 1) for child in element}


def _from_yaml(text: str, where: str) -> Any:
    """The value of a YAML text; "" for nothing.

    What stands between documents goes: OpenCV appends some to a file, ROS prints one after the
    other, all with keys of one map; OpenCV's %YAML:1.0 is no directive of YAML.
    """
    between = re.compile(r"%(YAML|TAG).*|(---|\.\.\.)\s*")
    lines = ["" if between.fullmatch(line) else line for line in text.splitlines()]
    events = yaml.parse("\n".join(lines), Loader=yaml.CSafeLoader)
    value: Any = ""
    try:
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                require(value == "", _line(where, event.start_mark), "a second document", "one")
                value = _from_event(next(events), events, where, 0)
    except yaml.YAMLError as error:  # in lines: what, where, what, where
        got = str(error).replace('\n  in "<unicode string>", ', " at ").replace("\n", ", ")
        raise InputError(f"{where}; got an error: {got}; expected well-formed YAML") from None
    return value


def _from_event(event: yaml.Event, events: Iterator[yaml.Event], where: str, depth: int) -> Any:
    """What begins with an event. Tags are passed over, and with them what YAML 1.1 takes "no",
    1:30 and 010 for."""
    if isinstance(event, yaml.ScalarEvent):
        return event.value if event.style else _scalar(event.value)
    line = _line(where, event.start_mark)
    alias = isinstance(event, yaml.AliasEvent)
    require(not alias, line, f"*{event.anchor}", "a plain value: no anchors and aliases")
    require(depth <= DEEPEST, line, f"{depth} levels", f"at most {DEEPEST} levels")
    if isinstance(event, yaml.SequenceStartEvent):
        values = []
        while not isinstance(event := next(events), yaml.SequenceEndEvent):
            values.append(_from_event(event, events, where, depth + 1))
        return values
    found: Document = {}
    while not isinstance(event := next(events), yaml.MappingEndEvent):
        line = _line(where, event.start_mark)
        # OpenCV's {x:1} has the key x, YAML's x:1
        word = isinstance(event, yaml.ScalarEvent) and (event.style or ":" not in event.value)
        require(word, line, getattr(event, "value", "no word"), "'key: value', with the blank")
        key = event.value
        require(key not in found, line, f"{key!r} again", "it once")
        found[key] = _from_event(next(events), events, where, depth + 1)
    return found


def _line(where: str, mark: yaml.Mark) -> str:
    return f"{where} line {mark.line + 1}"


def _scalar(word: str) -> Any:
    if _NUMBER.fullmatch(word):
        return float(word)
    special = {".nan": "nan", ".inf": "inf", "+.inf": "inf", "-.inf": "-inf"}.get(word.lower())
    return float(special) if special else word


def make(
    where: str,
    name: str,
    size: tuple[int, int] | None,
    K: Float,
    distortion: Sequence[float] | Float,
    R: Float,
    T: Float,
) -> Camera:
    """A camera, its rotation rounded in the file made exact again."""
    if size is None:
        raise InputError(
            f"{where}: the image size; got none in this file; expected "
            "read_calibration(path, size=(columns, rows))"
        )
    matrix = np.asarray(R, np.float64)
    fits = matrix.shape == (3, 3) and np.isfinite(matrix).all()
    require(fits, f"{where}: rotation", f"shape {matrix.shape}", "finite (3, 3)")
    u, _, v = np.linalg.svd(matrix)
    turn = u @ v
    fits = np.abs(turn - matrix).max() <= 1e-3 and np.linalg.det(turn) > 0.0
    require(fits, f"{where}: rotation", matrix.tolist(), "a rotation matrix")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, np.asarray(T, np.float64).reshape(3)
    values = np.ravel(np.asarray(distortion, np.float64))
    try:
        return Camera(size[0], size[1], K, values if values.any() else None, pose, name)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def number(text: object, where: str) -> float:
    """A finite number."""
    try:
        value = float(str(text))
    except ValueError:
        value = np.nan
    require(np.isfinite(value), where, repr(str(text).strip()), "a number")
    return value


def from_angles(first: float, second: float, third: float) -> Float:
    """Rz(third) Ry(second) Rx(first), degrees."""
    from scipy.spatial.transform import Rotation  # slow to import

    angles = [first, second, third]
    return np.asarray(Rotation.from_euler("xyz", angles, degrees=True).as_matrix())


def angles_of(R: Float) -> tuple[float, float, float]:
    """The angles (degrees) of which `from_angles` makes R."""
    from scipy.spatial.transform import Rotation

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # first and third may turn about the same axis
        a, b, c = Rotation.from_matrix(R).as_euler("xyz", degrees=True)
    return float(a), float(b), float(c)


def pose_of(camera: Camera) -> tuple[Float, Float]:
    """Rotation (3, 3) and translation (3,) of X_camera = R X + T."""
    return camera.camera_from_world[:3, :3], camera.camera_from_world[:3, 3]


def relative(camera: Camera, base: Camera) -> Float:
    """(4, 4): from the frame of camera ``base`` to that of ``camera``."""
    result: Float = camera.camera_from_world @ np.linalg.inv(base.camera_from_world)
    return result


def coefficients(camera: Camera) -> Float:
    """All 14 of OpenCV's model."""
    values = np.zeros(14)
    if camera.distortion is not None:
        values[: len(camera.distortion)] = camera.distortion
    return values
