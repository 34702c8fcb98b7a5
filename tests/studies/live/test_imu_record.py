"""What the imu of a live filter tells: that it is silent, and that its rates are in another unit than the map says."""

import numpy as np
import pytest
from live_messages import IMU, RANGES
from made_up_motion import as_map, made_up

from ortilo_drake.interop.recorded.recording import Imu, between
from ortilo_drake.studies.live.imu_record import LOST, SILENT, ImuRecord


def received(per_rad: float, place=None) -> ImuRecord:
    """Return the record of a made-up motion whose rates are so many to the rad/s, heard in pieces of 0.1 s."""
    m = made_up(12.0) if place is None else made_up(12.0, place=place)
    imu = Imu(m.t_imu - m.t_imu[0], per_rad * m.imu[:, :3], m.imu[:, 3:], None)
    record = ImuRecord(as_map(RANGES + IMU))
    for k in range(120):
        record.add(between(imu, 0.1 * k - 1e-9, 0.1 * (k + 1) - 1e-9))
    return record


def test_it_is_silent_half_a_second_after_its_last_row() -> None:
    record = received(1.0)
    last = 12.0 - 0.1
    assert not record.is_silent(last + 0.9 * SILENT)
    assert record.is_silent(last + SILENT + 0.2)


def test_nothing_is_silent_that_was_not_heard_yet() -> None:
    assert not ImuRecord(as_map(RANGES + IMU)).is_silent(100.0)


@pytest.mark.parametrize(("per_rad", "said"), [(1.0, ""), (180.0 / np.pi, "rate_unit: deg/s")])
def test_degrees_are_told_by_the_force_and_radians_are_not_doubted(per_rad, said) -> None:
    doubt = received(per_rad).doubt
    assert said in doubt
    assert bool(doubt) == bool(said)


def test_only_a_long_silence_is_told_whether_it_lies_within_rows_or_between_them() -> None:
    def rows(*t: float) -> Imu:
        return Imu(np.array(t), np.zeros((len(t), 3)), np.zeros((len(t), 3)), None)

    record = ImuRecord(as_map(RANGES + IMU))
    assert record.heard_again(rows(3.0, 3.1, 3.1 + 0.9 * LOST)) is None  # nor is the first row's stamp a silence
    assert record.heard_again(rows()) is None
    after = 3.2 + 2.0 * LOST
    assert record.heard_again(rows(after, after + 0.1)) == after
    assert record.heard_again(rows(after + 0.2, after + 1.3 * LOST)) == after + 1.3 * LOST
