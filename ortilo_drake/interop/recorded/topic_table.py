"""Logs of many topics: the topic that is asked for, and its fields as a table."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from ortilo_drake.interop.recorded.sources import Column
from ortilo_drake.interop.recorded.tables import NUMBERS, Table
from ortilo_drake.model.typed_yaml import InputError, nearest

FEWEST = 2  # rows
Topic = TypeVar("Topic")


def topic_of(path: Path, topic: str, topics: Mapping[str, Topic]) -> Topic:
    """Return a log's topic; InputError if there is no such."""
    if topic not in topics:
        raise InputError(f"{path}: no topic '{topic}'{nearest(topic, topics)}; has {', '.join(topics) or 'none'}")
    return topics[topic]


def check_size(path: Path, topic: str, rows: int, columns: int) -> None:
    """Raise InputError if a topic has hardly a row, or more numbers than are read."""
    if rows < FEWEST:
        raise InputError(f"{path}: {topic}: {rows} rows")
    if rows * (columns + 2) > NUMBERS:
        raise InputError(f"{path}: {topic}: more than {NUMBERS:,} numbers; cut the log into several recordings")


def place_of(path: Path, topic: str, wanted: Column, fields: Sequence[str]) -> int:
    """Return the index of a field, given by name or counted from 1; InputError if there is no such field."""
    at = wanted - 1 if isinstance(wanted, int) else fields.index(wanted) if wanted in fields else -1
    if not 0 <= at < len(fields):
        raise InputError(f"{path}: {topic} has no field '{wanted}'; has {', '.join(fields)}")
    return at


def table_of(
    path: Path,
    topic: str,
    t: np.ndarray,
    fields: Sequence[str],
    values: Sequence[np.ndarray],
    columns: tuple[Column, ...],
    names: Column | None,
) -> Table:
    """Return a topic's stamps t (n), and of the values of its fields (n each) columns and anchors' names, as a table.

    Raises:
        InputError: if there is no such field.
    """
    found = [values[place_of(path, topic, one, fields)].astype(float) for one in columns]
    called = None
    if names is not None:
        its = values[place_of(path, topic, names, fields)].tolist()
        called = np.array([str(name) for name in its], dtype=object)
    return Table(t, np.column_stack(found), called, np.arange(1, len(t) + 1))
