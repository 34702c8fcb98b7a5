"""Writing files: whole or not at all, through links, with the mode they had, and directly into pipes.

All content is made in memory first, so nothing else in the package opens a file to write, and no library meets a full
disk. The bytes go to a temporary file beside the target, reach the disk, and the file is then renamed. So a reader sees
the old file or the new one, also after a loss of power. A killed process leaves its temporary file behind; the next
process that writes to the folder a day later or more removes it.
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

    A link stays a link: its target is written, whether the target exists yet or not. An existing file keeps its mode; a
    new file and missing folders get the default mode. Pipes and character devices are written to directly; a pipe
    without a reader blocks until one comes, as the shell's `> PIPE` does. With `sync` the function waits for the disk,
    so that a loss of power leaves the old file or the new one. InputError if the file cannot be written; its old
    content then stays.
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
    """Refuse a file that cannot be written, before any work is done; remove stale temporary files beside it.

    The InputError names the file and the reason.
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
    """Remove the temporary files that killed processes left in a folder more than a day ago."""
    for file in folder.glob(f"{_PREFIX}*{_SUFFIX}"):
        with contextlib.suppress(OSError):
            found = file.lstat()
            if stat.S_ISREG(found.st_mode) and found.st_mtime < time.time() - _STALE:
                file.unlink()


def _not_written(path: Path, error: OSError | ValueError) -> InputError:
    return InputError(f"{path}: cannot be written: {getattr(error, 'strerror', None) or error}")


def _status(path: Path) -> os.stat_result | None:
    """Return the status of a path's target, None if there is none; OSError if the target cannot be written."""
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
    """Return the number of the stream, 1 or 2, that writes to this very file, as with `--json /dev/stdout > FILE`."""
    for stream in (1, 2):
        with contextlib.suppress(OSError):
            if os.path.samestat(there, os.fstat(stream)):
                return stream
    return None


def _replace(target: Path, data: bytes, there: os.stat_result | None, sync: bool) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.parent / f"{_PREFIX}{secrets.token_hex(8)}{_SUFFIX}"  # a short name, however long the target's is
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
