"""Writing files: whole or not at all, through links, with the mode they had, and straight into pipes.

Whatever is written is made in memory first, so nothing else in the package opens a file to write, and no library sees a
full disk. The bytes go to a temporary file beside the target, reach the disk and are then renamed: a reader, also one
after a loss of power, sees the old file or the new one. A killed process leaves its temporary file behind; its lock is
gone with the process, so the next one that writes to the folder removes it.
"""

import contextlib
import fcntl
import os
import secrets
import stat
import sys
from pathlib import Path

from ortilo_drake.model.typed_yaml import InputError

_PREFIX, _SUFFIX = ".ortilo-", ".partial"
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

    A link stays one: what it points to is written, whether it is there yet or not. A file that is there keeps its mode
    and, where the system allows it, its owner; a new one gets the usual ones, as do folders that are missing.
    Other names of the same file (hard links) keep the old content. Pipes and character devices are written to.

    Args:
        path: the file.
        data: all of it.
        sync: whether to wait for the disk, so that a loss of power leaves the old file or the new one.

    Raises:
        InputError: if it cannot be written; what was there before stays.
    """
    try:
        there = _status(path)
        if there is None or (stat.S_ISREG(there.st_mode) and _stream_of(there) is None):
            _replace(Path(os.path.realpath(path)), data, there, sync)
        else:
            _write_straight(path, data, there)
    except (OSError, ValueError) as error:
        raise _not_written(path, error) from None


def check_output(path: Path) -> None:
    """Refuse a file that cannot be written, before any work is done; remove what killed processes left beside it.

    Raises:
        InputError: naming the file and why.
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
    """Remove the temporary files of killed processes from a folder; those of living ones stay."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith(_PREFIX) and entry.name.endswith(_SUFFIX) and entry.is_file(follow_symlinks=False):
                with contextlib.suppress(OSError):
                    _remove_unlocked(entry.path)


def _remove_unlocked(path: str) -> None:
    """Remove a file that no process has locked; OSError if one has."""
    descriptor = os.open(path, os.O_WRONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.unlink(path)
    finally:
        os.close(descriptor)


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


def _write_all(descriptor: int, data: bytes) -> None:
    left = memoryview(data)
    while left:
        left = left[os.write(descriptor, left) :]


def _write_straight(path: Path, data: bytes, there: os.stat_result) -> None:
    """Write to a pipe or a character device, or to where stdout or stderr goes."""
    stream = _stream_of(there)
    if stream is not None:
        (sys.stdout if stream == 1 else sys.stderr).flush()
        _write_all(stream, data)
        return
    try:  # without O_NONBLOCK it would wait until somebody reads the pipe
        descriptor = os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    except OSError as error:
        if stat.S_ISFIFO(there.st_mode) and not isinstance(error, PermissionError):
            raise OSError(None, "is a pipe that nobody reads") from None
        raise
    try:
        os.set_blocking(descriptor, True)
        _write_all(descriptor, data)
    finally:
        os.close(descriptor)


def _replace(target: Path, data: bytes, there: os.stat_result | None, sync: bool) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    descriptor, partial = _open_partial(target.parent, 0o666 if there is None else 0o600)
    try:
        if there is not None:
            _keep_mode(descriptor, there)
        _write_all(descriptor, data)
        if sync:
            os.fsync(descriptor)
        os.replace(partial, target)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(partial)
        raise
    finally:
        os.close(descriptor)


def _open_partial(folder: Path, mode: int) -> tuple[int, str]:
    """Return a new temporary file in a folder, locked, and its name, which is short whatever the target's is."""
    while True:
        partial = os.path.join(folder, f"{_PREFIX}{secrets.token_hex(8)}{_SUFFIX}")
        descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, mode)
        with contextlib.suppress(OSError):  # some network folders have no locks; nothing in them is removed as stale
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        if os.fstat(descriptor).st_nlink:
            return descriptor, partial
        os.close(descriptor)  # another process removed it as stale before it was locked


def _keep_mode(descriptor: int, there: os.stat_result) -> None:
    made = os.fstat(descriptor)
    if made.st_gid != there.st_gid:
        with contextlib.suppress(PermissionError):
            os.fchown(descriptor, -1, there.st_gid)
    if made.st_uid != there.st_uid:
        with contextlib.suppress(PermissionError):
            os.fchown(descriptor, there.st_uid, -1)
    if stat.S_IMODE(made.st_mode) != stat.S_IMODE(there.st_mode):
        os.fchmod(descriptor, stat.S_IMODE(there.st_mode))
