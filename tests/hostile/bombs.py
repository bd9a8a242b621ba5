"""Small files that claim to be large, that grow when unpacked, or that name other files."""

from __future__ import annotations

import io
import pickle
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.hostile.amount import SHARE

__all__ = ["BOMBS", "SECRET", "Make"]

SECRET = 7.25
"""A number that stands in files that nobody has named; no result may hold it."""

BOMB = 1 << (30 if SHARE >= 1.0 else 28)
"""Bytes, unpacked: a gigabyte, or a quarter of it where CI takes a part of all cases."""
_POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
_FIELD = {"points": _POINTS, "cells_tet4": np.array([[0, 1, 2, 3]]), "displacement": 0 * _POINTS}


def _npy(array: np.ndarray, claimed: str = "") -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array, allow_pickle=False)
    data = stream.getvalue()
    if claimed:
        head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {claimed}, }}"
        data = data[:8] + struct.pack("<H", 118) + head.ljust(117).encode() + b"\n" + b"\0" * 96
    return data


def _npz(path: Path, **members: bytes) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in _FIELD.items():
            archive.writestr(f"{name}.npy", members.pop(name, None) or _npy(array))
        for name, data in members.items():
            archive.writestr(name, data)


def npz_claims(path: Path) -> None:
    _npz(path, points=_npy(_POINTS, "(1000000000000, 3)"))


def npz_overflows(path: Path) -> None:
    _npz(path, points=_npy(_POINTS, "(4294967296, 4294967296)"))


def npz_of_zeros(path: Path) -> None:
    """As large as `BOMB`, of one member that nothing needs."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in _FIELD.items():
            archive.writestr(f"{name}.npy", _npy(array))
        with archive.open("more.npy", "w", force_zip64=True) as member:
            for _ in range(BOMB >> 24):
                member.write(bytes(1 << 24))


class _Harm:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.write_text, (self.path, "code was executed")


def npz_with_code(path: Path) -> None:
    """A pickled object that writes a file when it is unpickled."""
    data = _npy(_POINTS).replace(b"'<f8'", b"'|O' ")
    _npz(path, displacement=data[:128] + pickle.dumps(_Harm(path.parent / "harm.txt")))


def npz_with_paths(path: Path) -> None:
    _npz(path, **{"../harm.txt": b"x", "/harm.txt": b"x"})


def npz_overlapping(path: Path) -> None:
    """Members whose data are the same bytes: a directory of a thousand entries."""
    _npz(path)
    data = path.read_bytes()
    at = data.rindex(b"PK\x05\x06")
    start = struct.unpack("<I", data[at + 16 : at + 20])[0]
    one = data[start:at]
    end = struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, 60_000, 60_000, len(one) * 20_000, start, 0)
    path.write_bytes(data[:start] + one * 20_000 + end)


def _exodus(path: Path) -> h5py.File:
    file = h5py.File(path, "w")
    file["coordx"], file["coordy"] = _POINTS[:, 0], _POINTS[:, 1]
    file["time_whole"] = np.array([1.0])
    file["connect1"] = np.array([[1, 2, 3, 4]], dtype=np.int32)
    file["connect1"].attrs["elem_type"] = "TETRA"
    return file


def _secret(path: Path) -> Path:
    secret = path.with_name("secret.h5")
    with h5py.File(secret, "w") as file:
        file["z"] = np.full(4, SECRET)
    return secret


def hdf5_external_link(path: Path) -> None:
    with _exodus(path) as file:
        file["coordz"] = h5py.ExternalLink(str(_secret(path)), "z")


def hdf5_external_storage(path: Path) -> None:
    raw = path.with_name("secret.bin")
    np.full(4, SECRET).tofile(raw)
    with _exodus(path) as file:
        file.create_dataset("coordz", (4,), "f8", external=[(str(raw), 0, h5py.h5f.UNLIMITED)])


def hdf5_virtual(path: Path) -> None:
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource(str(_secret(path)), "z", shape=(4,))
    with _exodus(path) as file:
        file.create_virtual_dataset("coordz", layout)


def hdf5_circle(path: Path) -> None:
    with _exodus(path) as file:
        file["coordz"] = h5py.SoftLink("/coordz")
        file["again"] = h5py.SoftLink("/")
        file["same"] = file["/"]


def hdf5_claims(path: Path) -> None:
    with _exodus(path) as file:
        file.create_dataset("coordz", (10**12,), "f8", chunks=(1 << 20,))


def hdf5_of_zeros(path: Path) -> None:
    with _exodus(path) as file:
        kept = file.create_dataset(
            "coordz", (BOMB // 8,), "f8", chunks=(1 << 21,), compression="gzip"
        )
        packed = zlib.compress(bytes(1 << 24))
        for start in range(0, BOMB // 8, 1 << 21):
            kept.id.write_direct_chunk((start,), packed)


def hdf5_deep(path: Path) -> None:
    with _exodus(path) as file:
        group = file
        for _ in range(3000):
            group = group.create_group("g")


def _laughs(root: str, inside: str, before: str = "") -> str:
    lines = ['<!ENTITY a0 "ha">']
    lines += [f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 12)]
    return f'<?xml version="1.0"?>{before}<!DOCTYPE {root} [{"".join(lines)}]>{inside}'


def _vtu(points: str, kind: str = 'format="ascii"', more: str = "") -> str:
    cells = "".join(
        f'<DataArray type="Int64" Name="{name}" format="ascii">{text}</DataArray>'
        for name, text in (("connectivity", "0 1 2 3"), ("offsets", "4"), ("types", "10"))
    )
    return (
        f'<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        f'header_type="UInt64"{more}><UnstructuredGrid><Piece NumberOfPoints="4" '
        f'NumberOfCells="1"><Points><DataArray type="Float64" NumberOfComponents="3" {kind}>'
        f"{points}</DataArray></Points><Cells>{cells}</Cells></Piece></UnstructuredGrid></VTKFile>"
    )


def xml_laughs(path: Path) -> None:
    path.write_text(_laughs("VTKFile", _vtu("&a11;")))


def xml_laughs_late(path: Path) -> None:
    """Behind more comments than a glance at the beginning sees."""
    path.write_text(_laughs("VTKFile", _vtu("&a11;"), "<!--" + "x" * 20_000 + "-->"))


def xml_laughs_wide(path: Path) -> None:
    path.write_bytes(_laughs("VTKFile", _vtu("&a11;")).encode("utf-16"))


def xml_secret(path: Path) -> None:
    (path.parent / "secret.txt").write_text(f"{SECRET} " * 12)
    entity = f'<!DOCTYPE VTKFile [<!ENTITY a SYSTEM "file://{path.parent}/secret.txt">]>'
    path.write_text('<?xml version="1.0"?><!--' + "x" * 5000 + "-->" + entity + _vtu("&a;"))


def xml_deep(path: Path) -> None:
    path.write_text("<VTKFile>" + "<a>" * 300_000 + "</a>" * 300_000 + "</VTKFile>")


def xml_attributes(path: Path) -> None:
    path.write_text("<VTKFile " + " ".join(f'a{n}="1"' for n in range(200_000)) + "/>")


def vtu_of_zeros(path: Path) -> None:
    """A compressed block that unpacks to a gigabyte."""
    import base64

    packed = zlib.compressobj(9)
    data = b"".join(packed.compress(bytes(1 << 24)) for _ in range(BOMB >> 24))
    data += packed.flush()
    head = np.array([1, BOMB, 0, len(data)], "<u8").tobytes()
    text = (base64.b64encode(head) + base64.b64encode(data)).decode()
    path.write_text(_vtu(text, 'format="binary"', ' compressor="vtkZLibDataCompressor"'))


def vtu_claims(path: Path) -> None:
    path.write_text(_vtu("0 " * 12).replace('NumberOfPoints="4"', 'NumberOfPoints="999999999999"'))


def pvd_of_itself(path: Path) -> None:
    path.write_text(
        '<VTKFile type="Collection"><Collection>'
        + f'<DataSet timestep="1" file="{path.name}"/>' * 1000
        + "</Collection></VTKFile>"
    )


def pvd_of_devices(path: Path) -> None:
    path.write_text(
        '<VTKFile type="Collection"><Collection><DataSet timestep="1" file="/dev/zero"/>'
        "</Collection></VTKFile>"
    )


def pvd_laughs(path: Path) -> None:
    path.write_text(_laughs("VTKFile", "<VTKFile>&a11;</VTKFile>"))


def calibration_laughs(path: Path) -> None:
    path.write_text(_laughs("opencv_storage", "<opencv_storage><a>&a11;</a></opencv_storage>"))


def calibration_aliases(path: Path) -> None:
    lines = ["%YAML:1.0", "---", 'a0: &a0 ["ha", "ha"]']
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 30)]
    path.write_text("\n".join([*lines, "camera_matrix: *a29", ""]))


def calibration_claims(path: Path) -> None:
    path.write_text(
        "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 100000\n   cols: 100000\n"
        "   dt: d\n   data: [ 1. ]\n"
    )


def calibration_packed(path: Path) -> None:
    """What OpenCV would unpack by itself."""
    packed = zlib.compressobj(9, zlib.DEFLATED, 31)
    data = packed.compress(b"%YAML:1.0\n---\n")
    data += b"".join(packed.compress(b"#" * (1 << 24)) for _ in range(BOMB >> 24))
    path.write_bytes(data + packed.flush())


def calibration_deep(path: Path) -> None:
    path.write_text("%YAML:1.0\n---\na: " + "[" * 100_000 + "]" * 100_000 + "\n")


def _png(path: Path, width: int, height: int, data: bytes, *more: tuple[bytes, bytes]) -> None:
    def chunk(kind: bytes, content: bytes) -> bytes:
        body = kind + content
        return struct.pack(">I", len(content)) + body + struct.pack(">I", zlib.crc32(body))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    middle = b"".join(chunk(*one) for one in more)
    tail = chunk(b"IDAT", data) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + head + middle + tail)


def png_claims(path: Path) -> None:
    _png(path, 100_000, 100_000, zlib.compress(bytes(100)))


def png_text(path: Path) -> None:
    """A comment that unpacks to 256 MB."""
    text = b"note\0\0" + zlib.compress(bytes(1 << 28))
    _png(path, 4, 4, zlib.compress(bytes(20)), *[(b"zTXt", text)] * 3)


def _tiff(path: Path, tags: dict[int, tuple[int, int]], next_: int = 0, data: bytes = b"") -> None:
    entries = b"".join(
        struct.pack("<HHII", tag, 4, count, value) for tag, (count, value) in sorted(tags.items())
    )
    head = struct.pack("<2sHIH", b"II", 42, 8, len(tags))
    path.write_bytes(head + entries + struct.pack("<I", next_) + data)


def tiff_claims(path: Path) -> None:
    _tiff(path, {256: (1, 100_000), 257: (1, 100_000), 258: (1, 8), 259: (1, 1), 262: (1, 1),
                 273: (1, 8), 277: (1, 1), 278: (1, 100_000), 279: (1, 100)})  # fmt: skip


def tiff_counts(path: Path) -> None:
    _tiff(path, {256: (1, 4), 257: (1, 4), 258: (1, 8), 259: (1, 1), 262: (1, 1),
                 273: (0x7FFFFFFF, 8), 277: (1, 1), 278: (1, 1), 279: (0x7FFFFFFF, 8)})  # fmt: skip


def tiff_circle(path: Path) -> None:
    _tiff(path, {256: (1, 4), 257: (1, 4), 258: (1, 8), 259: (1, 1), 262: (1, 1),
                 273: (1, 8), 277: (1, 1), 278: (1, 4), 279: (1, 16)}, next_=8)  # fmt: skip


def jpeg_claims(path: Path) -> None:
    import cv2

    cv2.imwrite(str(path.with_suffix(".jpg")), np.zeros((8, 8), np.uint8))
    data = bytearray(path.with_suffix(".jpg").read_bytes())
    at = data.index(b"\xff\xc0")
    data[at + 5 : at + 9] = struct.pack(">HH", 65_500, 65_500)
    path.write_bytes(bytes(data))


def scene_packed(path: Path) -> None:
    """Not TOML but what gzip makes of it."""
    import gzip

    path.write_bytes(gzip.compress(b'schema = 1\nname = "x"\n' * 1_000_000))


Make = Callable[[Path], None]
BOMBS: dict[str, tuple[str, tuple[Make, ...]]] = {
    "field.npz": ("field", (npz_claims, npz_overflows, npz_of_zeros, npz_with_code, npz_with_paths,
                            npz_overlapping)),
    "field.e": ("field", (hdf5_external_link, hdf5_external_storage, hdf5_virtual, hdf5_circle,
                          hdf5_claims, hdf5_of_zeros, hdf5_deep)),
    "field.vtu": ("field", (xml_laughs, xml_laughs_late, xml_laughs_wide, xml_secret, xml_deep,
                            xml_attributes, vtu_of_zeros, vtu_claims)),
    "field.pvd": ("field", (pvd_of_itself, pvd_of_devices, pvd_laughs)),
    "camera.xml": ("calibration", (calibration_laughs,)),
    "camera.yml": ("calibration", (calibration_aliases, calibration_claims, calibration_packed,
                                   calibration_deep)),
    "camera.yml.gz": ("calibration", (calibration_packed,)),
    "image.png": ("picture", (png_claims, png_text, jpeg_claims)),
    "image.tif": ("picture", (tiff_claims, tiff_counts, tiff_circle)),
    "scene.toml": ("scene", (scene_packed,)),
}  # fmt: skip
"""Name of the file -> who reads it, and what makes it."""
