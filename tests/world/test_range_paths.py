"""Ranges of a round and behind walls against geometry and the moments of an exponential length."""

from dataclasses import replace

import numpy as np
import pytest
from drake_box import PlayedBox
from scipy import stats

from ortilo_drake.loop.element import Box, Values
from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.room import load_room
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.onboard.ranging.sighted import sighted_box
from ortilo_drake.scenario import AffineNoise, Uwb, WallsBias, WallsExcess, load_scenario
from ortilo_drake.world.sensors.range_paths import paths_box

H = 1.0 / 30.0
ROOM = load_room()
ANCHORS = ROOM.anchor_positions
N = len(ANCHORS)
BEHIND_WALLS = np.array([12.0, -3.0, 1.5])
CROSSED = np.array([walls_crossed(BEHIND_WALLS, anchor, ROOM.wall_boxes) for anchor in ANCHORS])
EXCESS = Uwb(walls=WallsExcess(kind="excess", mean=0.4, time=0.5))
ROUND = Uwb(round=0.04)


def distances(p: np.ndarray) -> np.ndarray:
    return np.linalg.norm(p - ANCHORS, axis=1)


def message_at(p: np.ndarray) -> np.ndarray:
    return np.concatenate(([1.0, 0.0], distances(p), np.ones(N)))


def state_at(p: np.ndarray, v: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    return np.concatenate((p, np.zeros(3), v, np.zeros(3)))


def box_of(settings: Uwb, start: np.ndarray | None = None) -> Box:
    box = paths_box(settings, ROOM, H)
    assert box is not None
    return box if start is None else replace(box, given=box.given.updated(Values(start={"x": start})))


def excesses(ticks: int, seed: int) -> np.ndarray:
    """Return what a wall adds to a range (ticks, anchors behind walls), of a flight that stands still."""
    start = np.random.default_rng(seed).standard_normal(2 * N)
    plays = PlayedBox(box_of(EXCESS, start), H, seed, message=message_at(BEHIND_WALLS), state=state_at(BEHIND_WALLS))
    found = []
    for k in range(ticks):
        ranges = plays.say(k)[PAYLOAD : PAYLOAD + N]
        found.append((ranges - distances(BEHIND_WALLS))[CROSSED > 0] / CROSSED[CROSSED > 0])
        plays.step()
    return np.array(found)


def test_a_wall_adds_an_exponential_length() -> None:
    found = np.concatenate([excesses(1, seed)[0] for seed in range(150)])
    assert found.size > 500
    assert stats.kstest(found, "expon", args=(0.0, 0.4)).pvalue > 1e-3
    assert stats.skew(found) > 1.3  # 2 of an exponential, 0 of a Gaussian


@pytest.mark.long
def test_what_a_wall_adds_lasts_for_the_time_of_its_setting() -> None:
    """The squares of Gauss-Markov noise of correlation time T are correlated by exp(-2 t / T)."""
    found = excesses(6000, seed=3)
    found = (found - 0.4) / 0.4
    for ticks in (3, 6):
        correlation = np.mean(found[:-ticks] * found[ticks:])
        assert correlation == pytest.approx(np.exp(-2.0 * ticks * H / 0.5), abs=0.12)


def test_ranges_in_sight_stay_as_they_were() -> None:
    seen = CROSSED == 0
    assert 0 < seen.sum() < N
    plays = PlayedBox(box_of(EXCESS, np.ones(2 * N)), H, message=message_at(BEHIND_WALLS), state=state_at(BEHIND_WALLS))
    said = plays.say()[PAYLOAD : PAYLOAD + N]
    np.testing.assert_array_equal(said[seen], distances(BEHIND_WALLS)[seen])
    np.testing.assert_allclose((said - distances(BEHIND_WALLS))[~seen], 0.4 * CROSSED[~seen], rtol=1e-12)


def test_each_range_of_a_round_is_of_its_own_time() -> None:
    p, v = np.array([8.0, 1.0, 1.5]), np.array([0.9, -0.4, 0.2])
    ages = 0.04 - 0.04 / N * np.arange(1, N + 1)
    said = PlayedBox(box_of(ROUND), H, message=message_at(p), state=state_at(p, tuple(v))).say()
    there = np.linalg.norm(p - ages[:, np.newaxis] * v - ANCHORS, axis=1)
    np.testing.assert_allclose(said[PAYLOAD : PAYLOAD + N], there, rtol=1e-13)
    assert said[PAYLOAD + N - 1] == distances(p)[-1]  # the last one is taken at the stamp


def sighted(settings: Uwb, message: np.ndarray, x: np.ndarray) -> np.ndarray:
    box = sighted_box(settings, ROOM)
    assert box is not None
    return PlayedBox(box, H, message=message, belief=np.concatenate((x, np.zeros(228)))).say()


def test_a_round_is_taken_on_to_its_stamp() -> None:
    """What is left is of second order: s^2 v^2 / (2 d)."""
    p, v = np.array([8.0, 1.0, 1.5]), (0.9, -0.4, 0.2)
    said = PlayedBox(box_of(ROUND), H, message=message_at(p), state=state_at(p, v)).say()
    taken = sighted(ROUND, said, state_at(p, v))
    off = np.abs(said - message_at(p))[PAYLOAD : PAYLOAD + N].max()
    left = np.abs(taken - message_at(p))[PAYLOAD : PAYLOAD + N]
    assert off > 0.02
    assert np.all(left <= 0.04**2 * np.dot(v, v) / (2.0 * (distances(p) - 0.04)))


def test_ranges_behind_walls_are_left_out() -> None:
    taken = sighted(Uwb(behind_walls="left_out"), message_at(BEHIND_WALLS), state_at(BEHIND_WALLS))
    there = CROSSED == 0
    np.testing.assert_array_equal(taken[PAYLOAD + N :], there)
    np.testing.assert_array_equal(taken[PAYLOAD : PAYLOAD + N], np.where(there, distances(BEHIND_WALLS), 0.0))


def test_nothing_stands_between_where_nothing_differs() -> None:
    assert paths_box(Uwb(), ROOM, H) is None
    assert paths_box(Uwb(walls=WallsBias(kind="bias")), ROOM, H) is None
    assert sighted_box(Uwb(behind_walls="used"), ROOM) is None


@pytest.mark.parametrize(
    ("settings", "known"),
    [
        ((), "used"),
        (("uwb.walls.kind=block",), "used"),
        (("uwb.walls.kind=bias",), "left_out"),
        (("uwb.walls.kind=excess",), "left_out"),
        (("uwb.walls.kind=excess", "uwb.behind_walls=used"), "used"),
        (("uwb.behind_walls=left_out",), "left_out"),
    ],
)
def test_who_flies_there_knows_that_walls_lengthen_ranges(settings: tuple[str, ...], known: str) -> None:
    assert load_scenario("imu_uwb", settings).belief.uwb.behind_walls == known


def test_noise_with_a_floor_is_a_constant_and_a_share() -> None:
    assert AffineNoise(kind="affine", sd=0.02, fraction=0.003).sds == (0.02, 0.003)
