"""Messages of a ROS 1 bag, a ROS 2 bag or an MCAP file: a topic field by field, or several played.

Those of an MCAP file are decoded by their encoding: ROS 2's CDR, ROS 1's, or JSON. Messages that are played come in the
order in which they were received, as fast as they came or faster.
"""

import json
import time
from collections.abc import Callable, Iterator
from functools import partial
from heapq import merge
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mcap.records import Channel, Schema
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from ortilo_drake.interop.log.mcap_records import read_records
from ortilo_drake.interop.recorded.message_fields import check_types, field_of, numbers_of, stamp_of
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.ros2_folder import check_database, files_of_bag
from ortilo_drake.interop.recorded.sources import Column, Source
from ortilo_drake.interop.recorded.tables import Rows, Table
from ortilo_drake.interop.ros.ros_types import typestore
from ortilo_drake.interop.unpack import Unpacker
from ortilo_drake.model.input_files import check_file, exists
from ortilo_drake.model.typed_yaml import InputError, nearest


def messages_of(path: Path, topic: str, topics: set[str]) -> Iterator[tuple[str, int, Callable[[], Any]]]:
    """Yield type, time of receipt [ns] and decoder of each message of a topic; `topics` gets the names of all topics.

    Raises:
        InputError: if it is no bag or cut short, has no such topic, or holds or unpacks to more than the limits.
    """
    if not exists(path):
        raise InputError(f"{path}: no such bag")
    if not path.is_dir():
        check_file(path)
    elif not exists(path / "metadata.yaml"):
        raise InputError(f"{path}: a folder without metadata.yaml is no ROS 2 bag: give the file in it that is a bag")
    try:
        if path.suffix == ".mcap":
            yield from mcap_messages(path, topic, topics)
        elif not path.is_dir():
            yield from _of_file(path, topic, topics, False)
        else:
            with files_of_bag(path) as (files, packed):
                for file in files:
                    yield from (mcap_messages if file.suffix == ".mcap" else _of_file)(file, topic, topics, packed)
    except InputError:
        raise
    except Exception as error:  # rosbags and mcap raise errors of many kinds for files that are cut short or not theirs
        line = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: cannot be read as a bag (cut short?): {line}") from None
    if topic not in topics:
        has = ", ".join(sorted(topics)) or "none"
        raise InputError(f"{path}: no topic '{topic}'{nearest(topic, sorted(topics))}; has {has}")


def _of_file(path: Path, topic: str, topics: set[str], packed: bool) -> Iterator[tuple[str, int, Callable[[], Any]]]:
    from ortilo_drake.interop.recorded.lenient_bag import raw_messages

    if path.suffix == ".db3":
        check_database(path)
    unpacker = Unpacker(path)
    for reader, type_name, received, raw in raw_messages(path, topic, topics):
        data = unpacker.unpack("zstd", raw, "a message") if packed else raw
        yield type_name, received, partial(reader.deserialize, data, type_name)


def read_bag(
    path: Path,
    topic: str,
    source: Source,
    columns: tuple[Column, ...],
    rejected: Rejections,
    names: Column | None = None,
) -> Table:
    """Return the messages of a topic, stamps in s, or the field `time` as it is; a field that is a list gives many.

    Messages that cannot be decoded, or have another number of values than the first, are counted and left out.

    Raises:
        InputError: as messages_of, or if there is no such field, or hardly a message can be read.
    """
    rejected.word = "message"
    rows, k = Rows(path), 0
    for type_name, received, decode in messages_of(path, topic, set()):
        k += 1
        try:
            message = decode()
        except Exception:  # whatever a decoder raises of spoilt bytes
            rejected.add("messages that cannot be decoded", f"in message {k}")
            continue
        try:
            numbers, stamp = numbers_of(message, columns), stamp_of(message, received, source.time)
            anchor = "" if names is None else str(field_of(message, str(names)))
        except LookupError as error:
            if not rows.width:  # of the first message: a wrong map, not a wrong message
                fields = ", ".join(name for name in getattr(message, "__dict__", {}) if not name.startswith("__"))
                raise InputError(f"{path}: {topic}: {type_name} has no field '{error.args[0]}'; has {fields}") from None
            rejected.add("messages without a field asked for", f"in message {k}")
            continue
        except OverflowError:
            rejected.add("messages with a number that is too large", f"in message {k}")
            continue
        except (TypeError, ValueError):
            raise InputError(f"{path}: {topic}: a field of {list(columns)} is no number") from None
        if rows.width and len(numbers) != rows.width:
            rejected.add(f"messages without {rows.width} values", f"in message {k}")
            continue
        rows.add(k, stamp, numbers, None if names is None else anchor, received)
    if len(rows) < max(2, k / 2):
        why = f"{len(rows)} of {k} messages can be read" if k else "no messages: another topic, or none in the map?"
        raise InputError(f"{path}: {topic}: {why}")
    return rows.table()


Message = tuple[str, int, Any]  # topic, when it was received [ns], the message


def bag_messages(path: Path, topics: tuple[str, ...]) -> Iterator[Message]:
    """Yield the messages of some topics of a bag; those that cannot be decoded come as None.

    Raises:
        InputError: if there is no such bag, it cannot be read, or a topic is not in it.
    """

    def of(topic: str) -> Iterator[Message]:
        for _, received, decode in messages_of(path, topic, set()):
            try:
                yield topic, received, decode()
            except Exception:  # whatever a decoder raises of spoilt bytes
                yield topic, received, None

    yield from merge(*(of(topic) for topic in topics), key=lambda message: message[1])


def at_pace(messages: Iterator[Message], speed: float) -> Iterator[Message]:
    """Yield messages when they are due by the wall clock, `speed` times as fast as they were received."""
    began = first = None
    for message in messages:
        if began is None or first is None:
            began, first = time.monotonic(), message[1]
        due = began + (message[1] - first) * 1e-9 / speed
        time.sleep(max(0.0, due - time.monotonic()))
        yield message


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
