"""Flights of a wiring, compiled: generated source that calls the elements' compiled functions, without the GIL."""

from typing import Any

import numpy as np
from numba import typeof

from ortilo_drake.compiled.digest import digest_of
from ortilo_drake.compiled.generated import load
from ortilo_drake.compiled.inlined import helpers_only_linked
from ortilo_drake.loop.element import Values
from ortilo_drake.loop.raised import listen, tell
from ortilo_drake.loop.source import Places, flight_text, places_of
from ortilo_drake.loop.wiring import Wiring

NOTHING: dict[str, Values] = {}


class Player:
    """Flies a wiring, any number of times, on any thread.

    Args:
        wiring: what flies.
        recorded: what is kept of each tick, "box" or "box.part".
        ends: the box whose last number ends a flight where it is not negative: the cause.

    Attributes:
        width: numbers that are kept of each tick.
    """

    def __init__(self, wiring: Wiring, recorded: tuple[str, ...], ends: str):
        self.wiring, self._places = wiring, places_of(wiring)
        wires = [wiring.wire(name, "recorded") for name in recorded]
        self.width = sum(wire.size for wire in wires)
        self._memory = its = Memory(wiring, self._places)
        with helpers_only_linked():  # one block for all elements: Python collects numba's garbage once, at the end
            self.text = flight_text(wiring, self._places, wires, ends)
            self._fly: Any = load(f"flight_{digest_of(self.text)}", self.text, {}).fly
            self._fly.compile(tuple(map(typeof, (its.N, its.S, its.W, its.Y, its.T, its.seeds, self.rows(1)))))

    def rows(self, ticks: int) -> np.ndarray:
        """Return room for what is kept of so many ticks (ticks, width)."""
        return np.empty((ticks, self.width))

    def fly(self, seeds: np.ndarray, trace: np.ndarray, drawn: dict[str, Values] = NOTHING) -> int:
        """Fly once; write a row for each tick, and return the last tick.

        Args:
            seeds: of all noise, at each tick (ticks).
            trace: rows to write (ticks, width).
            drawn: of each box that differs in this flight what it is given in place of its own.

        Raises:
            ValueError: if the shapes do not fit, or what is drawn is not the box's.
            ElementError: if an element raises in flight.
        """
        if trace.shape != (len(seeds), self.width) or trace.dtype != np.float64 or seeds.dtype != np.int64:
            raise ValueError(f"trace: has the shape {trace.shape}, must have {(len(seeds), self.width)}")
        memory = self._memory.copy()
        for name, given in drawn.items():
            memory.put(name, given)
        listen()
        last = int(self._fly(memory.N, memory.S, memory.W, memory.Y, memory.T, seeds, trace))
        tell(self.wiring.boxes.values())
        return last


class Memory:
    """All that one flight of a wiring reads and writes.

    Attributes:
        N: constants, bytes.
        S: states.
        W: room to work in.
        Y: what is said.
        T: address and shape of each table.
        seeds: of all noise, for a player that flies one seed.
    """

    _known: tuple[int, int, list[int], np.ndarray, int] | None

    def __init__(self, wiring: Wiring, places: Places):
        self.seeds = np.zeros(1, dtype=np.int64)
        self._wiring, self._places = wiring, places
        self.N, self.T = np.zeros(places.sizes["N"], np.uint8), np.zeros(places.sizes["T"], np.int64)
        self.S, self.W, self.Y = (np.zeros(places.sizes[letter]) for letter in "SWY")
        self._kept = dict[tuple[str, str], np.ndarray]()
        for name, box in wiring.boxes.items():
            self.put(name, box.given)

    def copy(self) -> "Memory":
        """Return the memory of another flight: what is constant in both is shared."""
        other = Memory.__new__(Memory)
        other.__dict__.update(self.__dict__)
        other.N, other.S, other.T = self.N.copy(), self.S.copy(), self.T.copy()
        other.W, other.Y = np.zeros_like(self.W), np.zeros_like(self.Y)
        other._kept, other._known = dict(self._kept), None
        return other

    @property
    def known(self) -> tuple[int, int, list[int], np.ndarray, int]:
        """Addresses of N and W, T as a list, and the seeds with the first of them; for calls of single functions."""
        if self._known is None:
            addresses = self.N.ctypes.data, self.W.ctypes.data
            self._known = (*addresses, self.T.tolist(), self.seeds, int(self.seeds[0]))
        return self._known

    def __deepcopy__(self, memo: Any) -> "Memory":
        """Return itself: Drake copies what a Context holds, and nothing here changes once a Context has it."""
        return self

    def numbers_of(self, name: str) -> Any:
        """Return a box's constants as attributes, in their place in N."""
        at, dtype = self._places.numbers[name], self._wiring.boxes[name].element.dtype
        return self.N[at : at + dtype.itemsize].view(dtype).view(np.recarray)[0]

    def table_of(self, name: str, table: str) -> np.ndarray:
        """Return one of a box's tables."""
        return self._kept[name, table]

    def put(self, name: str, given: Values) -> None:
        """Put in what a box is given; ValueError if there is no such box, or it has no such value or shape."""
        self._known, box = None, self._wiring.boxes.get(name)
        if box is None:
            raise ValueError(f"drawn: {name!r}: must be one of {', '.join(self._wiring.boxes)}")
        record, states = self.numbers_of(name), {state.name for state in box.element.state}
        tables = {table.name: table for table in box.element.arrays}
        for its, known in ((given.numbers, record.dtype.names), (given.start, states), (given.tables, tables)):
            if unknown := [value for value in its if value not in known]:
                raise ValueError(f"drawn: {name}: {unknown[0]!r}: must be one of {', '.join(known) or 'none'}")
        for number, value in given.numbers.items():
            record[number] = value
        for state, value in given.start.items():
            place = self._places.arrays[name, state]
            if np.shape(value) != place.shape:
                raise ValueError(f"{name}: {state}: has the shape {np.shape(value)}, must have {place.shape}")
            place.of(self.S)[...] = value
        for table, value in given.tables.items():
            values, dimensions = np.ascontiguousarray(value, dtype=tables[table].kind), tables[table].dimensions
            if values.ndim != dimensions:
                raise ValueError(f"{name}: {table}: has the shape {values.shape}, must have {dimensions} dimensions")
            first = self._places.arrays[name, table].at
            self._kept[name, table] = values
            self.T[first : first + 1 + dimensions] = values.ctypes.data, *values.shape
