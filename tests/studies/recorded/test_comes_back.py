"""A filter that was lost comes back, one that is right is not led astray, and what cannot be made is left out."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_motion import ANCHORS, BIASES, LEVER, attitude, made_up, place

from ortilo_drake.interop.recorded.map_file import FilterSettings, Map
from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import Imu, Recording, Truth
from ortilo_drake.model.typed_yaml import InputError, parse_yaml, validate
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.recorded.calibrate import calibrate
from ortilo_drake.studies.recorded.doubts import of_plane
from ortilo_drake.studies.recorded.filter_types import UNKNOWN_LEVEL, FilterSetup, Level
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.reacquired import Lost, ranges_for_a_fix, solve_first_fix
from ortilo_drake.studies.recorded.recorded_report import report_text
from ortilo_drake.studies.recorded.replayed import CV, CV_RAW, replay
from ortilo_drake.studies.recorded.setups import calibrated_level, given_level, height_doubts

SETTINGS = FilterSettings()
MAP = f"ranges: {{file: r.csv, time: t, values: [1, 2, 3, 4, 5, 6]}}\nanchors: {ANCHORS.tolist()}\n"


def fast(t):
    """Move about a circle at 2.9 m/s, from the first stamp on."""
    return np.column_stack([3 + 2.4 * np.sin(1.2 * t), 4 + 2.4 * np.cos(1.2 * t), 1.4 + 0.0 * t])


def rows(t, r, kept=None):
    """Return single ranges of rows (m, 6), those that are kept."""
    t, anchor = np.repeat(t, 6), np.tile(np.arange(6), len(t))
    kept = np.isfinite(r).ravel() if kept is None else kept(t, anchor)
    return single_ranges(t[kept], anchor[kept], r.ravel()[kept])


def flown(motion, ranges, imu=True, path=place, stamps=None, smoothed=False):
    """Return the estimate, and its errors: of the antenna where there is no IMU."""
    samples = Imu(motion.t_imu, motion.imu[:, :3], motion.imu[:, 3:], None) if imu else None
    heading = float(attitude(motion.t_r[:1]).as_euler("ZYX")[0, 0])
    known = FilterSetup(ANCHORS, BIASES, LEVER if imu else np.zeros(3), heading if imu else None)
    found = estimate(
        ranges, samples, known, SETTINGS, np.arange(0.2, 58.0, 0.1) if stamps is None else stamps, smoothed
    )
    true = path(found.t) if imu else path(found.t) + attitude(found.t).apply(LEVER)
    return found, np.linalg.norm(found.p - true, axis=1)


MOTION = made_up()


@pytest.mark.long
@pytest.mark.parametrize(("imu", "until", "worst"), [(False, 37.0, 0.4), (False, 44.0, 0.4), (True, 50.0, 0.15)])
def test_after_an_outage_the_filter_is_there_within_a_second(imu, until, worst) -> None:
    ranges = rows(MOTION.t_r, MOTION.r, lambda t, i: (t < 30.0) | (t > until))
    found, errors = flown(MOTION, ranges, imu)
    (lost,) = found.lost
    assert lost == pytest.approx((30.0, until), abs=0.06)
    assert errors[found.t > until + 1.0].max() < worst
    assert found.run.taken.mean() > 0.995


@pytest.mark.long
def test_the_smoother_goes_through_an_outage() -> None:
    ranges = rows(MOTION.t_r, MOTION.r, lambda t, i: (t < 30.0) | (t > 45.0))
    _, filtered = flown(MOTION, ranges)
    found, smoothed = flown(MOTION, ranges, smoothed=True)
    inside = (found.t > 30.0) & (found.t < 45.0)
    assert smoothed[inside].max() < 0.3 * filtered[inside].max()
    assert smoothed[~inside].max() < 0.1


@pytest.mark.long
@settings(max_examples=12, deadline=None)
@given(st.floats(5.0, 30.0), st.floats(2.0, 20.0), st.sampled_from([1, 2, 10]))
def test_it_is_found_wherever_and_however_long_the_outage_is(begin, long, every) -> None:
    """Also of slow rows; constant velocity, whose deviation grows to metres in two seconds."""
    ranges = rows(MOTION.t_r[::every], MOTION.r[::every], lambda t, i: (t < begin) | (t > begin + long))
    found, errors = flown(MOTION, ranges, imu=False)
    after = errors[found.t > begin + long + 3.0]
    assert np.sqrt(np.mean(after**2)) < 0.3
    assert all(lost.found is not None for lost in found.lost)


@pytest.mark.long
def test_an_offset_of_all_ranges_loses_it_until_it_is_gone() -> None:
    """The ranges of another place for a while (a fault), then the right ones: refused at first, believed again."""
    moved = np.linalg.norm(place(MOTION.t_r)[:, None] + [1.5, -2.0, 0.3] - ANCHORS, axis=2) + BIASES
    r = np.where(((MOTION.t_r > 30.0) & (MOTION.t_r < 38.0))[:, None], moved, MOTION.r)
    found, errors = flown(MOTION, rows(MOTION.t_r, r))
    assert [lost.found for lost in found.lost] == pytest.approx([31.0, 39.0], abs=0.15)
    assert errors[found.t > 40.0].max() < 0.4


@pytest.mark.long
@pytest.mark.parametrize(("anchors", "size", "tau"), [((1, 4), 3.0, 2.0), ((0, 2, 4), 2.0, 4.0)])
def test_errors_that_fade_do_not_pull_the_filter_along(anchors, size, tau) -> None:
    """Ranges metres too long, right after seconds; heard as soon as they passed the gate, they pulled by 0.2 m."""
    r = MOTION.r.copy()
    for at in (20.0, 35.0):
        on = MOTION.t_r >= at
        r[np.ix_(on, anchors)] += size * np.exp(-(MOTION.t_r[on, None] - at) / tau)
    found, errors = flown(MOTION, rows(MOTION.t_r, r))
    assert np.sqrt(np.mean(errors[found.t > 5.0] ** 2)) < 0.11
    assert not found.lost


@pytest.mark.long
def test_a_vehicle_that_moves_at_the_first_range_is_found_moving() -> None:
    motion = made_up(duration=20.0, place=fast)
    ranges = rows(motion.t_r[::2], motion.r[::2])
    fix = solve_first_fix(ranges_for_a_fix(ranges), ANCHORS, BIASES)
    h = 1e-3
    true = (fast(motion.t_r[:1] + h) - fast(motion.t_r[:1] - h))[0] / (2 * h)
    assert np.linalg.norm(true) > 2.8
    assert (np.abs(fix.x[3:] - true) < 3.0 * np.sqrt(fix.variances[3:])).all()
    slow = rows(motion.t_r[::10], motion.r[::10])  # 2 Hz
    for imu in (True, False):
        found, errors = flown(motion, slow, imu, fast, np.arange(0.1, 19.0, 0.1))
        assert errors[found.t > 5.0].max() < (0.3 if imu else 1.5)
        assert found.run.taken.mean() > 0.95


def test_slow_ranges_start_the_filter_by_as_many_seconds_as_three_anchors_take() -> None:
    t = np.arange(6.0)
    one_by_one = single_ranges(t, np.arange(6), np.ones(6))
    assert len(ranges_for_a_fix(one_by_one).t) == 4
    with pytest.raises(InputError, match="2 anchors heard in the first 3 s"):
        ranges_for_a_fix(one_by_one._replace(t=2.0 * t))


def recording(ranges, truth=None, anchors=ANCHORS):
    return Recording("walk", ranges, None, truth, anchors, 0.0, 0.0, [], {})


def as_map(more="", anchors=ANCHORS):
    return validate(Map, parse_yaml(MAP.replace(str(ANCHORS.tolist()), str(anchors.tolist())) + more, "m"), "MAP.yaml")


@pytest.mark.long
def test_a_row_that_cannot_be_made_is_left_out_and_the_rest_stands() -> None:
    walk = recording(rows(MOTION.t_r, MOTION.r))
    found, _ = replay(walk, as_map("imposed: {lost: 1.0}\n"), lambda _: None)
    assert CV_RAW in found.rows
    assert f"{CV_RAW}, 100% of the ranges lost: this row is left out: ranges: none are left" in found.notes
    assert len(found.rows) == 2  # and the row of the gaps
    pair = recording(rows(MOTION.t_r, MOTION.r, lambda t, i: i < 2))
    with pytest.raises(InputError, match="walk: ranges: 2 anchors heard"):
        replay(pair, as_map(), lambda _: None)


@pytest.mark.long
def test_the_report_says_when_the_filter_was_lost() -> None:
    ranges = rows(MOTION.t_r, MOTION.r, lambda t, i: (t < 30.0) | (t > 44.0))
    found, _ = replay(recording(ranges), as_map("imposed: {lost: 0.0, gaps: null}\n"), lambda _: None)
    assert "lost from 29.9 s, found again at 44.0 s" in report_text([found], 0.3).replace("30.0 s", "29.9 s")
    (lost,) = found.rows[CV_RAW].lost
    assert isinstance(lost, Lost)


HIGH = np.array([(0, 0, 2.1), (4, 0, 2.1), (4, 5, 2.1), (0, 5, 2.1), (2, -1, 2.1), (5, 2, 2.1)])


def rover(z, anchors, duration=30.0, seed=3):
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 0.1)
    p = np.column_stack([2 + 1.2 * np.sin(0.6 * t), 2.5 + 1.5 * np.cos(0.45 * t), np.full(len(t), z)])
    r = np.linalg.norm(p[:, None] - anchors, axis=2) + 0.03 * rng.standard_normal((len(t), 6))
    return recording(rows(t, r), Truth(t, p, None), anchors)


@pytest.mark.long
def test_a_known_height_holds_the_filter_and_is_not_believed_to_death() -> None:
    """Anchors at the antenna's own height tell nothing of it: its deviation stays what was given."""
    level = HIGH - [0, 0, 1.7]
    robot = rover(0.4, level)
    t = np.arange(5.0, 29.0, 0.1)

    def z_of(known_level):
        found = estimate(
            robot.ranges, None, FilterSetup(level, np.zeros(6), np.zeros(3), None, known_level), SETTINGS, t
        )
        return found.p[:, 2] - 0.4, np.sqrt(found.P[:, 2, 2])

    e, sd = z_of(Level(0.4, 0.05, np.inf))
    assert np.abs(e).max() < 0.05
    np.testing.assert_allclose(sd, 0.05, rtol=0.1)
    unknown, _ = z_of(UNKNOWN_LEVEL)
    assert np.abs(unknown).max() > 0.2
    e, sd = z_of(Level(0.4, 0.05, 0.02))
    assert np.abs(np.diff(e)).max() < 0.02
    assert sd.max() < 0.06


@pytest.mark.long
@pytest.mark.parametrize("more", ["planar: true\n", "height: 0.2\n", "planar: true\nheight: 0.2\nheight_sd: 0.02\n"])
def test_of_two_mirror_images_the_one_at_the_known_height_is_taken(more) -> None:
    """Four anchors at 2.1 m and a rover at 0.2 m: the ranges are as well explained at 4.0 m."""
    map_ = as_map(more + "calibration: {clock: 0.0}\nimposed: {lost: 0.0, gaps: null}\n", HIGH)
    robot = rover(0.2, HIGH)
    calibration = calibrate(robot, map_.calibration, level=given_level(map_))
    assert abs(calibration.shift[2]) < 0.1
    assert calibrated_level(map_, calibration, robot).height == pytest.approx(0.2, abs=0.1)
    assert not height_doubts(map_, calibration, robot)
    found, _ = replay(robot, map_, lambda _: None)
    for name in (CV, CV_RAW):
        assert found.rows[name].rmse[2] < 0.08


def test_in_the_anchors_plane_a_planar_robot_is_its_own_mirror_image() -> None:
    p = np.tile([2.0, 2.5, 2.1], (5, 1))
    assert of_plane(HIGH, p, None)
    assert not of_plane(HIGH, p, None, planar=True)
    assert of_plane(HIGH, p - [0.0, 0.0, 1.9], None, planar=True)


def test_a_height_that_is_not_the_truths_is_told() -> None:
    robot = rover(0.2, HIGH)
    wavy = robot.truth.p + np.column_stack([np.zeros((300, 2)), 0.3 * np.sin(robot.truth.t)])
    map_ = as_map("planar: true\ncalibration: {clock: 0.0}\n", HIGH)
    calibration = calibrate(robot, map_.calibration, level=given_level(map_))
    (note,) = height_doubts(map_, calibration, robot._replace(truth=robot.truth._replace(p=wavy)))
    assert note.startswith("planar: true, but the truth's height deviates by 0.2")


def test_a_deviation_without_a_height_is_refused() -> None:
    with pytest.raises(InputError, match="height_sd: belongs to `height`"):
        as_map("height_sd: 0.1\n")
    with pytest.raises(InputError, match="planar"):
        as_map("planar: sometimes\n")


def test_a_start_below_anchors_almost_in_one_plane_is_not_found_above_them() -> None:
    """In the authors' room the search stopped in a local minimum 1.2 m too high."""
    anchors = load_scenario("nominal_imu_uwb").load_room().anchor_positions
    n, rng, true = len(anchors), np.random.default_rng(0), np.array([0.0, 0.0, 1.5])
    t, which = np.repeat(np.arange(0.0, 1.0, 0.1), n), np.tile(np.arange(n), 10)
    far = np.linalg.norm(anchors - true, axis=1)[which]
    for _ in range(10):
        ranges = single_ranges(t, which, far * (1.0 + 0.0075 * rng.standard_normal(len(far))))
        assert np.linalg.norm(solve_first_fix(ranges, anchors, np.zeros(n)).x[:3] - true) < 0.1
