"""Boxes that a System of Drake's plays, where no element can: a renderer, a detector, a part of one's own."""

from pydrake.systems.framework import PortDataType, System, SystemBase

from ortilo_drake.loop.element import Box, Element, parts_of
from ortilo_drake.model.typed_yaml import InputError


def system_box(name: str, system: System, says: tuple[str, ...], signals: dict[str, tuple[str, int]]) -> Box:
    """Return the box of a System.

    Its inputs are connected by name; one that no signal has the name of stays an input of the whole Diagram.

    Args:
        name: of the box.
        system: what plays it; it is named so where it has no name.
        says: those of its outputs, vectors all, that others read: the parts of what the box says.
        signals: what its inputs may read, by name: "box" or "box.part", and the size.

    Raises:
        InputError: if it has an input of a signal's name and of another size.
    """
    ports = [system.get_input_port(i) for i in range(system.num_input_ports())]
    reads = {}
    for port in ports:
        if port.get_name() in signals and port.get_data_type() == PortDataType.kVectorValued:
            said, size = signals[port.get_name()]
            if port.size() != size:
                role = "planner" if name == "reference" else name
                raise InputError(
                    f"{role}: {system.get_name()}: takes '{port.get_name()}' of {port.size()} numbers, must be {size}"
                )
            reads[port.get_name()] = said
    sizes = {port_name: system.GetOutputPort(port_name).size() for port_name in says}
    element = Element("system", reads=tuple(reads))
    return Box(name, element, sum(sizes.values()), reads=reads, parts=parts_of(sizes), system=system)


def require_ports(system: System, inputs: tuple[str, ...], outputs: tuple[str, ...], role: str) -> None:
    """Refuse a part of one's own that lacks a port, naming what it has."""
    if not isinstance(system, SystemBase):
        raise InputError(f"{role}: its function returned {system!r}: must be a Drake System")
    has_in = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    has_out = [system.get_output_port(i).get_name() for i in range(system.num_output_ports())]
    for wanted, has, kind in ((inputs, has_in, "input"), (outputs, has_out, "output")):
        missing = [name for name in wanted if name not in has]
        if missing:
            raise InputError(
                f"{role}: {system.get_name()}: has no {kind} '{missing[0]}', only {', '.join(has) or 'none'}"
            )
