"""Messages of a topic of an MCAP file by their encoding: ROS 2's CDR, ROS 1's, or JSON."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mcap.records import Channel, Schema
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from ortilo_drake.interop.log.mcap_records import read_records
from ortilo_drake.interop.recorded.message_fields import check_types
from ortilo_drake.interop.ros.ros_types import typestore
from ortilo_drake.interop.unpack import Unpacker
from ortilo_drake.model.typed_yaml import InputError

Decode = Callable[[bytes], Any]


def _of_json(data: bytes) -> Any:
    return json.loads(data, object_hook=lambda fields: SimpleNamespace(**fields))


def _decoder(path: Path, channel: Channel, schema: Schema | None) -> Decode:
    """Return the decoder of a channel's messages; InputError if their type or encoding is not supported."""
    encoding, kind = channel.message_encoding, "" if schema is None else schema.encoding
    if encoding == "json":
        return _of_json
    if encoding not in ("cdr", "ros1") or kind not in ("ros1msg", "ros2msg", "ros2idl", "omgidl", ""):
        found = f"{encoding or 'unnamed'} messages" + (f" ({kind})" if kind else "")
        raise InputError(f"{path}: topic '{channel.topic}' has {found}; cdr (ROS 2), ros1 and json are read")
    name = "" if schema is None else schema.name
    full = name if "/msg/" in name else name.replace("/", "/msg/", 1)
    store = typestore()
    if schema is not None and schema.data:
        text = schema.data.decode(errors="replace")
        types = get_types_from_idl(text) if kind.endswith("idl") else get_types_from_msg(text, name)
        check_types(types, full)
        store = get_typestore(Stores.EMPTY)
        store.register(types)
    if encoding == "ros1":
        return lambda data: store.deserialize_ros1(data, full)
    return lambda data: store.deserialize_cdr(data, full)


def mcap_messages(
    path: Path, topic: str, topics: set[str], packed: bool = False
) -> Iterator[tuple[str, int, Callable[[], Any]]]:
    """Yield type, time of logging [ns] and decoder of each of a topic's messages, in the file's order.

    `topics` gets the names of all topics; each message is `packed` with zstd of its own or not.

    Raises:
        InputError: if the file is damaged, cut short or too large, or its messages are of an encoding that is not read;
            the library raises errors of many kinds for a wrong schema.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[str, Decode]] = {}
    unpacker = Unpacker(path)
    for record in read_records(path, whole=True):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            topics.add(record.topic)
            if record.topic == topic and record.id not in channels:
                schema = schemas.get(record.schema_id)
                name = (schema.name if schema is not None else "") or record.message_encoding
                channels[record.id] = (name, _decoder(path, record, schema))
        elif record.channel_id in channels:
            name, decode = channels[record.channel_id]
            data = unpacker.unpack("zstd", record.data, "a message") if packed else record.data
            yield name, record.log_time, lambda data=data, decode=decode: decode(data)  # type: ignore[misc]
