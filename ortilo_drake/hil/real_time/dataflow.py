"""The blocks of a Diagram: the leaves of it and of the Diagrams in it, their names, and the order they depend in."""

from collections import Counter

from pydrake.systems.framework import Diagram, InputPortIndex, OutputPort, OutputPortIndex, System

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
