"""A flight of the two halves in lockstep: the world waits for each answer, so wall time has no influence.

The onboard half may be in this process or behind a link: the world only sees a function from a tick's messages to the
onboard half's outputs. The flight equals the one of flight/flight.py, bit for bit.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr

from ortilo_drake.flight.flight import CHECK_EVERY, flight_dataset
from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.flight.lost import find_loss
from ortilo_drake.flight.signals import Record, output_sizes
from ortilo_drake.flight.stepped_halves import OnboardHalf, Signals, WorldHalf
from ortilo_drake.model.signals import N_X
from ortilo_drake.scenario import Scenario

Ask = Callable[[int, Signals], Signals]  # a tick and its messages -> the onboard half's outputs at that tick


def in_this_process(scenario: Scenario) -> Ask:
    """Return a function that asks an onboard half in this process; call it for each tick in order, from 0."""
    onboard = OnboardHalf(scenario)

    def ask(tick: int, messages: Signals) -> Signals:
        onboard.receive(messages)
        outputs = onboard.outputs()
        onboard.advance()
        return outputs

    return ask


def fly_lockstep(
    scenario: Scenario,
    ask: Ask,
    progress: Callable[[int], None] | None = None,
    record: Record | None = None,
    world: WorldHalf | None = None,
) -> xr.Dataset:
    """Fly the world of a scenario with the commands of an onboard half.

    InputError as in fly.

    Args:
        scenario: the scenario.
        ask: gives the onboard half's outputs at a tick.
        progress: called with the number of ticks flown.
        record: called with the state, messages and outputs of each tick.
        world: the scenario's world, at its start; by default the function builds it, while the other half waits.

    Returns:
        The Dataset of flight.fly, without its real_time_factor.
    """
    ticks, room = flight_ticks(scenario), scenario.load_room()
    world = world or WorldHalf(scenario)
    names, rows = tuple(output_sizes(scenario.measurement)), list[np.ndarray]()
    for k in range(ticks + 1):
        x, messages = world.state, world.sample()
        outputs = ask(k, messages)
        rows.append(np.concatenate([x, *(outputs[name] for name in names)]))
        if record:
            record(k, x, messages, outputs)
        if progress and (k % CHECK_EVERY == 0 or k == ticks):
            progress(k)
        if find_loss(x[np.newaxis], scenario.h, room, scenario.vehicle):  # tumbling, its signals exceed the limits
            break
        if k < ticks:
            world.advance(outputs["control"])
    logged = np.array(rows)
    lost = find_loss(logged[:, :N_X], scenario.h, room, scenario.vehicle)
    end = lost.tick + 1 if lost else len(rows)
    flight = flight_dataset(scenario, np.arange(end) * scenario.h, logged[:end], lost)
    return flight.assign_attrs(player="drake")
