"""Differences of ranges in a replay: counted, calibrated, filtered, beside single ranges, with the sign reversed."""

import numpy as np
import pytest
from made_up_motion import ANCHORS, BIASES, TABLE_MAP, made_up, write_tables

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.model.typed_yaml import InputError, parse_yaml, validate
from ortilo_drake.studies.recorded.calibrate import calibrate
from ortilo_drake.studies.recorded.doubts import of_sign
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.setups import calibrated_setup

OWN = "differences: {file: differences.csv, time: t, value: d, a: a, b: b, names: [0, 1, 2, 3, 4, 5]}\n"
REST = TABLE_MAP[TABLE_MAP.index("anchors:") :]


def as_map(text: str) -> Map:
    return validate(Map, parse_yaml(text, "MAP.yaml"), "MAP.yaml")


def write_differences(folder, motion, more=()) -> None:
    """Write r_b - r_a of neighbours, one a row and at stamps of their own."""
    lines = ["t,a,b,d", *more]
    for k, t in enumerate(motion.t_r):
        for i in range(6):
            j = (i + 1) % 6
            lines.append(f"{t + 1e-3 * i:.4f},{i},{j},{motion.r[k, j] - motion.r[k, i]:.4f}")
    (folder / "differences.csv").write_text("\n".join(lines))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    motion = made_up()
    folder = write_tables(tmp_path_factory.mktemp("motion") / "made_up", motion)
    more = ["0.0111,2,2,0.1", "0.0112,2,9,0.1", "0.0113,1,2,77", "0.0114,1,2,nan"]
    write_differences(folder, motion, more)
    return folder


def test_rows_that_are_no_differences_are_counted(folder) -> None:
    recording = read_recording(folder, as_map(OWN + REST))
    counted = {reason.split(": ")[-1]: n for reason, n in recording.rejected.items()}
    assert counted["differences of one anchor to itself"] == 1
    assert counted["differences to anchors that are not surveyed"] == 1
    assert any("('9')" in line for line in recording.told)
    assert counted["differences longer by 1 m than their anchors lie apart"] == 1
    assert set(recording.ranges.other) == set(range(6))


def test_none_of_whose_anchors_is_surveyed_is_one_line(folder) -> None:
    with pytest.raises(InputError, match="no row names two anchors of the map"):
        read_recording(folder, as_map(OWN.replace("[0, 1, 2, 3, 4, 5]", "[10, 11, 12, 13, 14, 15]") + REST))
    with pytest.raises(InputError, match=r"ranges: are missing, and `differences`, too"):
        as_map(REST)


@pytest.mark.long
def test_constants_are_found_but_for_their_sum_and_the_filter_follows(folder) -> None:
    map_ = as_map(OWN + REST)
    recording = read_recording(folder, map_)
    found = calibrate(recording, map_.calibration)
    assert found.biases.sum() == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(found.biases, BIASES - BIASES.mean(), atol=0.04)
    ranges = "ranges:" + TABLE_MAP.split("ranges:")[1].split("\nanchors")[0] + "\n"
    both = read_recording(folder, as_map(ranges + OWN + REST))
    assert set(both.ranges.other) == set(range(-1, 6))
    t = np.arange(25.0, 55.0, 0.1)
    for heard, by in ((recording, found), (both, calibrate(both, map_.calibration))):
        at = estimate(heard.ranges, heard.imu, calibrated_setup(by, heard, map_), map_.filter, t)
        true = np.column_stack([np.interp(t + by.offset, heard.truth.t, axis) for axis in heard.truth.p.T])
        assert np.sqrt(np.mean(np.sum((at.p - by.position(true)) ** 2, axis=1))) < 0.08
        assert at.run.taken.mean() > 0.98


@pytest.mark.long
def test_a_reversed_sign_is_doubted_with_the_key_that_mends_it(folder) -> None:
    right = read_recording(folder, as_map(OWN + REST))
    wrong = read_recording(folder, as_map(OWN.replace("b: b,", "b: b, sign: -1,") + REST))
    assert of_sign(right.ranges, ANCHORS, 1) == []
    (said,) = of_sign(wrong.ranges, ANCHORS, -1)
    assert said.endswith("differences: {sign: 1}")
