"""The gate of stuck sensors: what repeats is not heard, until something else comes."""

import numpy as np
import pytest
from played_box import PlayedBox
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff

from ortilo_drake.onboard.estimator.robust.stuck_gate import repeats, stuck_box

H = 1.0 / 30.0


def heard(messages: list[np.ndarray], stuck: int, samples: int = 1) -> list[np.ndarray]:
    """Return what passes of a message a tick."""
    gate, passed = PlayedBox(stuck_box("imu", messages[0].size, stuck, samples)), []
    for k, message in enumerate(messages):
        passed.append(gate.say(k, message=message))
        gate.step(k, message=message)
    return passed


def said(*values: float, t: float = 0.0) -> np.ndarray:
    return np.array([1.0, t, *values])


@pytest.mark.parametrize("stuck", [2, 3, 5])
def test_the_nth_message_of_the_same_is_not_heard(stuck: int) -> None:
    messages = [said(1.0, 2.0, t=k * H) for k in range(7)] + [said(1.0, 2.5)] + [said(1.0, 2.0)]
    arrived = [m[0] for m in heard(messages, stuck)]
    assert arrived == [1.0] * (stuck - 1) + [0.0] * (8 - stuck) + [1.0, 1.0]


def test_what_is_heard_is_unchanged_and_what_is_not_is_zero() -> None:
    messages = [said(1.0, 2.0, t=0.5), said(1.0, 2.0, t=0.6)]
    first, second = heard(messages, 2)
    np.testing.assert_array_equal(first, messages[0])
    np.testing.assert_array_equal(second, np.zeros(4))


def test_ticks_without_a_message_do_not_count() -> None:
    messages = [said(1.0), np.zeros(3), said(2.0), np.zeros(3), said(2.0), np.zeros(3), said(2.0)]
    assert [m[0] for m in heard(messages, 3)] == [1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0]


def test_samples_are_compared_without_their_stamps() -> None:
    def message(t: float, value: float) -> np.ndarray:
        return np.array([1.0, t, 1.0, t - H / 2, value, 1.0, t, value])

    arrived = [m[0] for m in heard([message(k * H, 4.0) for k in range(4)] + [message(1.0, 4.1)], 3, samples=2)]
    assert arrived == [1.0, 1.0, 0.0, 0.0, 1.0]


def test_rounding_does_not_make_it_new() -> None:
    assert repeats(np.array([1.0 + 1e-13]), np.array([4.0, 1.0])) == 5.0
    assert repeats(np.array([1.0 + 1e-11]), np.array([4.0, 1.0])) == 1.0
    assert repeats(np.array([np.nan]), np.array([4.0, np.nan])) == 1.0


def test_derivatives_pass() -> None:
    passed = PlayedBox(stuck_box("uwb", 4, 2)).say(message=InitializeAutoDiff(said(1.0, 2.0)[:, None])[:, 0])
    np.testing.assert_array_equal(ExtractGradient(passed[:, None]), np.eye(4))
