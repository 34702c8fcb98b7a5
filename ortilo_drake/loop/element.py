"""An element: one box of the block diagram, described once for every player.

    out(...)    writes the element's output of tick k into `out`
    step(...)   changes the element's state from tick k to tick k + 1, in place

Both are plain functions. Their parameters, in any order, are the wiring:

    n            the element's constants, a record: n.mass, n.inertia[0]
    k            the tick, from 0
    seed         the seed of all noise in this tick
    seeds        the seeds of all ticks, for noise drawn for ticks other than k
    out          the element's output, an array of floats to write into
    <array>      one of the element's own arrays by name: a state, a work array, a table
    <group>      a NamedTuple of constants and tables, added by Box.with_groups
    <input>      any other name: the output array of another element

An element that `shows` one of its states has that state's array as output: nothing is copied.

The functions return nothing and allocate no memory where they can avoid it. numba compiles them (native.py); their
plain source runs on Drake's AutoDiffXd and Expression. Helpers that they call are register_jitable, or njit if the
helpers return no arrays: numba compiles an njit helper outside elements once, with the options of its first caller, and
code that counts no references must pass no arrays to code that counts them.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import Any, Literal

import numpy as np

RESERVED = ("n", "k", "seed", "seeds", "out")
Kind = Literal["f8", "i8", "u8", "b1"]
_KINDS: dict[str, Kind] = {"f": "f8", "i": "i8", "u": "u8", "b": "b1"}


@dataclass(frozen=True)
class Number:
    """A constant of an element: its name, its shape and its kind.

    Floats (f8), integers (i8) and noise streams (u8) take eight bytes each, booleans (b1) one, as in C.
    """

    name: str
    shape: tuple[int, ...] = ()
    kind: Kind = "f8"


@dataclass(frozen=True)
class Array:
    """An array of any shape: its name, its number of dimensions, and its kind."""

    name: str
    dimensions: int = 1
    kind: Kind = "f8"


@dataclass(frozen=True)
class Group:
    """A NamedTuple of numbers, arrays and other such NamedTuples, as one parameter of an element's functions.

    The group's numbers are among the element's constants and its arrays among the tables, named "<group>_<field>".

    Attributes:
        name: name of the parameter.
        of: class of the NamedTuple.
        fields: numbers, arrays and groups in the order of the class's fields.
    """

    name: str
    of: type
    fields: tuple["Number | Array | Group", ...]

    @property
    def leaves(self) -> list[Number | Array]:
        """The group's numbers and arrays, with the numbers and arrays of the groups in it."""
        return [leaf for item in self.fields for leaf in (item.leaves if isinstance(item, Group) else [item])]

    def filled(self, record: Any, array_of: Callable[[str], Any]) -> Any:
        """Return the NamedTuple, filled from the element's record and from its arrays by name."""
        values = []
        for item in self.fields:
            if isinstance(item, Group):
                values.append(item.filled(record, array_of))
            else:
                values.append(record[item.name] if isinstance(item, Number) else array_of(item.name))
        return self.of(*values)


def group_of(name: str, values: Any) -> tuple[Group, "Values"]:
    """Return the fields of a NamedTuple as a Group, and its values as a box's Values.

    ValueError if a field is no number, array of numbers or such a NamedTuple.
    """
    fields, given = list[Number | Array | Group](), Values()
    for field_name, value in values._asdict().items():
        full_name = f"{name}_{field_name}"
        if hasattr(value, "_asdict"):
            group, its = group_of(full_name, value)
            fields.append(group)
        else:
            kind, dimensions = kind_of(f"{type(values).__name__}.{field_name}", value), np.ndim(value)
            fields.append(Array(full_name, dimensions, kind) if dimensions else Number(full_name, kind=kind))
            its = Values(tables={full_name: value}) if dimensions else Values({full_name: value})
        given = given.updated(its)
    return Group(name, type(values), tuple(fields)), given


def kind_of(name: str, value: Any) -> Kind:
    """Return the kind of a constant's numbers; ValueError if the constant does not consist of numbers."""
    try:
        kind = np.asarray(value).dtype.kind
    except ValueError:  # lists of different lengths
        kind = "O"
    if kind not in _KINDS:
        raise ValueError(f"{name}: is {value!r}, must be a number or an array of numbers")
    return _KINDS[kind]


@dataclass(frozen=True)
class Element:
    """A kind of box: its two functions, and the names and shapes of its constants, tables, states and work arrays.

    Attributes:
        name: name of the kind.
        out: function that writes the output; None if the element shows a state.
        step: function that changes the state; None if the element has no state.
        numbers: constants in the record `n`.
        tables: constant arrays of any shape.
        state: arrays of floats that last from tick to tick.
        work: scratch arrays of floats; their values do not last from call to call.
        shows: name of the state that is the output; None if `out` writes the output.
        allocates: whether the functions make arrays. If not, numba compiles them without its memory management.
        reads: inputs of an element without functions: the vector inputs of the Drake System that plays it.
        groups: NamedTuples that the functions take as parameters.
        checked: whether compiled code checks array indices, and an error that a function raises ends the flight.
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
    groups: tuple[Group, ...] = ()
    checked: bool = False

    def having(self, given: "Values", work: dict[str, tuple[int, ...]]) -> "Element":
        """Return the element with the numbers, tables and state that `given` has, and with these work arrays."""
        grouped = {leaf.name for group in self.groups for leaf in group.leaves}
        numbers = [(name, its) for name, its in given.numbers.items() if name not in grouped]
        tables = [(name, its) for name, its in given.tables.items() if name not in grouped]
        had = replace(
            self,
            numbers=tuple(Number(name, np.shape(its), kind_of(name, its)) for name, its in numbers),
            tables=tuple(Array(name, np.ndim(its), kind_of(name, its)) for name, its in tables),
            state=tuple(Array(name, np.ndim(its)) for name, its in given.start.items()),
            work=tuple(Array(name, len(shape)) for name, shape in work.items()),
        )
        return self if had == self else had

    @property
    def constants(self) -> tuple[Number, ...]:
        """The element's numbers and the numbers of its groups."""
        return (*self.numbers, *(item for group in self.groups for item in group.leaves if isinstance(item, Number)))

    @property
    def arrays(self) -> tuple[Array, ...]:
        """The element's tables and the arrays of its groups."""
        return (*self.tables, *(item for group in self.groups for item in group.leaves if isinstance(item, Array)))

    @property
    def own(self) -> dict[str, Array]:
        """The element's own arrays (states, work arrays, tables) by name."""
        return {array.name: array for array in (*self.state, *self.work, *self.arrays)}

    @property
    def grouped(self) -> dict[str, Group]:
        """The element's groups by name."""
        return {group.name: group for group in self.groups}

    @property
    def functions(self) -> dict[str, Callable[..., None]]:
        """The element's functions by name: `out`, `step`, or both."""
        return {what: f for what, f in (("out", self.out), ("step", self.step)) if f is not None}

    def inputs_of(self, function: Callable[..., None]) -> list[str]:
        """Return the names of the inputs that one of the element's functions reads from other elements."""
        known = {*RESERVED, *self.own, *self.grouped}
        return [name for name in takes(function) if name not in known]

    @property
    def inputs(self) -> list[str]:
        """The names of all inputs that the element reads from other elements."""
        named = [name for f in self.functions.values() for name in self.inputs_of(f)]
        return list(dict.fromkeys([*self.reads, *named]))

    @property
    def dtype(self) -> np.dtype:
        """The type of the record that holds the element's constants."""
        fields: Any = [(number.name, number.kind, number.shape) for number in self.constants]
        return np.dtype(fields or [("nothing", "f8")], align=True)


def takes(function: Callable[..., None]) -> list[str]:
    """Return the names of a function's parameters."""
    return list(inspect.signature(function).parameters)


@dataclass(frozen=True)
class Values:
    """The values given to a box: its constants, its states in tick 0 (`start`), its tables."""

    numbers: dict[str, Any] = field(default_factory=dict)
    start: dict[str, Any] = field(default_factory=dict)
    tables: dict[str, Any] = field(default_factory=dict)

    def updated(self, other: "Values") -> "Values":
        """Return these values, replaced or extended by the values of `other`."""
        return Values(self.numbers | other.numbers, self.start | other.start, self.tables | other.tables)


@dataclass(frozen=True)
class Box:
    """One element of a wiring.

    Attributes:
        name: name of the box, unique in its wiring.
        element: the functions of the box and the layout of its values.
        size: size of the output.
        given: values of the constants, tables and states.
        work: shape of each work array.
        reads: source of each input, "box" or "box.part"; an input that is not listed reads the box of the same name.
        parts: named parts of the output: first index and size of each.
        holds: names of boxes whose outputs, one after the other, are the output of a box without functions: its parts.
        system: a Drake System that plays the box where no element can; only Drake's player can fly such a box.
    """

    name: str
    element: Element
    size: int
    given: Values = Values()
    work: dict[str, tuple[int, ...]] = field(default_factory=dict)
    reads: dict[str, str] = field(default_factory=dict)
    parts: dict[str, tuple[int, int]] = field(default_factory=dict)
    holds: tuple[str, ...] = ()
    system: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "element", self.element.having(self.given, self.work))

    def with_inputs(self, **reads: str) -> "Box":
        """Return a copy of the box whose inputs read these boxes."""
        return replace(self, reads=self.reads | reads)

    def with_groups(self, **tuples: Any) -> "Box":
        """Return a copy of the box whose functions also take these NamedTuples, named as their parameters.

        Raises:
            ValueError: if a field of a tuple is no number, array of numbers or NamedTuple of them.
        """
        groups, given = list[Group](), self.given
        for name, values in tuples.items():
            group, its = group_of(name, values)
            groups.append(group)
            given = given.updated(its)
        return replace(self, element=replace(self.element, groups=(*self.element.groups, *groups)), given=given)


def parts_of(sizes: Mapping[str, int]) -> dict[str, tuple[int, int]]:
    """Return the first index and the size of each part, for parts that follow one another in one vector."""
    starts = accumulate(sizes.values(), initial=0)
    return {name: (at, size) for at, (name, size) in zip(starts, sizes.items(), strict=False)}


def bundle(name: str, boxes: list[Box]) -> Box:
    """Return a box whose output joins the outputs of boxes, each a named part; a constant 0 if there are no boxes."""
    if not boxes:
        return constant(name, 0.0)
    sizes = {box.name: box.size for box in boxes}
    return Box(name, Element("bundle"), sum(sizes.values()), parts=parts_of(sizes), holds=tuple(sizes))


OUTSIDE = Element("outside")


def outside(name: str, size: int) -> Box:
    """Return the box of a signal from outside a wiring: an input port of the wiring's Drake system."""
    return Box(name, OUTSIDE, size)


def constant(name: str, values: Any) -> Box:
    """Return a box whose output is constant."""
    start = np.atleast_1d(np.asarray(values, dtype=float))
    return Box(name, Element("constant", shows="values"), start.size, Values(start={"values": start}))
