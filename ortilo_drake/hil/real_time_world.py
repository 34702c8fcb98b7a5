"""The world paced by the wall clock.

It sends its messages at every tick t_k and looks for a command every millisecond; a command acts from the millisecond
after it came. What flies while none comes is the failsafe's affair (world/failsafe.py).
"""

import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import xarray as xr
from pydrake.lcm import DrakeLcm

from ortilo_drake.experiments.flight import flight_dataset, flight_ticks
from ortilo_drake.experiments.lost import Lost, find_loss
from ortilo_drake.hil.camera_process import CameraProcess
from ortilo_drake.hil.halves import OUTPUTS, Signals, WorldHalf
from ortilo_drake.hil.handshake import say_hello, scenario_digest
from ortilo_drake.hil.lockstep import Record
from ortilo_drake.hil.packets import Hello
from ortilo_drake.hil.transport import Inbox
from ortilo_drake.hil.watch import Watch
from ortilo_drake.hil.wire import publish_messages
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.signals import STAMP
from ortilo_drake.scenario import Scenario

Figures = Callable[[], dict[str, Any]]  # the figures of a flight so far

COMMAND_PERIOD: Final = 1e-3  # [s]
HEARTBEAT: Final = 0.1  # how often the world says hello in flight, for an onboard half that joins it then [s]
LATE_TELEMETRY: Final = 0.5  # how long after the last tick telemetry is waited for [s]


def fly_in_real_time(
    scenario: Scenario,
    world: WorldHalf,
    lcm: DrakeLcm,
    inbox: Inbox,
    session: int,
    camera: CameraProcess | None = None,
    seconds: float | None = None,
    progress: Callable[[int], None] | None = None,
    record: Record | None = None,
    watching: Callable[[Figures], None] | None = None,
) -> tuple[xr.Dataset, Watch]:
    """Fly a world in real time on the commands that come over a link.

    Args:
        scenario: the scenario.
        world: its world, with COMMAND_PERIOD, at the start.
        lcm: the bus.
        inbox: hears command and telemetry of this flight.
        session: of this flight.
        camera: draws the pictures, if there is a rendered camera.
        seconds: end after that much of the flight; by default at its end.
        progress: called at every tick with the number of it.
        record: called with everything of a tick once it is over; outputs that were lost are NaN.
        watching: called before the first tick with a function that gives the figures so far, in any thread:
            Watch.summary, simulated_s, packets and failsafe.

    Returns:
        The flight, as experiments.flight.fly gives it but NaN where the telemetry of a tick was lost, and the watch.
    """
    ticks = flight_ticks(scenario) if seconds is None else round(seconds * scenario.control_rate)
    room, h, watch = scenario.load_room(), scenario.h, Watch(scenario.h)
    states: list[np.ndarray] = []
    sent: list[Signals] = []
    telemetry: dict[int, Signals] = {}
    command, command_tick = np.array([scenario.vehicle.hover_thrust, 0.0, 0.0, 0.0, 0.0]), -1
    hello = Hello("world", scenario_digest(scenario), session)
    heartbeat = max(1, round(HEARTBEAT * scenario.control_rate))
    k, mode = 0, world.failsafe_mode
    if watching:
        watching(
            lambda: watch.summary(k) | {"simulated_s": k * h, "packets": inbox.counts("command"), "failsafe": mode}
        )
    start = time.perf_counter()

    def listen(until: float) -> None:
        """Take what comes until a time on the clock, and return then."""
        nonlocal command_tick
        while True:
            left = until - time.perf_counter()
            for received, packet in inbox.poll(1 if left > 1.5e-3 else 0):
                if packet.name == "telemetry":
                    telemetry.setdefault(packet.tick, {}).update(packet.value)
                elif packet.name == "command":
                    watch.answered(packet.tick, received)
                    telemetry.setdefault(packet.tick, {})["control"] = packet.value
                    if packet.tick > command_tick:  # an older one that was overtaken is of no use
                        command_tick = packet.tick
                        command[:4], command[4] = packet.value, min(received - start, simulated)
            if left <= 0.0:
                return
            if left < 1.5e-3:
                time.sleep(min(left, 2e-4))

    lost: Lost | None = None
    simulated, step = 0.0, 0
    for k in range(ticks + 1):
        due, mode = start + k * h, world.failsafe_mode
        x, messages = world.state, world.sample()
        states.append(x)
        if camera and (shutter := messages.pop("shutter", None)) is not None:
            camera.shoot(session, k, shutter[STAMP], states[tick_of(shutter[STAMP], h)])
        publish_messages(lcm, session, k, messages)
        watch.sent(due, time.perf_counter())
        if k % heartbeat == 0:
            say_hello(lcm, hello)
        sent.append(messages)
        if progress:
            progress(k)
        lost = find_loss(x[np.newaxis], h, room, scenario.vehicle)
        if lost:
            lost = Lost(k, k * h, lost.cause)
        if lost or k == ticks:
            break
        while simulated < (k + 1) * h:
            step += 1
            while step * COMMAND_PERIOD <= simulated:
                step += 1
            simulated = min(step * COMMAND_PERIOD, (k + 1) * h)
            if simulated < step * COMMAND_PERIOD:
                step -= 1
            listen(start + simulated)
            world.advance_to(simulated, command)
    simulated = np.inf
    listen(time.perf_counter() + LATE_TELEMETRY)
    outputs = [telemetry.get(k, {}) for k in range(len(states))]
    for k, known in enumerate(outputs):
        outputs[k] = {name: known.get(name, np.full(size, np.nan)) for name, size in OUTPUTS.items()}
        if record:
            record(k, states[k], sent[k], outputs[k])
    logged = np.array(
        [np.concatenate([x, *(known[name] for name in OUTPUTS)]) for x, known in zip(states, outputs, strict=True)]
    )
    flight = flight_dataset(scenario, np.arange(len(states)) * h, logged, lost)
    flight.attrs["real_time_factor"] = watch.summary()["real_time_factor"]
    return flight, watch
