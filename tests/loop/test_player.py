"""A small loop as the player flies it is what NumPy's matrices make of it."""

import re
import threading
from dataclasses import replace

import numpy as np
import pytest
from small_loop import X_0, H, K, boxes, flown

from ortilo_drake.loop.element import Box, Element, Values, bundle, constant
from ortilo_drake.loop.player import Player
from ortilo_drake.loop.raised import ElementError
from ortilo_drake.loop.wiring import Wiring

RECORDED = ("mass", "sensor.y", "gain")


def second_of(x: np.ndarray, out: np.ndarray) -> None:
    out[0] = x[1]


@pytest.fixture(scope="module")
def player() -> Player:
    return Player(Wiring(boxes()), RECORDED, "watch")


def fly(player: Player, ticks: int, seed: int, drawn: dict[str, Values] | None = None) -> np.ndarray:
    trace = np.full((ticks, player.width), np.nan)
    last = player.fly(np.full(ticks, seed), trace, drawn or {})
    return trace[: last + 1]


def test_a_flight_is_the_recursion(player: Player) -> None:
    assert fly(player, 80, 7) == pytest.approx(flown(80, 7), rel=1e-13, abs=1e-13)


@pytest.mark.long
def test_flights_do_not_know_of_each_other(player: Player) -> None:
    first, _, again = fly(player, 50, 1), fly(player, 50, 2), fly(player, 50, 1)
    assert np.array_equal(first, again)


def test_threads_fly_the_same(player: Player) -> None:
    found: dict[int, np.ndarray] = {}
    threads = [threading.Thread(target=lambda s=s: found.update({s: fly(player, 400, s)})) for s in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(found[s], fly(player, 400, s)) for s in range(6))


def test_seeds_may_change_on_the_way(player: Player) -> None:
    seeds = np.array([4] * 10 + [5] * 20)
    trace = np.empty((30, player.width))
    player.fly(seeds, trace)
    assert np.array_equal(trace[:10], fly(player, 10, 4))
    assert trace[10, 2] == pytest.approx(trace[10, 0] + 0.05 * ((5 + 10) % 3))


def test_what_is_drawn_stands_for_what_a_box_has_in_that_flight_alone(player: Player) -> None:
    before = fly(player, 40, 3)
    other_K, other_x = np.array([[0.7, 0.9]]), np.array([0.2, -0.3])
    drawn = {
        "gain": Values(tables={"K": other_K}),
        "mass": Values(start={"x": other_x}),
        "sensor": Values({"off": 0.2}),
    }
    assert fly(player, 40, 3, drawn) == pytest.approx(flown(40, 3, other_K, other_x, 0.2), rel=1e-13, abs=1e-13)
    assert np.array_equal(fly(player, 40, 3), before)


def test_a_flight_ends_where_it_is_told(player: Player) -> None:
    away = {"mass": Values(start={"x": np.array([0.0, 10.0])}), "gain": Values(tables={"K": np.zeros((1, 2))})}
    trace = fly(player, 50, 0, away)
    assert len(trace) == 5  # 10 m/s for 0.1 s a tick: 4 m at tick 4, beyond 3 m
    assert trace[-1, 0] == pytest.approx(4.0)


def test_a_table_may_have_any_length() -> None:
    """The source of a flight has no size of a table in it: one compiled form serves all."""
    wide = np.hstack([K, np.zeros((1, 5))])
    gain, *others = boxes()
    player = Player(Wiring([replace(gain, given=Values(tables={"K": wide})), *others]), RECORDED, "watch")
    assert player.text == Player(Wiring(boxes()), RECORDED, "watch").text
    assert fly(player, 20, 0) == pytest.approx(flown(20, 0), rel=1e-13, abs=1e-13)


@pytest.mark.long
def test_a_bundle_is_what_its_boxes_say() -> None:
    def sum_out(both: np.ndarray, out: np.ndarray) -> None:
        out[0] = both[0] + 10.0 * both[1] + 100.0 * both[2]

    held = [box for box in boxes() if box.name in ("sensor", "gain")]
    total = Box("sum", Element("sum_of_three", out=sum_out), 1, reads={"both": "both"})
    player = Player(Wiring([*boxes(), bundle("both", held), total]), (*RECORDED, "sum"), "watch")
    trace = fly(player, 15, 2)
    k = np.arange(15)
    assert trace[:, 4] == pytest.approx(trace[:, 3] + 10.0 * trace[:, 2] + 100.0 * k)


def test_a_constant_says_the_same_in_every_tick() -> None:
    changed = [box.with_inputs(rate="nothing") if box.name == "gain" else box for box in boxes()]
    player = Player(Wiring([*changed, constant("nothing", 0.0)]), RECORDED, "watch")
    assert fly(player, 25, 1) == pytest.approx(flown(25, 1, K * [[1.0, 0.0]]), rel=1e-13, abs=1e-13)


@pytest.mark.long
def test_who_reads_a_shown_state_reads_it_before_it_steps() -> None:
    """A second mass that is pulled by the first one's position of this tick, not of the next."""

    def pulled_step(x: np.ndarray, leader: np.ndarray) -> None:
        x[0] = leader[0]

    follower = Box("a_follower", Element("follower", step=pulled_step, shows="x"), 1,
                   Values(start={"x": np.zeros(1)}), reads={"leader": "mass"})  # fmt: skip
    player = Player(Wiring([*boxes(), follower]), ("mass", "a_follower"), "watch")
    trace = fly(player, 12, 0)
    assert np.array_equal(trace[1:, 2], trace[:-1, 0])
    assert trace[0, 2] == 0.0


def test_shapes_that_do_not_fit_are_refused(player: Player) -> None:
    with pytest.raises(ValueError, match=r"trace: has the shape \(4, 4\), must have \(5, 4\)"):
        player.fly(np.zeros(5, np.int64), np.zeros((4, 4)))
    with pytest.raises(ValueError, match=r"mass: x: has the shape \(3,\), must have \(2,\)"):
        player.fly(np.zeros(5, np.int64), np.zeros((5, 4)), {"mass": Values(start={"x": np.zeros(3)})})


def test_the_loop_is_stable() -> None:
    """The gain is one: the reference that the other tests compare with is no flight into the distance."""
    A, B = np.array([[1.0, H], [0.0, 1.0]]), np.array([[H * H / 2.0], [H]])
    assert np.abs(np.linalg.eigvals(A - B @ K)).max() < 1.0
    assert X_0.any()


@pytest.mark.parametrize(
    ("drawn", "said"),
    [
        ({"masss": Values()}, "drawn: 'masss': must be one of gain, watch, mass, sensor"),
        ({"mass": Values({"hh": 0.1})}, "drawn: mass: 'hh': must be one of h"),
        ({"mass": Values(start={"u": [0.0]})}, "drawn: mass: 'u': must be one of x"),
        ({"mass": Values(tables={"K": K})}, "drawn: mass: 'K': must be one of none"),
        ({"gain": Values(tables={"K": K[0]})}, "gain: K: has the shape (2,), must have 2 dimensions"),
    ],
)
def test_what_is_drawn_for_what_is_not_there_is_refused(player: Player, drawn: dict[str, Values], said: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(said)}$"):
        fly(player, 5, 0, drawn)


def test_what_ends_a_flight_must_be_there() -> None:
    with pytest.raises(ValueError, match=r"^ends: reads 'watchh', must be one of gain, mass, sensor, watch$"):
        Player(Wiring(boxes()), RECORDED, "watchh")


def test_an_input_that_is_too_small_ends_a_flight_that_is_checked() -> None:
    reader = Box("short", Element("short", out=second_of), 1, reads={"x": "mass.rate"})
    player = Player(Wiring([*boxes(), reader], checked=True), RECORDED, "watch")
    with pytest.raises(ElementError, match=r"second_of .*: IndexError: index is out of bounds$"):
        fly(player, 5, 0)


def test_what_is_checked_flies_the_same(player: Player) -> None:
    assert np.array_equal(fly(Player(Wiring(boxes(), checked=True), RECORDED, "watch"), 80, 7), fly(player, 80, 7))
