"""A flight of a wiring as straight-line source text: each line of a tick is a call of one element's function."""

import math
from dataclasses import dataclass

import numpy as np

from ortilo_drake.loop.element import Box
from ortilo_drake.loop.native import native_of, parameters
from ortilo_drake.loop.wiring import Wire, Wiring

HEAD = '''"""A flight, made by ortilo_drake/loop/source.py: in each tick what is said, what is recorded, and the steps.

N, S, W and Y are the addresses of constants, states, room to work in and what is said; T has address and shape of each
table. A flight ends where {ends} says a cause, a number that is not negative.
"""

from numba import njit, types
'''


PART_HEAD = '''"""Part of a tick, made by ortilo_drake/loop/source.py; N, S, W, Y and T as in a whole flight."""

from numba import njit, types

'''


@dataclass(frozen=True)
class Places:
    """The memory layout of a wiring, box by box: constants in bytes, the rest in numbers of eight bytes.

    Attributes:
        numbers: of each box's record.
        state: of each state, by box and name: where, and its shape.
        work: likewise of each room to work in.
        said: of what each box says, where it does not show a state.
        tables: first of each table's entries in T, by box and name.
        sizes: of constants [bytes], states, work, what is said, and T.
    """

    numbers: dict[str, int]
    state: dict[tuple[str, str], tuple[int, tuple[int, ...]]]
    work: dict[tuple[str, str], tuple[int, tuple[int, ...]]]
    said: dict[str, int]
    tables: dict[tuple[str, str], int]
    sizes: tuple[int, int, int, int, int]


def places_of(wiring: Wiring) -> Places:
    """Return the places of all numbers, states, work arrays, outputs and tables of a wiring."""
    numbers, state, work, said, tables = {}, {}, {}, {}, {}
    at = [0, 0, 0, 0, 0]
    for box in wiring.boxes.values():
        numbers[box.name] = at[0]
        at[0] += -(-box.element.dtype.itemsize // 8) * 8  # every record begins where eight bytes may
        for name, start in box.given.start.items():
            shape = np.shape(start)
            state[box.name, name], at[1] = (at[1], shape), at[1] + math.prod(shape)
        for name, shape in box.work.items():
            work[box.name, name], at[2] = (at[2], shape), at[2] + math.prod(shape)
        if not box.element.shows and box.name not in wiring.holders:
            said[box.name], at[3] = at[3], at[3] + box.size
        for table in box.element.arrays:
            tables[box.name, table.name], at[4] = at[4], at[4] + 1 + table.dimensions
    for held, holder in wiring.holders.items():
        said[held] = said[holder] + wiring.boxes[holder].parts[held][0]
    return Places(numbers, state, work, said, tables, (at[0], at[1], at[2], at[3], at[4]))


def line_of(wiring: Wiring, places: Places, box: Box, what: str) -> str:
    """Return one line of a tick: the call of a box's `out` or `step`."""
    said: list[str] = []
    for name, dimensions, _ in parameters(box.element, box.element.functions[what]):
        if name == "n":
            said.append(f"N + {places.numbers[box.name]}")
        elif dimensions < 0:
            said.append(name)
        elif name == "seeds":
            said.append("seeds.ctypes.data, seeds.shape[0]")
        elif (box.name, name) in places.tables:
            at = places.tables[box.name, name]
            said += [f"T[{at + i}]" for i in range(1 + dimensions)]
        elif name in box.element.own:
            where, letter = (places.work, "W") if name in box.work else (places.state, "S")
            at, shape = where[box.name, name]
            said += [f"{letter} + {8 * at}", *map(str, shape)]
        else:
            wire = Wire(box.name, 0, box.size) if name == "out" else wiring.wires[box.name, name]
            letter, at = place_of(wiring, places, wire)
            said += [f"{letter} + {8 * at}", str(wire.size)]
    return f"{box.name}_{what}({', '.join(said)})"


def place_of(wiring: Wiring, places: Places, wire: Wire) -> tuple[str, int]:
    """Return the place of a wire's source: the array, states (S) or outputs (Y), and the index in it."""
    shows = wiring.boxes[wire.box].element.shows
    if shows:
        return "S", places.state[wire.box, shows][0] + wire.first
    return "Y", places.said[wire.box] + wire.first


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
    text = PART_HEAD + externals(wiring)
    for name, calls in parts.items():
        lines = "\n".join(f"    {line_of(wiring, places, box, what)}" for box, what in calls)
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
    text = HEAD.format(ends=ends) + "\n" + externals(wiring)
    body = [line_of(wiring, places, box, "out") for box in wiring.out_order]
    column = 0
    for wire in recorded:
        letter, at = place_of(wiring, places, wire)
        body += [f"for i in range({wire.size}):", f"    trace[k, {column} + i] = {letter}_[{at} + i]"]
        column += wire.size
    letter, at = place_of(wiring, places, Wire(ends, wiring.boxes[ends].size - 1, 1))
    body += [f"if {letter}_[{at}] >= 0.0 or k == last:", "    return k"]
    body += [line_of(wiring, places, box, "step") for box in wiring.step_order]
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
