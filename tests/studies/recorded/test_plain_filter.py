"""The filter of recordings as plain Python, on a short motion: its mathematics without its compiled code."""

import numpy as np
from made_up_motion import ANCHORS, BIASES, LEVER, attitude, made_up, place
from plain_filter import run_plainly
from scipy.stats import chi2

from ortilo_drake.interop.recorded.map_file import FilterSettings
from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import Imu
from ortilo_drake.studies.recorded import reacquired
from ortilo_drake.studies.recorded.filter_types import FilterSetup
from ortilo_drake.studies.recorded.filtered import estimate


def test_ranges_and_an_imu_give_the_position_within_what_the_filter_says_of_itself(monkeypatch) -> None:
    run_plainly(monkeypatch, reacquired, "run_filter", "initial_carried")
    motion = made_up(duration=4.0)
    anchor = np.tile(np.arange(6), len(motion.t_r))
    ranges = single_ranges(np.repeat(motion.t_r, 6), anchor, motion.r.ravel())
    imu = Imu(motion.t_imu, motion.imu[:, :3], motion.imu[:, 3:], None)
    heading = float(attitude(motion.t_r[:1]).as_euler("ZYX")[0, 0])
    known = FilterSetup(ANCHORS, BIASES, LEVER, heading)
    found = estimate(ranges, imu, known, FilterSettings(), np.arange(1.0, 3.9, 0.1), False)
    errors = found.p - place(found.t)
    assert np.max(np.sqrt(np.trace(found.P, axis1=1, axis2=2))) < 0.1  # [m]
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(found.P), errors)
    assert np.max(nees) < chi2.ppf(0.9999, 3)
