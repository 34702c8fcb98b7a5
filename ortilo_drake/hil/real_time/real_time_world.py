"""The world paced by the wall clock.

The world sends its messages at every tick t_k and polls for a command every millisecond. A command acts from the
millisecond after its receipt. While no command comes, the failsafe flies (world/vehicle/failsafe.py).
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from ortilo_drake.flight.flight import flight_dataset
from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.flight.lost import Lost, find_loss
from ortilo_drake.flight.signals import Record, Signals, output_sizes
from ortilo_drake.flight.stepped_halves import WorldHalf
from ortilo_drake.hil.real_time.camera_process import CameraProcess
from ortilo_drake.hil.real_time.tick_timing import TickTiming, TimingFigures
from ortilo_drake.hil.wire.handshake import Greeter
from ortilo_drake.hil.wire.inbox import Arrival, Inbox, PacketCounts
from ortilo_drake.hil.wire.packets import Outbox, publish_messages
from ortilo_drake.hil.wire.unpack import Packet
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.signals import STAMP
from ortilo_drake.scenario import Scenario


class FlightRecord:
    """A collector of a flight's ticks, which records each tick, in order, once its telemetry has had time to arrive.

    Lost outputs are recorded as NaN.
    """

    def __init__(self, scenario: Scenario, record: Record | None):
        self._record, self._sizes = record, output_sizes(scenario.measurement)
        self._states: list[np.ndarray] = []
        self._sent: list[Signals] = []
        self._heard: dict[int, Signals] = {}
        self._recorded = 0

    def send(self, x: np.ndarray, messages: Signals) -> None:
        """Add the true state x (12) and the messages of the next tick."""
        self._states.append(x)
        self._sent.append(messages)

    def receive(self, packet: Packet) -> None:
        """Add a packet with a command or telemetry."""
        outputs = {"control": packet.value} if packet.name == "command" else packet.value
        self._heard.setdefault(packet.tick, {}).update(outputs)

    def state(self, tick: int) -> np.ndarray:
        """Return the true state x (12) at a tick."""
        return self._states[tick]

    def outputs(self, tick: int) -> Signals:
        """Return the onboard half's outputs at a tick; NaN for outputs that never came."""
        heard = self._heard.get(tick, {})
        return {name: heard.get(name, np.full(size, np.nan)) for name, size in self._sizes.items()}

    def record_until(self, end: int) -> None:
        """Record the ticks before `end` that are not recorded yet."""
        for k in range(self._recorded, min(end, len(self._states))):
            if self._record:
                self._record(k, self._states[k], self._sent[k], self.outputs(k))
            self._sent[k] = {}
            self._recorded = k + 1

    def dataset(self, scenario: Scenario, lost: Lost | None) -> xr.Dataset:
        """Return the Dataset of the flight as flight.fly does, without the attributes player and real_time_factor."""
        rows = [np.concatenate([x, *self.outputs(k).values()]) for k, x in enumerate(self._states)]
        return flight_dataset(scenario, np.arange(len(rows)) * scenario.h, np.array(rows), lost)


@dataclass(frozen=True)
class FlightSoFar:
    """A flight under way: timing of its ticks, simulated time [s], counts of commands, mode (one of failsafe.MODES)."""

    timing: TimingFigures
    simulated_s: float
    packets: PacketCounts
    failsafe: str | None


Statistics = Callable[[], FlightSoFar]

COMMAND_PERIOD: Final = 1e-3  # period at which the world polls for a command [s]
SPIN: Final = 1.5e-3  # with less time left than this the world spins: a wait for a packet might return too late [s]
HEARTBEAT: Final = 0.1  # period of hellos in flight, for an onboard half that joins later [s]
LATE_TELEMETRY: Final = 0.5  # longest wait for the telemetry of a tick [s]


def fly_in_real_time(
    scenario: Scenario,
    world: WorldHalf,
    outbox: Outbox,
    inbox: Inbox,
    greeter: Greeter,
    camera: CameraProcess | None = None,
    seconds: float | None = None,
    progress: Callable[[int], None] | None = None,
    record: Record | None = None,
    show_statistics: Callable[[Statistics], None] | None = None,
) -> tuple[xr.Dataset, TickTiming]:
    """Fly a world in real time with the commands that come over a link.

    Args:
        scenario: the scenario.
        world: the world of the scenario, with COMMAND_PERIOD, at its start.
        outbox: sends to the onboard half.
        inbox: receives command and telemetry of this flight.
        greeter: says hello.
        camera: draws the pictures of a rendered camera, if there is one.
        seconds: end after this time of the flight [s]; by default at the end of the flight.
        progress: called with the number of every tick.
        record: called with state, messages and outputs of each tick LATE_TELEMETRY later; lost outputs are NaN.
        show_statistics: called before the first tick with a function that any thread may call for the figures so far.

    Returns:
        The flight as flight.fly returns it, with NaN where the telemetry of a tick was lost, and the timing of ticks.
    """
    ticks = flight_ticks(scenario) if seconds is None else round(seconds * scenario.control_rate)
    room, h, timing = scenario.load_room(), scenario.h, TickTiming(scenario.h)
    flown, command = FlightRecord(scenario, record), Command(scenario.vehicle.hover_thrust)
    heartbeat, lag = (max(1, round(seconds * scenario.control_rate)) for seconds in (HEARTBEAT, LATE_TELEMETRY))
    k, mode = 0, world.failsafe_mode
    if show_statistics:
        show_statistics(lambda: FlightSoFar(timing.summary(k), k * h, inbox.counts("command"), mode))
    start = time.perf_counter()

    def listen(until: float) -> None:
        """Take packets up to a time of the flight [s]."""
        for received, packet in _polled(inbox, start + until):
            if packet.name == "hello" or packet.tick > k + lag:
                continue  # no honest onboard half is that far ahead, even if the world was delayed
            flown.receive(packet)
            if packet.name == "command":
                timing.answered(packet.tick, received)
                command.receive(packet, min(received - start, until))

    lost: Lost | None = None
    for k in range(ticks + 1):
        mode = world.failsafe_mode
        x, messages = world.state, world.sample()
        flown.send(x, messages)
        shutter = messages.pop("shutter", None)
        if camera and shutter is not None:
            camera.shoot(outbox.session, k, shutter[STAMP], flown.state(tick_of(shutter[STAMP], h)))
        publish_messages(outbox, k, messages)
        timing.sent(start + k * h, time.perf_counter())
        if k % heartbeat == 0:
            greeter.say(k)
        if progress:
            progress(k)
        lost = find_loss(x[np.newaxis], h, room, scenario.vehicle, k)
        if lost or k == ticks:
            break
        moments = look_times(k * h, (k + 1) * h)
        for i, moment in enumerate(moments):
            listen(moment)
            world.advance_to(moment, command.value, command.tick * h)
            if i == len(moments) // 2:  # halfway, where recording delays neither this tick's command nor the next tick
                flown.record_until(k - lag)
    listen(time.perf_counter() - start + LATE_TELEMETRY)
    flown.record_until(k + 1)
    flight = flown.dataset(scenario, lost)
    flight.attrs["real_time_factor"] = timing.summary().real_time_factor
    return flight, timing


def look_times(begin: float, end: float) -> list[float]:
    """Return the times [s] at which the world polls for commands: multiples of COMMAND_PERIOD, and the tick's end."""
    first, last = math.floor(begin / COMMAND_PERIOD + 1e-6) + 1, math.ceil(end / COMMAND_PERIOD - 1e-6)
    return [*(n * COMMAND_PERIOD for n in range(first, last)), end]


class Command:
    """The newest command: its tick, and its value u (4) with time of receipt [s of the flight]; hover at the start."""

    def __init__(self, hover_thrust: float):
        self.value = np.array([hover_thrust, 0.0, 0.0, 0.0, 0.0])
        self.tick = -1

    def receive(self, packet: Packet, received: float) -> None:
        """Take a command, unless a newer command came before."""
        if packet.tick > self.tick:
            self.tick = packet.tick
            self.value[:4], self.value[4] = packet.value, received


def _polled(inbox: Inbox, until: float) -> Iterator[Arrival]:
    """Yield the packets that arrive up to a time of time.perf_counter() [s]."""
    while True:
        left = until - time.perf_counter()
        yield from inbox.poll(1 if left > SPIN else 0)
        if left <= 0.0:
            return
        if left < SPIN:
            time.sleep(min(left, 2e-4))
