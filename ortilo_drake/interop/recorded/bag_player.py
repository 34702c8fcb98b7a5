"""A recorded bag played: its messages in the order in which they were received, as fast as they came or faster."""

import time
from collections.abc import Iterator
from heapq import merge
from pathlib import Path
from typing import Any

from ortilo_drake.interop.recorded.bag_columns import messages_of

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
