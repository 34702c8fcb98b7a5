"""Products of small matrices against sums of exact fractions."""

from fractions import Fraction

import numpy as np
import pytest

from ortilo_drake.model.products import product, times


@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 4, 2), (6, 15, 6)])
def test_products_are_those_of_fractions(shape: tuple[int, int, int]) -> None:
    n, m, p = shape
    rng = np.random.default_rng(7)
    A, B = rng.integers(-9, 9, (n, m)) / 8.0, rng.integers(-9, 9, (m, p)) / 4.0  # sums of these are exact
    exact = [[sum((Fraction(A[i, k]) * Fraction(B[k, j]) for k in range(m)), Fraction(0)) for j in range(p)]
             for i in range(n)]  # fmt: skip
    assert product(A, B).tolist() == [[float(x) for x in row] for row in exact]
    assert times(A, B[:, 0]).tolist() == [float(row[0]) for row in exact]
