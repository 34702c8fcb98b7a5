"""Writing files: whole or not at all, through links, with the mode they had, and straight into pipes.

Whatever is written is made in memory first, so nothing else in the package opens a file to write, and no library sees a
full disk. The bytes go to a temporary file beside the target, reach the disk and are then renamed: a reader, also one
after a loss of power, sees the old file or the new one. A killed process leaves its temporary file behind; whoever
writes to the folder a day later removes it.
"""

import contextlib
import os
import secrets
import stat
import sys
import time
from pathlib import Path

from ortilo_drake.model.typed_yaml import InputError

_PREFIX, _SUFFIX = ".ortilo-", ".partial"
_STALE = 86400.0  # age of a temporary file that no living process writes any more [s]
_REFUSED = {stat.S_IFDIR: "is a folder", stat.S_IFSOCK: "is a socket", stat.S_IFBLK: "is a block device"}


def write_text(path: Path, text: str) -> None:
    """Write a text file as UTF-8; see write_bytes."""
    try:
        data = text.encode()
    except UnicodeEncodeError:
        raise InputError(f"{path}: cannot be written: holds text that is no Unicode (half a surrogate pair)") from None
    write_bytes(path, data)


def write_bytes(path: Path, data: bytes, sync: bool = True) -> None:
    """Write a file.

    A link stays one: what it points to is written, whether it is there yet or not. A file that is there keeps its mode;
    a new one gets the usual one, as do folders that are missing. Pipes and character devices are written to; a pipe
    that nobody reads is waited for until somebody does, as by the shell's `> PIPE`. With `sync` the disk is waited for,
    so that a loss of power leaves the old file or the new one. InputError if it cannot be written; what was there
    before stays.
    """
    try:
        there = _status(path)
        stream = None if there is None else _stream_of(there)
        if there is None or (stat.S_ISREG(there.st_mode) and stream is None):
            _replace(Path(os.path.realpath(path)), data, there, sync)
            return
        if stream is not None:
            (sys.stdout if stream == 1 else sys.stderr).flush()
        with open(path if stream is None else stream, "wb", closefd=stream is None) as file:
            file.write(data)
    except (OSError, ValueError) as error:
        raise _not_written(path, error) from None


def check_output(path: Path) -> None:
    """Refuse a file that cannot be written, before any work is done; remove what killed processes left beside it.

    InputError naming the file and why.
    """
    try:
        there = _status(path)
        target = Path(os.path.realpath(path))
        if there is None or stat.S_ISREG(there.st_mode):
            folder = next(parent for parent in target.parents if parent.exists())
            if not folder.is_dir():
                raise NotADirectoryError(None, f"{folder} is no folder")
            if not os.access(folder, os.W_OK | os.X_OK):
                raise PermissionError(None, f"no permission in {folder}")
        remove_stale(target.parent)
    except (OSError, ValueError) as error:
        raise _not_written(path, error) from None


def remove_stale(folder: Path) -> None:
    """Remove the temporary files of killed processes from a folder."""
    for file in folder.glob(f"{_PREFIX}*{_SUFFIX}"):
        with contextlib.suppress(OSError):
            found = file.lstat()
            if stat.S_ISREG(found.st_mode) and found.st_mtime < time.time() - _STALE:
                file.unlink()


def _not_written(path: Path, error: OSError | ValueError) -> InputError:
    return InputError(f"{path}: cannot be written: {getattr(error, 'strerror', None) or error}")


def _status(path: Path) -> os.stat_result | None:
    """Return the status of what a path leads to, None if nothing is there; OSError if that cannot be written."""
    try:
        there = os.stat(path)
    except FileNotFoundError:
        return None
    reason = _REFUSED.get(stat.S_IFMT(there.st_mode))
    if reason:
        raise OSError(None, reason)
    if stat.S_ISREG(there.st_mode) and not os.access(path, os.W_OK):
        raise PermissionError(None, "no permission to write this file")
    return there


def _stream_of(there: os.stat_result) -> int | None:
    """Return stdout or stderr if that goes to this very file, as with `--json /dev/stdout > FILE`."""
    for stream in (1, 2):
        with contextlib.suppress(OSError):
            if os.path.samestat(there, os.fstat(stream)):
                return stream
    return None


def _replace(target: Path, data: bytes, there: os.stat_result | None, sync: bool) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.parent / f"{_PREFIX}{secrets.token_hex(8)}{_SUFFIX}"  # short, whatever the target's name is
    try:
        with open(partial, "xb") as file:
            if there is not None:
                os.fchmod(file.fileno(), stat.S_IMODE(there.st_mode))
            file.write(data)
            file.flush()
            if sync:
                os.fsync(file.fileno())
        os.replace(partial, target)
    except BaseException:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise
