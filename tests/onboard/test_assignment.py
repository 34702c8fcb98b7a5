"""The compiled assignment is SciPy's."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from ortilo_drake.onboard.landmarks.assignment import assign


@given(st.integers(0, 2**32 - 1), st.integers(0, 8), st.integers(0, 8), st.sampled_from([2, 5, 10**6]))
def test_the_assignment_is_scipys(seed: int, rows: int, more: int, values: int) -> None:
    """Of few different costs many assignments are best: it is the same one."""
    random = np.random.default_rng(seed)
    costs = random.integers(values, size=(rows, rows + more)).astype(float)
    costs[random.random(costs.shape) < 0.3] = 1e6
    assert np.array_equal(assign(costs), linear_sum_assignment(costs)[1])
