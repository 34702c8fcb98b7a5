"""Information of differences of ranges against the expected square of the score, and lasting errors by their pairs."""

from typing import Any

import numpy as np
import pytest
from drake_box import PlayedBox
from scipy.stats import norm

from ortilo_drake.model.range_pairs import ROW, THERE, A, B, pairs_in_turn
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.scenario import load_scenario
from ortilo_drake.sensors.information_rows import GRADIENT, SOURCE, information
from ortilo_drake.sensors.information_uwb import between, difference_rows
from ortilo_drake.world.sensors.range_differences import differences_box

ROOM = load_scenario("tight_differences").load_room()
ANCHORS = ROOM.anchor_positions


def truth_of(ticks: int) -> np.ndarray:
    truth = np.zeros((ticks, 12))
    truth[:, :3], truth[:, 6:9] = [4.2, 1.3, 1.5], [1.0, -2.0, 0.5]
    return truth


@pytest.mark.parametrize(
    "noise", [{"kind": "constant", "sd": 0.1}, {"kind": "affine", "sd": 0.05, "fraction": 0.3}], ids=["same", "growing"]
)
def test_it_is_the_expected_square_of_the_score(noise: dict[str, Any]) -> None:
    scenario = load_scenario("tight_differences", {"uwb.noise": noise, "uwb.pairs": "all", "uwb.packets": 150})
    truth, tick, rows = truth_of(8), 7, 5
    seen = np.arange(8) == tick
    s_0, s_1 = scenario.uwb.sds
    v, weight = np.polynomial.hermite_e.hermegauss(40)
    pairs, expected = pairs_in_turn("all", len(ANCHORS)), np.zeros((6, 6))

    def model(state: np.ndarray, j: int) -> tuple[float, float]:
        place = state[:3] - (rows - 1 - j) / 150.0 * state[3:]
        d_a, d_b = (np.linalg.norm(place - ANCHORS[i]) for i in pairs[(tick * rows + j) % len(pairs)])
        return float(d_b - d_a), float(np.hypot(s_0 + s_1 * d_a, s_0 + s_1 * d_b))

    at, steps = truth[tick, [0, 1, 2, 6, 7, 8]], 1e-5 * np.eye(6)
    for j in range(rows):
        mean, sd = model(at, j)
        score = [(norm.logpdf(mean + sd * v, *model(at + e, j)) - norm.logpdf(mean + sd * v, *model(at - e, j))) / 2e-5
                 for e in steps]  # fmt: skip
        expected += np.einsum("an,bn,n->ab", score, score, weight / weight.sum())
    found = information(difference_rows(scenario, ROOM, truth, seen))
    kept = np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])
    np.testing.assert_allclose(found[kept], expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


def test_an_anchors_error_is_added_for_b_and_taken_off_for_a() -> None:
    growing = {"uwb.noise": {"kind": "proportional", "fraction": 0.01}}
    rows = difference_rows(load_scenario("tight_differences", growing), ROOM, truth_of(2), np.ones(2, dtype=bool))
    c, n = between(len(ANCHORS))(rows), len(ANCHORS)
    of_noise = rows[:, SOURCE] < 0.0
    assert of_noise.sum() == (~of_noise).sum() == 20
    assert not c[of_noise].any()  # the size of the noise says nothing of them
    for row, its, q in zip(c[~of_noise], rows[~of_noise], range(20), strict=True):
        expected = np.zeros(n)
        expected[(q + 1) % n], expected[q % n] = 1.0, -1.0
        np.testing.assert_array_equal(row, expected)
        assert np.abs(its[GRADIENT][3:6]).max() == 0.0


@pytest.mark.parametrize("walls", ["none", "block"])
def test_rows_are_those_that_the_world_gives(walls: str) -> None:
    settings = {"uwb.pairs": "all", "uwb.packets": 990, "uwb.walls.kind": walls, "uwb.max_distance": 9.0}
    scenario = load_scenario("tight_differences", settings | {"uwb.noise": {"kind": "constant", "sd": 0.1}})
    truth = truth_of(1)
    said = PlayedBox(differences_box(scenario, ROOM), scenario.h, 0, sent=np.zeros(1), state=truth[0]).say(0)
    there = [row for row in said[PAYLOAD:].reshape(-1, ROW) if row[THERE] == 1.0]
    found = difference_rows(scenario, ROOM, truth, np.ones(1, dtype=bool))
    assert 0 < len(there) < 33
    np.testing.assert_array_equal(found[:, SOURCE], [row[A] * len(ANCHORS) + row[B] for row in there])
