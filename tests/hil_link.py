"""Buses that only one test on this machine uses, and an onboard half that answers on a bus."""

import secrets
import select
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from waiting import HANGS, wait_for

from ortilo_drake.flight.stepped_halves import OnboardHalf
from ortilo_drake.hil.lockstep_link import answer_over_link
from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.handshake import Greeter, draw, flight_of, meet_world
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.packets import Goal, Outbox, ports
from ortilo_drake.hil.wire.unpack import Flight
from ortilo_drake.scenario import Scenario, load_scenario

KEY = 32 * b"k"  # key that the halves share
_OPEN: list[Bus] = []
PORTS_TO_TRY = range(20_000, 32_000)  # below the ports that the kernel assigns by itself


@contextmanager
def own_bus() -> Iterator[str]:
    """Yield the URL of a bus whose port only this test uses until it ends, whatever else runs on this machine.

    Holding the UDP port of the same number reserves the bus; the TCP port stays free for the server of the bus.
    """
    while True:
        port = PORTS_TO_TRY[secrets.randbelow(len(PORTS_TO_TRY))]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as held, socket.socket() as free:
            try:
                held.bind(("127.0.0.1", port))
                free.bind(("127.0.0.1", port))
            except OSError:
                continue
            free.close()
            try:
                yield f"tcp://127.0.0.1:{port}"
            finally:
                while _OPEN:
                    _OPEN.pop().close()
            return


def open_bus(url: str, serves: bool = False, key: bytes = KEY) -> Bus:
    """Open a bus; it is closed when own_bus ends."""
    _OPEN.append(Bus(url, key, serves))
    return _OPEN[-1]


def greeting(mechanism: bytes) -> bytes:
    """Return the first bytes that a ZeroMQ client (ZMTP 3.1) with a security mechanism sends."""
    return b"\xff" + bytes(8) + b"\x7f\x03\x01" + mechanism.ljust(20, b"\0") + bytes(32)


def refuses(url: str, size: int) -> bool:
    """Return whether the server of a bus refuses a message of this size from a client that has shown no key.

    Only the size of the message is sent. If the server does not refuse it, the client's connection lasts longer than a
    silent connection that was opened before. If it does, a machine that stands still may yet end the silent one first:
    that is tried again.
    """
    return any(_is_closed_early(url, size) for _ in range(2))


def _is_closed_early(url: str, size: int) -> bool:
    at = "127.0.0.1", int(url.rpartition(":")[2])
    with socket.create_connection(at) as silent, socket.socket() as stranger:
        silent.recv(1)  # the server now waits for the silent connection ...
        time.sleep(0.2)  # ... and closes it this much sooner than the other
        stranger.connect(at)
        stranger.sendall(greeting(b"CURVE") + b"\x06" + size.to_bytes(8, "big"))
        while True:
            ready, _, _ = select.select((silent, stranger), (), (), HANGS)
            assert ready, f"no connection is closed in {HANGS:g} s"
            for end in ready:  # the silent one first
                try:
                    is_open = bool(end.recv(100))
                except ConnectionError:
                    is_open = False
                if not is_open:
                    return end is stranger


def wait_for_message(bus: Bus) -> None:
    """Return once a message waits at an end of a bus, which handle has not taken yet."""
    wait_for(lambda: bus._socket.poll(10), "a message")


class Loop:
    """A replacement of a bus that returns published messages to its own subscribers."""

    def __init__(self) -> None:
        self.refused = Counter[str]()
        self._takers: dict[str, list[Callable[[bytes], None]]] = {}
        self._queue: list[tuple[str, bytes]] = []

    def publish(self, channel: str, data: bytes) -> None:
        self._queue.append((channel, data))

    def subscribe(self, channel: str, take: Callable[[bytes], None]) -> None:
        self._takers.setdefault(channel, []).append(take)

    def unsubscribe(self, channel: str, take: Callable[[bytes], None]) -> None:
        self._takers[channel].remove(take)

    def handle(self, timeout_ms: int = 0) -> int:
        came, self._queue = self._queue, []
        for channel, data in came:
            for take in self._takers.get(channel, ()):
                take(data)
        return len(came)


def settle(server: Bus, *others: Bus) -> None:
    """Wait until all have joined a bus: the server got a message from each, and each got one from the server.

    They count anew what they refuse: until then a busy machine may have been too slow for a handshake.
    """
    came = [0] * (len(others) + 1)

    def count(i: int) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            came[i] += 1

        return take

    takers = [count(i) for i in range(len(came))]
    for i, bus in enumerate((server, *others)):
        bus.subscribe("SETTLE", takers[i])

    def is_settled() -> bool:
        for bus in (server, *others):
            bus.publish("SETTLE", b"")
            bus.handle(5)
        return came[0] > len(others) and all(came)

    wait_for(is_settled, "all have joined")
    for i, bus in enumerate((server, *others)):
        while bus.handle(50):
            pass
        bus.unsubscribe("SETTLE", takers[i])
        bus.refused.clear()


def key_file(folder: Path) -> Path:
    """Write KEY to a file in a folder; return the file's path."""
    file = folder / "key"
    file.touch(0o600)
    file.write_text(KEY.hex())
    return file


def flight_for_packets(session: int = 77, shape: tuple[int, int] | None = None) -> Flight:
    """Return a flight of nominal_imu_uwb_yolo (30 Hz) with pictures of this shape."""
    scenario = load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected",))
    return flight_of(scenario, session)._replace(shape=shape)


class PlayedWorld:
    """A flying world as seen by those who join or listen; it receives hello and goals."""

    def __init__(self, url: str, scenario: Scenario):
        self.bus = open_bus(url, serves=True)
        self.inbox, self._greeter = Inbox(self.bus, ("hello", "goal")), Greeter(self.bus, scenario, False)
        self.flight = self._greeter.meet(draw())
        self.inbox.begin(self.flight)
        self.outbox = Outbox(self.bus, self.flight.session)

    def turn(self, tick: int, state: str = "") -> list[Goal]:
        """Send hello at a tick; return the goals that users sent since the last turn."""
        heard = [arrival.packet.value for arrival in self.inbox.poll()]
        self._greeter.say(tick, state)
        return [goal for goal in heard if isinstance(goal, Goal) and goal.role == "user"]

    def close(self) -> None:
        """Close the bus."""
        _OPEN.remove(self.bus)
        self.bus.close()


@contextmanager
def answering(scenario: Scenario, bus: str, after_user: bool = False) -> Iterator["Future[int]"]:
    """Run the onboard half of one flight in lockstep in a thread; yield the future number of answered ticks.

    With `after_user` the half answers the world only once a user has, so that the user hears the flight from its start.
    """
    joined = open_bus(bus)
    inbox, onboard = Inbox(joined, ("hello", "goal", "tick", *ports())), OnboardHalf(scenario)

    def user_has_answered() -> bool:
        return any(arrival.packet.value.role == "user" for arrival in inbox.poll(10))

    def answer() -> int:
        if after_user:
            wait_for(user_has_answered, "a user has answered the world")
        flight = meet_world(joined, inbox, scenario, HANGS).flight
        return answer_over_link(onboard, Outbox(joined, flight.session), inbox)

    with ThreadPoolExecutor(1) as pool:
        answered = pool.submit(answer)
        yield answered
        answered.result(HANGS)
