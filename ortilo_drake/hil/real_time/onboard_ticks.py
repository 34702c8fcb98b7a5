"""When the onboard half in real time ticks, and what it takes then; a clock's reading comes from outside.

Tick k begins when all that the world sent in it is here, or half a tick after it was expected. The world's clock is
known from its packets: the least delay heard lately is taken for the way's own (the usual estimate of a one-way offset,
as in D. L. Mills, RFC 5905, clock filter); so two machines need no common time. What comes later than its tick enters
in a tick after, with its own stamp; estimator.delay says what becomes of it.
"""

from collections import Counter, deque
from typing import Final

import numpy as np

from ortilo_drake.flight.stepped_halves import Signals
from ortilo_drake.hil.wire.tick_inbox import TickInbox
from ortilo_drake.hil.wire.unpack import Packet
from ortilo_drake.model.signals import STAMP
from ortilo_drake.onboard.estimator.late_measurements import history_ticks
from ortilo_drake.scenario import Scenario

CLOCK_WINDOW: Final = 150  # ticks of the world's over which the least delay is taken


class OnboardTicks:
    """The ticks of an onboard half; all times are one clock's [s].

    Attributes:
        first: the tick at which it joined the flight; None before.
        next: the tick that comes.
        ages: how many of the messages taken were how many ticks old.
    """

    def __init__(self, scenario: Scenario):
        self._h, estimator = scenario.h, scenario.estimator
        # What the filter puts into its own tick is of use after a newer message too; else it would be a step back.
        self._horizon = history_ticks(estimator.horizon, scenario.h) if estimator.delay == "replay" else 0
        self._inbox = TickInbox()
        self._offsets: deque[float] = deque(maxlen=CLOCK_WINDOW)  # of the world's tick 0, with the delay of the way
        self.first: int | None = None
        self.next = 0
        self.ages: Counter[int] = Counter()

    @property
    def overtaken(self) -> int:
        """How many messages were not taken, since a newer one had come."""
        return self._inbox.overtaken

    def hear(self, packet: Packet, received: float) -> None:
        """Take a packet of the world; the first list of a tick joins the flight."""
        if packet.name == "tick":
            self._offsets.append(received - packet.tick * self._h)
            if self.first is None:
                self.first = self.next = packet.tick
        self._inbox.put(packet)

    def due(self) -> float:
        """Return when the next tick begins whatever is missing; inf before the flight is joined."""
        return min(self._offsets) + (self.next + 0.5) * self._h if self._offsets else np.inf

    def begins(self, now: float) -> bool:
        """Return whether the next tick begins."""
        return self.first is not None and (self._inbox.is_complete(self.next) or now >= self.due())

    def take(self) -> Signals:
        """Return the messages of the next tick, which is then the one after."""
        k = self.next
        messages = self._inbox.take_until(k, keep_from=k + 1 - self._horizon)
        for message in messages.values():
            self.count_age(k, message)
        self.next += 1
        return messages

    def count_age(self, k: int, message: np.ndarray) -> None:
        """Count how old a message is that is taken in tick k."""
        self.ages[round(k - message[STAMP] / self._h)] += 1
