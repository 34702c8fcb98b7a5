"""A profile of the onboard half: the time that each block takes on this machine.

Two onboard halves take the same messages, tick by tick, in lockstep with a world. One does its tick as in flight, timed
as a whole. In the other every output port is evaluated on its own, in dataflow order, and then every block's discrete
update: Drake keeps what is evaluated already, so each time is that block's alone. What the whole took beyond the sum of
its blocks is Drake's: putting the messages (and a picture) on the input ports, events, caches, the context.

The world and its pictures are not timed, nor is the link. A detector is timed as a block here, on the tick; in flight
in real time it has its own thread (hil/real_time/detector_thread.py).
"""

import time
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram, OutputPort, System

from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.flight.stepped_halves import OnboardHalf, Signals, WorldHalf
from ortilo_drake.hil.real_time.warm_up import TICKS, warm_up
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

Row = dict[str, Any]
PROFILE_TICKS = 600  # that the command times
WHOLE, REST = "whole tick", "Drake"  # the two rows that are not blocks


def dataflow_order(diagram: Diagram) -> list[OutputPort]:
    """Return the output ports of a Diagram's systems, each after those that its value depends on."""
    sources = {
        (to.get_name(), int(i)): (of.get_name(), int(j)) for (to, i), (of, j) in diagram.connection_map().items()
    }
    systems = {system.get_name(): system for system in diagram.GetSystems()}
    ports = {(name, j): s.get_output_port(j) for name, s in systems.items() for j in range(s.num_output_ports())}
    order: dict[tuple[str, int], OutputPort] = {}

    def append(key: tuple[str, int]) -> None:
        if key in order:
            return
        system = systems[key[0]]
        for i in range(system.num_input_ports()):
            if (key[0], i) in sources and system.HasDirectFeedthrough(i, key[1]):
                append(sources[key[0], i])
        order[key] = ports[key]

    for key in ports:  # the recursion ends, as Drake refuses algebraic loops
        append(key)
    return list(order.values())


def updating_systems(diagram: Diagram) -> list[System]:
    """Return the systems of a Diagram that have a discrete update."""
    return [s for s in diagram.GetSystems() if s.GetUniquePeriodicDiscreteUpdateAttribute() is not None]


def time_blocks(onboard: OnboardHalf, ports: list[OutputPort], updating: list[System]) -> dict[str, float]:
    """Evaluate block by block a tick whose messages were taken; return the time of each block [s]."""
    context = onboard.context
    spent = dict.fromkeys((port.get_system().get_name() for port in ports), 0.0)
    of_ports = [(port, port.get_system().GetMyContextFromRoot(context)) for port in ports]
    of_systems: list[tuple[System, Context]] = [(system, system.GetMyContextFromRoot(context)) for system in updating]
    for port, its_context in of_ports:
        name = port.get_system().get_name()
        begin = time.perf_counter()
        port.Eval(its_context)
        spent[name] += time.perf_counter() - begin
    for system, its_context in of_systems:
        name = system.get_name()
        begin = time.perf_counter()
        system.EvalUniquePeriodicDiscreteUpdate(its_context)
        spent[name] = spent.get(name, 0.0) + time.perf_counter() - begin
    return spent


def time_whole(onboard: OnboardHalf, messages: Signals) -> tuple[Signals, float]:
    """Do a whole tick as in flight; return its outputs and its time [s]."""
    begin = time.perf_counter()
    onboard.take(messages)
    onboard.answer()
    outputs = onboard.outputs()
    onboard.advance()
    return outputs, time.perf_counter() - begin


def rows_of(spent: dict[str, np.ndarray], whole: np.ndarray) -> list[Row]:
    """Return the table: the blocks, the costliest first, then Drake's rest and the whole tick.

    Args:
        spent: the time of each block in every tick [s].
        whole: the time of every whole tick [s].

    Returns:
        block; median_us and p99_us over the ticks; share of all the time, from 0 to 1. Drake's may be below 0,
        as the times scatter.
    """
    rest = whole - sum(spent.values(), start=np.zeros_like(whole))
    blocks = sorted(spent, key=lambda name: -float(np.sum(spent[name])))
    columns = {name: spent[name] for name in blocks} | {REST: rest, WHOLE: whole}
    return [
        {
            "block": name,
            "median_us": 1e6 * float(np.median(times)),
            "p99_us": 1e6 * float(np.quantile(times, 0.99)),
            "share": float(np.sum(times) / np.sum(whole)),
        }
        for name, times in columns.items()
    ]


def profile_onboard(scenario: Scenario, ticks: int) -> list[Row]:
    """Fly the first ticks of a scenario in this process and time the onboard half; return the rows of rows_of.

    Args:
        scenario: the scenario.
        ticks: how many to time; as many as the flight has, if it has fewer. A few before them are not timed.

    Raises:
        InputError: if there is no tick to time.
    """
    last = min(ticks + TICKS, flight_ticks(scenario))
    if last <= TICKS:
        raise InputError(f"ticks: {ticks} of {flight_ticks(scenario)}: at least 1, in a flight of more than {TICKS}")
    warm_up(scenario)
    world, flying, timed = WorldHalf(scenario), OnboardHalf(scenario), OnboardHalf(scenario)
    ports, updating = dataflow_order(timed.diagram), updating_systems(timed.diagram)
    blocks, wholes = [], []
    for _ in range(last):
        messages = world.sample()
        outputs, whole = time_whole(flying, messages)
        timed.take(messages)
        blocks.append(time_blocks(timed, ports, updating))
        timed.advance()
        wholes.append(whole)
        world.advance(outputs["control"])
    spent = {name: np.array([block[name] for block in blocks[TICKS:]]) for name in blocks[0]}
    return rows_of(spent, np.array(wholes[TICKS:]))
