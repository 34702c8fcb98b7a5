"""The messages of an MCAP file, complete or cut short by a kill."""

import os
import struct
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import breakup_chunk

from ortilo_drake.model.input_files import open_file
from ortilo_drake.model.typed_yaml import InputError

MAGIC = b"\x89MCAP0\r\n"


class LoggedMessage(NamedTuple):
    """One message as it stands in the file."""

    topic: str
    type_name: str
    log_time: int
    data: bytes


def _whole_records(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield (opcode, content) of every complete record, up to DataEnd or to where the file was cut short."""
    with open_file(path) as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise InputError(f"{path}: not an MCAP file")
        left = os.fstat(file.fileno()).st_size - len(MAGIC)
        while len(head := file.read(9)) == 9:
            opcode, length = struct.unpack("<BQ", head)
            left -= 9 + length
            if opcode == Opcode.DATA_END or left < 0:
                return
            yield opcode, file.read(length)


def _records_in(opcode: int, content: bytes) -> list[McapRecord]:
    stream = ReadDataStream(BytesIO(content))
    match opcode:
        case Opcode.CHUNK:
            return breakup_chunk(Chunk.read(stream), validate_crc=True)
        case Opcode.SCHEMA:
            return [Schema.read(stream)]
        case Opcode.CHANNEL:
            return [Channel.read(stream)]
        case Opcode.MESSAGE:
            return [Message.read(stream, len(content))]
    return []


def read_logged(path: Path, wanted: Callable[[str], bool]) -> Iterator[LoggedMessage]:
    """Yield the messages of an MCAP file in the order they were written.

    Args:
        path: the file; it may end anywhere.
        wanted: whether a topic is asked for.

    Raises:
        InputError: if the file cannot be read, is no MCAP, or is damaged before its end.
    """
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    try:
        for opcode, content in _whole_records(path):
            for record in _records_in(opcode, content):
                if isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    if wanted(record.topic):
                        channels[record.id] = (record.topic, schemas.get(record.schema_id, ""))
                elif isinstance(record, Message) and record.channel_id in channels:
                    yield LoggedMessage(*channels[record.channel_id], record.log_time, record.data)
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (McapError, zstandard.ZstdError, struct.error, ValueError, MemoryError, OverflowError) as error:
        raise InputError(f"{path}: damaged: {' '.join(str(error).split()) or type(error).__name__}") from None
