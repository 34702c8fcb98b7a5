"""Pairs of anchors in turn, against all combinations."""

from itertools import combinations

import pytest

from ortilo_drake.model.range_pairs import pairs_in_turn


@pytest.mark.parametrize("n", [2, 3, 4, 7, 12])
def test_each_pair_comes_once_and_the_next_anchors_first(n: int) -> None:
    every = pairs_in_turn("all", n)
    assert sorted(sorted(pair) for pair in every.tolist()) == [list(pair) for pair in combinations(range(n), 2)]
    cycle = pairs_in_turn("cycle", n)
    assert all(b == (a + 1) % n for a, b in cycle)
    assert every[: len(cycle)].tolist() == cycle.tolist()
    assert len(cycle) == (1 if n == 2 else n)
