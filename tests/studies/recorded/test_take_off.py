"""A take-off that is too gentle for the specific force to show it: the ranges do."""

import numpy as np
import pytest
from made_up_motion import as_map
from plain_filter import run_plainly

from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import Imu, Recording
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.studies.recorded import reacquired
from ortilo_drake.studies.recorded.at_rest import at_rest
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.setups import uncalibrated_setup

ANCHORS = np.array([[0, 0, 0.2], [8, 0, 2.8], [8, 6, 0.2], [0, 6, 2.8], [4, 0, 2.8], [4, 6, 0.3]])
FLOOR, LEAVES, LASTS = np.array([4.0, 3.0, 0.2]), 3.0, 9.0
MAP = f"""ranges: {{file: bag, topics: {[f"/uwb/{i}" for i in range(6)]}, values: [range]}}
anchors: {ANCHORS.tolist()}
imu: {{file: bag, topic: /imu}}
start: {{position: {FLOOR.tolist()}, heading: 0, rests: true}}
"""


def place(t: np.ndarray) -> np.ndarray:
    """Return a climb of 1.2 m and a move of 1.5 m: upward 0.09 m/s² at most, where a take-off needs 0.15."""
    s = np.clip((t - LEAVES) / LASTS, 0.0, 1.0)
    return FLOOR + np.outer(s**3 * (10.0 - 15.0 * s + 6.0 * s**2), [1.2, 0.9, 1.2])


def flown(moves: bool, shakes: float = 0.05) -> Recording:
    """Return ranges at 10 Hz, white by 3 cm with constants of each anchor, and an imu at 50 Hz of a level body.

    Its force is white by 0.05 m/s² at rest, and by `shakes` from LEAVES on.
    """
    rng = np.random.default_rng(4)
    t, t_imu, h = np.arange(0.0, LEAVES + LASTS, 0.1), np.arange(0.0, LEAVES + LASTS, 0.02), 1e-3
    p = place(t if moves else 0.0 * t)
    r = np.linalg.norm(p[:, None] - ANCHORS, axis=2) + 0.03 * rng.standard_normal((len(t), 6))
    r += [0.1, -0.9, 0.7, 0.05, 0.0, -0.1] if not moves else [0.1, -0.1, 0.1, 0.05, 0.0, -0.1]
    a_W = (place(t_imu + h) - 2.0 * place(t_imu) + place(t_imu - h)) / h**2 if moves else np.zeros((len(t_imu), 3))
    white = np.where(t_imu > LEAVES, shakes, 0.05)[:, None] * rng.standard_normal((len(t_imu), 3))
    force = a_W + [0.0, 0.0, GRAVITY] + white
    imu = Imu(t_imu, 0.003 * rng.standard_normal((len(t_imu), 3)), force, None)
    ranges = single_ranges(np.repeat(t, 6), np.tile(np.arange(6), len(t)), r.ravel())
    return Recording("flown", ranges, imu, None, ANCHORS, 0.0, 0.0, [], {})


@pytest.mark.parametrize("moves", [True, False])
def test_a_gentle_take_off_shows_in_the_ranges_and_wrong_ranges_alone_are_none(
    monkeypatch: pytest.MonkeyPatch, moves: bool
) -> None:
    run_plainly(monkeypatch, reacquired, "run_filter", "initial_carried")
    recording, map_ = flown(moves), as_map(MAP)
    known = uncalibrated_setup(recording, map_, at_rest(recording, map_))
    t = np.arange(0.5, LEAVES + LASTS - 0.2, 0.5)
    found = estimate(recording.ranges, recording.imu, known, map_.filter, t)
    late = found.t > LEAVES + 0.6 * LASTS
    if moves:
        error = np.linalg.norm(found.p[late] - place(found.t[late]), axis=1)
        assert error.max() < 0.3
        assert np.all(error**2 < 9.0 * np.trace(found.P[late], axis1=1, axis2=2))
    else:
        np.testing.assert_array_equal(found.p, np.tile(FLOOR, (len(found.t), 1)))


@pytest.mark.parametrize("moves", [True, False])
def test_rotors_that_shake_the_force_are_a_take_off_at_the_next_range(
    monkeypatch: pytest.MonkeyPatch, moves: bool
) -> None:
    """A take-off that is noticed late is claimed to be at rest; rotors that turn on the floor do no harm."""
    run_plainly(monkeypatch, reacquired, "run_filter", "initial_carried")
    recording, map_ = flown(moves, 0.35), as_map(MAP)
    known = uncalibrated_setup(recording, map_, at_rest(recording, map_))
    t = np.arange(0.5, LEAVES + LASTS - 0.2, 0.1)
    found = estimate(recording.ranges, recording.imu, known, map_.filter, t)
    left = found.t[np.linalg.norm(found.p - FLOOR, axis=1) > 0.0]
    assert LEAVES < left[0] < LEAVES + 0.5
    error = found.p - (place(found.t) if moves else FLOOR)
    assert np.all(np.abs(error) < 3.0 * np.sqrt(np.diagonal(found.P, axis1=1, axis2=2)))
