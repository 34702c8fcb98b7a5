"""Tables as TUM and EuRoC lay them out: what NumPy wrote is read without a column named."""

import numpy as np
import pytest
from made_up_motion import OFFSET, TABLE_MAP, as_map, made_up, write_tables
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.csv_columns import LOOKED_AT, _head_of, is_comment, lines_of
from ortilo_drake.interop.recorded.map_edit import map_text
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.model.typed_yaml import InputError

BEGAN = 1_403_636_579_763_555_584  # [ns], as in EuRoC's files
RANGES = TABLE_MAP[: TABLE_MAP.index("imu:")]
SEEN = {
    "tum": "truth: {file: truth.tum, layout: tum}",
    "euroc": "truth: {file: data.csv, layout: euroc}\nimu: {file: imu0.csv, layout: euroc, zero: first}",
}


@pytest.fixture(scope="module")
def motion():
    return made_up(duration=6.0)


@pytest.fixture
def folder(tmp_path, motion):
    folder = write_tables(tmp_path / "motion", motion)
    q = Rotation.from_matrix(motion.R).as_quat()
    head = "timestamp tx ty tz qx qy qz qw"
    np.savetxt(folder / "truth.tum", np.column_stack([motion.t_truth, motion.p, q]), "%.9f", " ", header=head)

    def written(name: str, head: str, t: np.ndarray, *columns: np.ndarray) -> None:
        stamps = [str(BEGAN + round(s * 1e9)) for s in t]
        rows = np.column_stack(columns)
        lines = [",".join([stamp, *(f"{v:.9f}" for v in row)]) for stamp, row in zip(stamps, rows, strict=True)]
        (folder / name).write_text("\n".join([head, *lines]) + "\n")

    head = "#timestamp [ns],w_RS_S_x [rad s^-1],w_y,w_z,a_RS_S_x [m s^-2],a_y,a_z"
    written("imu0.csv", head, motion.t_imu, motion.imu)
    head = "#timestamp, p_RS_R_x [m], p_y, p_z, q_RS_w [], q_x, q_y, q_z, v_RS_R_x [m s^-1], v_y, v_z"
    written("data.csv", head, motion.t_truth, motion.p, q[:, [3, 0, 1, 2]], np.zeros_like(motion.p))
    return folder


@pytest.mark.parametrize("layout", ["tum", "euroc"])
def test_a_layout_is_read(folder, motion, layout) -> None:
    recording = read_recording(folder, as_map(f"{RANGES}\n{SEEN[layout]}"))
    np.testing.assert_allclose(recording.truth.p, motion.p, atol=1e-6)
    np.testing.assert_allclose(recording.truth.R, motion.R, atol=1e-6)
    np.testing.assert_allclose(recording.truth.t, motion.t_truth - motion.t_truth[0], atol=1e-6)
    began = BEGAN * 1e-9 if layout == "euroc" else 0.0
    assert recording.truth_origin == pytest.approx(began + 0.1 + OFFSET, abs=1e-6)
    if layout == "euroc":
        np.testing.assert_allclose(np.hstack([recording.imu.rates, recording.imu.force]), motion.imu, atol=1e-6)
        np.testing.assert_allclose(recording.imu.t, motion.t_imu, atol=1e-6)
    assert recording.rejected == {}


def test_what_is_spoilt_is_one_line_or_counted(folder) -> None:
    with pytest.raises(InputError, match=r"truth.layout: 'kitti' is not one of 'tum', 'euroc'"):
        as_map(f"{RANGES}\ntruth: {{file: a, layout: kitti}}")
    with pytest.raises(InputError, match=r"truth.position: is missing"):
        as_map(f"{RANGES}\ntruth: {{file: a, time: 1}}")
    path = folder / "truth.tum"
    rows = path.read_text().splitlines()
    rows[5] = rows[5][:30]
    path.write_text("\n".join(rows))
    recording = read_recording(folder, as_map(f"{RANGES}\n{SEEN['tum']}"))
    assert sum(recording.rejected.values()) == 1
    (folder / "data.csv").write_text("#timestamp, p_x\n1,2\n")
    with pytest.raises(InputError, match=r"data\.csv"):
        read_recording(folder, as_map(f"{RANGES}\n{SEEN['euroc']}"))


def test_a_map_with_a_layout_reads_back_the_same() -> None:
    map_ = as_map(f"{RANGES}\n{SEEN['euroc']}")
    assert as_map(map_text(map_)) == map_


def test_the_layout_is_found_from_the_first_rows_alone(tmp_path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n# a comment\n" + "".join(f"{k},{k}\n" for k in range(100)))
    lines = lines_of(tmp_path / "a.csv", Rejections("a"))
    head = _head_of(lines, tmp_path / "a.csv")
    assert sum(not is_comment(line) for line in head) == LOOKED_AT
    assert next(lines)[0] == head[-1][0] + 1
