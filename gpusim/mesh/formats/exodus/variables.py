"""The variables of Exodus files, out of netCDF classic or netCDF-4 (HDF5)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.io import netcdf_file

from gpusim.errors import InputError
from gpusim.files.hdf5_file import read_hdf5
from gpusim.files.input_file import InputFile

__all__ = ["ExodusContent", "exodus_content", "guarded", "native", "strings"]

T = TypeVar("T")

# What the readers of the containers raise on damaged files, whatever place the damage is in.
_DAMAGE = (
    ArithmeticError, AssertionError, AttributeError, LookupError, MemoryError, RuntimeError,
    SyntaxError, TypeError, ValueError,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class ExodusContent:
    """Variables of the file as plain arrays, and the element type of each block's connectivity."""

    file: InputFile
    arrays: Mapping[str, npt.NDArray[Any]]
    element_types: Mapping[str, str]

    @property
    def path(self) -> str:
        return str(self.file.path)

    def nodal(self, numbers: Sequence[int]) -> list[npt.NDArray[Any]]:
        """(T,N) values of each of these nodal variables, as they are stored."""
        arrays = self.arrays
        if _is_hdf5(self.file):  # where they were left until now
            each = "|".join(str(number + 1) for number in numbers)
            found = read_hdf5(self.file, f"vals_nod_var({each})?")
            arrays = {name: one.data for name, one in found.items() if one.data is not None}
        if "vals_nod_var" in arrays:
            return [arrays["vals_nod_var"][:, number] for number in numbers]
        names = [f"vals_nod_var{number + 1}" for number in numbers]
        return [ExodusContent(self.file, arrays, {}).array(name) for name in names]

    def array(self, name: str) -> npt.NDArray[Any]:
        if name not in self.arrays:
            raise InputError(f"{self.path}: not a complete Exodus file; got no variable {name!r}")
        return self.arrays[name]

    def names(self, name: str, ids: str, default: str, count: int) -> list[str]:
        given = strings(self.arrays[name]) if name in self.arrays else []
        given += [""] * (count - len(given))
        numbers = self.arrays.get(ids, np.arange(1, count + 1))
        return [
            text or f"{default}_{int(number)}"
            for text, number in zip(given[:count], numbers[:count], strict=True)
        ]

    def numbered(self, prefix: str) -> list[str]:
        """Names of the variables ``prefix1``, ``prefix2``, … as far as they go."""
        found = [name for name in self.arrays if name[len(prefix) :].isdigit()]
        found = [name for name in found if name.startswith(prefix)]
        return sorted(found, key=lambda name: int(name[len(prefix) :]))


def guarded(file: InputFile, read: Callable[[], T]) -> T:
    try:
        return read()
    except InputError as error:
        text = str(error)
        raise InputError(
            text if text.startswith(str(file.path)) else f"{file.path}: {text}"
        ) from None
    except (OSError, *_DAMAGE) as error:
        # SciPy meets damage in many ways
        raise InputError(
            f"{file.path}: damaged or cut off ({type(error).__name__}: {str(error)[:200]}); "
            "expected a complete Exodus file"
        ) from None


def _is_hdf5(file: InputFile) -> bool:
    return file.data[:8] == b"\x89HDF\r\n\x1a\n"


def exodus_content(file: InputFile) -> ExodusContent:
    """The variables; of HDF5 files without the values over time."""
    if file.data[:4] in (b"CDF\x01", b"CDF\x02"):
        with netcdf_file(file.stream(), "r", mmap=False) as classic:
            kinds = {
                name: _text(one.elem_type)
                for name, one in classic.variables.items()
                if name.startswith("connect") and hasattr(one, "elem_type")
            }
            arrays = {name: np.asarray(one.data) for name, one in classic.variables.items()}
    elif _is_hdf5(file):
        found = read_hdf5(file, "(?!vals_)[^/]*")
        kinds = {
            name: _text(one.attributes["elem_type"])
            for name, one in found.items()
            if name.startswith("connect") and "elem_type" in one.attributes
        }
        arrays = {name: one.data for name, one in found.items() if one.data is not None}
    else:
        raise InputError(
            f"{file.path}: not an Exodus file; got first bytes {file.data[:8]!r}; expected netCDF "
            "(classic, 64-bit offset, or netCDF-4)"
        )
    light = {
        name: array if name.startswith("vals_") else native(array) for name, array in arrays.items()
    }
    return ExodusContent(file, light, kinds)


def native(data: Any) -> npt.NDArray[Any]:
    array = np.asarray(data)
    return array.astype(array.dtype.newbyteorder("="))


def _text(value: Any) -> str:
    return value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)


def strings(letters: npt.NDArray[Any]) -> list[str]:
    # as bytes, for NumPy's strings hide the zero that ends a text (rubbish may follow it)
    rows = np.ascontiguousarray(letters).reshape(-1, letters.shape[-1])
    texts = [row.tobytes().split(b"\0")[0].decode("utf-8", "replace").strip() for row in rows]
    return ["".join(c if c.isprintable() else "?" for c in text) for text in texts]
