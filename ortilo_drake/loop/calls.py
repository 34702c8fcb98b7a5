"""The calls that a tick of a wiring makes, of compiled functions and of plain source."""

import ctypes
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numpy as np

from ortilo_drake.compiled.digest import digest_of
from ortilo_drake.loop.element import OUTSIDE, Box, takes
from ortilo_drake.loop.generated import load
from ortilo_drake.loop.native import native_of
from ortilo_drake.loop.plain import plain_source
from ortilo_drake.loop.player import Memory
from ortilo_drake.loop.source import line_of, part_text, place_of, places_of
from ortilo_drake.loop.wiring import Wire, Wiring

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
        said = [box for box in wiring.out_order if box.element.out]
        needed = {frozenset(), self.all, *(self.reads[box.name] for box in said)}
        self.groups: dict[frozenset[str], Calls] = {
            needs: [
                (box, "out") for box in said if self.reads[box.name] <= needs and (self.reads[box.name] or not needs)
            ]
            for needs in sorted(needed, key=sorted)  # in the same order in every process: it is in generated code
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
    lines = "\n".join(f"    {line_of(wiring, places, box, what)}" for box, what in calls) or "    pass"
    text = f"""def call(memory, S_, Y_, k):
    N, W, T, seeds, seed = memory.known
    S, Y = S_.__array_interface__["data"][0], Y_.__array_interface__["data"][0]
{lines}
"""
    made: dict[str, Any] = {f"{box.name}_{what}": _entry(box, what) for box, what in calls}
    exec(_code(text), made)
    call: Callable[..., None] = made["call"]
    return call


@lru_cache(maxsize=512)
def _code(text: str) -> Any:
    return compile(text, "<element>", "exec")


def _entry(box: Box, what: str) -> Any:
    native = native_of(box.element)[what]
    return ctypes.PYFUNCTYPE(None, *[ctypes.c_int64] * native.arguments)(native.address)


class PlainCalls:
    """Calls of plain source of a wiring's boxes, on arrays of a scalar type T."""

    def __init__(self, wiring: Wiring, T: type):
        self._wiring, self._places, self._T = wiring, places_of(wiring), T
        self._functions = {
            (box.name, what): (plain_source(f), takes(f))
            for box in wiring.boxes.values()
            for what, f in box.element.functions.items()
        }

    def make(self, calls: Calls, memory: Memory, S: np.ndarray, Y: np.ndarray, k: int) -> None:
        """Make calls one after the other; they read and write states and what is said.

        Raises:
            RuntimeError: naming the box whose plain source takes no such scalar.
        """
        work = np.full(self._places.sizes[2], self._T(0.0))
        for box, what in calls:
            function, names = self._functions[box.name, what]
            common = {"k": k, "seed": int(memory.seeds[0]), "seeds": memory.seeds}
            known = memory, S, Y, work
            arguments = [common[name] if name in common else self._argument(box, name, *known) for name in names]
            try:
                function(*arguments)
            except (TypeError, AttributeError, RuntimeError) as error:
                raise RuntimeError(f"{box.name}: its {what} takes no {self._T.__name__}: {error}") from error

    def _argument(self, box: Box, name: str, memory: Memory, S: np.ndarray, Y: np.ndarray, work: np.ndarray) -> Any:
        if name == "n":
            return memory.numbers_of(box.name)
        if name in box.element.grouped:
            arrays = partial(memory.table_of, box.name)
            return box.element.grouped[name].filled(memory.numbers_of(box.name), arrays)
        if name in box.element.own:
            for places, array in ((self._places.state, S), (self._places.work, work)):
                if (box.name, name) in places:
                    at, shape = places[box.name, name]
                    return array[at : at + int(np.prod(shape))].reshape(shape)
            return memory.table_of(box.name, name)
        wire = Wire(box.name, 0, box.size) if name == "out" else self._wiring.wires[box.name, name]
        letter, at = place_of(self._wiring, self._places, wire)
        return (S if letter == "S" else Y)[at : at + wire.size]
