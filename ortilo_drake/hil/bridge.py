"""A listener on the bus: it puts the ticks of a flight together and passes them on to other systems.

It sends only hellos to the world and the goals of a user: without goals it does not affect the flight of the halves.
"""

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ortilo_drake.flight.signals import Signals
from ortilo_drake.hil.goals.goal_link import GoalLink, goal_text
from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.handshake import PATIENCE, find_world
from ortilo_drake.hil.wire.inbox import Inbox, PacketCounts, TickInbox
from ortilo_drake.hil.wire.packets import ANSWER, FINISHED, Goal, Outbox, ports
from ortilo_drake.hil.wire.unpack import Packet
from ortilo_drake.interop.mavlink import MavlinkBridge
from ortilo_drake.interop.ros.ros2 import Ros2Bridge
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

Target = Callable[[float, Signals, Signals], None]  # t [s], messages, outputs; as in interop/ros/ros_messages.py
Goals = Callable[[], np.ndarray | None]
LAG: Final = 6  # number of later ticks after which an incomplete tick is passed on
_POLL_MS: Final = 50
_ANSWERS: Final = 100


def mavlink_target(bridge: MavlinkBridge, scenario: Scenario, vision: bool = False) -> Target:
    """Return a target that sends every estimate, and a heartbeat every second of flight.

    The estimate may jump after a gap in which the failsafe flew; the jump counts as a reset. With `vision` the target
    sends VISION_POSITION_ESTIMATE in place of ODOMETRY.
    """
    rate, resets, last = scenario.control_rate, 0, -1
    longest = max(1.0, scenario.failsafe.timeout * rate)  # [ticks]; an answer in the very next tick leaves no gap
    send_estimate = bridge.send_vision if vision else bridge.send

    def send(t: float, messages: Signals, outputs: Signals) -> None:
        nonlocal resets, last
        k = round(t * rate)
        if k % max(1, round(rate)) == 0:
            bridge.send_heartbeat()
        if "estimate" in outputs:
            resets += 0 <= last < k - longest
            last = k
            send_estimate(t, outputs["estimate"], outputs["covariance"], resets)

    return send


def ros2_target(bridge: Ros2Bridge) -> Target:
    """Return a target that publishes every tick; the true state is left out, for it is not on the bus."""
    return lambda t, messages, outputs: bridge.send_tick(t, None, messages, outputs)


class TickCollector:
    """A collector that puts the packets of both halves together tick by tick, and yields the ticks in order."""

    def __init__(self) -> None:
        self._world = TickInbox()
        self._outputs: dict[int, Signals] = {}
        self._waiting: set[int] = set()
        self._picture: Packet | None = None
        self._first, self._last = -1, -1
        self.given = self.without_world = self.without_answer = 0

    @property
    def lost(self) -> int:
        """The number of ticks missing between the first and the last tick yielded."""
        return self._last + 1 - self._first - self.given if self.given else 0

    def put(self, packet: Packet) -> None:
        """Take a packet. A packet of a tick already yielded is dropped; but a picture goes with the next tick.

        In real time a picture takes longer than a tick to draw, so the tick's list of messages does not name it.
        """
        if packet.tick <= self._last:
            if packet.name == "image":
                self._picture = packet
            return
        self._waiting.add(packet.tick)
        if packet.name == "command":
            self._outputs.setdefault(packet.tick, {})["control"] = packet.value
        elif packet.name == "telemetry":
            self._outputs.setdefault(packet.tick, {}).update(packet.value)
        else:
            self._world.put(packet)

    def ready(self, lag: int = LAG) -> Iterator[tuple[int, Signals, Signals]]:
        """Yield (tick, messages, outputs) of complete ticks, and of ticks `lag` ticks or more older than the newest."""
        while self._waiting:
            k, newest = min(self._waiting), max(self._waiting)
            world, answer = self._world.is_complete(k), self._outputs.get(k, {}).keys() >= ANSWER
            if not (world and answer) and newest - k < lag:
                return
            self._waiting.remove(k)
            self._first = k if self._first < 0 else self._first
            self._last = k
            self.given += 1
            self.without_world += not world
            self.without_answer += not answer
            messages = self._world.pop(k)
            if self._picture and "image" not in messages:
                messages |= {"shutter": np.array([1.0, self._picture.stamp]), "image": self._picture.value}
                self._picture = None
            yield k, messages, self._outputs.pop(k, {})


def goals_target(goals: Goals, link: GoalLink, answers: deque[Goal], say: Callable[[str], None]) -> Target:
    """Return a target that passes a user's goals on to the onboard half, at every tick.

    `goals` returns the newest goal p_W (2 or more) [m] since the last call, of which x and y are used, or None. The
    target empties `answers`, the packets of the goals' channel. `say` takes a line about the outcome of each goal.
    """

    def pass_on(t: float, messages: Signals, outputs: Signals) -> None:
        p_W = goals()
        if p_W is not None:
            try:
                link.ask(p_W[0], p_W[1])
            except InputError as problem:
                say(str(problem))
        answer = link.turn(answers)
        answers.clear()
        if answer:
            say(f"{goal_text(answer)}: {answer.reason or 'flies there'}")

    return pass_on


@dataclass(frozen=True)
class BridgeReport:
    """The counts of ticks that a bridge passed on."""

    ticks: int
    """number of ticks passed on."""
    lost: int
    """number of ticks missing between the first and the last passed on."""
    without_world: int
    """number of ticks that lacked messages of the world; the onboard half goes on for some ticks after the end."""
    without_answer: int
    """number of ticks that lacked outputs of the onboard half."""
    packets: PacketCounts
    """counts of all packets."""
    failed: dict[str, str]
    """reasons of failure by name of the target."""

    def lines(self) -> dict[str, Any]:
        """Return the figures to print and to write as JSON, without lost packets, which belong to no channel."""
        data: dict[str, Any] = as_data(self)
        del data["packets"]["lost"]
        return data


def run_bridge(
    url: str,
    key: bytes,
    scenario: Scenario,
    targets: Mapping[str, Target],
    seconds: float | None = None,
    wait: float = 60.0,
    say: Callable[[str], None] = print,
    goals: Goals | None = None,
) -> BridgeReport:
    """Pass every tick of one flight on to targets, until the world says that it has finished.

    InputError if the bus does not work; if the world is not heard, flies another scenario or falls silent; or if every
    target has failed.

    Args:
        url: the bus, tcp://HOST:PORT.
        key: the key that the halves share, see key_file.py.
        scenario: the scenario of both halves.
        targets: functions that take the ticks, by name. A target that raises gets no more ticks, and a line says so.
        seconds: longest duration [s]; by default up to the end of the flight.
        wait: longest search for the world [s].
        say: takes a line when the bridge begins to listen, when a target failed, and about each goal.
        goals: returns the user's goals, see goals_target; by default there are none.
    """
    with Bus(url, key) as bus:
        inbox = Inbox(bus, ("hello", "tick", *ports(), "command", "telemetry", "goal"))
        say(f"listening on {url}")
        flight = find_world(bus, inbox, scenario, wait).flight
        ticks, alive, failed = TickCollector(), dict(targets), dict[str, str]()
        answers: deque[Goal] = deque(maxlen=_ANSWERS)
        if goals:
            alive["goals"] = goals_target(goals, GoalLink(Outbox(bus, flight.session), inbox), answers, say)
        heard = time.monotonic()
        end = heard + seconds if seconds is not None else np.inf
        finished = False
        while not finished and time.monotonic() < end:
            for _, packet in inbox.poll(_POLL_MS):
                if packet.name == "goal":
                    answers.append(packet.value)
                    continue  # a goal is no sign of life of the world: another user may have sent it
                if packet.name != "hello":
                    ticks.put(packet)
                elif packet.value.role == "world":
                    finished |= packet.value.state == FINISHED
                else:
                    continue
                heard = time.monotonic()
            for k, messages, outputs in ticks.ready(1 if finished else LAG):
                failed |= _hand_on(alive, k * scenario.h, messages, outputs, say)
            if not alive.keys() - {"goals"}:
                raise InputError(f"bridge: nothing left to send to ({'; '.join(failed)})")
            if time.monotonic() > heard + PATIENCE:
                raise InputError(f"world: silent for {PATIENCE:g} s")
        return BridgeReport(ticks.given, ticks.lost, ticks.without_world, ticks.without_answer, inbox.counts(), failed)


def _hand_on(
    targets: dict[str, Target], t: float, messages: Signals, outputs: Signals, say: Callable[[str], None]
) -> dict[str, str]:
    """Give a tick to each target; remove the targets that fail and return the reasons by name."""
    failed = {}
    for name, target in list(targets.items()):
        try:
            target(t, messages, outputs)
        except Exception as error:  # a library may raise any error; the other targets go on
            del targets[name]
            failed[name] = " ".join(str(error).split()) or type(error).__name__
            say(f"{name}: failed at {t:.3f} s and gets no more: {failed[name]}")
    return failed
