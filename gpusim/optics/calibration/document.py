"""The trees of keys, lists and numbers that calibration files are: YAML, JSON and OpenCV's XML.

Of YAML what OpenCV, ROS and Kalibr write is read: maps and lists by indentation or in brackets,
plain and quoted words, tags (passed over) and comments. Anchors, aliases and texts of several lines
are refused. Numbers become floats, all else stays text.
"""

from __future__ import annotations

import json
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.validation import require

Document = dict[str, Any]

DEEPEST = 20
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_WORD = re.compile(r"""\s*("(?:[^"\\]|\\.)*"|'(?:[^']|'')*'|[\[\]{},]|:(?=[\s\[{]|$)"""
                   r"""|(?:[^\s\[\]{},:"']|:(?=\S))(?:[^\[\]{},:]|:(?=\S))*)""")  # fmt: skip
_QUOTED_KEY = re.compile(r"""("(?:[^"\\]|\\.)*"|'[^']*')\s*:(?=\s|$)""")


def read_document(text: str, where: str) -> Document:
    """The map that a file's ``text`` holds.

    Raises
    ------
    InputError
        Not well-formed (with the line), deeper than 20 levels, or no map.
    """
    begin = text.lstrip()[:1]
    if begin == "<":
        found = _from_xml(xml_root(text, where), where, 0)
    elif begin == "{":
        try:
            found = json.loads(text, parse_int=float)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{where}; got {error}; expected well-formed JSON") from None
    else:
        found = _Block(list(_lines(text, where)), where).value(-1, 0)
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
        words = [_scalar(word) for word in (element.text or "").split()]
        if len(words) != 1 and not all(isinstance(word, float) for word in words):
            return (element.text or "").strip().strip('"')
        return words[0] if len(words) == 1 else words
    if all(child.tag == "_" for child in element):
        return [_from_xml(child, where, depth + 1) for child in element]
    return {child.tag: _from_xml(child, where, depth + 1) for child in element}


@dataclass(frozen=True)
class _Line:
    number: int
    indent: int
    text: str


def _lines(text: str, where: str) -> Iterator[_Line]:
    """Lines without comments and tags; what stands in brackets is joined to one."""
    first, indent, depth = 0, 0, 0
    parts: list[str] = []
    for number, line in enumerate(text.splitlines(), start=1):
        bare = _bare(line)
        if not bare or (not depth and bare.startswith(("%", "---", "..."))):
            continue
        if not depth:
            first, indent, parts = number, len(line) - len(line.lstrip()), []
        parts.append(bare.strip())
        outside = re.sub(r""""(?:[^"\\]|\\.)*"|'[^']*'""", "", bare)
        depth += sum(outside.count(c) for c in "[{") - sum(outside.count(c) for c in "]}")
        if depth <= 0:
            depth = 0
            yield _Line(first, indent, " ".join(parts))
    require(not depth, f"{where} line {first}", "a bracket that isn't closed", "]")


def _bare(line: str) -> str:
    """Without a comment, and without tags before a value."""
    for match in re.finditer(r""""(?:[^"\\]|\\.)*"|'[^']*'|(?:^|(?<=\s))#""", line):
        if match[0] == "#":
            line = line[: match.start()]
            break
    return re.sub(r"(^|(?<=[\s\[,]))!{1,2}[\w:.-]*(?=\s|$)", "", line).rstrip()


class _Block:
    """The lines of a text, and how far they are read."""

    def __init__(self, lines: list[_Line], where: str) -> None:
        self.lines, self.where, self.at = lines, where, 0

    def value(self, outer: int, depth: int) -> Any:
        """What is further in than ``outer``: a map, a list, or one value; "" for nothing."""
        if self.at == len(self.lines) or self.lines[self.at].indent <= outer:
            return ""
        line = self.lines[self.at]
        if depth > DEEPEST:
            raise self._fault(line, f"at most {DEEPEST} levels")
        if line.text == "-" or line.text.startswith("- "):
            return self._list(line.indent, depth)
        if _key_and_rest(line.text) is not None:
            return self._map(line.indent, depth)
        self.at += 1
        return self._flow(line, line.text)

    def _list(self, indent: int, depth: int) -> list[Any]:
        found = []
        while self.at < len(self.lines) and self.lines[self.at].indent == indent:
            line = self.lines[self.at]
            if not (line.text == "-" or line.text.startswith("- ")):
                break  # the next key of the map that the list is a value of
            rest = line.text[1:].lstrip()
            if rest:  # what follows is a line of its own, further in
                inner = indent + len(line.text) - len(rest)
                self.lines[self.at] = _Line(line.number, inner, rest)
            else:
                self.at += 1
            found.append(self.value(indent, depth + 1))
        self._check_end(indent)
        return found

    def _map(self, indent: int, depth: int) -> Document:
        found: Document = {}
        while self.at < len(self.lines) and self.lines[self.at].indent == indent:
            line = self.lines[self.at]
            parts = _key_and_rest(line.text)
            if parts is None:
                raise self._fault(line, "'key: value'")
            key, rest = parts
            if key in found:
                raise self._fault(line, f"{key} once")
            self.at += 1
            if rest:
                found[key] = self._flow(line, rest)
            else:
                # a list may stand as far in as its key
                here = self.at < len(self.lines) and self.lines[self.at]
                same = here and here.indent == indent and re.match(r"-(\s|$)", here.text)
                found[key] = self.value(indent - 1 if same else indent, depth + 1)
        self._check_end(indent)
        return found

    def _check_end(self, indent: int) -> None:
        if self.at < len(self.lines) and self.lines[self.at].indent > indent:
            raise self._fault(self.lines[self.at], f"{indent} blanks before it")

    def _flow(self, line: _Line, text: str) -> Any:
        """A value in one line: a word, or lists and maps in brackets, which are nearly JSON."""
        if text[0] not in "[{\"'":
            return self._word(line, text)
        words = _WORD.findall(text)
        if "".join(words).replace(" ", "") != text.replace(" ", ""):
            raise self._fault(line, "words, numbers and brackets")
        written, depth = [""], 0
        for word, after in zip(words, [*words[1:], ""], strict=True):
            depth += (word in "[{") - (word in "]}")
            if depth > DEEPEST:
                raise self._fault(line, f"values in brackets, at most {DEEPEST} deep")
            if word == "," and after in ("]", "}") and written[-1] not in "[{,:":
                continue  # YAML's lists may end with a comma
            if word not in "[]{},:":
                value = _unquoted(word.strip()) if after == ":" else self._word(line, word.strip())
                word = json.dumps(value)
            written.append(word)
        try:
            return json.loads("".join(written))
        except ValueError:
            raise self._fault(line, "one value: [a, b, …] or {key: value, …}") from None

    def _word(self, line: _Line, text: str) -> Any:
        if text[0] in "&*|>@`":
            raise self._fault(line, "a plain value: no anchors, aliases or blocks of text")
        return _scalar(text)

    def _fault(self, line: _Line, expected: str) -> InputError:
        shown = line.text if len(line.text) <= 60 else line.text[:60] + "…"
        return InputError(f"{self.where} line {line.number}; got {shown!r}; expected {expected}")


def _key_and_rest(text: str) -> tuple[str, str] | None:
    """``key: rest`` in its two parts; None for another text."""
    quoted = _QUOTED_KEY.match(text)
    if quoted:
        return _unquoted(quoted[1]), text[quoted.end() :].strip()
    colon = re.search(r":(?=\s|$)", text)
    if colon is None or any(sign in text[: colon.start()] for sign in "\"'[{"):
        return None
    return text[: colon.start()].rstrip(), text[colon.end() :].strip()


def _unquoted(word: str) -> str:
    return word[1:-1] if len(word) > 1 and word[0] == word[-1] and word[0] in "\"'" else word


def _scalar(word: str) -> Any:
    if _NUMBER.fullmatch(word):
        return float(word)
    special = {".nan": "nan", ".inf": "inf", "+.inf": "inf", "-.inf": "-inf"}.get(word.lower())
    return float(special) if special else _unquoted(word)


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
