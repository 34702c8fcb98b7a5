"""The heading where none is known: that which most trials end with, against the truth."""

import numpy as np
import pytest
from made_up_motion import TABLE_MAP, as_map, attitude, made_up, write_tables
from usd_logs import util_folder, util_map

from ortilo_drake.interop.recorded.recording import between, read_recording
from ortilo_drake.studies.recorded.calibrate import calibrate
from ortilo_drake.studies.recorded.filter_types import FilterSetup
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.setups import airborne, calibrated_setup, with_aids


def test_the_heading_of_a_body_in_motion_is_found(tmp_path) -> None:
    map_ = as_map(TABLE_MAP)
    recording = read_recording(write_tables(tmp_path, made_up(outliers=0.005)), map_)
    known = FilterSetup(np.asarray(recording.anchors), None, np.zeros(3), None, tags=recording.tags)
    found = estimate(recording.ranges, recording.imu, known, map_.filter, np.zeros(0))
    yaw = attitude(np.array([0.05])).as_euler("ZYX")[0, 0]
    assert abs(found.begin.heading - yaw) < np.radians(20.0)


@pytest.mark.long
@pytest.mark.parametrize(("name", "most"), [("0425-traj4", 0.26), ("0425-traj16", 0.32)])
def test_a_recording_that_begins_in_flight_is_not_turned_round(name, most) -> None:
    """The likeliest innovations took 225 and 135 degrees, and the errors were 0.37 and 0.38 m; it flies at about 0."""
    map_ = as_map(util_map(name))
    recording = read_recording(util_folder() / name, map_)
    by = calibrate(recording, map_.calibration)
    known = with_aids(calibrated_setup(by, recording, map_), recording, map_, looks=False)
    t = recording.truth.t - by.offset
    t = t[airborne(recording.truth, by, map_)(t)]
    t = t[t >= t[0] + 8.0]
    ranges = recording.ranges.only(recording.ranges.t >= t[0])
    imu = between(recording.imu, t[0] - 1e-3, np.inf)
    found = estimate(ranges, imu, known._replace(start=None, heading=None, rest=None), map_.filter, t)
    assert abs(found.begin.heading) < np.radians(20.0)
    true = np.column_stack([np.interp(found.t + by.offset, recording.truth.t, p) for p in recording.truth.p.T])
    assert np.sqrt(np.mean(np.sum((found.p - true) ** 2, axis=1))) < most
