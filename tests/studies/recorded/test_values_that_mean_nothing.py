"""Values that stand in a recording but were not measured: codes, repeated values, leaps, clocks that jump."""

import re

import numpy as np
import pytest
from made_up_motion import ANCHORS, OFFSET, TABLE_MAP, as_map, made_up, write_tables

from ortilo_drake.interop.recorded.range_rows import code_of_none
from ortilo_drake.interop.recorded.recording import Recording, read_recording
from ortilo_drake.interop.recorded.rejected import leaping_rows
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.doubts import of_stuck
from ortilo_drake.studies.recorded.first_look import first_look
from ortilo_drake.studies.recorded.imu_doubts import attitude_doubts, force_doubts
from ortilo_drake.studies.recorded.level_doubts import level_doubts

MAP = as_map(TABLE_MAP)
MOTION = made_up(duration=30.0)


def recorded(tmp_path, **changes: np.ndarray) -> Recording:
    return read_recording(write_tables(tmp_path / "walk", MOTION._replace(**changes)), MAP)


@pytest.fixture(scope="module")
def right(tmp_path_factory) -> Recording:
    return recorded(tmp_path_factory.mktemp("right"))


@pytest.mark.parametrize("code", [9999.0, 65.535, 655.35])
def test_a_code_for_no_range_is_left_out_and_counted(tmp_path, right, code) -> None:
    unheard = np.random.default_rng(2).random(MOTION.r.shape) < 0.1
    found = recorded(tmp_path, r=np.where(unheard, code, MOTION.r))
    np.testing.assert_array_equal(found.ranges.r, right.ranges.r[~unheard.ravel()])
    (reason,) = found.rejected
    assert reason.startswith(f"ranges.csv (ranges): ranges of exactly {code:g}, far above all others")
    assert found.rejected[reason] == unheard.sum()


def test_one_long_range_is_no_code() -> None:
    assert np.isnan(code_of_none(np.array([3.0, 4.0, 5.0, 90.0, 90.0])))
    assert np.isnan(code_of_none(np.full(9, 5.0)))
    assert np.isnan(code_of_none(np.zeros(0)))


def test_a_lone_position_far_away_is_left_out_and_counted(tmp_path) -> None:
    p = MOTION.p.copy()
    p[5::97] += [3.0, -2.0, 0.5]
    found = recorded(tmp_path, p=p)
    assert len(found.truth.t) == len(p) - len(p[5::97])
    assert found.rejected == {"truth.csv (truth): rows whose position leaps away and back": len(p[5::97])}
    walk = np.cumsum(np.full((40, 3), 0.5), axis=0)  # a fast body, and one that stays where it leapt
    assert not leaping_rows(walk).any()
    assert not leaping_rows(np.where(np.arange(40)[:, None] > 20, walk + 9.0, walk)).any()


def test_an_anchor_whose_ranges_keep_one_value_is_told(right) -> None:
    assert of_stuck(right.ranges) == []
    its = right.ranges.anchor == 3
    held = right.ranges._replace(r=np.where(its, 4.2, right.ranges.r))
    assert "anchor 4 for 29.9 s: last values repeated?" in of_stuck(held)[0]
    all_ = right.ranges._replace(r=np.repeat(MOTION.r[::20], 20, axis=0)[: len(MOTION.r)].ravel())
    assert all(f"anchor {i + 1} for " in of_stuck(all_)[0] for i in range(6))
    still = right.ranges._replace(r=np.round(np.tile(MOTION.r[0], len(MOTION.r)), 1))
    assert of_stuck(still) == []  # a body at rest, measured to a decimetre


def test_a_clock_that_jumps_is_told_with_the_time(right) -> None:
    t = right.ranges.t
    jumped = right._replace(ranges=right.ranges._replace(t=t + 0.5 * (t > 15.0)))
    said = re.match(
        r"ranges: a clock that jumps by (.*) s about (.*) s after the first", first_look(jumped, MAP).guess.key
    )
    assert float(said[1]) == pytest.approx(0.5, abs=0.05)
    assert float(said[2]) == pytest.approx(15.0, abs=2.0)


def test_a_constant_of_all_ranges_is_told_and_no_unit_that_makes_a_room_of_a_centimetre(right) -> None:
    with pytest.raises(InputError, match=r"all ranges have a constant of some 15\d m: antenna delays\?"):
        first_look(right._replace(ranges=right.ranges._replace(r=right.ranges.r + 154.0)), MAP)


def test_anchors_with_z_down_are_told(right) -> None:
    key = first_look(right._replace(anchors=ANCHORS * [1.0, 1.0, -1.0]), MAP).guess.key
    assert key.startswith("anchors: z of each with the other sign, or truth: {axes: [x, y, -z]}")


@pytest.mark.parametrize("then", [10.0, 15.0, 20.0])
def test_a_clock_that_begins_anew_is_told_with_the_line(tmp_path, then) -> None:
    t = np.where(MOTION.t_r > then, MOTION.t_r - then, MOTION.t_r)
    line = 3 + int(np.argmax(np.diff(t) < 0.0))
    with pytest.raises(InputError, match=rf"its clock begins anew in line {line}: two times would be mixed"):
        recorded(tmp_path, t_r=t)
    rows = [f"{s:.3f},{i},{r:.3f}" for s, row in zip(t, MOTION.r, strict=True) for i, r in enumerate(row)]
    with pytest.raises(InputError, match=rf"its clock begins anew in line {2 + 6 * (line - 2)}: two times"):
        named(tmp_path, rows)


def test_parts_of_a_recording_may_stand_in_any_order(tmp_path) -> None:
    of_all = zip(MOTION.t_r, MOTION.r, strict=True)
    rows = [f"{s:.3f},{i},{r:.3f}" for s, row in of_all for i, r in enumerate(row)]
    assert len(named(tmp_path, rows[1800:] + rows[:1800]).ranges.t) == len(rows)


def named(tmp_path, rows: list[str]) -> Recording:
    text = TABLE_MAP.replace("[r0, r1, r2, r3, r4, r5]", "[r], anchor: a, names: [0, 1, 2, 3, 4, 5]")
    folder = write_tables(tmp_path / "named", MOTION)
    (folder / "ranges.csv").write_text("\n".join(["t,a,r", *rows]))
    return read_recording(folder, as_map(text))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_truth_without_attitude_hides_the_lever_and_makes_no_scale_or_clock_doubtful(tmp_path, seed) -> None:
    text = TABLE_MAP.partition("imu:")[0] + "truth: {file: truth.csv, time: t, position: [x, y, z]}\n"
    map_ = as_map(f"{text}calibration: {{clock: {OFFSET}}}")
    for duration in (20.0, 40.0):
        folder = write_tables(tmp_path / f"{duration:.0f}", made_up(duration=duration, seed=seed))
        recording = read_recording(folder, map_)
        assert first_look(recording, map_).guess is None
    long = recording._replace(ranges=recording.ranges._replace(r=recording.ranges.r * 1.05))
    said = re.match(r"ranges: {scale: (.*)}", first_look(long, map_).guess.key)
    assert float(said[1]) == pytest.approx(1 / 1.05, abs=0.03)


def test_an_imu_or_an_attitude_that_was_not_measured_is_told(right) -> None:
    nothing = right.imu._replace(force=0.0 * right.imu.force)
    assert force_doubts(nothing, MAP) == [
        "imu: its force is 0: it was not measured, or `imu: force` names other columns"
    ]
    assert level_doubts(nothing, MAP) == []
    never = right._replace(truth=right.truth._replace(R=np.tile(np.eye(3), (len(right.truth.t), 1, 1))))
    (said,) = attitude_doubts(never, MAP, OFFSET, None)
    assert said == "truth: its attitude never changes though the body rates turn: leave `truth: rotation` out"
