"""A flight of a wiring as straight-line source text: each line of a tick is a call of one element's function."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ortilo_drake.loop.element import Box
from ortilo_drake.loop.native import native_of, parameters
from ortilo_drake.loop.wiring import Wire, Wiring

HEAD = '''"""{what}, made by ortilo_drake/loop/source.py.

N, S, W and Y are the addresses of constants, states, room to work in and what is said; T has address and shape of each
table.
"""

from numba import njit, types

'''


class Place(NamedTuple):
    """The place of an array in a flight's memory.

    Attributes:
        letter: of the memory: states (S), room to work in (W), what is said (Y), tables (T).
        at: index of its first number; of a table that of its address in T, which its sizes follow.
        shape: of the array; of a table as its box is given it.
    """

    letter: str
    at: int
    shape: tuple[int, ...]

    def of(self, memory: np.ndarray) -> np.ndarray:
        """Return the array, a view."""
        return memory[self.at : self.at + math.prod(self.shape)].reshape(self.shape)


@dataclass(frozen=True)
class Places:
    """The memory layout of a wiring, box by box: constants (N) in bytes, the rest in numbers of eight bytes.

    Attributes:
        numbers: of each box's record.
        said: of what each box says.
        arrays: of each array that a box's functions take, by box and name: its own, `out`, and what it reads.
        sizes: of each memory, by its letter.
    """

    numbers: dict[str, int]
    said: dict[str, Place]
    arrays: dict[tuple[str, str], Place]
    sizes: dict[str, int]

    def of(self, wire: Wire) -> Place:
        """Return the place of a wire's source."""
        said = self.said[wire.box]
        return Place(said.letter, said.at + wire.first, (wire.size,))


def places_of(wiring: Wiring) -> Places:
    """Return the places of all numbers, states, work arrays, outputs and tables of a wiring."""
    places = Places({}, {}, {}, dict.fromkeys("NSWYT", 0))

    def take(letter: str, n: int) -> int:
        places.sizes[letter] += n
        return places.sizes[letter] - n

    for box in wiring.boxes.values():
        its: dict[str, Place] = {}
        # Every record begins where eight bytes may.
        places.numbers[box.name] = take("N", -(-box.element.dtype.itemsize // 8) * 8)
        its |= {name: Place("S", take("S", np.size(x)), np.shape(x)) for name, x in box.given.start.items()}
        its |= {name: Place("W", take("W", math.prod(shape)), shape) for name, shape in box.work.items()}
        for table in box.element.arrays:
            its[table.name] = Place("T", take("T", 1 + table.dimensions), np.shape(box.given.tables[table.name]))
        if box.element.shows:
            places.said[box.name] = its[box.element.shows]._replace(shape=(box.size,))
        elif box.name not in wiring.holders:
            places.said[box.name] = Place("Y", take("Y", box.size), (box.size,))
        places.arrays.update({(box.name, name): place for name, place in its.items()})
    for box in (box for box in wiring.boxes.values() if box.holds):
        for held, (first, size) in zip(box.holds, box.parts.values(), strict=True):
            places.said.setdefault(held, places.of(Wire(box.name, first, size)))
    places.arrays.update({(name, "out"): place for name, place in places.said.items()})
    places.arrays.update({reader: places.of(wire) for reader, wire in wiring.wires.items()})
    return places


def line_of(places: Places, box: Box, what: str) -> str:
    """Return one line of a tick: the call of a box's `out` or `step`."""
    said: list[str] = []
    for name, dimensions, _ in parameters(box.element, box.element.functions[what]):
        if name == "n":
            said.append(f"N + {places.numbers[box.name]}")
        elif dimensions < 0:
            said.append(name)
        elif name == "seeds":
            said.append("seeds.ctypes.data, seeds.shape[0]")
        else:
            letter, at, shape = places.arrays[box.name, name]
            in_memory = [f"{letter} + {8 * at}", *map(str, shape)]
            said += [f"T[{at + i}]" for i in range(1 + dimensions)] if letter == "T" else in_memory
    return f"{box.name}_{what}({', '.join(said)})"


def externals(wiring: Wiring) -> str:
    """Return the declarations of all functions that a tick calls."""
    text = ""
    for box in wiring.boxes.values():
        for what, native in native_of(box.element).items():
            types_of = ", ".join(["types.int64"] * native.arguments)
            text += f'{box.name}_{what} = types.ExternalFunction("{native.symbol}", types.void({types_of}))\n'
    return text


def part_text(wiring: Wiring, places: Places, parts: dict[str, list[tuple[Box, str]]]) -> str:
    """Return the source of functions (N_, S_, W_, Y_, T, seeds, k), by name the calls that each makes."""
    text = HEAD.format(what="Part of a tick") + externals(wiring)
    for name, calls in parts.items():
        lines = "\n".join(f"    {line_of(places, box, what)}" for box, what in calls)
        text += f"""

@njit(cache=True, error_model="numpy")
def {name}(N_, S_, W_, Y_, T, seeds, k):
    N, S, W, Y = N_.ctypes.data, S_.ctypes.data, W_.ctypes.data, Y_.ctypes.data
    seed = seeds[0]
{lines}
"""
    return text


def flight_text(wiring: Wiring, places: Places, recorded: list[Wire], ends: str) -> str:
    """Return the source of fly(N_, S_, W_, Y_, T, seeds, trace) -> last tick.

    Args:
        wiring: what flies.
        places: of it.
        recorded: what is written to each row of the trace, one after the other.
        ends: the box whose last number ends the flight where it is not negative.
    """
    text = HEAD.format(what="A flight, in each tick what is said, what is recorded, and the steps") + externals(wiring)
    body = [line_of(places, box, "out") for box in wiring.out_order]
    column = 0
    for wire in recorded:
        letter, at, _ = places.of(wire)
        body += [f"for i in range({wire.size}):", f"    trace[k, {column} + i] = {letter}_[{at} + i]"]
        column += wire.size
    end = wiring.wire(ends, "ends")
    letter, at, _ = places.of(Wire(end.box, end.first + end.size - 1, 1))
    body += [f"if {letter}_[{at}] >= 0.0 or k == last:  # {ends} says a cause", "    return k"]
    body += [line_of(places, box, "step") for box in wiring.step_order]
    lines = "\n".join(f"        {line}" for line in body)
    return f"""{text}

@njit(cache=True, nogil=True, error_model="numpy")
def fly(N_, S_, W_, Y_, T, seeds, trace):
    N, S, W, Y, last = N_.ctypes.data, S_.ctypes.data, W_.ctypes.data, Y_.ctypes.data, trace.shape[0] - 1
    for k in range(last + 1):
        seed = seeds[k]
{lines}
    return last
"""
