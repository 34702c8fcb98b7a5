"""A start that the first ranges contradict: refused with the unit that fits, doubted, or right."""

import numpy as np
import pytest
from live_messages import RANGES
from made_up_motion import ANCHORS, as_map

from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.live.start_check import check_start

PLACE = np.array([1.5, 1.8, 0.4])


def checked(off=(0.0, 0.0, 0.0), by=1.0, bias_start=0.2, wrong=0.0, sd=0.05) -> str:
    """Return the doubt about a start that is so far off [m], by ranges of one second times a factor."""
    rng = np.random.default_rng(3)
    n, t = len(ANCHORS), np.arange(0.0, 1.0, 0.1)
    r = np.linalg.norm(PLACE - ANCHORS, axis=1) + 0.03 * rng.standard_normal((len(t), n))
    r[:, 0] += wrong
    ranges = single_ranges(np.repeat(t, n), np.tile(np.arange(n), len(t)), by * r.ravel())
    at = PLACE + off
    start = f"start: {{position: {at.tolist()}, position_sd: {sd}, heading: 0}}\nfilter: {{bias_start: {bias_start}}}\n"
    return check_start(ranges, at, ANCHORS, as_map(RANGES + start))


@pytest.mark.parametrize(("unit", "by"), [("mm", 1e3), ("cm", 1e2), ("in", 1 / 0.0254), ("ft", 1 / 0.3048)])
def test_ranges_in_another_unit_are_refused_with_its_name(unit, by) -> None:
    with pytest.raises(InputError, match=rf"^start: the first ranges .* or are they in {unit} \(`scale: "):
        checked(by=by)


def test_a_far_start_is_refused_without_a_unit_where_none_fits() -> None:
    with pytest.raises(InputError, match=r"or leave it out$"):
        checked((0.0, 2.0, 0.0))


def test_half_a_metre_of_height_is_doubted_where_the_anchors_biases_are_known_to_be_small_else_told() -> None:
    """Biases of 0.2 m leave the height open by 0.3 m: the ranges say what they know."""
    assert "more than it and the anchors' biases allow" in checked((0.0, 0.0, 0.5), bias_start=0.03)
    assert "which the anchors' biases may make" in checked((0.0, 0.0, 0.5))
    assert "0.40) m, by (" in checked((0.0, 0.0, 0.5))  # the height that is right
    assert checked((0.0, 0.0, 0.5), sd=0.5) == ""


def test_a_right_start_is_not_doubted_nor_one_whose_ranges_fit_no_place() -> None:
    assert checked(bias_start=0.03) == checked() == ""
    assert checked((0.0, 0.0, 0.5), bias_start=0.03, wrong=3.0) == ""
