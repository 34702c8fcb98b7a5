"""Reading a log back, complete or cut short: as the Dataset of the flight, and tick by tick for a replay."""

import json
import os
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import numpy as np
import xarray as xr
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema

from ortilo_drake.flight.flight import flight_dataset
from ortilo_drake.flight.lost import find_loss
from ortilo_drake.flight.saved_flight import LARGEST
from ortilo_drake.flight.signals import Signals, output_sizes
from ortilo_drake.interop.ros.ros_messages import ARRAY_TYPE, FORMAT, SCENARIO_TOPIC, SENT, SIGNAL_PREFIX, STRING_TYPE
from ortilo_drake.interop.ros.ros_sensors import IMAGE_TOPIC, IMAGE_TYPE, image_of
from ortilo_drake.interop.ros.ros_types import GOAL_TOPIC, GOAL_TYPE, from_cdr
from ortilo_drake.interop.unpack import CHUNK_LIMIT, Unpacker
from ortilo_drake.model.input_files import MIB, exists, open_file
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.scenario import scenario_from_json

MAGIC = b"\x89MCAP0\r\n"
HEAD: Final = struct.Struct("<BQ")  # opcode and length of a record
DEFINITIONS: Final = 64 * MIB  # of all schemas and channels, which are kept; a hundred types take 1 MiB
_READ: Final = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.DATA_END)


class LoggedMessage(NamedTuple):
    """One message as it stands in the file."""

    topic: str
    type_name: str
    log_time: int
    data: bytes


def _unpacked(content: bytes, unpacker: Unpacker) -> bytes:
    """Return the records of a chunk."""
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    packed = chunk.compression != ""
    raw = unpacker.unpack(chunk.compression, chunk.data, "a chunk") if packed else chunk.data
    if len(raw) != chunk.uncompressed_size:
        raise ValueError(f"a chunk holds {len(raw)} bytes, and states {chunk.uncompressed_size}")
    if chunk.uncompressed_crc and zlib.crc32(raw) != chunk.uncompressed_crc:
        raise ValueError("a chunk's checksum is wrong")
    return raw


def _records(path: Path, file: IO[bytes], left: int, in_chunk: bool) -> Iterator[tuple[int, bytes]]:
    """Yield (opcode, content) of the records in so many bytes, up to DataEnd or to where a file was cut short."""
    while left > 0:
        head = file.read(HEAD.size)
        opcode, length = HEAD.unpack(head) if len(head) == HEAD.size else (-1, left)
        left -= HEAD.size + length
        if left < 0:
            if in_chunk:
                raise ValueError("a record goes beyond its chunk")
            return
        if opcode == 0:
            raise ValueError("a record of no kind")
        if opcode not in _READ or (in_chunk and opcode in (Opcode.CHUNK, Opcode.DATA_END)):
            file.seek(length, os.SEEK_CUR)
        elif length > CHUNK_LIMIT:
            raise InputError(f"{path}: a record of {length / MIB:.4g} MiB; at most {CHUNK_LIMIT / MIB:g} MiB are read")
        else:
            yield opcode, file.read(length)


def _all_records(path: Path, cut: Callable[[], None]) -> Iterator[tuple[int, bytes]]:
    """Yield (opcode, content) of schemas, channels and messages, those in chunks included."""
    unpacker = Unpacker(path)
    with open_file(path) as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise InputError(f"{path}: not an MCAP file")
        for opcode, content in _records(path, file, os.fstat(file.fileno()).st_size - len(MAGIC), False):
            if opcode == Opcode.DATA_END:
                return
            if opcode == Opcode.CHUNK:
                raw = _unpacked(content, unpacker)
                yield from _records(path, BytesIO(raw), len(raw), True)
            else:
                yield opcode, content
        cut()


def read_records(path: Path, cut: Callable[[], None] = lambda: None) -> Iterator[Schema | Channel | Message]:
    """Yield schemas, channels and messages of an MCAP file in the order they were written.

    It may end anywhere; `cut` is called behind the last record of one that was cut short. InputError if the file cannot
    be read, is no MCAP, is damaged before its end, or holds or unpacks to more than the limits of interop/unpack.py.
    """
    definitions = 0
    try:
        for opcode, content in _all_records(path, cut):
            stream = ReadDataStream(BytesIO(content))
            if opcode == Opcode.MESSAGE:
                yield Message.read(stream, len(content))
                continue
            definitions += len(content)
            if definitions > DEFINITIONS:
                raise InputError(f"{path}: more than {DEFINITIONS / MIB:g} MiB of schemas and channels")
            yield Schema.read(stream) if opcode == Opcode.SCHEMA else Channel.read(stream)
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (McapError, struct.error, ValueError, MemoryError, OverflowError) as error:
        raise InputError(f"{path}: damaged: {' '.join(str(error).split()) or type(error).__name__}") from None


def read_logged(path: Path, wanted: Callable[[str], bool]) -> Iterator[LoggedMessage]:
    """Yield the messages of wanted topics of an MCAP file, in the order they were written; errors as read_records."""
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    for record in read_records(path):
        if isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            if wanted(record.topic):
                channels[record.id] = (record.topic, schemas.get(record.schema_id, ""))
        elif record.channel_id in channels:
            yield LoggedMessage(*channels[record.channel_id], record.log_time, record.data)


TICK_LIMIT: Final = 64 * MIB  # of the messages of a tick: a picture of 4K takes 33
MISSING_LIMIT: Final = 256 * MIB  # of ticks that a log leaves out: 50 minutes at 30 Hz


class LoggedTick(NamedTuple):
    """One tick of a log: k, the true state (12) if it was known, the messages, and the outputs that were recorded."""

    k: int
    state: np.ndarray | None
    messages: Signals
    outputs: Signals


def log_file(path: Path) -> Path:
    """Return the MCAP file of a log's folder, or the path itself if it is a file; InputError if there is none."""
    if not exists(path):
        raise InputError(f"{path}: no such log")
    if not path.is_dir():
        return path
    files = sorted(path.glob("*.mcap"))
    if len(files) != 1:
        raise InputError(
            f"{path}: not a log: holds {len(files)} .mcap files, not one; `ortilo replay --map MAP.yaml` "
            "reads other recordings (docs/how_to/recorded.md)"
        )
    return files[0]


def _description(path: Path) -> dict[str, Any]:
    """Return the content of /ortilo/scenario: format, software, scenario; InputError if it is not the first message."""
    first = next(read_logged(path, lambda topic: True), None)
    if first is None:
        raise InputError(f"{path}: empty or cut off before its scenario")
    try:
        if (first.topic, first.type_name) != (SCENARIO_TOPIC, STRING_TYPE):
            raise ValueError
        description = json.loads(from_cdr(STRING_TYPE, first.data).data)
        found = description["format"]
        _ = json.loads(description["scenario"]), str(description["software"])
    except Exception:  # whatever is wrong with a foreign message
        raise InputError(f"{path}: not a log of ortilo-drake: does not begin with {SCENARIO_TOPIC}") from None
    if found != FORMAT:
        raise InputError(f"{path}: a log of format {found}, this version reads format {FORMAT}")
    return description


def log_scenario(path: Path) -> Scenario:
    """Return the scenario that a log was flown with; InputError if it is no such log."""
    file = log_file(path)
    description = _description(file)
    return scenario_from_json(description["scenario"], description.get("scenario_format"), str(file))


def holds_what_was_sent(path: Path) -> bool:
    """Return whether a log's messages are what a world sent in real time; InputError if it is no log.

    When and whether the onboard half took them is then not known.
    """
    return _description(log_file(path)).get("messages") == SENT


def _decode(file: Path, message: LoggedMessage) -> tuple[str, np.ndarray]:
    try:
        if message.topic == IMAGE_TOPIC and message.type_name == IMAGE_TYPE:
            return "image", image_of(from_cdr(IMAGE_TYPE, message.data).data)
        if (message.topic, message.type_name) == (GOAL_TOPIC, GOAL_TYPE):
            p_W = from_cdr(GOAL_TYPE, message.data).pose.position
            return "goal", np.array([p_W.x, p_W.y])
        if message.type_name == ARRAY_TYPE:
            return message.topic.removeprefix(SIGNAL_PREFIX), np.array(from_cdr(ARRAY_TYPE, message.data).data)
    except Exception as error:  # the decoders raise errors of many kinds
        raise InputError(f"{file}: {message.topic}: cannot be decoded: {error}") from None
    raise InputError(f"{file}: {message.topic}: is of type {message.type_name or 'unknown'}")


def _bounded(file: Path, k: int, messages: Iterable[LoggedMessage]) -> Iterator[LoggedMessage]:
    """Yield a tick's messages; InputError if they are more than a tick can have, as where all have one log time."""
    size = 0
    for message in messages:
        size += len(message.data)
        if size > TICK_LIMIT:
            raise InputError(f"{file}: tick {k}: holds more than {TICK_LIMIT / MIB:g} MiB")
        yield message


def read_ticks(path: Path, images: bool = True) -> Iterator[LoggedTick]:
    """Yield the ticks of a log in order; a log that a kill cut short ends at the cut.

    InputError if there is no such log, or it is not one, or it is damaged, or its log times do not rise.
    """
    file, scenario = log_file(path), log_scenario(path)
    sizes = output_sizes(scenario.measurement)

    def wanted(topic: str) -> bool:
        if topic in (IMAGE_TOPIC, SCENARIO_TOPIC):
            return images and topic == IMAGE_TOPIC
        return topic == GOAL_TOPIC or topic.startswith(SIGNAL_PREFIX)

    before = -1
    for log_time, group in groupby(read_logged(file, wanted), key=lambda message: message.log_time):
        k = round(log_time * 1e-9 * scenario.control_rate)
        if k <= before:
            raise InputError(f"{file}: tick {k} after tick {before}: log times must rise")
        before = k
        signals = dict(_decode(file, message) for message in _bounded(file, k, group))
        state = signals.pop("state", None)
        outputs = {name: signals.pop(name) for name in sizes if name in signals}
        outputs = {name: value for name, value in outputs.items() if not np.isnan(value).all()}  # NaN: it never came
        yield LoggedTick(k, state, signals, outputs)


def read_messages(path: Path) -> Iterator[tuple[int, Signals, Signals]]:
    """Yield (k, messages, outputs) of every tick: what the onboard half took and what it answered; see read_ticks."""
    for tick in read_ticks(path):
        yield tick.k, tick.messages, tick.outputs


def read_log(path: Path) -> xr.Dataset:
    """Return a log as the Dataset that flight.fly returns of the same flight, but for `player` and `real_time_factor`.

    A log that a kill cut short gives the ticks before the cut. Ticks that are not in the log are NaN; so is the truth
    in the log of an onboard half, which does not know it. A loss is found from the true states that are there.
    InputError as read_ticks; also if there is no tick, or its flight would fill the memory.
    """
    file = log_file(path)
    description, scenario = _description(file), log_scenario(file)
    sizes = scenario.measurement.logged_sizes()
    ticks: list[tuple[int, Signals]] = []
    for tick in read_ticks(file, images=False):
        signals = tick.outputs if tick.state is None else tick.outputs | {"state": tick.state}
        for name, value in signals.items():
            if value.shape != (sizes[name],):
                raise InputError(f"{file}: {SIGNAL_PREFIX}{name}: has {value.size} numbers, not {sizes[name]}")
        ticks.append((tick.k, signals))
        # A flight may fill the memory, with its own ticks or with those that its log times leave out.
        row, missing = 8 * sum(sizes.values()), tick.k + 1 - len(ticks)
        if (tick.k + 1) * row > LARGEST or missing * row > MISSING_LIMIT:
            most = f"{LARGEST / MIB:g} MiB, {MISSING_LIMIT / MIB:g} of them of missing ticks"
            raise InputError(f"{file}: tick {tick.k}, of which {missing} are missing: at most {most}, are read")
    if not ticks:
        raise InputError(f"{file}: cut off before its first tick")
    logged = np.full((ticks[-1][0] + 1, sum(sizes.values())), np.nan)
    starts = dict(zip(sizes, np.cumsum([0, *sizes.values()]).tolist(), strict=False))
    for k, signals in ticks:
        for name, value in signals.items():
            logged[k, starts[name] : starts[name] + sizes[name]] = value
    known = [k for k, signals in ticks if "state" in signals]
    lost = find_loss(logged[known, : sizes["state"]], scenario.h, scenario.load_room(), scenario.vehicle)
    if lost is not None:
        k = known[lost.tick]
        lost = type(lost)(k, k * scenario.h, lost.cause)
        logged = logged[: k + 1]
    flight = flight_dataset(scenario, np.arange(len(logged)) * scenario.h, logged, lost)
    flight.attrs["software"] = description["software"]
    return flight
