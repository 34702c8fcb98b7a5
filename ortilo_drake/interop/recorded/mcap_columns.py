"""Messages of a topic of an MCAP file by their encoding: ROS 2's CDR, ROS 1's, or JSON."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mcap.reader import make_reader
from mcap.records import Channel, Schema
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from ortilo_drake.interop.ros.ros_types import typestore
from ortilo_drake.model.input_files import open_file
from ortilo_drake.model.typed_yaml import InputError, nearest

Decode = Callable[[bytes], Any]


def _of_json(data: bytes) -> Any:
    return json.loads(data, object_hook=lambda fields: SimpleNamespace(**fields))


def _decoder(path: Path, channel: Channel, schema: Schema | None) -> Decode:
    """Return what decodes a channel's messages; InputError if that is not one of ours."""
    encoding, kind = channel.message_encoding, "" if schema is None else schema.encoding
    if encoding == "json":
        return _of_json
    if encoding not in ("cdr", "ros1") or kind not in ("ros1msg", "ros2msg", "ros2idl", "omgidl", ""):
        found = f"{encoding or 'unnamed'} messages" + (f" ({kind})" if kind else "")
        raise InputError(f"{path}: topic '{channel.topic}' has {found}; cdr (ROS 2), ros1 and json are read")
    name = "" if schema is None else schema.name
    store = typestore()
    if schema is not None and schema.data:
        text = schema.data.decode(errors="replace")
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_idl(text) if kind.endswith("idl") else get_types_from_msg(text, name))
    name = name if "/msg/" in name else name.replace("/", "/msg/", 1)
    if encoding == "ros1":
        return lambda data: store.deserialize_ros1(data, name)
    return lambda data: store.deserialize_cdr(data, name)


def mcap_messages(path: Path, topic: str) -> Iterator[tuple[str, int, Callable[[], Any]]]:
    """Yield type, time of logging [ns] and what decodes it of each of a topic's messages.

    Raises:
        InputError: if there is no such topic, or its messages are of an encoding that is not read; the library raises
            errors of many kinds for a file that is cut short.
    """
    with open_file(path) as file:
        decoders: dict[int, Decode] = {}
        summary = make_reader(file).get_summary()
        topics = sorted({c.topic for c in summary.channels.values()}) if summary else []
        if topics and topic not in topics:
            raise InputError(f"{path}: no topic '{topic}'{nearest(topic, topics)}; has {', '.join(topics)}")
        file.seek(0)
        for schema, channel, message in make_reader(file).iter_messages(topics=[topic]):
            if channel.id not in decoders:
                decoders[channel.id] = _decoder(path, channel, schema)
            decode = decoders[channel.id]
            name = (schema.name if schema is not None else "") or channel.message_encoding
            yield name, message.log_time, lambda data=message.data, decode=decode: decode(data)  # type: ignore[misc]
        if not decoders:
            raise InputError(f"{path}: no message of topic '{topic}'")
