"""The ticks of the onboard half in real time: when each begins, and which messages it takes.

Tick k begins when all that the world sent in it is here, or half a tick after it was expected. The offset of the
world's clock is estimated from its packets, by the least delay seen lately (as in D. L. Mills, RFC 5905, clock filter);
so two machines need no common time. The caller reads the clock. A message that is later than its tick enters in a tick
after it, with its own stamp; filter.delay says what becomes of it.
"""

from collections import Counter, deque
from typing import Final

import numpy as np

from ortilo_drake.flight.stepped_halves import Signals
from ortilo_drake.hil.wire.tick_inbox import TickInbox
from ortilo_drake.hil.wire.unpack import Packet
from ortilo_drake.model.clock import history_ticks
from ortilo_drake.model.signals import STAMP
from ortilo_drake.scenario import Scenario

CLOCK_WINDOW: Final = 150  # ticks of the world over which the least delay is taken


class OnboardTicks:
    """The ticks of an onboard half; all times are one clock's [s].

    It joined the flight at the first tick, None before; the next one comes. Ages counts the messages that were taken at
    each age in ticks.
    """

    def __init__(self, scenario: Scenario):
        self._h, estimator = scenario.h, scenario.estimator
        # A filter that replays puts a late message into its own tick; for any other, an older message is a step back.
        self._horizon = history_ticks(estimator.horizon, scenario.h) if estimator.delay == "replay" else 0
        self._inbox = TickInbox()
        self._offsets: deque[float] = deque(maxlen=CLOCK_WINDOW)  # time of the world's tick 0, plus a delay
        self.first: int | None = None
        self.next = 0
        self.ages: Counter[int] = Counter()

    @property
    def overtaken(self) -> int:
        """The number of messages dropped for a newer one."""
        return self._inbox.overtaken

    def receive(self, packet: Packet, received: float) -> None:
        """Take a packet of the world; the first tick that it lists is the first of this half."""
        if packet.name == "tick":
            self._offsets.append(received - packet.tick * self._h)
            if self.first is None:
                self.first = self.next = packet.tick
        self._inbox.put(packet)

    def due(self) -> float:
        """Return the latest time at which the next tick begins, complete or not; inf before the flight is joined."""
        return min(self._offsets) + (self.next + 0.5) * self._h if self._offsets else np.inf

    def begins(self, now: float) -> bool:
        """Return whether the next tick begins now."""
        return self.first is not None and (self._inbox.is_complete(self.next) or now >= self.due())

    def next_messages(self) -> Signals:
        """Return the messages of the next tick, and go on to the one after."""
        k = self.next
        messages = self._inbox.pop_until(k, keep_from=k + 1 - self._horizon)
        for message in messages.values():
            self.count_age(k, message)
        self.next += 1
        return messages

    def count_age(self, k: int, message: np.ndarray) -> None:
        """Count the age of a message that is taken in tick k."""
        self.ages[round(k - message[STAMP] / self._h)] += 1
