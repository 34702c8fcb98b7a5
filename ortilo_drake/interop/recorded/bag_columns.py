"""Messages of a topic of a ROS 1 bag, a ROS 2 bag or an MCAP file, field by field, by rosbags."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader

from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Column, Source
from ortilo_drake.interop.ros.ros_types import typestore
from ortilo_drake.model.input_files import check_file, exists
from ortilo_drake.model.typed_yaml import InputError, nearest

_PART = re.compile(r"([^\[\].]+)|\[(\d+)\]")


def field_of(message: Any, path: str) -> Any:
    """Return a field by its path, such as `pose.position.x` or `ranges[2]`; LookupError if there is none."""
    value = message
    for name, index in _PART.findall(path):
        try:
            value = value[int(index)] if index else getattr(value, name)
        except (AttributeError, IndexError, TypeError):
            raise LookupError(path) from None
    return value


def _stamp(message: Any, received: int, time: Column | None) -> float:
    if time is not None:
        value = field_of(message, str(time))
        return float(value.sec + value.nanosec * 1e-9) if hasattr(value, "nanosec") else float(value)
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None or (stamp.sec, stamp.nanosec) == (0, 0):
        return received * 1e-9
    return float(stamp.sec + stamp.nanosec * 1e-9)


def _numbers(message: Any, columns: tuple[Column, ...]) -> list[float]:
    found: list[float] = []
    for column in columns:
        value = np.asarray(field_of(message, str(column)), dtype=float)
        found.extend(value.ravel().tolist())
    return found


def _raw(path: Path, topic: str) -> Iterator[tuple[AnyReader, str, int, bytes]]:
    with AnyReader([path], default_typestore=typestore()) as reader:
        topics = sorted({connection.topic for connection in reader.connections})
        connections = [c for c in reader.connections if c.topic == topic]
        if not connections:
            raise InputError(f"{path}: no topic '{topic}'{nearest(topic, topics)}; has {', '.join(topics) or 'none'}")
        for connection, received, raw in reader.messages(connections=connections):
            yield reader, connection.msgtype, received, raw


def read_bag(
    path: Path, topic: str, source: Source, columns: tuple[Column, ...], rejected: Rejections
) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps (n) [s], or the field `time` as it is, and the fields (n, m); a field that is a list gives many.

    Messages that cannot be decoded, or have another number of values than the first, are counted and left out.

    Raises:
        InputError: if the file is no bag or cut short, there is no such topic or field, or hardly a message can be
        read.
    """
    if not exists(path):
        raise InputError(f"{path}: no such bag")
    if not path.is_dir():
        check_file(path)
    stamps: list[float] = []
    rows: list[list[float]] = []
    k = 0
    try:
        for reader, type_name, received, raw in _raw(path, topic):
            k += 1
            try:
                message = reader.deserialize(raw, type_name)
            except Exception:  # whatever a decoder raises of spoilt bytes
                rejected.add("messages that cannot be decoded", f"message {k}")
                continue
            try:
                numbers, stamp = _numbers(message, columns), _stamp(message, received, source.time)
            except LookupError as error:
                if not rows:  # of the first message: a wrong map, not a wrong message
                    fields = ", ".join(name for name in vars(message) if not name.startswith("__"))
                    raise InputError(
                        f"{path}: {topic}: {type_name} has no field '{error.args[0]}'; has {fields}"
                    ) from None
                rejected.add("messages without a field asked for", f"message {k}")
                continue
            except (TypeError, ValueError):
                raise InputError(f"{path}: {topic}: a field of {list(columns)} is no number") from None
            if rows and len(numbers) != len(rows[0]):
                rejected.add(f"messages without {len(rows[0])} values", f"message {k}")
                continue
            stamps.append(stamp)
            rows.append(numbers)
    except InputError:
        raise
    except Exception as error:  # rosbags raises errors of many kinds for files that are cut short or none of its
        line = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: cannot be read as a bag (cut short?): {line}") from None
    if len(rows) < max(2, k / 2):
        raise InputError(f"{path}: {topic}: {len(rows)} of {k} messages can be read")
    return np.array(stamps), np.array(rows, dtype=float)
