"""An element's function of a NamedTuple gets the tuple's own numbers and arrays."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, constant
from ortilo_drake.loop.player import Player
from ortilo_drake.loop.shares import fields_of, function_of
from ortilo_drake.loop.wiring import Wiring


class Numbers(NamedTuple):
    scale: float
    size: int
    grid: np.ndarray
    upside_down: bool
    there: np.ndarray


@register_jitable
def said(numbers: Numbers, k: int, state: np.ndarray, out: np.ndarray) -> None:
    sign = -1.0 if numbers.upside_down else 1.0
    for i in range(numbers.size):
        out[i] = sign * (numbers.scale * state[i] + numbers.grid[i, 1] * k) if numbers.there[i] else 7.0


NUMBERS = Numbers(2.0, 3, np.arange(6.0).reshape(3, 2), True, np.array([True, False, True]))


def test_a_tuple_taken_apart_is_put_together_again() -> None:
    fields = fields_of(NUMBERS)
    element = Element(
        "said", out=function_of(fields, said, "k", "state", "out"), numbers=fields.numbers, tables=fields.tables
    )
    box = Box("said", element, 3, fields.given(NUMBERS))
    player = Player(Wiring([constant("state", [10.0, 20.0, 30.0]), box, constant("end", [-1.0])]), ("said",), "end")
    trace = np.zeros((3, 3))
    player.fly(np.zeros(3, np.int64), trace)
    np.testing.assert_array_equal(trace, [[-20.0, 7.0, -60.0], [-21.0, 7.0, -65.0], [-22.0, 7.0, -70.0]])


@pytest.mark.parametrize("wrong", ["high", None])
def test_what_is_no_number_is_refused_by_name(wrong: Any) -> None:
    with pytest.raises(ValueError, match=r"Numbers\.scale: is .*, must be a number or an array of numbers"):
        fields_of(NUMBERS._replace(scale=wrong))
