"""The window of packet numbers that a channel has seen: each is taken once."""

import heapq
from typing import Final

REMEMBERED: Final = 4096  # more than a link holds a packet back


class Window:
    """Remembers the REMEMBERED greatest numbers taken; those up to the last it forgot, or below a floor, are old.

    A single number far ahead makes no others old.

    Args:
        floor: the least number to take.
    """

    def __init__(self, floor: int = 0):
        self._floor = floor
        self._heap: list[int] = []
        self._known: set[int] = set()

    def is_old(self, number: int) -> bool:
        """Return whether a number is too old to tell whether it was taken, or below the floor."""
        return number < self._floor

    def is_known(self, number: int) -> bool:
        """Return whether a number was taken."""
        return number in self._known

    def add(self, number: int) -> None:
        """Remember a number that is neither old nor known."""
        self._known.add(number)
        heapq.heappush(self._heap, number)
        if len(self._heap) > REMEMBERED:
            least = heapq.heappop(self._heap)
            self._known.remove(least)
            self._floor = least + 1
