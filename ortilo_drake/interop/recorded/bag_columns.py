"""Messages of a topic of a ROS 1 bag, a ROS 2 bag or an MCAP file, field by field, by rosbags."""

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ortilo_drake.interop.recorded.lenient_bag import raw_messages
from ortilo_drake.interop.recorded.mcap_columns import mcap_messages
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Column, Source
from ortilo_drake.interop.recorded.tables import Table
from ortilo_drake.model.input_files import check_file, exists
from ortilo_drake.model.typed_yaml import InputError

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


def _seconds(stamp: Any) -> float:
    """Return a stamp's seconds; its nanoseconds are called nanosec in ROS 2, nsec elsewhere."""
    return float(stamp.sec + 1e-9 * (stamp.nanosec if hasattr(stamp, "nanosec") else stamp.nsec))


def _stamp(message: Any, received: int, time: Column | None) -> float:
    if time is not None:
        value = field_of(message, str(time))
        return _seconds(value) if hasattr(value, "sec") else float(value)
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    found = _seconds(stamp) if hasattr(stamp, "sec") else 0.0
    return found if found != 0.0 else received * 1e-9


def _numbers(message: Any, columns: tuple[Column, ...]) -> list[float]:
    found: list[float] = []
    for column in columns:
        value = np.asarray(field_of(message, str(column)), dtype=float)
        found.extend(value.ravel().tolist())
    return found


def _messages(path: Path, topic: str) -> Iterator[tuple[str, int, Callable[[], Any]]]:
    """Yield type, time of receipt [ns] and what decodes it of each message."""
    if path.suffix == ".mcap":
        yield from mcap_messages(path, topic)
        return
    for reader, type_name, received, raw in raw_messages(path, topic):
        yield type_name, received, partial(reader.deserialize, raw, type_name)


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

    Args:
        path: the bag's file or folder.
        topic: the topic.
        source: its entry in the map.
        columns: fields with numbers.
        rejected: where to count.
        names: the field that names each message's anchor.

    Raises:
        InputError: if the file is no bag or cut short, there is no such topic or field, or hardly a message can be
        read.
    """
    if not exists(path):
        raise InputError(f"{path}: no such bag")
    if not path.is_dir():
        check_file(path)
    rejected.word = "message"
    stamps: list[float] = []
    rows: list[list[float]] = []
    called: list[str] = []
    kept: list[int] = []
    k = 0
    try:
        for type_name, received, decode in _messages(path, topic):
            k += 1
            try:
                message = decode()
            except Exception:  # whatever a decoder raises of spoilt bytes
                rejected.add("messages that cannot be decoded", f"in message {k}")
                continue
            try:
                numbers, stamp = _numbers(message, columns), _stamp(message, received, source.time)
                anchor = "" if names is None else str(field_of(message, str(names)))
            except LookupError as error:
                if not rows:  # of the first message: a wrong map, not a wrong message
                    fields = ", ".join(name for name in getattr(message, "__dict__", {}) if not name.startswith("__"))
                    raise InputError(
                        f"{path}: {topic}: {type_name} has no field '{error.args[0]}'; has {fields}"
                    ) from None
                rejected.add("messages without a field asked for", f"in message {k}")
                continue
            except (TypeError, ValueError):
                raise InputError(f"{path}: {topic}: a field of {list(columns)} is no number") from None
            if rows and len(numbers) != len(rows[0]):
                rejected.add(f"messages without {len(rows[0])} values", f"in message {k}")
                continue
            stamps.append(stamp)
            rows.append(numbers)
            called.append(anchor)
            kept.append(k)
    except InputError:
        raise
    except Exception as error:  # rosbags and mcap raise errors of many kinds for files that are cut short or not theirs
        line = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: cannot be read as a bag (cut short?): {line}") from None
    if len(rows) < max(2, k / 2):
        raise InputError(f"{path}: {topic}: {len(rows)} of {k} messages can be read")
    found = None if names is None else np.array(called)
    return Table(np.array(stamps), np.array(rows, dtype=float), found, np.array(kept))
