"""A made-up motion, whose clock offset, frame, biases and lever are known, through calibration, filter and smoother."""

import numpy as np
import pytest
from made_up_motion import ANCHORS, BIASES, LEVER, OFFSET, SHIFT, TABLE_MAP, YAW, as_map, made_up, place, write_tables
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import FilterSettings, Gaps
from ortilo_drake.interop.recorded.recording import Ranges, read_recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.calibrate import calibrate
from ortilo_drake.studies.recorded.filter_types import FilterSetup
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.fit_noise import fit_noise
from ortilo_drake.studies.recorded.replayed import CV, RAW, SMOOTH, WITH_IMU, gap_ends, lose_gaps, lose_some, replay

FIRST = 0.05  # the first range's stamp, from which the recording counts [s]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_tables(tmp_path_factory.mktemp("motion") / "made_up", made_up(outliers=0.005))


@pytest.fixture(scope="module")
def recording(folder):
    return read_recording(folder, as_map(TABLE_MAP))


@pytest.fixture(scope="module")
def replayed(recording):
    return replay(recording, as_map(TABLE_MAP), lambda _: None)


def offset_found(recording, calibration) -> float:
    return calibration.offset + recording.truth_origin - recording.origin


@pytest.mark.long
def test_clock_frame_biases_and_lever_are_found_from_the_first_part(recording) -> None:
    found = calibrate(recording, as_map(TABLE_MAP).calibration)
    assert found.told_by == "rates"
    assert offset_found(recording, found) == pytest.approx(OFFSET, abs=0.003)
    assert np.arctan2(found.F[1, 0], found.F[0, 0]) == pytest.approx(YAW, abs=np.radians(0.5))
    np.testing.assert_allclose(found.shift, SHIFT, atol=0.03)
    np.testing.assert_allclose(found.biases, BIASES, atol=0.03)
    np.testing.assert_allclose(found.lever, LEVER, atol=0.02)
    np.testing.assert_allclose(found.mount, np.eye(3), atol=0.01)
    assert found.left == pytest.approx(0.03, rel=0.15)


@pytest.mark.long
def test_ranges_alone_tell_clock_and_frame(recording) -> None:
    settings = as_map(TABLE_MAP).calibration
    found = calibrate(recording._replace(imu=None), settings, lever=False)
    assert found.told_by == "ranges"
    assert offset_found(recording, found) == pytest.approx(OFFSET, abs=0.15)  # the lever that it knows nothing of
    assert np.arctan2(found.F[1, 0], found.F[0, 0]) == pytest.approx(YAW, abs=np.radians(3.0))


@pytest.mark.long
def test_a_tilted_frame_is_found(recording) -> None:
    tilt = Rotation.from_rotvec([0.2, -0.1, 0.3])
    truth = recording.truth
    tilted = recording._replace(truth=truth._replace(p=tilt.apply(truth.p), R=tilt.as_matrix() @ truth.R))
    settings = as_map(TABLE_MAP).calibration.model_copy(update={"frame": "se3"})
    found = calibrate(tilted, settings)
    expected = (Rotation.from_rotvec([0, 0, YAW]) * tilt.inv()).as_matrix()
    off = Rotation.from_matrix(found.F @ expected.T).magnitude()
    assert off < np.radians(1.5)


def test_a_known_clock_is_taken_as_it_is(recording) -> None:
    settings = as_map(TABLE_MAP).calibration.model_copy(update={"clock": OFFSET})
    found = calibrate(recording, settings)
    assert found.told_by == "map"
    assert offset_found(recording, found) == pytest.approx(OFFSET, abs=1e-9)
    np.testing.assert_allclose(found.lever, LEVER, atol=0.02)


@pytest.mark.long
def test_anchors_that_nobody_surveyed_are_found_in_the_truths_frame(recording) -> None:
    unknown = recording._replace(anchors=6)
    found = calibrate(unknown, as_map(TABLE_MAP).calibration.model_copy(update={"share": 0.6}))
    F = Rotation.from_rotvec([0, 0, YAW])
    expected = F.inv().apply(ANCHORS - SHIFT)
    np.testing.assert_allclose(found.anchors, expected, atol=0.25)  # bias and distance are hard to tell apart
    assert np.sqrt(np.mean((found.anchors - expected) ** 2)) < 0.12


@pytest.mark.long
def test_the_filter_is_consistent_and_better_than_constant_velocity(replayed) -> None:
    found, _ = replayed
    rows = found.rows
    assert max(rows[WITH_IMU].rmse) < 0.03
    assert rows[WITH_IMU].ate < 0.6 * rows[CV].ate
    assert rows[SMOOTH].ate < rows[WITH_IMU].ate
    assert max(rows[RAW].rmse) < 0.15
    assert rows[WITH_IMU].nees < 4.0
    assert rows[WITH_IMU].available == 1.0
    half = next(scores for name, scores in rows.items() if "50%" in name)
    gaps = next(scores for name, scores in rows.items() if "2 s" in name)
    assert half.ate < 1.3 * rows[WITH_IMU].ate
    assert gaps.gaps >= 6
    assert gaps.gap_end < 0.3
    assert gaps.available < 1.0
    assert found.offset == pytest.approx(OFFSET, abs=0.003)
    assert found.doubts == ()
    assert found.residual == pytest.approx(0.03, rel=0.2)


@pytest.mark.long
def test_a_measured_lever_is_used_where_nothing_is_calibrated(recording, replayed) -> None:
    map_ = as_map(TABLE_MAP + f"calibration: {{lever: {LEVER.tolist()}}}")
    found, _ = replay(recording, map_, lambda _: None)
    assert found.rows[RAW].ate < replayed[0].rows[RAW].ate - 0.02  # of 0.136 m


@pytest.mark.long
def test_evo_agrees_with_the_errors_themselves(replayed) -> None:
    found, drawn = replayed
    estimated, truth = drawn[WITH_IMU]
    judged = estimated.t > found.judged_from
    e = (estimated.p - truth)[judged]
    assert found.rows[WITH_IMU].ate == pytest.approx(np.sqrt(np.mean(np.sum(e**2, axis=1))), rel=1e-9)
    assert found.rows[WITH_IMU].ate_aligned < found.rows[WITH_IMU].ate
    over = 20
    d = e[over:] - e[:-over]
    assert found.rows[WITH_IMU].rpe == pytest.approx(np.sqrt(np.mean(np.sum(d**2, axis=1))), rel=1e-6)


@pytest.mark.long
def test_without_truth_the_heading_is_found_by_innovations(recording) -> None:
    map_ = as_map(TABLE_MAP)
    found, drawn = replay(recording._replace(truth=None), map_, lambda _: None)
    estimated, truth = drawn[RAW]
    assert truth is None
    assert found.offset is None
    late = estimated.t > 30.0
    tag = place(estimated.t[late] + FIRST)
    assert np.sqrt(np.mean((estimated.p[late] - tag) ** 2)) < 0.15  # lever and biases unknown
    assert found.rows[RAW].ate is None


def test_a_flown_command_takes_the_accelerometers_place(folder, recording) -> None:
    t = recording.imu.t + recording.origin
    (folder / "command.csv").write_text("\n".join(["t,T", *(f"{a:.6f},{9.81 + 0.2}" for a in t)]))
    text = TABLE_MAP + "command: {file: command.csv, time: t, thrust: T}\nfilter: {acceleration: 0.6}\n"
    commanded = read_recording(folder, as_map(text))
    np.testing.assert_allclose(commanded.imu.force, np.tile([0, 0, 10.01], (len(commanded.imu.t), 1)))
    np.testing.assert_allclose(commanded.imu.rates, recording.imu.rates)


@pytest.mark.long
def test_an_imus_attitude_that_is_not_as_its_force_is_told(recording) -> None:
    attitude = np.tile(Rotation.from_rotvec([0.4, 0, 0]).as_matrix(), (len(recording.imu.t), 1, 1))
    found, _ = replay(
        recording._replace(imu=recording.imu._replace(attitude=attitude)), as_map(TABLE_MAP), lambda _: None
    )
    assert any("disagree on up" in note for note in found.notes)


@pytest.mark.long
@pytest.mark.parametrize("by", ["innovations", "truth"])
def test_the_fit_finds_the_noise_of_the_ranges(recording, by) -> None:
    map_ = as_map(TABLE_MAP + "filter: {range_white: 0.1}\n")
    fitted = fit_noise([recording], map_, by, lambda _: None, most=120)
    assert fitted.after > fitted.before
    assert fitted.settings.range_white == pytest.approx(0.03, rel=0.25 if by == "innovations" else 1.0)
    assert fitted.judged.gains["innovations"].sign == 1


@pytest.mark.long
def test_a_fit_begins_at_the_maps_numbers_though_they_lie_beyond_its_limits(recording) -> None:
    map_ = as_map(TABLE_MAP + "filter: {range_white: 0.1, acceleration: 0.0001, range_correlated: 0.001}\n")
    fitted = fit_noise([recording], map_, "innovations", lambda _: None, most=120)
    assert fitted.after > fitted.before > -1e9
    assert fitted.settings.range_white == pytest.approx(0.03, rel=0.25)
    assert fitted.judged.gains["innovations"].sign == 1


def test_too_few_ranges_give_one_clear_line(recording) -> None:
    few = recording._replace(ranges=Ranges(*(part[::100] for part in recording.ranges)))
    with pytest.raises(InputError, match="fewer than 50 ranges in the first 30%"):
        calibrate(few, as_map(TABLE_MAP).calibration)
    two = recording.ranges.anchor < 2
    pair = Ranges(*(part[two] for part in recording.ranges))
    with pytest.raises(InputError, match="2 anchors heard"):
        estimate(pair, None, FilterSetup(ANCHORS, None, np.zeros(3), None), FilterSettings(), np.zeros(1))


@pytest.mark.long
def test_an_imu_that_was_on_long_before_starts_the_filter_where_the_ranges_do(recording) -> None:
    late = recording.ranges.t > 12.3
    ranges = Ranges(*(part[late] for part in recording.ranges))
    found, _ = replay(recording._replace(ranges=ranges), as_map(TABLE_MAP), lambda _: None)
    assert max(found.rows[WITH_IMU].rmse) < 0.06


@pytest.mark.long
def test_a_truth_with_a_gap_calibrates_by_the_rest(recording) -> None:
    t = recording.truth.t
    kept = (t < 6.0) | (t > 11.0)
    gappy = recording._replace(
        truth=recording.truth._replace(t=t[kept], p=recording.truth.p[kept], R=recording.truth.R[kept])
    )
    found = calibrate(gappy, as_map(TABLE_MAP).calibration)
    assert offset_found(recording, found) == pytest.approx(OFFSET, abs=0.005)
    assert found.left == pytest.approx(0.03, rel=0.15)


@pytest.mark.long
def test_nothing_left_to_judge_is_said(recording) -> None:
    settings = as_map(TABLE_MAP + "calibration: {share: 0.99}\n")
    with pytest.raises(InputError, match="less than 3 s of the recording is left to judge"):
        replay(recording, settings, lambda _: None)


def test_losses_are_as_asked_for_and_repeat(recording) -> None:
    ranges = recording.ranges
    some = lose_some(ranges, 0.5, seed=3)
    assert len(some.t) == pytest.approx(len(ranges.t) / 2, rel=0.05)
    np.testing.assert_array_equal(some.r, lose_some(ranges, 0.5, seed=3).r)
    gaps = Gaps(last=2.0, every=6.0)
    ends = gap_ends(ranges, gaps, 20.0)
    heard = lose_gaps(ranges, gaps, ends)
    assert ends[0] == 22.0
    assert np.diff(np.unique(heard.t)).max() == pytest.approx(2.05, abs=0.051)
    assert not ((heard.t >= 20.0) & (heard.t < 22.0)).any()
