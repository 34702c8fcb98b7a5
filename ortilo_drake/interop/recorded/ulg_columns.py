"""Messages of PX4's log (`.ulg`), field by field, read by pyulog.

A topic is a message's name, of several instances with its number behind: `sensor_accel[1]`; a column is a field, of an
array with its place: `gyro_rad[0]`. Stamps are the messages' `timestamp` [us].
"""

import io
from contextlib import redirect_stdout
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Column
from ortilo_drake.interop.recorded.tables import Table
from ortilo_drake.interop.recorded.topic_table import check_size, place_of, table_of, topic_of
from ortilo_drake.model.input_files import MIB, open_file
from ortilo_drake.model.optional import check_installed
from ortilo_drake.model.typed_yaml import InputError

MAGIC: Final = b"ULog\x01\x12\x35"
LIMIT: Final = 1024 * MIB
HEAD: Final = 16  # bytes before the first message
MICROSECONDS: Final = 1e-6


def is_ulg(path: Path) -> bool:
    """Return whether a file begins as such a log, or is called so."""
    if not path.is_file():
        return False
    with open_file(path) as file:
        return file.read(len(MAGIC)) == MAGIC or path.suffix == ".ulg"


def _is_whole(data: bytes) -> bool:
    """Return whether a log ends where its last message does: each begins with its size (H) and kind (B)."""
    at = HEAD
    while at + 3 <= len(data):
        at += 3 + data[at] + 256 * data[at + 1]
    return at == len(data)


@lru_cache(maxsize=1)  # each stream of a map asks for the same file
def _log(path: Path, changed: int) -> tuple[Any, bool]:
    """Return the log that pyulog read, and whether it read all of it."""
    check_installed("pyulog", "recorded")
    from pyulog import ULog

    with open_file(path, LIMIT) as file:
        data = file.read()
    try:
        with redirect_stdout(io.StringIO()):
            log = ULog(io.BytesIO(data))
        return log, _is_whole(data) and not log.file_corruption
    except Exception as error:  # of many kinds, where the definitions are spoilt
        raise InputError(f"{path}: no ULog that can be read: {type(error).__name__}: {error}") from None


def read_ulg(
    path: Path,
    topic: str,
    time: Column | tuple[Column, Column] | None,
    columns: tuple[Column, ...],
    rejected: Rejections,
    names: Column | None = None,
) -> Table:
    """Return the messages of a topic.

    Raises:
        InputError: if pyulog is not installed, the file is no such log, or there is no such topic, field or hardly a
            message.
    """
    if isinstance(time, tuple):
        raise InputError(f"{path}: {topic}: time: {list(time)}: a log's stamp is one field")
    log, whole = _log(path, path.stat().st_mtime_ns)
    rejected.word = "message"
    rejected.add("log that is cut short or spoilt: what could be read of it is used", "", int(not whole))
    topics = {f"{one.name}[{one.multi_id}]" if one.multi_id else one.name: one.data for one in log.data_list}
    data = topic_of(path, topic.removesuffix("[0]"), topics)
    fields, values = list(data), list(data.values())
    check_size(path, topic, len(values[0]), len(columns))
    t = values[place_of(path, topic, "timestamp" if time is None else time, fields)].astype(float)
    return table_of(path, topic, t * (MICROSECONDS if time is None else 1.0), fields, values, columns, names)
