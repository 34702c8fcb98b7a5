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
    <group>      a NamedTuple of constants and tables, which its box takes (Box.taking)
    <input>      any other name: an array that another element says

An element that `shows` one of its states says that array: nothing is copied.

The functions return nothing and, where they can help it, allocate nothing. numba compiles them (native.py); their plain
source runs on Drake's AutoDiffXd and Expression. Helpers that they call are register_jitable, or njit if they return no
arrays: outside elements numba compiles an njit one once, as its first caller is, and code that counts no references
must give no arrays to code that does.
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

    Floats (f8), whole numbers (i8) and streams of noise (u8) have eight bytes each, truths (b1) one, as in C.
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
class Group:
    """A NamedTuple of numbers, arrays and other such tuples as one parameter of an element's functions.

    Its numbers are among the element's constants and its arrays among the tables, each as "<group>_<field>".

    Attributes:
        name: of the parameter.
        of: its class.
        fields: in the order of the class.
    """

    name: str
    of: type
    fields: tuple["Number | Array | Group", ...]

    @property
    def leaves(self) -> list[Number | Array]:
        """Its numbers and arrays, and those of the groups in it."""
        return [leaf for item in self.fields for leaf in (item.leaves if isinstance(item, Group) else [item])]

    def filled(self, record: Any, array_of: Callable[[str], Any]) -> Any:
        """Return the tuple, of the element's record and its arrays by their names."""
        values = []
        for item in self.fields:
            if isinstance(item, Group):
                values.append(item.filled(record, array_of))
            else:
                values.append(record[item.name] if isinstance(item, Number) else array_of(item.name))
        return self.of(*values)


def group_of(name: str, values: Any) -> tuple[Group, "Values"]:
    """Return the fields of a NamedTuple as a Group, and its values as a box is given them.

    Raises:
        ValueError: if a field is no number, array of numbers or such a tuple.
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
    """Return the kind of a constant's numbers; ValueError where it is not of numbers."""
    kind = np.asarray(value).dtype.kind
    if kind not in _KINDS:
        raise ValueError(f"{name}: is {value!r}, must be a number or an array of numbers")
    return _KINDS[kind]


@dataclass(frozen=True)
class Element:
    """A kind of box: its functions, and of a box the constants, tables, states and work that its values make.

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
        groups: NamedTuples that its functions take.
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

    def having(self, given: "Values", work: dict[str, tuple[int, ...]]) -> "Element":
        """Return the element with the numbers, tables, state and work of a box's values."""
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
        """Its numbers and those of its groups."""
        return (*self.numbers, *(item for group in self.groups for item in group.leaves if isinstance(item, Number)))

    @property
    def arrays(self) -> tuple[Array, ...]:
        """Its tables and those of its groups."""
        return (*self.tables, *(item for group in self.groups for item in group.leaves if isinstance(item, Array)))

    @property
    def own(self) -> dict[str, Array]:
        """The element's own arrays by name."""
        return {array.name: array for array in (*self.state, *self.work, *self.arrays)}

    @property
    def grouped(self) -> dict[str, Group]:
        """Its groups by name."""
        return {group.name: group for group in self.groups}

    @property
    def functions(self) -> dict[str, Callable[..., None]]:
        """Its functions by name, those that it has: `out` and `step`."""
        return {what: f for what, f in (("out", self.out), ("step", self.step)) if f is not None}

    def inputs_of(self, function: Callable[..., None]) -> list[str]:
        """Return the names of what one of its functions reads of other elements."""
        known = {*RESERVED, *self.own, *self.grouped}
        return [name for name in takes(function) if name not in known]

    @property
    def inputs(self) -> list[str]:
        """Names of what it reads of other elements."""
        named = [name for f in self.functions.values() for name in self.inputs_of(f)]
        return list(dict.fromkeys([*self.reads, *named]))

    @property
    def dtype(self) -> np.dtype:
        """The record of its constants."""
        fields: Any = [(number.name, number.kind, number.shape) for number in self.constants]
        return np.dtype(fields or [("nothing", "f8")], align=True)


def takes(function: Callable[..., None]) -> list[str]:
    """Return the names of a function's parameters."""
    return list(inspect.signature(function).parameters)


@dataclass(frozen=True)
class Values:
    """The values given to a box: its constants, its state at the start, its tables."""

    numbers: dict[str, Any] = field(default_factory=dict)
    start: dict[str, Any] = field(default_factory=dict)
    tables: dict[str, Any] = field(default_factory=dict)

    def updated(self, other: "Values") -> "Values":
        """Return the same with other values where the other has any."""
        return Values(self.numbers | other.numbers, self.start | other.start, self.tables | other.tables)


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
    given: Values = Values()
    work: dict[str, tuple[int, ...]] = field(default_factory=dict)
    reads: dict[str, str] = field(default_factory=dict)
    parts: dict[str, tuple[int, int]] = field(default_factory=dict)
    holds: tuple[str, ...] = ()
    system: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "element", self.element.having(self.given, self.work))

    def with_inputs(self, **reads: str) -> "Box":
        """Return a box whose inputs read these boxes."""
        return replace(self, reads=self.reads | reads)

    def with_groups(self, **tuples: Any) -> "Box":
        """Return a box whose functions take these NamedTuples as well, by the names of their parameters.

        Raises:
            ValueError: if a field of one is no number, array of numbers or NamedTuple of them.
        """
        groups, given = list[Group](), self.given
        for name, values in tuples.items():
            group, its = group_of(name, values)
            groups.append(group)
            given = given.updated(its)
        return replace(self, element=replace(self.element, groups=(*self.element.groups, *groups)), given=given)


def parts_of(sizes: Mapping[str, int]) -> dict[str, tuple[int, int]]:
    """Return where parts of these sizes stand, one after the other: first index and size."""
    starts = accumulate(sizes.values(), initial=0)
    return {name: (at, size) for at, (name, size) in zip(starts, sizes.items(), strict=False)}


def bundle(name: str, boxes: list[Box]) -> Box:
    """Return a box that says what several boxes say, one after the other, each a part of it; 0 where there are none."""
    if not boxes:
        return constant(name, 0.0)
    sizes = {box.name: box.size for box in boxes}
    return Box(name, Element("bundle"), sum(sizes.values()), parts=parts_of(sizes), holds=tuple(sizes))


OUTSIDE = Element("outside")


def outside(name: str, size: int) -> Box:
    """Return the box of a signal from outside a wiring: an input of its Drake system."""
    return Box(name, OUTSIDE, size)


def constant(name: str, values: Any) -> Box:
    """Return a box that always says the same numbers."""
    start = np.atleast_1d(np.asarray(values, dtype=float))
    return Box(name, Element("constant", shows="values"), start.size, Values(start={"values": start}))
