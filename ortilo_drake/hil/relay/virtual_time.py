"""A flight behind a relay in virtual time: the same as in real time, but without waiting.

The world's millisecond, the relay's faults and the onboard half's ticks are those of real_time_world.py, relay.py and
real_time_onboard.py. But time is counted instead of waited for, and computing takes no time. So comparisons of faults
and filters repeat bit for bit, on any machine under any load.
"""

import heapq
import itertools
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr

from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.flight.lost import find_loss
from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.flight.store import in_folder, keep_json, kept_json
from ortilo_drake.flight.summary import Summary
from ortilo_drake.hil.real_time.real_time_onboard import OnboardTicks, join_flight
from ortilo_drake.hil.real_time.real_time_world import COMMAND_PERIOD, Command, FlightRecord, look_times
from ortilo_drake.hil.relay.relay import FaultModel, Faults
from ortilo_drake.hil.wire.unpack import Packet
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, with_seed

NONE: Final = Faults()


class _Way:
    """The packets on their way in one direction of the relay, in virtual time."""

    def __init__(self, faults: FaultModel):
        self._faults, self._order = faults, itertools.count()
        self._due: list[tuple[float, int, Packet]] = []
        self._seen: set[tuple[str, int]] = set()

    def send(self, packet: Packet, now: float) -> None:
        for due in self._faults.due_times(packet.name, now):
            heapq.heappush(self._due, (due, next(self._order), packet))

    def arrived(self, now: float) -> list[tuple[float, Packet]]:
        """Return the packets that arrived up to `now` [s], with their times and without duplicates, as inbox.Inbox."""
        came = []
        while self._due and self._due[0][0] <= now:
            due, _, packet = heapq.heappop(self._due)
            if (packet.name, packet.tick) not in self._seen:
                self._seen.add((packet.name, packet.tick))
                came.append((due, packet))
        return came


def fly_in_virtual_time(
    scenario: Scenario, to_onboard: Faults = NONE, to_world: Faults = NONE, seed: int = 1
) -> xr.Dataset:
    """Fly both halves of a scenario behind a relay with the given seed and return the flight; no telemetry is lost.

    InputError if the scenario renders pictures, which take time.
    """
    if scenario.is_rendered:
        raise InputError(f"{scenario.name}: camera: must be 'projected' in virtual time")
    world, onboard = WorldHalf(scenario, COMMAND_PERIOD), OnboardHalf(scenario)
    there, back = _Way(FaultModel(to_onboard, seed, "to_onboard")), _Way(FaultModel(to_world, seed, "to_world"))
    ticks, flown, command = OnboardTicks(scenario), FlightRecord(scenario, None), Command(scenario.vehicle.hover_thrust)
    room, h, end, lost = scenario.load_room(), scenario.h, flight_ticks(scenario), None

    def answer(now: float) -> None:
        for received, packet in there.arrived(now):
            joins = ticks.first is None
            ticks.receive(packet, received)
            if joins and ticks.first:
                join_flight(onboard, None, 0, ticks.first, h)
        while ticks.begins(now):
            k = ticks.next
            onboard.receive(ticks.next_messages())
            outputs = onboard.outputs()
            back.send(Packet("command", k, outputs["control"]), now)
            flown.receive(Packet("telemetry", k, outputs))
            onboard.advance()

    for k in range(end + 1):
        x, messages = world.state, world.sample()
        flown.send(x, messages)
        for name, value in messages.items():
            there.send(Packet(name, k, value), k * h)
        there.send(Packet("tick", k, tuple(messages)), k * h)
        answer(k * h)
        lost = find_loss(x[np.newaxis], h, room, scenario.vehicle, k)
        if lost or k == end:
            break
        for moment in look_times(k * h, (k + 1) * h):
            answer(moment)
            for received, packet in back.arrived(moment):
                command.receive(packet, received)
            world.advance_to(moment, command.value, command.tick * h)
    flight = flown.dataset(scenario, lost)
    flight.attrs["real_time_factor"] = np.nan
    return flight


def summary_in_virtual_time(scenario_json: str, to_onboard: str, to_world: str, seed: int, file: str) -> Summary:
    """Fly a scenario with a seed behind a relay with the seed + 1; write and return the flight's summary.

    For worker processes: scenario and faults come as JSON. An existing file is read instead, unless it is damaged.
    """
    path = Path(file)
    there: Summary | None = kept_json(path, Summary, in_folder(path))
    if there is not None:
        return there
    scenario = with_seed(Scenario.model_validate_json(scenario_json), seed)
    ways = Faults.model_validate_json(to_onboard), Faults.model_validate_json(to_world)
    found = summary(fly_in_virtual_time(scenario, *ways, seed + 1))
    keep_json(path, found, in_folder(path))
    return found
