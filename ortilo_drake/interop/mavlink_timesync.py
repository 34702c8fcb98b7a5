"""The companion's clock for an autopilot: with the answers to TIMESYNC a PX4 maps stamps of estimates to its own clock.

A request has tc1 = 0 and the asker's clock in ts1 [ns]. The answer returns ts1, with the companion's clock in tc1
(MAVLink, time synchronisation protocol). PX4 (Timesync.cpp) asks 10 times a second on a link of mode Onboard, ignores
answers that took 10 ms or longer, and trusts its offset after 500 answers. Until then, and without answers, PX4 stamps
each estimate on arrival. The bridge's loop sleeps longer than 10 ms, so a separate thread waits for requests.
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

ID: Final = bytes([111, 0, 0])  # the message number of TIMESYNC, as in every MAVLink 2 packet of it
OTHER_CLOCK: Final = 1.0  # a stamp farther than this from the companion's clock comes from another clock [s]
GRACE: Final = 10.0  # time for which all stamps must be off: a process that catches up reads old ones for a while [s]
BEAT: Final = 1.0  # period of heartbeats [s]; a router learns from them where to send requests


class TimesyncThread:
    """A thread that sends heartbeats and answers TIMESYNC from entering to leaving; `clock` returns ns.

    If the stamps come from another clock, an autopilot that maps them with these answers would fuse estimates as if
    they were years old. So when all stamps within GRACE come from another clock, `check_stamp` ends the answers for
    good and says so. PX4 trusts its offset no earlier than 50 s after the first answer.
    """

    def __init__(self, bridge: MavlinkBridge, say: Callable[[str], None], clock: Callable[[], int] = time.time_ns):
        self._bridge, self._say, self._clock = bridge, say, clock
        self._common = import_module("pymavlink.dialects.v20.common")
        self._answers, self._off_since, self._ended = True, math.inf, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "TimesyncThread":
        """Start the thread."""
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End the thread; the owner of the bridge closes the socket."""
        self._ended.set()
        self._thread.join()

    def check_stamp(self, stamp: float) -> None:
        """Compare a stamp that has just come [s], -inf for none, with the clock of the answers."""
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
        """Answer the TIMESYNC requests in a packet; other messages are ignored."""
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
