"""What the imu of a live filter tells: that it is silent."""

import numpy as np

from ortilo_drake.interop.recorded.recording import Imu
from ortilo_drake.studies.live.sensor_records import LOST, SILENT, ImuRecord


def rows(*t: float) -> Imu:
    return Imu(np.array(t), np.zeros((len(t), 3)), np.zeros((len(t), 3)), None)


def test_it_is_silent_half_a_second_after_its_last_row() -> None:
    record = ImuRecord()
    record.add(rows(11.8, 11.9))
    record.add(rows())
    assert not record.is_silent(11.9 + 0.9 * SILENT)
    assert record.is_silent(11.9 + 1.1 * SILENT)


def test_nothing_is_silent_that_was_not_heard_yet() -> None:
    assert not ImuRecord().is_silent(100.0)


def test_only_a_long_silence_is_told_whether_it_lies_within_rows_or_between_them() -> None:
    record = ImuRecord()
    assert record.heard_again(rows(3.0, 3.1, 3.1 + 0.9 * LOST)) is None  # nor is the first row's stamp a silence
    assert record.heard_again(rows()) is None
    after = 3.2 + 2.0 * LOST
    assert record.heard_again(rows(after, after + 0.1)) == after
    assert record.heard_again(rows(after + 0.2, after + 1.3 * LOST)) == after + 1.3 * LOST
