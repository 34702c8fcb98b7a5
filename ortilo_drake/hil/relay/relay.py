"""A process between the halves that passes their packets on, with faults.

Each half has a bus of its own. The world serves its bus and the relay joins it; the relay serves the onboard half's,
which joins that. Listeners, and users who ask for a goal, are on the world's bus. Both buses have the same key.
"""

import heapq
import itertools
import time
from functools import partial
from threading import Event
from typing import Final

from ortilo_drake.hil.relay.faults import FaultModel, Faults
from ortilo_drake.hil.wire.address import address
from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.packets import NO_TICK, channel_of, ports
from ortilo_drake.hil.wire.urls import DEFAULT_URL, ONBOARD_URL
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.world.noise import stream_id, uniforms

_FROM_ONBOARD: Final = ("command", "telemetry")
_FROM_ONBOARD_LARGEST: Final = 2**18  # bytes: telemetry of a sensor with 170 rows; pictures only go the other way
_WAIT = 1  # [ms]


class _Direction:
    """Packets on their way from one half's bus to the other's, the next due first."""

    def __init__(self, half: str, source: Bus, target: Bus, faults: FaultModel):
        self._target, self.faults = target, faults
        self._due: list[tuple[float, int, str, bytes]] = []
        self._order = itertools.count()  # breaks ties, first come first served
        for name in (*_FROM_ONBOARD, *NO_TICK) if half == "onboard" else (*ports(), "tick", *NO_TICK):
            source.subscribe(channel_of(name), partial(self._take, name))

    def _take(self, name: str, data: bytes) -> None:
        for due in self.faults.due_times(name, time.monotonic()):
            heapq.heappush(self._due, (due, next(self._order), channel_of(name), data))

    def release(self, now: float) -> None:
        """Publish what is due."""
        while self._due and self._due[0][0] <= now:
            _, _, channel, data = heapq.heappop(self._due)
            self._target.publish(channel, data)
            self.faults.counts["sent"] += 1


def run_relay(
    key: bytes,
    url_world: str = DEFAULT_URL,
    url_onboard: str = ONBOARD_URL,
    to_onboard: Faults | None = None,
    to_world: Faults | None = None,
    seed: int = 1,
    seconds: float = float("inf"),
    stop: Event | None = None,
    ready: Event | None = None,
) -> dict[str, dict[str, int]]:
    """Pass packets on until the seconds are over, `stop` is set or Ctrl-C is pressed; then return their counts.

    The world serves one bus, the relay the onboard half's, with the same key; `ready` is set once it listens. The
    faults of each direction, none by default, are drawn by the seed. The counts, for "to_onboard" and "to_world", are
    of packets taken, lost, crowded (out of a full queue), duplicated and sent; those taken and not yet due at the end
    are not sent. InputError if a bus cannot be opened or both are the same.
    """
    if address(url_world) == address(url_onboard):
        raise InputError(f"url: {url_world!r}: the relay needs two different buses, one for each half")
    with (
        Bus(url_world, key) as world,
        Bus(url_onboard, key, serves=True, largest=_FROM_ONBOARD_LARGEST) as onboard,
    ):
        directions = {
            "to_onboard": _Direction("world", world, onboard, FaultModel(to_onboard or Faults(), seed, "to_onboard")),
            "to_world": _Direction("onboard", onboard, world, FaultModel(to_world or Faults(), seed, "to_world")),
        }
        uniforms(seed, stream_id("compile now"), 0, 1)  # so that numba does not compile at the first packet
        if ready:
            ready.set()
        end = time.monotonic() + seconds
        try:
            while time.monotonic() < end and not (stop and stop.is_set()):
                world.handle(_WAIT)
                onboard.handle(0)
                for each in directions.values():
                    each.release(time.monotonic())
        except KeyboardInterrupt:
            pass
        return {name: dict(each.faults.counts) for name, each in directions.items()}
