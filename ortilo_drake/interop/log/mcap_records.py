"""The messages of an MCAP file that is complete or that a kill cut short."""

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema

from ortilo_drake.interop.unpack import CHUNK_LIMIT, Unpacker
from ortilo_drake.model.input_files import MIB, open_file
from ortilo_drake.model.typed_yaml import InputError

MAGIC = b"\x89MCAP0\r\n"
HEAD: Final = struct.Struct("<BQ")  # opcode and length of a record
DEFINITIONS: Final = 64 * MIB  # limit of all schemas and channels, which are kept; a hundred types take 1 MiB
_READ: Final = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.DATA_END)


class LoggedMessage(NamedTuple):
    """One message of the file, with its log time [ns] and its encoded data."""

    topic: str
    type_name: str
    log_time: int
    data: bytes


def _unpacked(content: bytes, unpacker: Unpacker) -> bytes:
    """Return the bytes of a chunk's records, unpacked and checked."""
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    packed = chunk.compression != ""
    raw = unpacker.unpack(chunk.compression, chunk.data, "a chunk") if packed else chunk.data
    if len(raw) != chunk.uncompressed_size:
        raise ValueError(f"a chunk holds {len(raw)} bytes, and states {chunk.uncompressed_size}")
    if chunk.uncompressed_crc and zlib.crc32(raw) != chunk.uncompressed_crc:
        raise ValueError("a chunk's checksum is wrong")
    return raw


def _records(path: Path, file: IO[bytes], left: int, in_chunk: bool) -> Iterator[tuple[int, bytes]]:
    """Yield (opcode, content) of the records in the next `left` bytes; it ends early where a file was cut short."""
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
    """Yield (opcode, content) of schemas, channels and messages, inside and outside of chunks; see read_records."""
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
    """Yield the schemas, channels and messages of an MCAP file in the order in which they were written.

    The file may end anywhere: `cut` is called after the last record of a file that was cut short. InputError if the
    file cannot be read, is no MCAP file, is damaged before its end, or exceeds a limit of interop/unpack.py.
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
    """Yield the messages of the wanted topics of an MCAP file in the order of the file; errors as in read_records."""
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
