"""An element's function that takes a NamedTuple gets the tuple's own numbers and arrays, from every player."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from plain_box import PlainBox

from ortilo_drake.loop.element import Box, Element, Values, constant, group_of
from ortilo_drake.loop.own import box
from ortilo_drake.loop.player import Player
from ortilo_drake.loop.wiring import Wiring


class Grid(NamedTuple):
    values: np.ndarray
    scale: float


class Settings(NamedTuple):
    size: int
    grid: Grid
    upside_down: bool
    there: np.ndarray


def said(n: Any, k: int, state: np.ndarray, settings: Settings, out: np.ndarray) -> None:
    sign, grid = -1.0 if settings.upside_down else 1.0, settings.grid
    for i in range(settings.size):
        out[i] = sign * (grid.scale * state[i] + grid.values[i, 1] * k) if settings.there[i] else n.absent


def without_n(settings: Settings, out: np.ndarray) -> None:
    out[0] = settings.grid.scale


def write(out: np.ndarray) -> None:
    out[0] = 0.0


SETTINGS = Settings(3, Grid(np.arange(6.0).reshape(3, 2), 2.0), True, np.array([True, False, True]))
BOX = Box("said", Element("said", out=said), 3, Values({"absent": 7.0}))
SAID = [[-20.0, 7.0, -60.0], [-21.0, 7.0, -65.0], [-22.0, 7.0, -70.0]]


def played(box: Box, drawn: dict[str, Values] | None = None) -> np.ndarray:
    wiring = Wiring([constant("state", [10.0, 20.0, 30.0]), box, constant("end", [-1.0])])
    player, trace = Player(wiring, (box.name,), "end"), np.zeros((3, box.size))
    player.fly(np.zeros(3, np.int64), trace, drawn or {})
    return trace


@pytest.mark.long
def test_a_tuple_taken_apart_is_put_together_again() -> None:
    np.testing.assert_array_equal(played(BOX.with_groups(settings=SETTINGS)), SAID)


def test_plain_source_takes_it_too() -> None:
    box, state = PlainBox(BOX.with_groups(settings=SETTINGS)), np.array([10.0, 20.0, 30.0])
    np.testing.assert_array_equal([box.say(k, state=state) for k in range(3)], SAID)


def test_a_tuple_s_numbers_come_where_the_function_takes_no_others() -> None:
    box = Box("alone", Element("alone", out=without_n), 1).with_groups(settings=SETTINGS)
    np.testing.assert_array_equal(played(box), [[2.0]] * 3)


def test_a_flight_may_have_another_field() -> None:
    drawn = Values({"settings_grid_scale": 3.0}, tables={"settings_there": np.array([True, True, False])})
    np.testing.assert_array_equal(played(BOX.with_groups(settings=SETTINGS), {"said": drawn})[0], [-30.0, -60.0, 7.0])


@pytest.mark.parametrize("wrong", ["high", None])
def test_what_is_no_number_is_refused_by_name(wrong: Any) -> None:
    with pytest.raises(ValueError, match=r"Settings\.size: is .*, must be a number or an array of numbers"):
        group_of("settings", SETTINGS._replace(size=wrong))


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: box(4), "^out: is missing"),
        (lambda: box("a", lambda out: None), "^size: 'a': must be an integer, at least 1$"),  # type: ignore[arg-type]
        (lambda: box(0, lambda out: None), "^size: 0: must be an integer, at least 1$"),
        (lambda: box(1, "say"), "^out: 'say': must be a function$"),  # type: ignore[arg-type]
        (lambda: box(1, write, shows="x", state={"x": [0.0]}), "^out: must be left out where shows names the output"),
        (lambda: box(1, write, numbers=[1.0]), r"^numbers: \[1\.0\]: must be values by their names$"),  # type: ignore[arg-type]
        (lambda: box(1, write, numbers={"class": 1.0}), "^numbers: 'class': must be a name that a parameter may have$"),
        (lambda: box(1, write, tables={"a": [1.0]}, state={"a": [1.0]}), "^state: 'a': has that name twice$"),
        (lambda: box(1, write, numbers={"a": float("nan")}), "^a: is nan, must not be NaN$"),
        (lambda: box(1, write, state={"a": "no"}), "^a: is 'no', must be a number or an array of numbers$"),
        (lambda: box(1, write, state={"a": 1.0}), "^a: is 1.0, must be an array$"),
        (
            lambda: box(1, write, state={"a": [[1.0], [2.0, 3.0]]}),
            r"^a: is \[\[1.0\], \[2.0, 3.0\]\], must be a number or",
        ),
        (
            lambda: box(1, write, tables={"a": [[1.0], [2.0, 3.0]]}),
            r"^a: is \[\[1.0\], \[2.0, 3.0\]\], must be a number or",
        ),
    ],
)
def test_a_box_that_cannot_be_is_refused_where_it_is_made(made: Callable[[], object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        made()
