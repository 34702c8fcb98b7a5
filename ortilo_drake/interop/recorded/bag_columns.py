"""Messages of a ROS 1 bag, a ROS 2 bag or an MCAP file: fields of one topic as a table, or several topics played.

Messages of an MCAP file are decoded by their encoding: ROS 2's CDR, ROS 1's, or JSON. Messages are played in the order
in which they were received, at the original speed or another one.
"""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from functools import partial
from heapq import merge
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
from mcap.records import Channel, Schema
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from ortilo_drake.interop.log.mcap_records import read_records
from ortilo_drake.interop.recorded.message_fields import check_types, field_of, numbers_of, stamp_of
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.ros2_folder import PACKED, check_database, files_of_bag
from ortilo_drake.interop.recorded.sources import Column, Source
from ortilo_drake.interop.recorded.tables import Rows, Table
from ortilo_drake.interop.ros.ros_types import typestore
from ortilo_drake.interop.unpack import Unpacker
from ortilo_drake.model.input_files import check_file, exists
from ortilo_drake.model.typed_yaml import InputError, nearest

ZSTD: Final = b"\x28\xb5\x2f\xfd"  # first bytes of zstd data; no message of another encoding begins with them


def messages_of(
    path: Path, topic: str, topics: set[str], cut: Callable[[], None] = lambda: None
) -> Iterator[tuple[str, int, Callable[[], Any]]]:
    """Yield (type, time of receipt [ns], decoder) of each message of a topic; add the names of all topics to `topics`.

    An MCAP file that was cut short is read up to the cut, and `cut` is called. InputError if the file is no bag, is cut
    short and not MCAP, has no such topic, or exceeds a limit when read or unpacked.
    """
    short: list[Path] = []
    if not exists(path):
        raise InputError(f"{path}: no such bag")
    if not path.is_dir():
        check_file(path)
    try:
        with files_of_bag(path) if path.is_dir() or path.suffix == PACKED else nullcontext([path]) as files:
            for file in files:
                if file.suffix == ".mcap":
                    yield from mcap_messages(file, topic, topics, partial(short.append, path))
                else:
                    yield from _of_file(file, topic, topics)
    except InputError:
        raise
    except Exception as error:  # rosbags and mcap raise errors of many kinds for foreign files and files cut short
        line = " ".join(str(error).split()) or type(error).__name__
        mends = " `rosbag reindex` may mend it" if path.suffix in (".bag", ".active") else ""
        raise InputError(f"{path}: cannot be read as a bag (cut short?{mends}): {line}") from None
    if topic not in topics:
        if short:
            raise InputError(f"{path}: cannot be read as a bag (cut short): no topic '{topic}' in what is left of it")
        has = ", ".join(sorted(topics)) or "none"
        raise InputError(f"{path}: no topic '{topic}'{nearest(topic, sorted(topics))}; has {has}")
    if short:
        cut()


def _of_file(path: Path, topic: str, topics: set[str]) -> Iterator[tuple[str, int, Callable[[], Any]]]:
    from ortilo_drake.interop.recorded.lenient_bag import raw_messages

    if path.suffix == ".db3":
        check_database(path)
    unpacker = Unpacker(path)
    for reader, type_name, received, raw in raw_messages(path, topic, topics):
        data = unpacker.unpack("zstd", raw, "a message") if raw[:4] == ZSTD else raw
        yield type_name, received, partial(reader.deserialize, data, type_name)


def read_bag(
    path: Path,
    topic: str,
    source: Source,
    columns: tuple[Column, ...],
    rejected: Rejections,
    names: tuple[Column, ...] = (),
) -> Table:
    """Return the fields `columns` of a topic's messages as a table; a field that is a list gives several values.

    Stamps are in s, or `source.time` as it is. Messages that cannot be decoded, or differ from the first in the number
    of values, are counted and left out. InputError as in messages_of, for a missing field, or for too few messages.
    """
    rejected.word = "message"
    rows, k, empty = Rows(path), 0, 0
    cut = "the bag's end is missing, as after a loss of power: it is read as far as it goes"
    for type_name, received, decode in messages_of(path, topic, set(), partial(rejected.notes.append, cut)):
        k += 1
        try:
            message = decode()
        except Exception:  # a decoder may raise any error for damaged bytes
            rejected.add("messages that cannot be decoded", f"in message {k}")
            continue
        try:
            numbers, stamp = numbers_of(message, columns), stamp_of(message, received, source.time)
            called = [field_of(message, str(name)) for name in names]
        except LookupError as error:
            if not rows.width:  # already the first message: the map is wrong, not the message
                fields = ", ".join(name for name in getattr(message, "__dict__", {}) if not name.startswith("__"))
                raise InputError(f"{path}: {topic}: {type_name} has no field '{error.args[0]}'; has {fields}") from None
            rejected.add("messages without a field asked for", f"in message {k}")
            continue
        except OverflowError:
            rejected.add("messages with a number that is too large", f"in message {k}")
            continue
        except (TypeError, ValueError):
            raise InputError(f"{path}: {topic}: a field of {list(columns)} is no number") from None
        each, its = [tuple(map(str, called))], [numbers]
        if called and isinstance(called[0], list | np.ndarray):  # a list of anchors beside a list of ranges
            n = len(called[0])
            lists = [one if isinstance(one, list | np.ndarray) else [one] * n for one in called]
            fits = len(numbers) == n * len(columns) and all(len(one) == n for one in lists)
            each = [tuple(map(str, row)) for row in zip(*lists, strict=False)]
            its = np.reshape(numbers, (len(columns), n)).T.tolist() if fits else []
            empty += n == 0
        if len(each) != len(its) or any(rows.width not in (0, len(row)) for row in its):
            rejected.add(f"messages without {rows.width or len(each)} values", f"in message {k}")
            continue
        for row_names, row in zip(each, its, strict=True):
            rows.add(k, stamp, row, row_names, received)
    if len(rows) < max(2, (k - empty) / 2):
        most = f" ({rejected.most()})" if rejected.counts else ""
        why = (
            f"{len(rows)} of {k} messages can be read{most}" if k else "no messages: another topic, or none in the map?"
        )
        raise InputError(f"{path}: {topic}: {why}")
    return rows.table()


Message = tuple[str, int, Any]  # topic, time of receipt [ns], message


def bag_messages(path: Path, topics: tuple[str, ...]) -> Iterator[Message]:
    """Yield the messages of some topics of a bag by time of receipt; None for a message that cannot be decoded.

    InputError if there is no such bag, if the bag cannot be read, or if it lacks a topic.
    """

    def of(topic: str) -> Iterator[Message]:
        for _, received, decode in messages_of(path, topic, set()):
            try:
                yield topic, received, decode()
            except Exception:  # a decoder may raise any error for damaged bytes
                yield topic, received, None

    yield from merge(*(of(topic) for topic in topics), key=lambda message: message[1])


def at_pace(messages: Iterator[Message], speed: float) -> Iterator[Message]:
    """Yield each message at its due time by the wall clock, `speed` times as fast as they were received."""
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
    """Return the decoder of a channel's messages; InputError if the type or encoding is not supported."""
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
    path: Path, topic: str, topics: set[str], cut: Callable[[], None] = lambda: None
) -> Iterator[tuple[str, int, Callable[[], Any]]]:
    """Yield (type, log time [ns], decoder) of each message of a topic, in the order of the file.

    The names of all topics are added to `topics`. A single message may be packed with zstd. InputError if the file is
    damaged or too large, or if its messages have an unsupported encoding. For a wrong schema the library raises errors
    of many kinds.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[str, Decode]] = {}
    unpacker = Unpacker(path)
    for record in read_records(path, cut):
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
            data = unpacker.unpack("zstd", record.data, "a message") if record.data[:4] == ZSTD else record.data
            yield name, record.log_time, lambda data=data, decode=decode: decode(data)  # type: ignore[misc]
