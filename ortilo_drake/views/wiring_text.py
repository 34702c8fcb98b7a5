"""The wiring of a scenario as text of at most 100 columns, in three depths: blocks, boxes, elements."""

import inspect
import textwrap
from collections.abc import Callable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from ortilo_drake.diagrams.wiring.whole import boxes_of
from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.loop.element import Box
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.scenario import Scenario
from ortilo_drake.views.blocks import WORLD, blocks_of, signals_between

SHORT = 6  # largest array whose values are printed
PACKAGE = Path(__file__).parents[1]


def wiring_text(wiring: Wiring, depth: int) -> str:
    """Return a scenario's wiring as text.

    Depth 1 has the paper's blocks, depth 2 every box in the order of a tick, depth 3 the element of every box.
    """
    return "\n".join({1: blocks_text, 2: tick_text, 3: elements_text}[depth](wiring)) + "\n"


def blocks_text(wiring: Wiring) -> Iterator[str]:
    """Yield the paper's blocks: the boxes of each block, and the signals that it reads from other blocks."""
    blocks, half, widths = blocks_of(wiring), "", (20, 34, 46)
    signals = signals_between(wiring, blocks)
    for block in blocks.values():
        its = "world" if block.column in WORLD else "onboard"
        if its != half:
            yield from row((its, "", "") if half else (its, "boxes", "reads"), widths)
            half = its
        sources: dict[str, list[str]] = {}
        for (source, reader), names in signals.items():
            if reader == block.name:
                sources.setdefault(", ".join(names), []).append(source)
        reads = "; ".join(f"{names} from {', '.join(those)}" for names, those in sources.items())
        yield from row((f"  {block.name}", ", ".join(block.boxes), reads), widths)


def tick_text(wiring: Wiring) -> Iterator[str]:
    """Yield every box in the order of a tick: the size of its output, and the signals it reads."""
    widths = (4, 28, 7, 61)
    yield from row(("", "in each tick says", "size", "reads"), widths)
    for i, box in enumerate(wiring.out_order, 1):
        yield from row((f"{i:>3}", box.name, str(box.size), reads_of(wiring, box, "out")), widths)
    yield from row(("", "then steps", "size", "reads"), widths)
    for i, box in enumerate(wiring.step_order, len(wiring.out_order) + 1):
        yield from row((f"{i:>3}", box.name, str(box.size), reads_of(wiring, box, "step")), widths)
    still = [box for box in wiring.boxes.values() if not box.element.functions]
    if still:
        yield from row(("", "without functions", "size", "holds"), widths)
    for box in still:
        yield from row(("", box.name, str(box.size), description_of(wiring, box)), widths)


def elements_text(wiring: Wiring) -> Iterator[str]:
    """Yield every box with its element: functions and their files, inputs, numbers and arrays."""
    for box in wiring.boxes.values():
        if box is not next(iter(wiring.boxes.values())):
            yield ""
        yield f"{box.name} ({box.size}): {kind_of(box)}"
        for name, said in parts_of(wiring, box):
            yield from row((f"  {name}", said), (12, 88))


def parts_of(wiring: Wiring, box: Box) -> Iterator[tuple[str, str]]:
    """Yield the description of a box's element: pairs of a heading and a text."""
    element, given = box.element, box.given
    for what, function in element.functions.items():
        yield what, function_text(function)
    for name, said in (
        ("reads", all_reads(wiring, box)),
        ("holds", [f"{held} ({wiring.boxes[held].size})" for held in box.holds]),
        ("parts", [f"{part} ({size})" for part, (_, size) in box.parts.items() if not box.holds]),
        ("numbers", [value_text(number.name, given.numbers[number.name]) for number in element.constants]),
        ("state", [value_text(array.name, given.start[array.name]) for array in element.state]),
        ("tables", [value_text(array.name, given.tables[array.name]) for array in element.arrays]),
        ("work", [f"{name} {shape}" for name, shape in box.work.items()]),
    ):
        if said:
            yield name, "; ".join(said)


def kind_of(box: Box) -> str:
    """Return the kind of a box: an element, or a Drake System."""
    if box.system is None:
        return f"element {box.element.name}"
    return f"System {type(box.system).__name__} of Drake, no element"


def description_of(wiring: Wiring, box: Box) -> str:
    """Return a description of a box without functions: its source, its values, or the System behind it."""
    if box.holds:
        return ", ".join(f"{held} ({wiring.boxes[held].size})" for held in box.holds)
    if box.system is not None:
        return ", ".join((kind_of(box), *all_reads(wiring, box)))
    return ", ".join(value_text(name, value) for name, value in box.given.start.items())


def reads_of(wiring: Wiring, box: Box, what: str) -> str:
    """Return the inputs of one function of a box as text, each with its source and size."""
    ports = box.element.inputs_of(box.element.functions[what])
    return ", ".join(f"{port} = {source_text(wiring, box, port)}" for port in ports)


def all_reads(wiring: Wiring, box: Box) -> list[str]:
    """Return a line for each input of a box, with its source."""
    return [f"{port} = {source_text(wiring, box, port)}" for name, port in wiring.wires if name == box.name]


def source_text(wiring: Wiring, box: Box, port: str) -> str:
    """Return the source of an input: "box (size)" or "box.part (size)"."""
    return f"{box.reads.get(port, port)} ({wiring.wires[box.name, port].size})"


def value_text(name: str, value: Any) -> str:
    """Return a name with its value if the value is short, else with its shape."""
    values = np.asarray(value)
    if values.size > SHORT or values.ndim > 1 or values.size == 0:
        return f"{name} {values.shape}{'' if values.any() or not values.size else ' zeros'}"
    numbers = [f"{number:.6g}" if values.dtype.kind == "f" else str(number) for number in values.ravel()]
    said = ", ".join(numbers)
    return f"{name} = {said if values.ndim == 0 else f'[{said}]'}"


def function_text(function: Callable[..., None]) -> str:
    """Return the name of an element's function and its file; a file of the package is relative to the package's."""
    written = inspect.unwrap(written_by_hand(function))
    file = Path(written.__code__.co_filename)
    return f"{written.__name__} in {file.relative_to(PACKAGE.parent) if file.is_relative_to(PACKAGE.parent) else file}"


def written_by_hand(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function, or the function of a registered part if a function of the package only wraps it."""
    if "<locals>" not in function.__qualname__ or not function.__module__.startswith(f"{PACKAGE.name}."):
        return function
    enclosed = inspect.getclosurevars(function).nonlocals.values()
    return next((value for value in enclosed if callable(value)), function)


def row(cells: tuple[str, ...], widths: tuple[int, ...]) -> Iterator[str]:
    """Yield the lines of a row of a table; each cell except the first is wrapped to the width of its column."""
    wide = [width - 2 for width in widths[:-1]] + [widths[-1]]
    broken = [cells[:1], *(textwrap.wrap(cell, width) for cell, width in zip(cells[1:], wide[1:], strict=True))]
    for parts in zip_longest(*broken, fillvalue=""):
        yield "".join(part.ljust(width) for part, width in zip(parts, widths, strict=True)).rstrip()


def wiring_of(scenario: Scenario) -> Wiring:
    """Return a scenario's wiring; InputError if it cannot be flown."""
    return Wiring(boxes_of(scenario, flight_ticks(scenario)))
