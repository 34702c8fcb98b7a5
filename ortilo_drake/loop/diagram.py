"""A wiring as part of a Drake Diagram: a system for each box, or all elements fused into one."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import Context, DiagramBuilder, InputPort, InputPortIndex, OutputPort, System
from pydrake.systems.primitives import Multiplexer

from ortilo_drake.loop.element import OUTSIDE, Box, Given
from ortilo_drake.loop.shell import WiredSystem_, alone
from ortilo_drake.loop.wiring import Wiring


class Added(NamedTuple):
    """What was added to a Diagram.

    Attributes:
        systems: by the name of a box, or of what is fused.
        outputs: output ports by the names that were asked for.
        inputs: which exported input each signal from outside is, by its name.
    """

    systems: dict[str, System]
    outputs: dict[str, OutputPort]
    inputs: dict[str, InputPortIndex]

    def _wired(self) -> Iterable[Any]:
        return (system for system in self.systems.values() if hasattr(system, "boxes"))

    def holder(self, box: str) -> Any:
        """Return the system that plays a box by its element."""
        return next(system for system in self._wired() if box in system.boxes())

    def set_seed(self, context: Context, seed: int) -> None:
        """Set the seed of all noise; the context is the root's."""
        for system in self._wired():
            system.set_seed_in(system.GetMyMutableContextFromRoot(context), seed)

    def seed_in(self, context: Context) -> int:
        """Return the seed of all noise; the context is the root's."""
        system = next(iter(self._wired()))
        seed: int = system.seed_in(system.GetMyContextFromRoot(context))
        return seed

    def give(self, context: Context, given: dict[str, Given]) -> None:
        """Give boxes other numbers, tables or states, by their names; the context is the root's."""
        for system in self._wired():
            its = {name: values for name, values in given.items() if name in system.boxes()}
            if its:
                system.give(system.GetMyMutableContextFromRoot(context), its)

    def set_state(self, context: Context, box: str, state: str, values: np.ndarray) -> None:
        """Set a state of a box; the context is the root's."""
        system = self.holder(box)
        system.set_state(system.GetMyMutableContextFromRoot(context), box, state, values)

    def state_of(self, context: Context, box: str, state: str) -> np.ndarray:
        """Return a state of a box; the context is the root's."""
        system = self.holder(box)
        values: np.ndarray = system.state_of(system.GetMyContextFromRoot(context), box, state)
        return values


def system_of(wiring: Wiring, h: float, name: str | None = None) -> System:
    """Return a wiring of one box, and of what it reads from outside, as a system that is named as the box.

    Its outputs are the box's parts or, where it has none, what it says by the box's name.
    """
    (box,) = (box for box in wiring.boxes.values() if box.element is not OUTSIDE)
    return WiredSystem_[float](name or box.name, wiring, {port: (said,) for port, said in _ports_of(box).items()}, h)


def add_wiring(
    builder: DiagramBuilder,
    wiring: Wiring,
    asked: dict[str, str | tuple[str, ...]],
    h: float,
    sources: dict[str, OutputPort] | None = None,
    fused: str | None = None,
    inputs_named: dict[str, str] | None = None,
) -> Added:
    """Add a wiring to a Diagram that is being built.

    A box of OUTSIDE becomes an input of the Diagram by its name, unless there is a source for it. So does an input of a
    System in the place of an element that it does not read of another box: a picture, a path.

    Args:
        builder: of the Diagram.
        wiring: the boxes.
        asked: what is to be read from outside, "box" or "box.part", or several of them one after the other, by its name.
        h: tick [s].
        sources: output ports in the place of boxes of OUTSIDE, by their names.
        fused: name of the one system that all elements become; None for a system each.
        inputs_named: names of the Diagram's inputs, where they are not those of the boxes of OUTSIDE.
    """
    ports = dict(sources or {})
    shows = {name: tuple(_said(wiring, one) for one in ((said,) if isinstance(said, str) else said)) for name, said in asked.items()}
    wanted = [one for said in shows.values() for one in said if not fused or len(said) == 1]
    readers: list[tuple[InputPort, str]] = []
    systems: dict[str, System] = {}
    outputs: dict[str, OutputPort] = {}
    for box in wiring.boxes.values():
        if box.system is not None:
            systems[box.name] = builder.AddSystem(box.system)
            readers += [(box.system.GetInputPort(p), said) for p, said in _reads(wiring, box).items()]
            ports |= {f"{box.name}.{part}": box.system.GetOutputPort(part) for part in box.parts}
            ports[box.name] = _together(builder, [ports[f"{box.name}.{part}"] for part in box.parts])
        elif box.holds and not fused:
            whole = builder.AddNamedSystem(box.name, Multiplexer([wiring.boxes[name].size for name in box.holds]))
            readers += [(whole.get_input_port(i), name) for i, name in enumerate(box.holds)]
            ports[box.name] = whole.get_output_port()
    elements = [box for box in wiring.boxes.values() if box.element.functions or box.element.shows]
    wired: list[tuple[str, Wiring, dict[str, str]]] = []
    if fused:
        around = [replace(box, element=OUTSIDE, system=None) for box in wiring.boxes.values() if box.system is not None]
        known = {box.name for box in (*elements, *around)}
        others = [box for box in wiring.boxes.values() if box.name not in known and _is_read(wiring, box)]
        whole_wiring = Wiring([*elements, *around, *others])
        wired.append((fused, whole_wiring, {name: name for name, box in whole_wiring.boxes.items() if box.element is OUTSIDE}))
    else:
        wired += [(box.name, alone(wiring, box.name), _reads(wiring, box)) for box in elements]
    wanted += [said for _, said in readers] + [said for _, _, reads in wired for said in reads.values()]
    for name, its, reads in wired:
        own = {said: wiring.boxes[said.partition(".")[0]] for said in dict.fromkeys(wanted)}
        shown = {said: said for said, box in own.items() if box.name in its.boxes and its.boxes[box.name].element is not OUTSIDE}
        names = {(said if fused else said.partition(".")[2] or said): said for said in shown}
        several = {port: said for port, said in shows.items() if fused and len(said) > 1}
        system = builder.AddSystem(WiredSystem_[float](name, its, {port: (said,) for port, said in names.items()} | several, h))
        systems[name] = system
        outputs |= {port: system.GetOutputPort(port) for port in several}
        ports |= {said: system.GetOutputPort(port) for port, said in names.items()}
        readers += [(system.GetInputPort(port), said) for port, said in reads.items()]
    inputs: dict[str, InputPortIndex] = {}
    for port, said in readers:
        if said in ports:
            builder.Connect(ports[said], port)
        elif said in inputs:
            builder.ConnectInput(inputs[said], port)
        else:
            inputs[said] = builder.ExportInput(port, (inputs_named or {}).get(said, said))
    for box in wiring.boxes.values():
        for port in _unread(box):
            inputs[port.get_name()] = builder.ExportInput(port, port.get_name())
    for name, said in shows.items():
        if name not in outputs:
            outputs[name] = _together(builder, [ports[one] for one in said])
    return Added(systems, outputs, inputs)


def _is_read(wiring: Wiring, box: Box) -> bool:
    return bool(box.holds) or box.name in wiring.holders or any(wire.box == box.name for wire in wiring.wires.values())


def _ports_of(box: Box) -> dict[str, str]:
    return {part: f"{box.name}.{part}" for part in box.parts} or {box.name: box.name}


def _said(wiring: Wiring, said: str) -> str:
    """Return what "bundle.part" is a part of, by its own name."""
    name, _, part = said.partition(".")
    return part if wiring.boxes[name].holds and part else said


def _reads(wiring: Wiring, box: Box) -> dict[str, str]:
    """Return what each input of a box reads, "box" or "box.part"."""
    return {port: _said(wiring, box.reads.get(port, port)) for port in box.element.inputs}


def _unread(box: Box) -> Iterable[InputPort]:
    """Return the inputs of a box's System that no other box says."""
    if box.system is None:
        return []
    ports = [box.system.get_input_port(i) for i in range(box.system.num_input_ports())]
    return [port for port in ports if port.get_name() not in box.element.reads]


def _together(builder: DiagramBuilder, ports: list[OutputPort]) -> OutputPort:
    """Return output ports as one, one after the other."""
    if len(ports) == 1:
        return ports[0]
    both = builder.AddSystem(Multiplexer([port.size() for port in ports]))
    for i, port in enumerate(ports):
        builder.Connect(port, both.get_input_port(i))
    whole: OutputPort = both.get_output_port()
    return whole
