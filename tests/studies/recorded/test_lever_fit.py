"""The lever that the innovations tell without truth or map, against the one that made-up motions were given."""

import made_up_motion
import numpy as np
import pytest
from made_up_motion import LEVER, OFFSET, SHIFT, TABLE_MAP, YAW, as_map, made_up, write_tables
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.studies.recorded.filter_types import FilterSetup
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.lever_fit import PRIOR, fit_lever
from ortilo_drake.studies.recorded.replayed import RAW, replay

# The made-up motion's own noise: 0.03 m of a range; of 50 samples a second 0.03 m/s² and 0.001 rad/s.
NOISE = """
filter: {acceleration: 0.0042, rotation: 0.00014, acceleration_bias: 0.0005, range_white: 0.03, range_correlated: 0.003}
"""
MAP = as_map(TABLE_MAP + NOISE)


def recorded(folder, seed, duration=60.0, outliers=0.005):
    return read_recording(write_tables(folder, made_up(duration, seed, outliers=outliers)), MAP)


def unknown(recording) -> FilterSetup:
    return FilterSetup(np.asarray(recording.anchors), None, np.zeros(3), None, tags=recording.tags)


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_known_lever_is_found_and_the_position_is_the_imus(tmp_path, seed) -> None:
    recording = recorded(tmp_path, seed)
    known = unknown(recording)
    found = fit_lever(recording.ranges, recording.imu, known, MAP.filter)
    assert (np.abs(found.arm - LEVER) < 3.0 * found.sd).all()
    assert (found.sd < PRIOR / 3.0).all()
    assert np.linalg.norm(found.arm - LEVER) < 0.7 * np.linalg.norm(LEVER)
    t, truth = np.arange(40.0, 59.0, 0.1), recording.truth
    F = Rotation.from_rotvec([0, 0, YAW])
    then, stamps = t + recording.origin + OFFSET, truth.t + recording.truth_origin
    place = np.column_stack([np.interp(then, stamps, p) for p in F.apply(truth.p).T])
    errors = [
        estimate(recording.ranges, recording.imu, known._replace(lever=arm), MAP.filter, t).p - place - SHIFT
        for arm in (np.zeros(3), found.arm)
    ]
    none, fitted = np.sqrt(np.mean(np.sum(np.square(errors), axis=2), axis=1))
    assert fitted < none


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, 4, 6])  # a fit with weighed ranges is 4.5 sd off, finds none, and is 3.7 sd off
def test_an_anchor_that_errs_for_a_while_does_not_carry_the_lever_away(tmp_path, seed) -> None:
    """Its error swells to 0.2 m: between the ranges that surely are direct and those that surely are reflected."""
    recording = recorded(tmp_path, seed, 32.0, outliers=0.0)
    ranges = recording.ranges
    t, r = ranges.t - ranges.t[0], ranges.r.copy()
    errs = (ranges.anchor == 1) & (t > 8.0) & (t < 14.0)
    r[errs] += 0.2 * np.sin(np.pi * (t[errs] - 8.0) / 6.0)
    settings = MAP.filter.model_copy(update={"reflected": 0.05})
    found = fit_lever(ranges._replace(r=r), recording.imu, unknown(recording), settings)
    assert (np.abs(found.arm - LEVER) < 3.0 * found.sd).all()


@pytest.mark.long
def test_a_body_that_does_not_turn_tells_no_lever(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(made_up_motion, "attitude", lambda t: Rotation.from_rotvec(np.zeros((len(t), 3))))
    recording = recorded(tmp_path, 1)
    assert fit_lever(recording.ranges, recording.imu, unknown(recording), MAP.filter) is None


@pytest.mark.long
def test_a_replay_without_truth_tells_the_lever_that_it_took(tmp_path) -> None:
    found, _ = replay(recorded(tmp_path, 2)._replace(truth=None), MAP, lambda _: None)
    (said,) = (note for note in found.notes if note.startswith(RAW))
    assert "first 30 s put the antenna at (0.1" in said
