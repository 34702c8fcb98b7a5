"""Units and axes of recorded files: what a map says of them is what is read."""

import numpy as np
import pytest
from made_up_motion import TABLE_MAP, made_up, write_tables

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import frozen_rows, read_recording
from ortilo_drake.model.typed_yaml import InputError, parse_yaml, validate


def as_map(text):
    return validate(Map, parse_yaml(text, "MAP.yaml"), "MAP.yaml")


@pytest.fixture(scope="module")
def motion():
    return made_up(duration=5.0)


@pytest.mark.parametrize(("unit", "metres"), [("g", 9.81), ("mg", 9.81e-3), ("ft/s2", 0.3048), ("m/s2", 1.0)])
def test_the_force_is_read_in_its_unit(motion, tmp_path, unit, metres) -> None:
    imu = motion.imu.copy()
    imu[:, 3:] /= metres
    folder = write_tables(tmp_path / "walk", motion._replace(imu=imu))
    map_ = as_map(TABLE_MAP.replace("force: [fx, fy, fz]", f"force: [fx, fy, fz], force_unit: {unit}"))
    np.testing.assert_allclose(read_recording(folder, map_).imu.force, motion.imu[:, 3:], rtol=1e-6, atol=1e-6)


def test_a_truth_in_mm_with_y_up_is_turned_and_scaled(motion, tmp_path) -> None:
    up = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # the file's axes by ours: its y is our z, its z our -y
    folder = write_tables(tmp_path / "walk", motion._replace(p=motion.p @ up.T * 1000, R=up @ motion.R))
    truth = read_recording(folder, as_map(TABLE_MAP + "  scale: 0.001\n  axes: [x, -z, y]\n")).truth
    np.testing.assert_allclose(truth.p, motion.p, atol=1e-6)
    np.testing.assert_allclose(truth.R, motion.R, atol=1e-7)
    with pytest.raises(InputError, match=r"truth\.axes: \['x', '-y', 'z'\]: mirrors space"):
        read_recording(folder, as_map(TABLE_MAP + "  axes: [x, -y, z]\n"))


def test_poses_that_freeze_are_dropped_and_counted(motion, tmp_path) -> None:
    p = motion.p.copy()
    p[20:40] = p[20]  # 0.95 s
    p[60:64] = p[60]  # 0.15 s: no freeze
    np.testing.assert_array_equal(np.flatnonzero(frozen_rows(motion.t_truth, p, 0.5)), np.arange(21, 40))
    folder = write_tables(tmp_path / "walk", motion._replace(p=p))
    read = read_recording(folder, as_map(TABLE_MAP + "  drop_frozen: 0.5\n"))
    assert len(read.truth.t) == len(p) - 19
    assert any("19 rows that repeat a position (frozen)" in line for line in read.told)
