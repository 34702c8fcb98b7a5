"""Logs of flight controllers, topic by topic: PX4's ULog (`.ulg`), read by pyulog, and the Crazyflie's uSD card log.

A topic of a ULog is the name of a message, with a number for further instances: `sensor_accel[1]`. A column is the name
of a field, with an index for an array: `gyro_rad[0]`. Stamps are the field `timestamp` of the messages [us].

A log of a uSD card, version 1 or 2, little endian, is

    0xBC, version (H), number of kinds (H)
    each kind: its number (H), its name and a zero, number of fields (H), `name(T)` and a zero for each field
    each event: number of its kind (H), stamp since the start (I in ms in version 1, Q in us in version 2), the fields
    CRC-32 of all bytes before (I)

with T a code of Python's struct. The log names no units: the firmware's gyroscope is in deg/s, its accelerometer in g,
its range finder in mm. A log without CRC lost its end in a loss of power: it is read up to its last whole event.

Source: crazyflie-firmware, tools/usdlog/cfusdlog.py.
"""

import io
import struct
from array import array
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple
from zlib import crc32

import numpy as np

from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Column
from ortilo_drake.interop.recorded.tables import NUMBERS, Table
from ortilo_drake.model.input_files import MIB, open_file
from ortilo_drake.model.optional import check_installed
from ortilo_drake.model.typed_yaml import InputError, nearest

LIMIT: Final = 1024 * MIB
FEWEST: Final = 2  # smallest number of rows of a topic
ULOG, USD = b"ULog\x01\x12\x35", b"\xbc"  # first bytes of both kinds of logs
ULOG_HEAD: Final = 16  # bytes before the first message
CRC: Final = 4  # length of the CRC [bytes]
PADS, PADDED = (b"\0", b"\xff"), 32  # padding of the last block: its byte, and its least length [bytes]
HEADS: Final = {1: (struct.Struct("<HI"), 1e-3), 2: (struct.Struct("<HQ"), 1e-6)}  # head of an event, unit of stamp [s]
CODES: Final = "?bBhHiIlLqQefd"
STANDARD: Final = {"l": "i", "L": "I"}  # codes of struct that are longer in NumPy, and NumPy's codes of the same length


class Topic(NamedTuple):
    """A topic: number of rows n, names of fields, and a function that returns stamps (n) [s] and values (n each)."""

    rows: int
    fields: tuple[str, ...]
    read: Callable[[], tuple[np.ndarray, list[np.ndarray]]]


class Log(NamedTuple):
    """A log: the word for its rows, its topics, the amount that could not be read, the reason, and a note."""

    word: str
    topics: dict[str, Topic]
    unread: int = 0
    why: str = ""
    note: str = ""


def is_flight_log(path: Path) -> bool:
    """Return whether a file has the first bytes of a flight log, or the suffix .ulg."""
    if not path.is_file():
        return False
    with open_file(path) as file:
        begin = file.read(len(ULOG))
    return begin == ULOG or begin[:1] == USD or path.suffix == ".ulg"


@lru_cache(maxsize=1)  # all streams of a map read the same file
def _log(path: Path, changed: int) -> Log:
    with open_file(path, LIMIT) as file:
        data = file.read()
    return _usd(path, data) if data[:1] == USD else _ulog(path, data)


def _ulog(path: Path, data: bytes) -> Log:
    check_installed("pyulog", "recorded")
    from pyulog import ULog

    try:
        with redirect_stdout(io.StringIO()):
            log = ULog(io.BytesIO(data))
    except Exception as error:  # errors of many kinds, where the definitions are damaged
        raise InputError(f"{path}: no ULog that can be read: {type(error).__name__}: {error}") from None
    at = ULOG_HEAD
    while at + 3 <= len(data):  # each message begins with its size (H) and its kind (B)
        at += 3 + data[at] + 256 * data[at + 1]

    def topic_from(of: dict[str, np.ndarray]) -> Topic:
        return Topic(len(of["timestamp"]), tuple(of), lambda: (of["timestamp"] * 1e-6, list(of.values())))

    topics = {f"{one.name}[{one.multi_id}]" if one.multi_id else one.name: one.data for one in log.data_list}
    cut = at != len(data) or log.file_corruption
    why = "log that is cut short or spoilt: what could be read of it is used"
    return Log("message", {name: topic_from(of) for name, of in topics.items()}, int(cut), why)


class _Kind(NamedTuple):
    """A kind of event: its name, its fields and their layout, and the places of its events in the file."""

    name: str
    fields: tuple[str, ...]
    layout: np.dtype
    places: array


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


def _usd(path: Path, data: bytes) -> Log:
    if len(data) < 9:
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
    raw = np.frombuffer(data, np.uint8)

    def topic_from(kind: _Kind) -> Topic:
        def read() -> tuple[np.ndarray, list[np.ndarray]]:
            bytes_of = raw[np.array(kind.places)[:, None] + np.arange(head.size + kind.layout.itemsize)]
            stamps = np.ascontiguousarray(bytes_of[:, 2 : head.size]).view("<u8" if version == 2 else "<u4")[:, 0]
            if not kind.fields:
                return stamps * unit, []
            events = np.ascontiguousarray(bytes_of[:, head.size :]).view(kind.layout)[:, 0]
            return stamps * unit, [events[str(i)] for i in range(len(kind.fields))]

        return Topic(len(kind.places), kind.fields, read)

    topics = {kind.name: topic_from(kind) for kind in kinds.values()}
    if not whole:
        note = "the log's end is missing, as after a loss of power: it is read as far as it goes"
        return Log("event", topics, note=note)
    why = f"bytes behind an event of unknown number {number}" if unknown else "bytes of an event that is cut short"
    return Log("event", topics, last - end, why)


def _written(data: bytes) -> int:
    """Return where the padding of the last block begins, a run of bytes 0 or 255; without padding, the file's end."""
    return min((n for pad in PADS if len(data) - (n := len(data.rstrip(pad))) >= PADDED), default=len(data))


def _events(data: bytes, at: int, end: int, sizes: dict[int, int]) -> tuple[list[int], int]:
    """Return the places of the events, and the place of the first event that is unknown or not whole."""
    places = []
    while at + 2 <= end and (size := sizes.get(data[at] + 256 * data[at + 1], LIMIT)) <= end - at:
        places.append(at)
        at += size
    return places, at


def read_flight_log(
    path: Path,
    topic: str,
    time: Column | tuple[Column, Column] | None,
    columns: tuple[Column, ...],
    rejected: Rejections,
    names: tuple[Column, ...] = (),
) -> Table:
    """Return the rows of a topic, with stamps in s; for a ULog with `time`, the stamps are that field as it is.

    InputError if the file is no flight log or is damaged, or if it lacks the topic or a field, or has too few rows.
    """
    log = _log(path, path.stat().st_mtime_ns)
    time = None if log.word == "event" else time  # an event has no second stamp
    if isinstance(time, tuple):
        raise InputError(f"{path}: {topic}: time: {list(time)}: a log's stamp is one field")
    rejected.word = log.word
    rejected.add(log.why, "", log.unread)
    rejected.notes += [log.note] * bool(log.note)
    its = log.topics.get(topic, log.topics.get(topic.removesuffix("[0]")))
    if its is None:
        has = ", ".join(log.topics) or "none"
        raise InputError(f"{path}: no topic '{topic}'{nearest(topic, log.topics)}; has {has}")
    if its.rows < FEWEST:
        raise InputError(f"{path}: {topic}: {its.rows} rows")
    if its.rows * (len(columns) + 2) > NUMBERS:
        raise InputError(f"{path}: {topic}: more than {NUMBERS:,} numbers; cut the log into several recordings")
    stamps, values = its.read()

    def field(wanted: Column) -> np.ndarray:
        """Return the values of a field, given by its name or its number from 1."""
        at = wanted - 1 if isinstance(wanted, int) else its.fields.index(wanted) if wanted in its.fields else -1
        if not 0 <= at < len(its.fields):
            raise InputError(f"{path}: {topic} has no field '{wanted}'; has {', '.join(its.fields)}")
        return values[at]

    t = stamps if time is None else field(time).astype(float)
    found = np.column_stack([field(one).astype(float) for one in columns])
    called = np.array([[str(name) for name in field(one).tolist()] for one in names], dtype=object).T if names else None
    return Table(t, found, called, np.arange(1, len(t) + 1))
