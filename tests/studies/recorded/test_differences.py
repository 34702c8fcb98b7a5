"""Differences of ranges in a replay: counted, calibrated, filtered, beside single ranges, with the sign reversed."""

import re

import numpy as np
import pytest
from made_up_motion import ANCHORS, BIASES, TABLE_MAP, as_map, made_up, write_tables

from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.calibrate import calibrate
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.first_look import first_look
from ortilo_drake.studies.recorded.setups import calibrated_setup

OWN = "differences: {file: differences.csv, time: t, value: d, a: a, b: b, names: [0, 1, 2, 3, 4, 5]}\n"
REST = TABLE_MAP[TABLE_MAP.index("anchors:") :]


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


def placed(recording, anchors):
    return recording._replace(anchors=np.asarray(anchors))


@pytest.mark.long
@pytest.mark.parametrize("truth", [True, False])
def test_what_differences_tell_of_a_wrong_map(folder, truth) -> None:
    """The key that mends it is named, by the truth or by the differences alone."""
    text = OWN + REST if truth else OWN + REST[: REST.index("truth:")]
    map_ = as_map(text)
    right = read_recording(folder, map_)
    assert first_look(right, map_).guess is None
    sign = as_map(text.replace("b: b,", "b: b, sign: -1,"))
    assert first_look(read_recording(folder, sign), sign).guess.key == "differences: {sign: 1}"
    swapped = first_look(placed(right, ANCHORS[[0, 4, 2, 3, 1, 5]]), map_).guess
    assert swapped.key == "anchors: entries '1' and '4' change places"
    assert swapped.after < 0.2 < 0.5 < swapped.before
    if truth:
        typed = ANCHORS.copy()
        typed[2] = [6.0, 4.0, 0.2]
        key = first_look(placed(right, typed), map_).guess.key
        at = re.fullmatch(r"anchors: entry '2' at \[6, (.*), 0\.2\], not \[6, 4, 0\.2\],", key)[1]
        assert float(at) == pytest.approx(8.0, abs=0.3)


def test_differences_in_mm_are_told(folder) -> None:
    in_mm = as_map((OWN + REST).replace("b: b,", "b: b, scale: 1000,"))
    with pytest.raises(InputError, match=r"m apart: in mm or cm\? differences: {scale: } makes them metres"):
        read_recording(folder, in_mm)
