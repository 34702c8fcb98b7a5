"""Files that a user names: only regular files up to a size limit are read.

A FIFO without a writer would hang the program, and a device or a file without an end would fill the memory.
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
TEXT_LIMIT = 4 * MIB  # for scenarios, rooms, waypoints, .cfg; the largest allowed room takes a tenth of the limit
DATA_LIMIT = 4096 * MIB  # for flights, logs and weights


def open_file(path: Path, limit: int = DATA_LIMIT) -> BinaryIO:
    """Open a regular file, or a link to one, to read its bytes.

    InputError if the file does not exist, is not regular, is larger than the limit [bytes], or cannot be read.
    """
    try:
        found = os.stat(path)
        if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):  # opening a folder fails by itself
            raise OSError(None, "is no regular file")
        if found.st_size > limit:
            raise OSError(None, f"{found.st_size / MIB:.4g} MiB, at most {limit / MIB:g} MiB are read")
        return open(path, "rb")
    except (OSError, ValueError) as error:  # ValueError: NUL in the name
        raise InputError(f"{path}: cannot be read: {reason(error)}") from None


def check_file(path: Path, limit: int = DATA_LIMIT) -> None:
    """Raise the InputError of open_file for a file, before a library opens the file by its name."""
    open_file(path, limit).close()


def exists(path: Path) -> bool:
    """Return whether a file or folder of this name exists; False for a name that no file can have."""
    try:
        return path.exists()
    except (OSError, ValueError):  # too long, or NUL in it
        return False


def read_bytes(path: Path, limit: int = DATA_LIMIT) -> bytes:
    """Return the bytes of a file; InputError as in open_file."""
    with open_file(path, limit) as file:
        try:
            content = file.read(limit + 1)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {reason(error)}") from None
    if len(content) > limit:  # the file grew, or its size is not known, as in /proc
        raise InputError(f"{path}: cannot be read: at most {limit / MIB:g} MiB are read")
    return content


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file of at most TEXT_LIMIT, with Unix line ends; InputError as in open_file."""
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
    """Yield the arrays of a .npz file by name.

    ValueError if an array is compressed, which numpy.savez never does: a few kB may unpack to gigabytes. NumPy and
    zipfile raise a dozen other kinds of errors.
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
