"""Files that a user names: regular ones only, and no more of them than a limit.

A FIFO that nobody writes to would hang the program, and a device or a file without an end would fill the memory.
"""

import os
import stat
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ortilo_drake.model.input_error import InputError

MIB = 2**20
TEXT_LIMIT = 4 * MIB  # scenarios, rooms, waypoints, .cfg: the largest room allowed takes a tenth of it
DATA_LIMIT = 4096 * MIB  # flights, logs and weights


def open_file(path: Path, limit: int = DATA_LIMIT) -> BinaryIO:
    """Open a regular file, or one that a link leads to, to read its bytes.

    InputError if there is no such file, it is no regular one or larger than the limit [bytes], or it cannot be read.
    """
    try:
        found = os.stat(path)
        if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):  # to open a folder fails by itself
            raise OSError(None, "is no regular file")
        if found.st_size > limit:
            raise OSError(None, f"{found.st_size / MIB:.4g} MiB, at most {limit / MIB:g} MiB are read")
        return open(path, "rb")
    except (OSError, ValueError) as error:  # ValueError: NUL in the name
        raise InputError(f"{path}: cannot be read: {reason(error)}") from None


def check_file(path: Path, limit: int = DATA_LIMIT) -> None:
    """Refuse the files that open_file refuses, before a library opens the file by its name."""
    open_file(path, limit).close()


def exists(path: Path) -> bool:
    """Return whether a file or folder of that name exists; no error for a name that no file can have."""
    try:
        return path.exists()
    except (OSError, ValueError):  # too long, or NUL in it
        return False


def read_bytes(path: Path, limit: int = DATA_LIMIT) -> bytes:
    """Return the bytes of a file; InputError as open_file."""
    with open_file(path, limit) as file:
        try:
            content = file.read(limit + 1)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {reason(error)}") from None
    if len(content) > limit:  # it grew, or is of a kind whose size is not told, as in /proc
        raise InputError(f"{path}: cannot be read: at most {limit / MIB:g} MiB are read")
    return content


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file of at most TEXT_LIMIT, with plain line ends; InputError as open_file."""
    try:
        text = read_bytes(path, TEXT_LIMIT).decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{path}: cannot be read: not UTF-8 text") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def reason(error: Exception) -> str:
    """Return the text of an operating system's error without the file's name."""
    return getattr(error, "strerror", None) or str(error)


@contextmanager
def arrays_of(file: BinaryIO) -> Iterator[Mapping[str, np.ndarray]]:
    """Give the arrays of a .npz file.

    ValueError if one is packed, as numpy.savez does not: a few kB may unpack to gigabytes. NumPy and zipfile raise
    errors of a dozen kinds besides.
    """
    loaded = np.load(file, allow_pickle=False)
    if not isinstance(loaded, np.lib.npyio.NpzFile):
        raise ValueError("holds one array, not several by name")
    with loaded as found:
        assert found.zip  # until it is closed
        for part in found.zip.infolist():
            if part.compress_type != zipfile.ZIP_STORED:
                raise ValueError(f"{part.filename} is packed; arrays are read that are not")
        yield found
