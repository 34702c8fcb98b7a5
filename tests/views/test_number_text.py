"""Numbers as text: digits that are known, lost flights by name."""

import math

import pytest

from ortilo_drake.flight.intervals import middle_of
from ortilo_drake.views.numbers import count, in_its_digits, number, of_all_and_kept, with_interval


@pytest.mark.parametrize(
    ("value", "ends", "text"),
    [
        (0.1081, (0.0582, 0.1614), "0.11 [0.06, 0.16]"),  # known to 0.05
        (0.1081, (0.1072, 0.1092), "0.108 [0.107, 0.109]"),
        (0.00019, (0.00018, 0.00021), "0.00019 [0.00018, 0.00021]"),
        (0.113, (0.105, 0.39), "0.11 [0.10, 0.39]"),
        (139.21, (95.0, 165.0), "140 [100, 160]"),
        (0.004, (0.0, 0.05), "0.004 [0.00, 0.05]"),
        (3.0, (3.0, 3.0), "3.000 [3.000, 3.000]"),
        (0.0, (0.0, 0.0), "0 [0, 0]"),
        (0.1081, (0.0582, math.inf), "0.11 [0.06, lost]"),
        (math.inf, (0.0582, math.inf), "lost [0.058, lost]"),
        (math.inf, (math.inf, math.inf), "lost"),
    ],
)
def test_a_number_has_the_digits_that_its_interval_knows(value: float, ends: tuple[float, float], text: str) -> None:
    assert with_interval(value, ends) == text


def test_without_an_interval_it_says_so() -> None:
    assert with_interval(0.0993, None) == "0.10 [?]"
    assert with_interval(math.inf, None) == "lost [?]"
    assert with_interval(None, None) == "none"
    assert number(0.0095) == "0.0095"
    assert number(-31.4) == "-31"


def test_another_number_has_the_digits_of_the_one_beside_it() -> None:
    """0.06 [0.05, 0.07] stands beside 0.06 to 0.08, and 0.060 without an interval beside 0.061 to 0.084."""
    assert [in_its_digits(end, 0.0602, (0.051, 0.072)) for end in (0.0606, 0.084)] == ["0.06", "0.08"]
    assert [in_its_digits(end, 0.0602, None) for end in (0.0606, 0.084)] == ["0.061", "0.084"]


def test_the_kept_stand_beside_all_where_flights_were_lost() -> None:
    kept = [0.010, 0.011, 0.012, 0.013, 0.014, 0.015, 0.016]
    assert of_all_and_kept(middle_of(kept, 0), 0) == "0.013 [0.010, 0.016]"
    assert of_all_and_kept(middle_of(kept, 2), 2) == "0.014 [0.011, lost]; kept 0.013 [0.010, 0.016]"
    assert of_all_and_kept(middle_of([], 6), 6) == "lost"


def test_a_count_has_wilsons_interval_in_percent() -> None:
    assert count(7, 20) == "7 of 20 [18, 57 %]"
    assert count(0, 200) == "0 of 200 [0, 1.9 %]"
