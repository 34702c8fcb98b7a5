"""A profile of the onboard half: the time that each block takes on this machine.

Two onboard halves take the same messages, tick by tick, in lockstep with a world. The first does its tick as in flight,
timed as a whole. In the second every output port is evaluated on its own, in dataflow order, and then every block's
discrete update. Drake caches values, so each time is that of one block alone. A block is a leaf of the onboard Diagram
or of a Diagram in it, such as the estimator. The time of the whole beyond the sum of its blocks is Drake's: to put the
messages (and a picture) on the input ports, for events, caches and the context.

The world, its pictures and the link are not timed. A detector is timed here as a block within the tick; in flight in
real time it has its own thread (hil/real_time/camera_process.py).
"""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from graphlib import TopologicalSorter
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram, InputPortIndex, OutputPort, OutputPortIndex, System

from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.flight.stepped_halves import OnboardHalf, Signals, WorldHalf
from ortilo_drake.hil.real_time.warm_up import TICKS
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

PROFILE_TICKS = 600  # number of ticks that the command times
WHOLE, REST = "whole tick", "Drake"  # the two rows that are not blocks


@dataclass(frozen=True)
class ProfileRow:
    """A block's median and 99th percentile time of a tick [us], and its share of the whole time [1].

    Drake's share may be below 0, because the times scatter.
    """

    block: str
    median_us: float
    p99_us: float
    share: float


def time_blocks(onboard: OnboardHalf, ports: list[OutputPort], updating: list[System]) -> dict[str, float]:
    """Evaluate a tick, whose messages were received, block by block; return the time of each block [s] by its path."""
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
    """Do a whole tick as in flight; return the outputs and the time of the tick [s]."""
    begin = time.perf_counter()
    onboard.receive(messages)
    onboard.answer()
    outputs = onboard.outputs()
    onboard.advance()
    return outputs, time.perf_counter() - begin


def rows_of(spent: dict[str, np.ndarray], whole: np.ndarray) -> list[ProfileRow]:
    """Return rows of the blocks, slowest first, of Drake's rest and the whole tick, given their times per tick [s]."""
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
    """Fly `ticks` ticks of a scenario in this process and time the onboard half; return the rows of rows_of.

    A shorter flight gives fewer ticks. The first TICKS ticks are not timed. InputError if no tick is left to time.
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
    """Return all leaf systems of a Diagram, also within its inner Diagrams."""
    systems = diagram.GetSystems()
    return [leaf for s in systems for leaf in (leaves(s) if isinstance(s, Diagram) else [s])]


def block_names(diagram: Diagram) -> dict[str, str]:
    """Return the block name of every leaf by its path: the leaf's own name or type, with a number for equal names."""
    names, counts = {}, Counter[str]()
    for leaf in leaves(diagram):
        own = leaf.get_name().rpartition("/")[2].partition("@")[0]  # Drake's default: drake/systems/Gain@<address>
        counts[own] += 1
        names[leaf.GetSystemPathname()] = own if counts[own] == 1 else f"{own} {counts[own]}"
    return names


def dataflow_order(diagram: Diagram) -> list[OutputPort]:
    """Return the output ports of a Diagram's leaves, each after the ports that its value depends on."""
    sources, systems = _sources(diagram), {leaf.GetSystemPathname(): leaf for leaf in leaves(diagram)}
    ports = {(path, j): s.get_output_port(j) for path, s in systems.items() for j in range(s.num_output_ports())}

    def before(path: str, j: int) -> list[Port]:
        inputs = (i for i in range(systems[path].num_input_ports()) if (path, i) in sources)
        return [sources[path, i] for i in inputs if systems[path].HasDirectFeedthrough(i, j)]

    order = TopologicalSorter({key: before(*key) for key in ports})
    return [ports[key] for key in order.static_order()]  # there is one, because Drake refuses algebraic loops


def updating_systems(diagram: Diagram) -> list[System]:
    """Return the leaves of a Diagram that have a discrete update."""
    return [leaf for leaf in leaves(diagram) if leaf.GetUniquePeriodicDiscreteUpdateAttribute() is not None]


def _sources(diagram: Diagram) -> dict[Port, Port]:
    """Return the output port of a leaf that feeds each connected input port of a leaf."""
    connections = diagram.connection_map().items()
    found = {port: _output_of(of, int(j)) for (to, i), (of, j) in connections for port in _inputs_of(to, int(i))}
    for system in diagram.GetSystems():
        found |= _sources(system) if isinstance(system, Diagram) else {}
    return found


def _inputs_of(system: System, i: int) -> list[Port]:
    """Return the input ports of leaves to which an input port leads."""
    if not isinstance(system, Diagram):
        return [(system.GetSystemPathname(), i)]
    return [port for s, j in system.GetInputPortLocators(InputPortIndex(i)) for port in _inputs_of(s, int(j))]


def _output_of(system: System, j: int) -> Port:
    """Return the output port of the leaf behind an output port."""
    while isinstance(system, Diagram):
        system, j = system.get_output_port_locator(OutputPortIndex(j))
    return system.GetSystemPathname(), int(j)
