"""The companion's clock for an autopilot: answers to TIMESYNC, so that a PX4 maps the stamps of estimates to its own.

A request has tc1 = 0 and in ts1 the asker's clock [ns]. The answer gives ts1 back, with the own clock in tc1 (MAVLink,
time synchronisation protocol). PX4 (Timesync.cpp) asks 10 times a second on a link of mode Onboard, ignores answers
that took 10 ms or longer, and trusts its offset after 500. Until then, and without answers, it stamps each estimate
when it comes. So answers need a thread that waits for requests: the bridge's loop sleeps longer than that.
"""

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from types import TracebackType
from typing import Final

from ortilo_drake.interop.mavlink import MavlinkBridge

ID: Final = bytes([111, 0, 0])  # TIMESYNC's number as each of its MAVLink 2 packets contains it
OTHER_CLOCK: Final = 1.0  # stamps that are so far from the companion's clock are of another [s]
GRACE: Final = 10.0  # so long all stamps must be off: a process that catches up takes in old ones for a while [s]
BEAT: Final = 1.0  # between two heartbeats [s]; a router learns by them where requests have to go


class TimesyncThread:
    """Sends heartbeats and answers TIMESYNC in a thread of its own, from entering to leaving; clock returns ns.

    An autopilot that maps stamps of another clock by these answers would fuse estimates of years ago: `check_stamp`
    ends the answers for good when all stamps of GRACE are such ones, and says so. PX4 trusts its offset no earlier than
    50 s after the first answer.
    """

    def __init__(self, bridge: MavlinkBridge, say: Callable[[str], None], clock: Callable[[], int] = time.time_ns):
        self._bridge, self._say, self._clock = bridge, say, clock
        self._common = import_module("pymavlink.dialects.v20.common")
        self._answers, self._off_since, self._ended = True, math.inf, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "TimesyncThread":
        """Begin."""
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End the thread; the socket is its owner's to close."""
        self._ended.set()
        self._thread.join()

    def check_stamp(self, stamp: float) -> None:
        """Compare a stamp that has just come [s], -inf for none, with the clock that is answered with."""
        now = 1e-9 * self._clock()
        off = stamp - now
        if not stamp > 0.0:
            return
        if abs(off) <= OTHER_CLOCK:
            self._off_since = math.inf
            return
        self._off_since = min(self._off_since, now)
        if self._answers and now - self._off_since >= GRACE:
            self._answers = False
            self._say(
                f"warning  stamps are {abs(off):.3g} s {'ahead of' if off > 0.0 else 'behind'} this machine's clock: "
                "TIMESYNC is not answered any more; reboot the autopilot, and give EKF2_EV_DELAY the median of late ms"
            )

    def answer(self, packet: bytes) -> None:
        """Answer the requests in a packet; whatever else it contains is ignored."""
        now = self._clock()
        if not self._answers or ID not in packet:
            return
        parser = self._common.MAVLink(None)
        parser.robust_parsing = True
        for message in parser.parse_buffer(packet) or []:
            if message.get_type() == "TIMESYNC" and message.tc1 == 0:
                self._bridge.send_timesync(now, message.ts1)

    def _run(self) -> None:
        beat = -float("inf")
        while not self._ended.is_set():
            with suppress(OSError):  # a network that is down may come back
                if time.monotonic() >= beat:
                    beat = time.monotonic() + BEAT
                    self._bridge.send_heartbeat()
                packet = self._bridge.receive()
                if packet is not None:
                    self.answer(packet)
