"""Units and axes of recorded files: what a map says of them is what is read."""

import numpy as np
import pytest
from made_up_motion import TABLE_MAP, as_map, made_up, write_tables
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.interop.recorded.rejected import frozen_rows
from ortilo_drake.model.typed_yaml import InputError


@pytest.fixture(scope="module")
def motion():
    return made_up(duration=5.0)


def test_a_left_handed_truth_is_mirrored_with_its_body(motion, tmp_path) -> None:
    """As Unity has it: x right, y up, z forward; a turn by w about n is there one by -w about the mirrored n."""
    mirror = np.array([[0, -1.0, 0], [0, 0, 1], [1, 0, 0]])  # ours forward, left, up by the file's axes
    turn = Rotation.from_rotvec(-Rotation.from_matrix(motion.R).as_rotvec() @ mirror.T).as_matrix()
    folder = write_tables(tmp_path / "walk", motion._replace(p=motion.p @ mirror.T, R=turn))
    truth = read_recording(folder, as_map(TABLE_MAP + "  axes: [z, -x, y]\n")).truth
    np.testing.assert_allclose(truth.p, motion.p, atol=1e-6)
    np.testing.assert_allclose(truth.R, motion.R, atol=1e-6)


@pytest.mark.parametrize(
    ("unit", "size"), [("deg/s", np.pi / 180), ("mrad/s", 1e-3), ("mdeg/s", np.pi / 180e3), ("0.001064", 1.064e-3)]
)
def test_body_rates_are_read_in_their_unit(motion, tmp_path, unit, size) -> None:
    imu = motion.imu.copy()
    imu[:, :3] /= size
    folder = write_tables(tmp_path / "walk", motion._replace(imu=imu))
    map_ = as_map(TABLE_MAP.replace("rates: [wx, wy, wz]", f"rates: [wx, wy, wz], rate_unit: {unit}"))
    np.testing.assert_allclose(read_recording(folder, map_).imu.rates, motion.imu[:, :3], rtol=1e-6, atol=1e-7)


def test_a_unit_of_0_is_refused() -> None:
    with pytest.raises(InputError, match=r"imu\.force_unit: 0: must be"):
        as_map(TABLE_MAP.replace("force: [fx, fy, fz]", "force: [fx, fy, fz], force_unit: 0"))


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("g", 9.81), ("mg", 9.81e-3), ("ft/s2", 0.3048), ("m/s2", 1.0), ("-1", -1.0), ("5.988e-4", 5.988e-4)],
)
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


@pytest.mark.parametrize("source", ["imu", "truth"])
def test_stamps_in_another_unit_than_the_ranges_are_one_line(motion, tmp_path, source) -> None:
    stamps = {"imu": {"t_imu": motion.t_imu * 1e3}, "truth": {"t_truth": motion.t_truth * 1e3}}[source]
    folder = write_tables(tmp_path / "walk", motion._replace(**stamps))
    with pytest.raises(InputError, match=rf"the {source}'s stamps span .* s: {source}\.unit or ranges\.unit is wrong"):
        read_recording(folder, as_map(TABLE_MAP))


def test_poses_that_freeze_are_dropped_and_counted(motion, tmp_path) -> None:
    p = motion.p.copy()
    p[20:40] = p[20]  # 0.95 s
    p[60:64] = p[60]  # 0.15 s: no freeze
    np.testing.assert_array_equal(np.flatnonzero(frozen_rows(motion.t_truth, p, 0.5)), np.arange(21, 40))
    folder = write_tables(tmp_path / "walk", motion._replace(p=p))
    read = read_recording(folder, as_map(TABLE_MAP + "  drop_frozen: 0.5\n"))
    assert len(read.truth.t) == len(p) - 19
    assert any("19 rows that repeat a position (frozen)" in line for line in read.told)
