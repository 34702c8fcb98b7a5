"""Kept files: they are read back unchanged and with values in their ranges, or else made again with a warning.

A kept file ends in a line with its origin and the SHA-256 of all bytes before the line. Libraries that read netCDF,
HDF5 and ZIP ignore the line. Parquet is read from its end, so in Parquet the line stands between data and footer, where
nothing in the file points to it, and its digest covers both. The digest detects damage, not forgery: it has no key.
"""

import hashlib
import json
import logging
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError

from ortilo_drake.flight.files import write_bytes
from ortilo_drake.model.input_files import exists, read_bytes

_LOG = logging.getLogger(__name__)
LARGEST: Final = 2**31  # largest size of a file [bytes]
_HEX = 64  # number of digits of a SHA-256
_PARQUET = b"PAR1"
T = TypeVar("T")


def _not_below_zero(value: float) -> float:
    if value < 0.0:
        raise ValueError(f"{value}: must not be negative")
    return value


Share = Annotated[float, Field(ge=0.0, le=1.0)]
Count = Annotated[int, Field(ge=0)]
Amount = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Error = Annotated[float, AfterValidator(_not_below_zero)]  # infinite or NaN for an estimate that diverged


def sealed(data: bytes, of: str) -> bytes:
    """Return the data with the line that names their origin `of` and their digest; `unsealed` is the inverse."""
    at = len(data) - _footer(data)
    return data[:at] + _mark(of) + hashlib.sha256(data).hexdigest().encode() + b"\n" + data[at:]


def unsealed(data: bytes, of: str) -> bytes:
    """Return the bytes that `sealed` was given; ValueError if `data` is not a result of `sealed` for the same `of`."""
    mark, footer = _mark(of), _footer(data)
    end = len(data) - footer
    at = max(end - len(mark) - _HEX - 1, 0)
    content, line = data[:at] + data[end:], data[at:end]
    if line[: len(mark)] != mark:
        raise ValueError("damaged, or not made by ortilo: the line with its digest is missing")
    if line[len(mark) :] != hashlib.sha256(content).hexdigest().encode() + b"\n":
        raise ValueError("damaged: its bytes are not those that were saved")
    return content


def _mark(of: str) -> bytes:
    return f"\nortilo-drake {of}, sha256 ".encode()


def _footer(data: bytes) -> int:
    """Return the length of a Parquet file's footer [bytes]; 0 for other files."""
    length = int.from_bytes(data[-8:-4], "little") + 8 if data.endswith(_PARQUET) else 0
    return length if length <= len(data) else 0


def in_folder(path: Path) -> str:
    """Return a kept file's origin: its name with its folder's name, which has the digest of a scenario."""
    return f"{path.parent.name}/{path.name}"


def keep(path: Path, data: bytes, of: str, sync: bool = True) -> None:
    """Write bytes with their digest, whole or not at all.

    `of` is the origin of the bytes, so that a file renamed to another's name is noticed. `sync` is as in write_bytes.
    InputError if the file cannot be written.
    """
    write_bytes(path, sealed(data, of), sync)


def kept(path: Path, of: str, read: Callable[[bytes], T], then: str = "flown again") -> T | None:
    """Return the content of a kept file; None if there is no file; None and a warning of one line if it is damaged.

    `of` is the origin given to keep. `read` makes the content from the bytes that keep was given; any exception that it
    raises counts as damage. `then` ends the warning and says in words what is done about damage.
    """
    if not exists(path):
        return None
    try:
        return read(unsealed(read_bytes(path, LARGEST), of))
    except Exception as error:  # pyarrow, h5py, zipfile and pydantic raise a dozen kinds of errors
        _LOG.warning("%s: %s: %s", path, reason_of(error).removeprefix(f"{path}: "), then)
        return None


def keep_json(path: Path, value: Any, of: str) -> None:
    """Keep a dataclass, a number or a list of them as JSON; see keep."""
    keep(path, json.dumps(value, default=asdict).encode(), of)


def kept_json(path: Path, kind: Any, of: str) -> Any:
    """Return a value of type `kind` from a kept file, checked against the type's annotated ranges; None as in kept."""
    return kept(path, of, partial(TypeAdapter(kind).validate_json, strict=True))


def reason_of(error: Exception) -> str:
    """Return the text of an error in one line of at most 200 characters."""
    text = str(error)
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        text = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return " ".join(text.split())[:200]
