"""ROS 1 bags with definitions that are no UTF-8, or of a topic that nobody asks for and that cannot be read."""

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import Header, ReaderError, RecordType

from ortilo_drake.interop.ros.ros_types import typestore
from ortilo_drake.model.typed_yaml import InputError, nearest


def _record(header: Header) -> bytes:
    """Return a header as a bag has it, its text as UTF-8 with ? for bytes that are none."""
    fields = []
    for name, value in header.items():
        text = value.decode(errors="replace").replace("\ufffd", "?").encode()
        field = name.encode() + b"=" + (text if name in ("type", "md5sum", "message_definition", "callerid") else value)
        fields.append(struct.pack("<L", len(field)) + field)
    content = b"".join(fields)
    return struct.pack("<L", len(content)) + content


class LenientReader(Reader):
    """A reader that takes comments in any encoding, as old bags have them, and only the topic that is asked for."""

    topic: str
    topics_of_bag: tuple[str, ...] = ()

    def read_connection(self) -> Connection:
        """Read a connection's record; what is no UTF-8 in it is replaced (rosbags refuses the bag)."""
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

    def open(self) -> None:
        """Open the bag and keep the connections of the topic, so that no other type can spoil the reading."""
        super().open()
        self.topics_of_bag = tuple(sorted({connection.topic for connection in self.connections}))
        self.connections = [connection for connection in self.connections if connection.topic == self.topic]


def raw_messages(path: Path, topic: str) -> Iterator[tuple[AnyReader, str, int, bytes]]:
    """Yield reader, type, time of receipt [ns] and bytes of a topic's messages in a ROS 1 or ROS 2 bag.

    Raises:
        InputError: if there is no such topic; rosbags raises errors of many kinds besides.
    """
    reader = AnyReader([path], default_typestore=typestore())
    lenient = None
    if not reader.is2:
        lenient = LenientReader(path)
        lenient.topic = topic
        reader.readers = [lenient]
    with reader:
        topics = lenient.topics_of_bag if lenient else sorted({connection.topic for connection in reader.connections})
        connections = [c for c in reader.connections if c.topic == topic]
        if not connections:
            raise InputError(f"{path}: no topic '{topic}'{nearest(topic, topics)}; has {', '.join(topics) or 'none'}")
        for connection, received, raw in reader.messages(connections=connections):
            yield reader, connection.msgtype, received, raw
