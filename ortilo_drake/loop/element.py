"""An element: one box of the block diagram, described once for every player.

    out(...)    writes what the element says in tick k into `out`
    step(...)   changes the element's state from tick k to tick k + 1, in place

Both are plain functions. Their parameters, in any order, are the wiring:

    n            the element's constants, a record: n.mass, n.inertia[0]
    k            the tick, from 0
    seed         the seed of all noise in this tick
    seeds        the seeds of all ticks, for noise that is drawn for other ticks than k
    out          what the element says, an array of floats to write into
    <array>      one of the element's own arrays by its name: state, room to work in, a table
    <input>      any other name: an array that another element says

An element that `shows` one of its states says that array: nothing is copied.

The functions return nothing and, where they can help it, allocate nothing. numba compiles them (native.py); their plain
source runs on Drake's AutoDiffXd and Expression. Helpers that they call are register_jitable or njit.
"""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

RESERVED = ("n", "k", "seed", "seeds", "out")
Kind = Literal["f8", "i8", "u8", "b1"]


@dataclass(frozen=True)
class Number:
    """A constant of an element: its name, its shape and its kind.

    Floats (f8), whole numbers (i8) and streams of noise (u8) have eight bytes each: NumPy's record is then C's struct.
    """

    name: str
    shape: tuple[int, ...] = ()
    kind: Kind = "f8"


@dataclass(frozen=True)
class Array:
    """An array of any shape: its name, how many dimensions it has, and its kind."""

    name: str
    dimensions: int = 1
    kind: Kind = "f8"


@dataclass(frozen=True)
class Element:
    """What all boxes of one kind have in common.

    Attributes:
        name: of the kind.
        out: writes what it says; None where it shows a state.
        step: changes its state; None where it has none.
        numbers: its constants.
        tables: its constants of any shape.
        state: its states, of floats.
        work: room to work in, of floats, which outlives no call.
        shows: the state that it says; None where `out` says it.
        allocates: whether its functions make arrays. One that does not is compiled without numba's memory management.
        reads: what it reads where it has no functions: the vector inputs of a Drake System that plays it.
    """

    name: str
    out: Callable[..., None] | None = None
    step: Callable[..., None] | None = None
    numbers: tuple[Number, ...] = ()
    tables: tuple[Array, ...] = ()
    state: tuple[Array, ...] = ()
    work: tuple[Array, ...] = ()
    shows: str | None = None
    allocates: bool = False
    reads: tuple[str, ...] = ()

    @property
    def own(self) -> dict[str, Array]:
        """The element's own arrays by name."""
        return {array.name: array for array in (*self.state, *self.work, *self.tables)}

    @property
    def functions(self) -> dict[str, Callable[..., None]]:
        """Its functions by name, those that it has: `out` and `step`."""
        return {what: f for what, f in (("out", self.out), ("step", self.step)) if f is not None}

    def inputs_of(self, function: Callable[..., None]) -> list[str]:
        """Return the names of what one of its functions reads of other elements."""
        return [name for name in takes(function) if name not in RESERVED and name not in self.own]

    @property
    def inputs(self) -> list[str]:
        """Names of what it reads of other elements."""
        named = [name for f in self.functions.values() for name in self.inputs_of(f)]
        return list(dict.fromkeys([*self.reads, *named]))

    @property
    def dtype(self) -> np.dtype:
        """The record of its constants."""
        fields: Any = [(number.name, number.kind, number.shape) for number in self.numbers]
        return np.dtype(fields or [("nothing", "f8")], align=True)


def takes(function: Callable[..., None]) -> list[str]:
    """Return the names of a function's parameters."""
    return list(inspect.signature(function).parameters)


@dataclass(frozen=True)
class Given:
    """What a box is given: the values of its constants, its state at the start, its tables."""

    numbers: dict[str, Any] = field(default_factory=dict)
    start: dict[str, Any] = field(default_factory=dict)
    tables: dict[str, Any] = field(default_factory=dict)

    def with_(self, other: "Given") -> "Given":
        """Return the same with other values where the other has any."""
        return Given(self.numbers | other.numbers, self.start | other.start, self.tables | other.tables)


@dataclass(frozen=True)
class Box:
    """One element of a wiring.

    Attributes:
        name: within its wiring.
        element: what it does.
        size: of what it says.
        given: its values.
        work: shape of each room to work in.
        reads: which box each input reads, "box" or "box.part"; of an input that is not here the box of its name.
        parts: where a part of what it says stands: first index and size.
        holds: of a box without functions: names of boxes; what they say, one after the other, is what it says.
        system: a Drake System that plays the box, where no element can; only Drake's player has it fly.
    """

    name: str
    element: Element
    size: int
    given: Given = Given()
    work: dict[str, tuple[int, ...]] = field(default_factory=dict)
    reads: dict[str, str] = field(default_factory=dict)
    parts: dict[str, tuple[int, int]] = field(default_factory=dict)
    holds: tuple[str, ...] = ()
    system: Any = None

    def reading(self, **reads: str) -> "Box":
        """Return a box whose inputs read these boxes."""
        return replace(self, reads=self.reads | reads)


def bundle(name: str, boxes: list[Box]) -> Box:
    """Return a box that says what several boxes say, one after the other; each of them is a part of it."""
    parts, at = {}, 0
    for box in boxes:
        parts[box.name], at = (at, box.size), at + box.size
    return Box(name, Element("bundle"), at, parts=parts, holds=tuple(box.name for box in boxes))


OUTSIDE = Element("outside")


def outside(name: str, size: int) -> Box:
    """Return what stands for a signal from outside a wiring: an input of its Drake system."""
    return Box(name, OUTSIDE, size)


def constant(name: str, values: Any) -> Box:
    """Return a box that always says the same numbers."""
    start = np.atleast_1d(np.asarray(values, dtype=float))
    element = Element("constant", state=(Array("values"),), shows="values")
    return Box(name, element, start.size, Given(start={"values": start}))
