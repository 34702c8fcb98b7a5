"""A profile of the onboard half: the time that each block takes on this machine.

Two onboard halves take the same messages, tick by tick, in lockstep with a world. One does its tick as in flight, timed
as a whole. In the other every output port is evaluated on its own, in dataflow order, and then every block's discrete
update: Drake keeps what is evaluated already, so each time is that block's alone. A block is a leaf of the onboard
Diagram or of a Diagram in it, such as the estimator. What the whole took beyond the sum of its blocks is Drake's:
putting the messages (and a picture) on the input ports, events, caches, the context.

The world and its pictures are not timed, nor is the link. A detector is timed as a block here, on the tick; in flight
in real time it has its own thread (hil/real_time/camera_process.py).
"""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram, InputPortIndex, OutputPort, OutputPortIndex, System

from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.flight.stepped_halves import OnboardHalf, Signals, WorldHalf
from ortilo_drake.hil.real_time.warm_up import TICKS
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

PROFILE_TICKS = 600  # that the command times
WHOLE, REST = "whole tick", "Drake"  # the two rows that are not blocks


@dataclass(frozen=True)
class ProfileRow:
    """A block's time over the ticks [us], and its share of all the time, from 0 to 1.

    Drake's share may be below 0, as the times scatter.
    """

    block: str
    median_us: float
    p99_us: float
    share: float


def time_blocks(onboard: OnboardHalf, ports: list[OutputPort], updating: list[System]) -> dict[str, float]:
    """Evaluate block by block a tick whose messages were taken; return the time of each block [s] by its path."""
    work: list[tuple[System, Callable[[Context], Any]]] = [(port.get_system(), port.Eval) for port in ports]
    work += [(system, system.EvalUniquePeriodicDiscreteUpdate) for system in updating]
    spent = {system.GetSystemPathname(): 0.0 for system, _ in work}
    for system, evaluate in work:
        path, its_context = system.GetSystemPathname(), system.GetMyContextFromRoot(onboard.context)
        begin = time.perf_counter()
        evaluate(its_context)
        spent[path] += time.perf_counter() - begin
    return spent


def time_whole(onboard: OnboardHalf, messages: Signals) -> tuple[Signals, float]:
    """Do a whole tick as in flight; return its outputs and its time [s]."""
    begin = time.perf_counter()
    onboard.receive(messages)
    onboard.answer()
    outputs = onboard.outputs()
    onboard.advance()
    return outputs, time.perf_counter() - begin


def rows_of(spent: dict[str, np.ndarray], whole: np.ndarray) -> list[ProfileRow]:
    """Return the blocks, the costliest first, Drake's rest and the whole tick, from the times in every tick [s]."""
    rest = whole - sum(spent.values(), start=np.zeros_like(whole))
    blocks = sorted(spent, key=lambda name: -float(np.sum(spent[name])))
    columns = {name: spent[name] for name in blocks} | {REST: rest, WHOLE: whole}
    return [
        ProfileRow(
            block=name,
            median_us=1e6 * float(np.median(times)),
            p99_us=1e6 * float(np.quantile(times, 0.99)),
            share=float(np.sum(times) / np.sum(whole)),
        )
        for name, times in columns.items()
    ]


def profile_onboard(scenario: Scenario, ticks: int) -> list[ProfileRow]:
    """Fly so many ticks of a scenario in this process and time the onboard half; return the rows of rows_of.

    They are as many as the flight has, if it has fewer; a few before them are not timed. InputError if there is none.
    """
    last = min(ticks + TICKS, flight_ticks(scenario))
    if last <= TICKS:
        raise InputError(f"ticks: {ticks} of {flight_ticks(scenario)}: at least 1, in a flight of more than {TICKS}")
    world = WorldHalf(scenario)
    flying, timed = OnboardHalf(scenario, fused=False), OnboardHalf(scenario, fused=False)
    ports, updating = dataflow_order(timed.diagram), updating_systems(timed.diagram)
    blocks, wholes = [], []
    for _ in range(last):
        messages = world.sample()
        outputs, whole = time_whole(flying, messages)
        timed.receive(messages)
        blocks.append(time_blocks(timed, ports, updating))
        timed.advance()
        wholes.append(whole)
        world.advance(outputs["control"])
    names = block_names(timed.diagram)
    spent = {names[path]: np.array([block[path] for block in blocks[TICKS:]]) for path in blocks[0]}
    return rows_of(spent, np.array(wholes[TICKS:]))


Port = tuple[str, int]  # a leaf's path and the index of one of its ports


def leaves(diagram: Diagram) -> list[System]:
    """Return the systems of a Diagram that are no Diagrams, with those of the Diagrams in it."""
    systems = diagram.GetSystems()
    return [leaf for s in systems for leaf in (leaves(s) if isinstance(s, Diagram) else [s])]


def block_names(diagram: Diagram) -> dict[str, str]:
    """Return the block's name of every leaf by its path: the leaf's own, or its type's; of equal ones with a number."""
    names, counts = {}, Counter[str]()
    for leaf in leaves(diagram):
        own = leaf.get_name().rpartition("/")[2].partition("@")[0]  # Drake's for none: drake/systems/Gain@<address>
        counts[own] += 1
        names[leaf.GetSystemPathname()] = own if counts[own] == 1 else f"{own} {counts[own]}"
    return names


def dataflow_order(diagram: Diagram) -> list[OutputPort]:
    """Return the output ports of a Diagram's leaves, each after those that its value depends on."""
    sources, systems = _sources(diagram), {leaf.GetSystemPathname(): leaf for leaf in leaves(diagram)}
    ports = {(path, j): s.get_output_port(j) for path, s in systems.items() for j in range(s.num_output_ports())}
    order: dict[Port, OutputPort] = {}

    def append(key: Port) -> None:
        if key in order:
            return
        path, j = key
        for i in range(systems[path].num_input_ports()):
            if (path, i) in sources and systems[path].HasDirectFeedthrough(i, j):
                append(sources[path, i])
        order[key] = ports[key]

    for key in ports:  # the recursion ends, as Drake refuses algebraic loops
        append(key)
    return list(order.values())


def updating_systems(diagram: Diagram) -> list[System]:
    """Return the leaves of a Diagram that have a discrete update."""
    return [leaf for leaf in leaves(diagram) if leaf.GetUniquePeriodicDiscreteUpdateAttribute() is not None]


def _sources(diagram: Diagram) -> dict[Port, Port]:
    """Return for each connected input port of a leaf the leaf's output port that feeds it."""
    connections = diagram.connection_map().items()
    found = {port: _output_of(of, int(j)) for (to, i), (of, j) in connections for port in _inputs_of(to, int(i))}
    for system in diagram.GetSystems():
        found |= _sources(system) if isinstance(system, Diagram) else {}
    return found


def _inputs_of(system: System, i: int) -> list[Port]:
    """Return the leaves' input ports that an input port leads to."""
    if not isinstance(system, Diagram):
        return [(system.GetSystemPathname(), i)]
    return [port for s, j in system.GetInputPortLocators(InputPortIndex(i)) for port in _inputs_of(s, int(j))]


def _output_of(system: System, j: int) -> Port:
    """Return the leaf's output port that an output port is."""
    while isinstance(system, Diagram):
        system, j = system.get_output_port_locator(OutputPortIndex(j))
    return system.GetSystemPathname(), int(j)
