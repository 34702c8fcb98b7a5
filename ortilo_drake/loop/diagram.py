"""A wiring as part of a Drake Diagram: a system for each box, or all elements fused into one."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from pydrake.systems.framework import Context, DiagramBuilder, InputPort, InputPortIndex, OutputPort, System
from pydrake.systems.primitives import Multiplexer

from ortilo_drake.loop.element import OUTSIDE, Box, Values, outside
from ortilo_drake.loop.shell import WiredSystem_
from ortilo_drake.loop.wiring import Wiring

FUSED: Final = "elements"  # the name of the system of all elements


class Added(NamedTuple):
    """The Systems added to a Diagram for a wiring.

    Attributes:
        systems: by the name of a box, or FUSED.
        outputs: output ports by the names that were asked for.
    """

    systems: dict[str, Any]
    outputs: dict[str, OutputPort]

    def _players(self) -> Iterator[Any]:
        """Yield the systems that play boxes by their elements."""
        return (system for system in self.systems.values() if hasattr(system, "boxes"))

    def set_seed(self, context: Context, seed: int) -> None:
        """Set the seed of all noise; the context is the root's."""
        for system in self.systems.values():
            if hasattr(system, "set_seed_in"):
                system.set_seed_in(system.GetMyMutableContextFromRoot(context), seed)

    def seed_in(self, context: Context) -> int:
        """Return the seed of all noise; the context is the root's."""
        system = next(self._players())
        return int(system.seed_in(system.GetMyContextFromRoot(context)))

    def give(self, context: Context, given: dict[str, Values]) -> None:
        """Give boxes other numbers, tables or states, by their names; the context is the root's."""
        for system in self._players():
            its = {name: given[name] for name in given.keys() & system.boxes()}
            if its:
                system.give(system.GetMyMutableContextFromRoot(context), its)

    def state_of(self, context: Context, box: str, state: str) -> np.ndarray:
        """Return a state of a box; the context is the root's."""
        system = next(system for system in self._players() if box in system.boxes())
        values: np.ndarray = system.state_of(system.GetMyContextFromRoot(context), box, state)
        return values


class _Unit(NamedTuple):
    """Boxes that become one system.

    Attributes:
        name: of the system.
        wiring: the boxes, with one of OUTSIDE for each input.
        reads: what each input reads, "box" or "box.part".
    """

    name: str
    wiring: Wiring
    reads: dict[str, str]

    def plays(self, said: str) -> bool:
        """Return whether one of its boxes says that."""
        box = self.wiring.boxes.get(said.partition(".")[0])
        return box is not None and box.element is not OUTSIDE

    def port_of(self, said: str) -> str:
        """Return the name of the output that shows that: of one box its part's."""
        box, _, part = said.partition(".")
        return part if part and self.name == box else said


def system_of(wiring: Wiring, h: float, seed: int = 0) -> System:
    """Return a wiring whose last box, those from outside apart, is all that is to be read, as a system of its name.

    Its outputs are the box's parts or, where it has none, what it says by the box's name.
    """
    *_, box = (box for box in wiring.boxes.values() if box.element is not OUTSIDE)
    outputs = {part: (f"{box.name}.{part}",) for part in box.parts} or {box.name: (box.name,)}
    return WiredSystem_[float](box.name, wiring, outputs, h, seed)


def add_wiring(
    builder: DiagramBuilder,
    wiring: Wiring,
    asked: Mapping[str, str | tuple[str, ...]],
    h: float,
    sources: Mapping[str, OutputPort] | None = None,
    fused: bool = False,
    inputs_named: Mapping[str, str] | None = None,
    seed: int = 0,
    chance: OutputPort | None = None,
) -> Added:
    """Add a wiring to a Diagram that is being built.

    A box of OUTSIDE becomes an input of the Diagram by its name, unless there is a source for it. So does an input of a
    System in the place of an element that it does not read of another box: a picture, a path.

    Args:
        builder: of the Diagram.
        wiring: the boxes.
        asked: what is to be read from outside, by its name: "box" or "box.part", or several, one after the other.
        h: tick [s].
        sources: output ports in the place of boxes of OUTSIDE, by their names.
        fused: whether all elements become one system, FUSED, or a system each.
        inputs_named: names of the Diagram's inputs, where they are not those of the boxes of OUTSIDE.
        seed: of all noise in a default Context.
        chance: of seeds.add_chance, by which Drake may draw another seed.
    """
    several = {name: (said,) if isinstance(said, str) else said for name, said in asked.items()}
    shows = {name: tuple(_said(wiring, one) for one in said) for name, said in several.items()}
    ports, systems, readers = dict(sources or {}), dict[str, Any](), list[tuple[InputPort, str]]()
    for box in wiring.boxes.values():
        if box.system is not None:
            systems[box.name] = builder.AddSystem(box.system)
            readers += [(box.system.GetInputPort(p), said) for p, said in _reads(wiring, box).items()]
            ports |= {f"{box.name}.{part}": box.system.GetOutputPort(part) for part in box.parts}
            ports[box.name] = together(builder, [ports[f"{box.name}.{part}"] for part in box.parts])
        elif box.holds and not fused:
            whole = builder.AddNamedSystem(box.name, Multiplexer([wiring.boxes[name].size for name in box.holds]))
            readers += [(whole.get_input_port(i), name) for i, name in enumerate(box.holds)]
            ports[box.name] = whole.get_output_port()
    units = [_all_in_one(wiring)] if fused else _each_by_itself(wiring)
    joined = {name: said for name, said in shows.items() if len(said) > 1 and all(map(units[0].plays, said))}
    wanted = [said for _, said in readers] + [said for unit in units for said in unit.reads.values()]
    apart = {name: said for name, said in shows.items() if name not in joined}
    wanted += [one for said in apart.values() for one in said]
    outputs = dict[str, OutputPort]()
    for unit in units:
        own = {unit.port_of(said): (said,) for said in wanted if unit.plays(said)}
        system = builder.AddSystem(WiredSystem_[float](unit.name, unit.wiring, own | joined, h, seed))
        systems[unit.name] = system
        ports |= {said: system.GetOutputPort(port) for port, (said,) in own.items()}
        outputs |= {port: system.GetOutputPort(port) for port in joined}
        readers += [(system.GetInputPort(port), said) for port, said in unit.reads.items()]
    for system in systems.values():
        if chance is not None and hasattr(system, "set_seed_in") and system.HasInputPort("chance"):
            builder.Connect(chance, system.GetInputPort("chance"))
    inputs = dict[str, InputPortIndex]()
    for port, said in readers:
        if said in ports:
            builder.Connect(ports[said], port)
        elif said in inputs:
            builder.ConnectInput(inputs[said], port)
        else:
            inputs[said] = builder.ExportInput(port, (inputs_named or {}).get(said, said))
    for port in (port for box in wiring.boxes.values() for port in _unread(box)):
        builder.ExportInput(port, port.get_name())
    outputs |= {name: together(builder, [ports[one] for one in said]) for name, said in apart.items()}
    return Added(systems, outputs)


def _each_by_itself(wiring: Wiring) -> list[_Unit]:
    """Return a unit for each element, constants included."""
    units = []
    for box in (box for box in wiring.boxes.values() if box.element.functions or box.element.shows):
        reads = _reads(wiring, box)
        inputs = [outside(port, wiring.wires[box.name, port].size) for port in reads]
        units.append(_Unit(box.name, Wiring([box.with_inputs(**{port: port for port in reads}), *inputs]), reads))
    return units


def _all_in_one(wiring: Wiring) -> _Unit:
    """Return one unit of all elements; what Systems say comes from its outside."""
    read = {*wiring.holders, *(wire.box for wire in wiring.wires.values())}
    boxes = [box if box.system is None else replace(box, element=OUTSIDE, system=None) for box in wiring.boxes.values()]
    whole = Wiring([box for box in boxes if box.element is not OUTSIDE or box.name in read])
    return _Unit(FUSED, whole, {its: its for its, box in whole.boxes.items() if box.element is OUTSIDE})


def _said(wiring: Wiring, said: str) -> str:
    """Return the box that a bundle holds as that part; any other name as it is."""
    name, _, part = said.partition(".")
    box = wiring.boxes[name]
    return dict(zip(box.parts, box.holds, strict=True))[part] if box.holds and part else said


def _reads(wiring: Wiring, box: Box) -> dict[str, str]:
    """Return the source of each input of a box, "box" or "box.part"."""
    said = {port: _said(wiring, box.reads.get(port, port)) for port in box.element.inputs}
    return {port: its for port, its in said.items() if its.partition(".")[0] != box.name}


def _unread(box: Box) -> list[InputPort]:
    """Return the inputs of a box's System that no other box says, but for chance, which need not be connected."""
    known = {*box.element.reads, *(["chance"] if hasattr(box.system, "set_seed_in") else [])}
    ports = [box.system.get_input_port(i) for i in range(box.system.num_input_ports())] if box.system else []
    return [port for port in ports if port.get_name() not in known]


def together(builder: DiagramBuilder, ports: list[OutputPort]) -> OutputPort:
    """Return output ports as one, one after the other."""
    if len(ports) == 1:
        return ports[0]
    both = builder.AddSystem(Multiplexer([port.size() for port in ports]))
    for i, port in enumerate(ports):
        builder.Connect(port, both.get_input_port(i))
    whole: OutputPort = both.get_output_port()
    return whole
