"""Functions that take a NamedTuple of numbers and arrays, as elements.

Whoever brings a sensor or an estimator of their own (model/parts.py) writes functions of such a tuple. An element has
its constants in a record and its arrays as tables instead, so an element's function is made that puts the tuple
together and hands it on:

    def reading(numbers, n, k, state, out): ...

    fields = fields_of(Numbers(sd=0.1, heights=np.zeros(3)))
    out = function_of(fields, reading, "n", "k", "state", "out")
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ortilo_drake.loop.element import Array, Given, Kind, Number

_PREFIX = "its_"  # of the fields' names among an element's own
_KINDS: dict[str, Kind] = {"f": "f8", "i": "i8", "u": "u8", "b": "b1"}


@dataclass(frozen=True)
class Fields:
    """What a NamedTuple is made of.

    Attributes:
        of: its class.
        kinds: of each field: of a plain number, or of the numbers in an array.
        dimensions: of each field's array; 0 of a plain number.
    """

    of: type
    kinds: tuple[Kind, ...]
    dimensions: tuple[int, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fields."""
        names: tuple[str, ...] = self.of._fields  # type: ignore[attr-defined]
        return names

    @property
    def numbers(self) -> tuple[Number, ...]:
        """The plain numbers as an element has them."""
        listed = zip(self.names, self.kinds, self.dimensions, strict=True)
        return tuple(Number(_PREFIX + name, kind="i8" if kind == "b1" else kind) for name, kind, n in listed if n == 0)

    @property
    def tables(self) -> tuple[Array, ...]:
        """The arrays as an element has them."""
        listed = zip(self.names, self.kinds, self.dimensions, strict=True)
        return tuple(Array(_PREFIX + name, n, kind) for name, kind, n in listed if n > 0)

    def given(self, numbers: Any) -> Given:
        """Return the values of such a tuple as a box is given them."""
        values = {_PREFIX + name: value for name, value in numbers._asdict().items()}
        tables = {array.name: values.pop(array.name) for array in self.tables}
        return Given(values, tables=tables)


def fields_of(numbers: Any) -> Fields:
    """Return what a NamedTuple of plain numbers and arrays is made of.

    Raises:
        ValueError: if a field is neither.
    """
    kinds, dimensions = [], []
    for name, value in numbers._asdict().items():
        found = np.asarray(value)
        if found.dtype.kind not in _KINDS:
            raise ValueError(f"{type(numbers).__name__}.{name}: is {value!r}, must be a number or an array of numbers")
        kinds.append(_KINDS[found.dtype.kind])
        dimensions.append(found.ndim)
    return Fields(type(numbers), tuple(kinds), tuple(dimensions))


def function_of(fields: Fields, function: Callable[..., None], *takes: str) -> Callable[..., None]:
    """Return an element's function that calls another one with the NamedTuple and with what it takes beside it.

    Args:
        fields: of the NamedTuple.
        function: (numbers, *takes); of compiled code: register_jitable or njit.
        takes: names of its other arguments, as of any element's function.
    """
    tables = [array.name for array in fields.tables]
    values = []
    for name, kind, dimensions in zip(fields.names, fields.kinds, fields.dimensions, strict=True):
        value = f"{_PREFIX}{name}" if dimensions else f"n.{_PREFIX}{name}"
        values.append(f"{value} != 0" if kind == "b1" and not dimensions else value)
    names = ", ".join(dict.fromkeys((*takes, "n", *tables)))
    text = f"def taking({names}):\n    function({', '.join(('of(' + ', '.join(values) + ')', *takes))})\n"
    made: dict[str, Any] = {"__name__": function.__module__, "of": fields.of, "function": function}
    exec(text, made)
    taking: Callable[..., None] = made["taking"]
    return taking
