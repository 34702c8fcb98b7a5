"""Ranging against plain distances and the statistics of its noise model."""

import numpy as np
import pytest
from drake_box import PlayedBox
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.room import load_room
from ortilo_drake.model.signals import uwb_size
from ortilo_drake.scenario import (
    ConstantNoise,
    ProportionalNoise,
    Uwb,
    WallsBias,
    WallsBlock,
    WallsIgnored,
)
from ortilo_drake.world.sensors.uwb import uwb_box

settings.register_profile("compiled", deadline=None)  # the first example may wait for numba
settings.load_profile("compiled")

H = 1.0 / 30.0
ROOM = load_room()
ANCHORS = ROOM.anchor_positions
N = len(ANCHORS)
SILENT = ConstantNoise(kind="constant", sd=0.0)
BEHIND_WALLS = (12.0, -3.0, 1.5)


def ranging(settings: Uwb, p_WB, tick: int = 0, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Ranges and flags (n each) of the system's output port."""
    x = np.concatenate([p_WB, np.full(9, 0.3)])
    message = PlayedBox(uwb_box(settings, ROOM, H), H, seed, sent=np.zeros(1), state=x).say(tick)
    assert message.shape == (uwb_size(N),)
    assert message[0] == 1.0
    assert message[1] == tick * H
    return message[2 : 2 + N], message[2 + N :]


positions = st.tuples(st.floats(-1, 28), st.floats(-4, 4), st.floats(0.1, 2.9))


@pytest.mark.long
@given(p=positions)
def test_without_noise_a_range_is_the_distance(p) -> None:
    ranges, there = ranging(Uwb(noise=SILENT), p)
    np.testing.assert_allclose(ranges, np.linalg.norm(np.array(p) - ANCHORS, axis=1), rtol=1e-14)
    assert np.all(there == 1.0)


@pytest.mark.long
@given(p=positions)
def test_walls_lengthen_or_block_exactly_the_ranges_they_cross(p) -> None:
    clear, _ = ranging(Uwb(noise=SILENT), p)
    walls = np.array([walls_crossed(np.array(p), a, ROOM.wall_boxes) for a in ANCHORS])
    biased, there = ranging(Uwb(noise=SILENT, walls=WallsBias(kind="bias", per_wall=0.3)), p)
    np.testing.assert_allclose(biased, clear + 0.3 * walls, rtol=1e-14)
    assert np.all(there == 1.0)
    blocked, there = ranging(Uwb(noise=SILENT, walls=WallsBlock(kind="block")), p)
    np.testing.assert_array_equal(there, walls == 0)
    np.testing.assert_array_equal(blocked, np.where(walls == 0, clear, 0.0))


@pytest.mark.long
@given(p=positions, limit=st.floats(0.5, 20))
def test_far_anchors_are_out_of_reach(p, limit) -> None:
    ranges, there = ranging(Uwb(noise=SILENT, max_distance=limit), p)
    d = np.linalg.norm(np.array(p) - ANCHORS, axis=1)
    np.testing.assert_array_equal(there, d <= limit)
    assert np.all(ranges[there == 0.0] == 0.0)


@pytest.mark.long
@pytest.mark.parametrize(
    ("noise", "sd"),
    [
        (ProportionalNoise(), lambda d: 0.0075 * d),
        (ProportionalNoise(fraction=0.02), lambda d: 0.02 * d),
        (ConstantNoise(kind="constant", sd=0.1), lambda d: 0.1 + 0.0 * d),
    ],
    ids=["the authors'", "proportional", "constant"],
)
def test_noise_has_the_model_s_distribution(noise, sd) -> None:
    p = np.array([5.0, 1.0, 1.5])
    d = np.linalg.norm(p - ANCHORS, axis=1)
    ticks = 1_500
    v = np.array([(ranging(Uwb(noise=noise), p, k)[0] - d) / sd(d) for k in range(ticks)])
    assert np.all(np.abs(v.mean(axis=0)) < 4 / np.sqrt(ticks))
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], ticks)
    assert np.all((low < np.sum(v**2, axis=0)) & (np.sum(v**2, axis=0) < high))
    assert stats.kstest(v.ravel(), "norm").pvalue > 1e-3
    assert np.abs(np.corrcoef(v.T) - np.eye(N)).max() < 4.5 / np.sqrt(ticks)
    whiteness = np.sum(v[1:] * v[:-1], axis=0) / ticks
    assert np.all(np.abs(whiteness) < 4.5 / np.sqrt(ticks))


def test_a_hidden_anchor_leaves_the_others_noise() -> None:
    all_there, _ = ranging(Uwb(walls=WallsIgnored()), BEHIND_WALLS, 60)
    some, there = ranging(Uwb(walls=WallsBlock(kind="block")), BEHIND_WALLS, 60)
    assert 0 < np.sum(there) < N
    np.testing.assert_array_equal(some[there == 1.0], all_there[there == 1.0])


def test_a_seed_and_a_tick_make_one_message() -> None:
    p = (5.0, 1.0, 1.5)
    once = ranging(Uwb(), p, 12)[0]
    np.testing.assert_array_equal(once, ranging(Uwb(), p, 12)[0])
    assert np.all(once != ranging(Uwb(), p, 13)[0])
    assert np.all(once != ranging(Uwb(), p, 12, seed=2)[0])


def test_no_range_is_negative() -> None:
    at_anchor = ANCHORS[0] + 1e-3
    ranges = [ranging(Uwb(noise=ConstantNoise(kind="constant", sd=0.5)), at_anchor, k)[0][0] for k in range(50)]
    assert min(ranges) == 0.0 < max(ranges)


def test_is_memoryless() -> None:
    receiver = PlayedBox(uwb_box(Uwb(), ROOM, H), H, sent=np.zeros(1), state=np.zeros(12))
    assert receiver.context.num_total_states() == 0


def test_says_nothing_in_a_tick_in_which_nothing_is_sent() -> None:
    receiver = PlayedBox(uwb_box(Uwb(), ROOM, H), H, sent=np.array([-1.0]), state=np.zeros(12))
    assert not receiver.say(3).any()
