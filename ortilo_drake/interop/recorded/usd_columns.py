"""Events of a Crazyflie's log on its uSD card, field by field: versions 1 and 2, little endian.

    0xBC, version (H), number of kinds (H)
    each kind: its number (H), its name and a zero, number of fields (H), `name(T)` and a zero of each field
    each event: number of its kind (H), stamp since the start (I in ms in version 1, Q in us in version 2), the fields
    CRC-32 of all before (I)

with T a code of Python's struct. A log has no units of its own: the firmware's gyroscope is in deg/s, its accelerometer
in g, its range finder in mm.

A log that ends within an event, or behind one, lost its end with the power and never had a CRC: it is read up to there.

Source: crazyflie-firmware, tools/usdlog/cfusdlog.py.
"""

import struct
from array import array
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple
from zlib import crc32

import numpy as np

from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Column
from ortilo_drake.interop.recorded.tables import Table
from ortilo_drake.interop.recorded.topic_table import check_size, table_of, topic_of
from ortilo_drake.model.input_files import MIB, open_file
from ortilo_drake.model.typed_yaml import InputError

MAGIC: Final = 0xBC
LIMIT: Final = 1024 * MIB
CRC: Final = 4  # bytes
PADS, PADDED = (b"\0", b"\xff"), 32  # what the last block may be filled with, so many bytes at least
HEADS: Final = {1: (struct.Struct("<HI"), 1e-3), 2: (struct.Struct("<HQ"), 1e-6)}  # of an event; seconds in its stamp
CODES: Final = "?bBhHiIlLqQefd"
STANDARD: Final = {"l": "i", "L": "I"}  # of struct's codes those that NumPy makes longer


class _Kind(NamedTuple):
    """A kind of event: its name, its fields and their layout, and where in the file its events are."""

    name: str
    fields: tuple[str, ...]
    layout: np.dtype
    places: array


class _Log(NamedTuple):
    data: bytes
    head: struct.Struct
    unit: float
    kinds: dict[int, _Kind]
    unread: int  # bytes at the end that could not be read
    why: str
    cut: bool  # whether its end is missing, and with it the CRC


def is_usd(path: Path) -> bool:
    """Return whether a file begins as such a log."""
    if not path.is_file():
        return False
    with open_file(path) as file:
        return file.read(1) == bytes([MAGIC])


def _name(data: bytes, at: int, path: Path) -> tuple[str, int]:
    end = data.find(b"\0", at)
    if end < 0:
        raise InputError(f"{path}: cut short in the names of its events")
    return data[at:end].decode(errors="replace"), end + 1


def _kinds(data: bytes, count: int, path: Path) -> tuple[dict[int, _Kind], int]:
    kinds, at = {}, 5
    for _ in range(count):
        (number,) = struct.unpack_from("<H", data, at)
        name, at = _name(data, at + 2, path)
        (fields,) = struct.unpack_from("<H", data, at)
        at += 2
        names, codes = [], []
        for _ in range(fields):
            field, at = _name(data, at, path)
            if len(field) < 4 or field[-3] != "(" or field[-1] != ")" or field[-2] not in CODES:
                raise InputError(f"{path}: {name}: field '{field[:40]}' must be name(T) with T one of {CODES}")
            names.append(field[:-3])
            codes.append(np.dtype(f"<{STANDARD.get(field[-2], field[-2])}"))
        layout = np.dtype({"names": [str(i) for i in range(fields)], "formats": codes})
        kinds[number] = _Kind(name, tuple(names), layout, array("q"))
    return kinds, at


@lru_cache(maxsize=1)  # each stream of a map asks for the same file
def _index(path: Path, changed: int) -> _Log:
    with open_file(path, LIMIT) as file:
        data = file.read()
    if len(data) < 9 or data[0] != MAGIC:
        raise InputError(f"{path}: is no uSD log, or cut short: {len(data)} bytes")
    version, count = struct.unpack_from("<HH", data, 1)
    if version not in HEADS:
        raise InputError(f"{path}: uSD log of version {version}; 1 and 2 are read")
    head, unit = HEADS[version]
    try:
        kinds, at = _kinds(data, count, path)
    except struct.error:
        raise InputError(f"{path}: cut short in the names of its events") from None
    sizes = {number: head.size + kind.layout.itemsize for number, kind in kinds.items()}
    whole = crc32(data[:-CRC]) == struct.unpack("<I", data[-CRC:])[0]
    last = len(data) - CRC if whole else _written(data)
    places, end = _events(data, at, last, sizes)
    number = int.from_bytes(data[end : end + 2], "little")
    unknown = last - end >= CRC and number not in sizes
    if unknown and not whole:
        raise InputError(f"{path}: its CRC is wrong: the log is spoilt")
    for place in places:
        kinds[data[place] + 256 * data[place + 1]].places.append(place)
    why = f"bytes behind an event of unknown number {number}" if unknown else "bytes of an event that is cut short"
    return _Log(data, head, unit, kinds, last - end, why, not whole)


def _written(data: bytes) -> int:
    """Return where the last block's padding begins, a run of bytes 0 or 255; else where the file ends."""
    return min((n for pad in PADS if len(data) - (n := len(data.rstrip(pad))) >= PADDED), default=len(data))


def _events(data: bytes, at: int, end: int, sizes: dict[int, int]) -> tuple[list[int], int]:
    """Return where the events begin, and where the first one does that is unknown or not whole."""
    places = []
    while at + 2 <= end and (size := sizes.get(data[at] + 256 * data[at + 1], LIMIT)) <= end - at:
        places.append(at)
        at += size
    return places, at


def read_usd(
    path: Path, topic: str, columns: tuple[Column, ...], rejected: Rejections, names: Column | None = None
) -> Table:
    """Return the events of a kind, stamps in s since the start.

    Raises:
        InputError: if the file is no such log, has a wrong CRC, or there is no such kind, field or hardly an event.
    """
    log = _index(path, path.stat().st_mtime_ns)
    rejected.word = "event"
    if log.cut:
        rejected.notes.append("the log's end is missing, as after a loss of power: it is read as far as it goes")
    else:
        rejected.add(log.why, "", log.unread)
    kind = topic_of(path, topic, {kind.name: kind for kind in log.kinds.values()})
    places = np.array(kind.places)
    check_size(path, topic, len(places), len(columns))
    raw = np.frombuffer(log.data, np.uint8)
    bytes_of = raw[places[:, None] + np.arange(log.head.size + kind.layout.itemsize)]
    stamp = np.ascontiguousarray(bytes_of[:, 2 : log.head.size]).view("<u8" if log.head.size > 6 else "<u4")[:, 0]
    events = np.ascontiguousarray(bytes_of[:, log.head.size :]).view(kind.layout)[:, 0] if kind.fields else None
    values = [] if events is None else [events[str(i)] for i in range(len(kind.fields))]
    return table_of(path, topic, stamp * log.unit, kind.fields, values, columns, names)
