"""Faults of files that come up while a library, or a reader, looks at what isn't there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile


@contextmanager
def file_faults(file: InputFile, kind: str) -> Iterator[None]:
    """Whatever goes wrong meanwhile is the fault of the file, which should be of that ``kind``.

    Raises InputError that names the file.
    """
    try:
        yield
    except InputError as error:
        text = str(error)
        raise InputError(
            text if text.startswith(str(file.path)) else f"{file.path}: {text}"
        ) from None
    except (
        ArithmeticError, AssertionError, AttributeError, LookupError, MemoryError, OSError,
        RuntimeError, SyntaxError, TypeError, ValueError,
    ) as error:  # fmt: skip
        reason = " ".join(repr(str(error))[1:-1].split())[:200]
        raise InputError(
            f"{file.path}: damaged, or no {kind}; got {type(error).__name__}: {reason}"
        ) from None
