"""The calls that a tick of a wiring makes, of compiled functions and of plain source."""

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from ortilo_drake.compiled.digest import digest_of
from ortilo_drake.compiled.generated import load
from ortilo_drake.loop.element import OUTSIDE, Box, takes
from ortilo_drake.loop.native import native_of
from ortilo_drake.loop.plain import plain_source
from ortilo_drake.loop.player import Memory
from ortilo_drake.loop.source import line_of, part_text, places_of
from ortilo_drake.loop.wiring import Wiring

Calls = list[tuple[Box, str]]


class Reading:
    """The outside values that a part of a wiring reads within a tick, and the calls that a tick makes.

    Attributes:
        inputs: boxes that stand for what comes from outside, by name.
        reads: of each box that computes what it says, the names of the inputs that this depends on within a tick.
        groups: the calls that say what depends on these inputs, by their names; of no input first.
        steps: the calls that change states.
    """

    def __init__(self, wiring: Wiring):
        self._wiring = wiring
        self.inputs = {name: box for name, box in wiring.boxes.items() if box.element is OUTSIDE}
        self.reads: dict[str, frozenset[str]] = {name: frozenset([name]) for name in self.inputs}
        for box in wiring.out_order:
            wires = (wiring.wires[box.name, port] for port in box.element.inputs_of(box.element.functions["out"]))
            self.reads[box.name] = frozenset().union(*(self.of(wire.box) for wire in wires))
        said = {box.name: self.reads[box.name] for box in wiring.out_order}
        self.groups: dict[frozenset[str], Calls] = {
            needs: [(wiring.boxes[name], "out") for name, its in said.items() if its <= needs and (its or not needs)]
            # In the same order in every process: it is in generated code.
            for needs in sorted({frozenset(), self.all, *said.values()}, key=sorted)
        }
        self.steps: Calls = [(box, "step") for box in wiring.step_order]

    def of(self, name: str) -> frozenset[str]:
        """Return the inputs that what a box says depends on within a tick."""
        held = self._wiring.boxes[name].holds
        return self.reads.get(name, frozenset()).union(*(self.of(one) for one in held))

    @property
    def draws(self) -> bool:
        """True if any box draws random numbers."""
        functions = [f for box in self._wiring.boxes.values() for f in box.element.functions.values()]
        return any({"seed", "seeds"} & set(takes(f)) for f in functions)

    @property
    def all(self) -> frozenset[str]:
        """The inputs that anything that is said depends on within a tick."""
        return frozenset().union(*(self.of(name) for name in self._wiring.boxes if name not in self.inputs))


def compiled_calls(wiring: Wiring, parts: dict[str, Calls]) -> dict[str, Callable[..., None]]:
    """Return functions (memory, S, Y, k) of compiled code, by name, that make calls one after the other."""
    places, boxes = places_of(wiring), [box for box in wiring.boxes.values() if box.element.functions]
    if len(boxes) <= 1:  # of a constant none
        return {name: _single(wiring, calls) for name, calls in parts.items()}
    text = part_text(wiring, places, parts)
    module = load(f"part_{digest_of(text)}", text, {})
    return {name: _of_memory(getattr(module, name)) for name in parts}


def _of_memory(function: Callable[..., None]) -> Callable[..., None]:
    def call(memory: Memory, S: np.ndarray, Y: np.ndarray, k: int) -> None:
        function(memory.N, S, memory.W, Y, memory.T, memory.seeds, k)

    return call


def _single(wiring: Wiring, calls: Calls) -> Callable[..., None]:
    """Return likewise a function that makes the call of one box by itself: nothing is compiled but the element."""
    places = places_of(wiring)
    lines = "\n".join(f"    {line_of(places, box, what)}" for box, what in calls) or "    pass"
    text = f"""def call(memory, S_, Y_, k):
    N, W, T, seeds, seed = memory.known
    S, Y = S_.__array_interface__["data"][0], Y_.__array_interface__["data"][0]
{lines}
"""
    known: dict[str, Any] = {}
    for box, what in calls:
        native = native_of(box.element)[what]
        known[f"{box.name}_{what}"] = ctypes.PYFUNCTYPE(None, *[ctypes.c_int64] * native.arguments)(native.address)
    exec(text, known)
    call: Callable[..., None] = known["call"]
    return call


class PlainCalls:
    """Calls of plain source of a wiring's boxes, on arrays of a scalar type T; floats take the functions as is."""

    def __init__(self, wiring: Wiring, T: type):
        self._places, self._T = places_of(wiring), T
        self._functions = {
            (box.name, what): (f if T is float else plain_source(f), takes(f))
            for box in wiring.boxes.values()
            for what, f in box.element.functions.items()
        }

    def make(self, calls: Calls, memory: Memory, S: np.ndarray, Y: np.ndarray, k: int) -> None:
        """Make calls one after the other; they read and write states and what is said.

        Raises:
            RuntimeError: naming the box whose plain source takes no such scalar.
        """
        for box, what in calls:
            try:
                self.call(box, what, memory, S, Y, k)
            except (TypeError, AttributeError, RuntimeError) as error:
                raise RuntimeError(f"{box.name}: its {what} takes no {self._T.__name__}: {error}") from error

    def call(self, box: Box, what: str, memory: Memory, S: np.ndarray, Y: np.ndarray, k: int) -> Any:
        """Make one call; return what the function returns, which should be nothing."""

        def array(name: str) -> np.ndarray:
            place = self._places.arrays[box.name, name]
            if place.letter == "T":
                return memory.table_of(box.name, name)
            if place.letter == "W":
                return np.full(place.shape, self._T(0.0))
            return place.of(S if place.letter == "S" else Y)

        function, names = self._functions[box.name, what]
        n, groups = memory.numbers_of(box.name), box.element.grouped
        known = {"n": n, "k": k, "seed": int(memory.seeds[0]), "seeds": memory.seeds}
        known |= {name: groups[name].filled(n, array) for name in names if name in groups}
        return function(*[known[name] if name in known else array(name) for name in names])
