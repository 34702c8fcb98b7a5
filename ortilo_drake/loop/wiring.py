"""The wiring of boxes: which output each input reads, and the order in which a tick calls them.

A wiring knows the size of each output and part, but not how many numbers an element reads of an input: only the code of
the element says it. So an input that is too small is found in flight, by elements that check their indices.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from graphlib import CycleError, TopologicalSorter

import numpy as np

from ortilo_drake.loop.element import RESERVED, Box


@dataclass(frozen=True)
class Wire:
    """The source of an input: a box, and the first index and size of the part of its output that is read."""

    box: str
    first: int
    size: int


class Wiring:
    """Boxes, in any order, checked as a whole.

    Args:
        boxes: the boxes.
        checked: whether all elements check their indices in flight, as elements of your own do.

    Raises:
        ValueError: if two boxes have the same name, an input reads a box or part that does not exist, a value has a
            reserved name, a part is not within its box's output, a box shows no state of its output's size, a bundle
            holds a box that shows a state, or outputs read one another in a loop.
    """

    def __init__(self, boxes: list[Box], checked: bool = False):
        if checked:
            boxes = [replace(box, element=replace(box.element, checked=bool(box.element.functions))) for box in boxes]
        self.boxes = {box.name: box for box in boxes}
        if len(self.boxes) != len(boxes):
            raise ValueError(f"wiring: two boxes have one name among {', '.join(sorted(box.name for box in boxes))}")
        for box in boxes:
            check_values(box)
            for part, (first, size) in box.parts.items():
                if not 0 <= first <= first + size <= box.size:
                    raise ValueError(f"{box.name}.{part}: is [{first}, {first + size}), must be within [0, {box.size})")
        self.holders = {held: box.name for box in boxes for held in box.holds}
        for held, holder in self.holders.items():
            if self.boxes[self.wire(held, holder).box].element.shows:
                raise ValueError(f"{holder}: holds '{held}', which shows a state: must be a box with an `out`")
        self.wires = {
            (box.name, port): self.wire(box.reads.get(port, port), f"{box.name}: {port}")
            for box in boxes
            for port in box.element.inputs
        }
        _ = self.out_order, self.step_order

    def wire(self, said: str, reader: str) -> Wire:
        """Return the wire from `said`, "box" or "box.part"; ValueError names the reader if this source is missing."""
        name, _, part = said.partition(".")
        source = self.boxes.get(name)
        if source is None:
            raise ValueError(f"{reader}: reads '{said}', must be one of {', '.join(sorted(self.boxes))}")
        if part and part not in source.parts:
            raise ValueError(f"{reader}: reads '{said}', must be a part of it: {', '.join(source.parts)}")
        return Wire(name, *(source.parts[part] if part else (0, source.size)))

    @cached_property
    def out_order(self) -> list[Box]:
        """The boxes with an `out` function, each after the boxes that its `out` reads."""
        says = {name for name, box in self.boxes.items() if box.element.out is not None}
        graph = {name: sorted(self._read_by(name, "out") & says) for name in says}
        return [self.boxes[name] for name in _sorted(graph)]

    @cached_property
    def step_order(self) -> list[Box]:
        """The boxes with a `step` function; a box that reads a shown state steps before the state's owner."""
        steps = {name for name, box in self.boxes.items() if box.element.step is not None}
        graph: dict[str, list[str]] = {name: [] for name in steps}
        for name in sorted(steps):
            for shown in self._read_by(name, "step") & steps:
                if self.boxes[shown].element.shows and shown != name:
                    graph[shown].append(name)
        return [self.boxes[name] for name in _sorted(graph)]

    def _read_by(self, name: str, what: str) -> set[str]:
        element = self.boxes[name].element
        read = {self.wires[name, port].box for port in element.inputs_of(element.functions[what])}
        return {held for box in read for held in (self.boxes[box].holds or (box,))}


def _sorted(graph: dict[str, list[str]]) -> list[str]:
    """Return the names of a graph, each after the names that it needs; names that may come next are sorted."""
    sorter, found = TopologicalSorter(graph), list[str]()
    try:
        sorter.prepare()
    except CycleError as error:
        raise ValueError(f"wiring: {' reads '.join(error.args[1])}: must not read each other in a tick") from None
    while sorter.is_active():
        ready = sorted(sorter.get_ready())
        found += ready
        sorter.done(*ready)
    return found


def check_values(box: Box) -> None:
    """Raise ValueError if a value of a box has a reserved name, or if the box shows no state of its output's size."""
    element = box.element
    named = {*element.own, *(number.name for number in element.constants)}
    if reserved := sorted(named & set(RESERVED)):
        raise ValueError(f"{box.name}: a value is named {reserved}, which is reserved")
    if element.shows:
        if element.shows not in box.given.start:
            raise ValueError(f"{box.name}: shows {element.shows!r}, must be one of its states: {list(box.given.start)}")
        size = np.size(box.given.start[element.shows])
        if size != box.size:
            raise ValueError(f"{box.name}: {element.shows}: has {size} numbers, must have {box.size}")
