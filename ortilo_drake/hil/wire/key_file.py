"""The secret that both halves share: a file of 64 hexadecimal digits that only its owner can read.

The halves of one user on one machine share one file, which is made when first needed. Two machines need copies of it.
"""

import hashlib
import os
import re
import secrets
import stat
import sys
from pathlib import Path
from typing import Final

from ortilo_drake.hil.wire.address import leaves_machine
from ortilo_drake.model.typed_yaml import InputError

KEY_SIZE: Final = 32
STDIN: Final = "-"
NO_SECRET: Final = hashlib.sha256(b"ortilo: no secret").digest()  # a key that everybody with the program knows
_TEXT: Final = 2 * KEY_SIZE


def new_key() -> bytes:
    """Return a new random key (KEY_SIZE)."""
    return secrets.token_bytes(KEY_SIZE)


def default_file() -> Path:
    """Return the path of the key file that the halves of one user share."""
    base = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(base) / "ortilo" / "key"


def write_key(path: Path) -> None:
    """Write a new key to a new file of mode 600; InputError if the file already exists or cannot be written."""
    partial = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with open(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
            file.write(f"{new_key().hex()}\n")
        try:
            os.link(partial, path)  # unlike a renaming, a link replaces no file; and no reader sees half a file
        finally:
            partial.unlink()
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {(error.strerror or str(error)).lower()}") from None


def read_key(path: Path) -> bytes:
    """Return the key in a file; InputError if there is no key, or if other users own the file or may access it."""
    try:
        opened = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError as error:
        raise InputError(f"{path}: no key file: {(error.strerror or str(error)).lower()}") from None
    try:
        status = os.fstat(opened)
        if not stat.S_ISREG(status.st_mode):
            raise InputError(f"{path}: no key file: must be a regular file")
        if status.st_uid != os.geteuid():
            raise InputError(f"{path}: belongs to user {status.st_uid}: a key must be your own")
        if status.st_mode & 0o077:
            raise InputError(f"{path}: others may read or write it: chmod 600 {path}, or make a new one")
        text = os.read(opened, _TEXT + 2)
    finally:
        os.close(opened)
    return _key(text.decode("ascii", "replace"), str(path))


def _key(text: str, source: str) -> bytes:
    if re.fullmatch(r"[0-9a-f]{64}\n?", text):
        return bytes.fromhex(text)
    raise InputError(f"{source}: no key: must be {_TEXT} hexadecimal digits, as `ortilo hil key FILE` makes them")


def own_key() -> bytes:
    """Return the key that the halves of this user on this machine share; make it if there is none."""
    path = default_file()
    if not os.path.lexists(path):
        try:
            write_key(path)
        except InputError:
            if not os.path.lexists(path):  # otherwise another process has made the file first
                raise
    return read_key(path)


def choose_key(url: str, file: str | None = None, insecure: bool = False) -> bytes:
    """Return the key for a bus: from a file, from stdin (STDIN), this user's own (None), or NO_SECRET if insecure.

    NO_SECRET keeps nobody out. InputError if the key cannot be read, or if no key is given although other machines can
    take part.
    """
    if insecure:
        if file is not None:
            raise InputError("--insecure: cannot be combined with --key")
        return NO_SECRET
    if file == STDIN:
        return _key(sys.stdin.readline(_TEXT + 2), "stdin")
    if file is not None:
        return read_key(Path(file))
    if leaves_machine(url):
        raise InputError(
            f"url: {url!r}: is open to other machines: give both halves the same --key FILE, which "
            "`ortilo hil key FILE` makes, or --insecure"
        )
    return own_key()
