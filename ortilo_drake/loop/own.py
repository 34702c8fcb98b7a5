"""Boxes for your own elements, made of plain functions and values.

def out(n, estimate, reference, out):
    out[0] = n.gain * (reference[2] - estimate[2])

made = box(1, out, numbers={"gain": 2.0})
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import replace
from keyword import iskeyword
from numbers import Integral
from typing import Any

import numpy as np

from ortilo_drake.compiled.digest import plain
from ortilo_drake.loop.calls import PlainCalls
from ortilo_drake.loop.element import Box, Element, Values, kind_of, outside
from ortilo_drake.loop.player import Memory
from ortilo_drake.loop.raised import ElementError
from ortilo_drake.loop.source import places_of
from ortilo_drake.loop.wiring import Wiring, check_values


def box(
    size: int,
    out: Callable[..., None] | None = None,
    step: Callable[..., None] | None = None,
    *,
    numbers: dict[str, Any] | None = None,
    tables: dict[str, Any] | None = None,
    state: dict[str, Any] | None = None,
    work: dict[str, tuple[int, ...]] | None = None,
    shows: str | None = None,
) -> Box:
    """Return a box of an element of your own, made of two plain functions (docs/how_to/own_parts.md).

    The names of their parameters decide what is passed: `out` the array for the output; `n` the numbers; a name in
    tables, state or work that array; `k` the tick; `seed` the seed of its noise; any other name that box's output.

    Args:
        size: size of the output.
        out: function that writes the output of a tick; None if `shows` is given.
        step: function that changes the state to the next tick's; None without a state.
        numbers: constants, attributes of `n`.
        tables: constant arrays.
        state: arrays of floats, with their values in tick 0.
        work: shapes of scratch arrays.
        shows: name of the state that is the output, in place of `out`.

    Raises:
        ValueError: if a value is no number or array of numbers, is NaN or has no name of its own, if the size is no
            positive integer, if a shape is none, or if there is no output.
    """
    if not isinstance(size, Integral) or size < 1:
        raise ValueError(f"size: {size!r}: must be an integer, at least 1")
    if out is None and shows is None:
        raise ValueError("out: is missing: must write the output, unless shows names a state")
    if out is not None and shows is not None:
        raise ValueError(f"out: must be left out where shows names the output, {shows!r}")
    for what, function in (("out", out), ("step", step)):
        if function is not None and not inspect.isfunction(plain(function)):
            raise ValueError(f"{what}: {function!r}: must be a function")
    groups = {"numbers": numbers, "tables": tables, "state": state, "work": work}
    _check_names({group: its or {} for group, its in groups.items()})
    for name, values in ((numbers or {}) | (tables or {}) | (state or {})).items():
        kind_of(name, values)
    for name, values in ((numbers or {}) | (state or {})).items():
        if np.isnan(values).any():
            raise ValueError(f"{name}: is {values!r}, must not be NaN")
    for name, values in ((tables or {}) | (state or {})).items():
        if np.ndim(values) == 0:
            raise ValueError(f"{name}: is {values!r}, must be an array")
    for name, shape in (work or {}).items():
        if not isinstance(shape, tuple | list) or not all(isinstance(its, Integral) and its >= 0 for its in shape):
            raise ValueError(f"{name}: {shape!r}: must be a shape, such as (3,) or (3, 3)")
    element = Element("own", out, step, shows=shows, allocates=True, checked=True)
    made = Box("own", element, size, Values(numbers or {}, state or {}, tables or {}), work or {})
    check_values(made)
    return made


def _check_names(groups: dict[str, dict[str, Any]]) -> None:
    """Check that each name is a Python name and is used once, as parameters and fields need; else ValueError."""
    seen = set[str]()
    for group, its in groups.items():
        if not isinstance(its, dict):
            raise ValueError(f"{group}: {its!r}: must be values by their names")
        for name in its:
            if not isinstance(name, str) or not name.isidentifier() or iskeyword(name):
                raise ValueError(f"{group}: {name!r}: must be a name that a parameter may have")
            if name in seen:
                raise ValueError(f"{group}: {name!r}: has that name twice")
            seen.add(name)


def output_at_first(its: Box, what: str, sizes: Mapping[str, int]) -> np.ndarray:
    """Call `out` or `step` of a box in tick 0 in plain Python, with zeros at its inputs; return the output array.

    Args:
        its: the box.
        what: "out" or "step"; without a function of that name, the state that the box shows is returned.
        sizes: size of each input, by name.

    Raises:
        ElementError: if the function returns anything.
    """
    if what not in its.element.functions:
        return np.array(its.given.start[its.element.shows or ""], dtype=float).ravel()
    element = replace(its.element, step=None) if what == "out" else replace(its.element, out=None)
    inputs = {name: outside(name, sizes[name]) for name in element.inputs}
    alone = replace(its, element=element, reads={name: name for name in inputs})
    wiring = Wiring([alone, *inputs.values()])
    places = places_of(wiring)
    memory, said = Memory(wiring, places), places.said[its.name]
    if PlainCalls(wiring, float).call(alone, what, memory, memory.S, memory.Y, 0) is not None:
        raise ElementError(f"returns something: must write into {'`out`' if what == 'out' else 'its state'} instead")
    return said.of(memory.S if said.letter == "S" else memory.Y)
