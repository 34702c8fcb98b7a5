"""ROS 1 bags and ROS 2 databases, read by rosbags within limits.

Definitions that are not UTF-8 are accepted. Definitions of topics that are not used may be unreadable.
"""

import struct
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import Chunk, Header, IndexData, ReaderError, RecordType

from ortilo_drake.interop.recorded.message_fields import check_types
from ortilo_drake.interop.ros.ros_types import typestore
from ortilo_drake.interop.unpack import CHUNK_LIMIT, Unpacker
from ortilo_drake.model.input_files import MIB, open_file
from ortilo_drake.model.typed_yaml import InputError

INDEXED: Final = 2**22  # most messages of a topic, an hour at 1 kHz; an entry of the index takes 150 bytes
_HEAD, _SIZE = 55, struct.Struct("<L")  # head of a bag's index [bytes], whose last four are the size of the index


class BoundedFile:
    """A regular file that reads at most CHUNK_LIMIT at once, because the lengths in a bag may be wrong."""

    def __init__(self, path: Path) -> None:
        self.file: BinaryIO = open_file(path)
        self.path = path
        self.tell, self.seek, self.close = self.file.tell, self.file.seek, self.file.close

    def read(self, size: int) -> bytes:
        """Return the next bytes, at most `size`; InputError if `size` exceeds CHUNK_LIMIT."""
        if size > CHUNK_LIMIT:
            raise InputError(
                f"{self.path}: a record of {size / MIB:.4g} MiB; at most {CHUNK_LIMIT / MIB:g} MiB are read"
            )
        return self.file.read(size)

    def readline(self) -> bytes:
        """Return the next line, or its first 80 bytes."""
        return self.file.readline(80)


class _Place:
    """A bag's path, with the methods that rosbags uses."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def exists(self) -> bool:
        return True

    def open(self, mode: str) -> BoundedFile:
        return BoundedFile(self.path)


def _record(header: Header) -> bytes:
    """Return a header in a bag's format, with its text as UTF-8 and ? for invalid bytes."""
    fields = []
    for name, value in header.items():
        text = value.decode(errors="replace").replace("\ufffd", "?").encode()
        field = name.encode() + b"=" + (text if name in ("type", "md5sum", "message_definition", "callerid") else value)
        fields.append(struct.pack("<L", len(field)) + field)
    content = b"".join(fields)
    return struct.pack("<L", len(content)) + content


class LenientReader(Reader):
    """A reader of one topic that accepts comments in any encoding, as in old bags."""

    def __init__(self, path: Path, topic: str) -> None:
        super().__init__(_Place(path))  # type: ignore[arg-type]  # the reader uses no other methods of a path
        self.topic = topic
        self.topics_of_bag: set[str] = set()
        self.unpacker = Unpacker(path)

    def read_connection(self) -> Connection:
        """Read a connection's record; replace invalid UTF-8 in it, for which rosbags would refuse the bag."""
        assert self.bio
        begin = self.bio.tell()
        try:
            return super().read_connection()
        except ReaderError:
            self.bio.seek(begin)
        first, second = Header.read(self.bio, RecordType.CONNECTION), Header.read(self.bio)
        end, whole = self.bio.tell(), self.bio
        self.bio = BytesIO(_record(first) + _record(second))
        try:
            return super().read_connection()
        finally:
            self.bio = whole
            self.bio.seek(end)

    def read_chunk(self) -> Chunk:
        """Read a chunk's header; the chunk will be unpacked within the limits of interop/unpack.py."""
        assert self.bio
        begin = self.bio.tell()
        kind = Header.read(self.bio, RecordType.CHUNK).get_string("compression")
        self.bio.seek(begin)
        chunk = super().read_chunk()
        unpack = partial(self.unpacker.unpack, kind, what="a chunk")
        return chunk if kind == "none" else chunk._replace(decompressor=unpack)

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """Read the part of a chunk's index for the topic; InputError for more than INDEXED messages."""
        assert self.bio
        begin = self.bio.tell()
        entries = _SIZE.unpack_from(self.bio.read(_HEAD), _HEAD - _SIZE.size)[0] // 12
        self.bio.seek(begin)
        found: dict[int, list[IndexData]] = defaultdict(list)
        if entries <= INDEXED:
            super().read_index_data(pos, found)
        for key in found.keys() & {connection.id for connection in self.connections if connection.topic == self.topic}:
            entries = len(found[key]) + len(indexes[key])
            indexes[key] += found[key]
        if entries > INDEXED:
            raise InputError(f"{self.unpacker.path}: more than {INDEXED:,} messages of a topic")

    def open(self) -> None:
        """Open the bag and keep only the connections of the topic, so that no other type can prevent the reading."""
        super().open()
        self.topics_of_bag = {connection.topic for connection in self.connections}
        self.connections = [connection for connection in self.connections if connection.topic == self.topic]


def raw_messages(path: Path, topic: str, topics: set[str]) -> Iterator[tuple[AnyReader, str, int, bytes]]:
    """Yield (reader, type, time of receipt [ns], bytes) of a topic's messages in a ROS 1 bag or a ROS 2 database.

    Check a database before, see check_database. The names of all topics are added to `topics`. InputError if the file
    exceeds a limit when read or unpacked; rosbags also raises errors of many kinds.
    """
    reader = AnyReader([path], default_typestore=typestore())
    lenient = None
    if not reader.is2:
        lenient = LenientReader(path, topic)
        reader.readers = [lenient]
    with reader:
        topics |= lenient.topics_of_bag if lenient else {connection.topic for connection in reader.connections}
        connections = [c for c in reader.connections if c.topic == topic]
        for connection in connections:
            check_types(reader.typestore.fielddefs, connection.msgtype)
        for connection, received, raw in reader.messages(connections=connections) if connections else ():
            yield reader, connection.msgtype, received, raw
