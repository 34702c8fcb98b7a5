"""Readers of others' recordings: the same motion from every format, and one clear line or a count for what is wrong."""

from pathlib import Path

import numpy as np
import pytest
from made_up_motion import BAG_MAP, OFFSET, TABLE_MAP, as_map, made_up, write_bag, write_tables

from ortilo_drake.interop.recorded.map_edit import map_text
from ortilo_drake.interop.recorded.map_file import load_map
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.interop.recorded.rejected import Rejections, lines_of_all
from ortilo_drake.interop.recorded.units import axes_matrix
from ortilo_drake.model.typed_yaml import InputError


@pytest.fixture(scope="module")
def motion():
    return made_up(duration=6.0)


@pytest.fixture
def folder(tmp_path, motion):
    return write_tables(tmp_path / "motion", motion)


def lines(path: Path) -> list[str]:
    return path.read_text().splitlines()


def rewrite(path: Path, change) -> None:
    rows = lines(path)
    change(rows)
    path.write_text("\n".join(rows) + "\n")


def read(folder, text=TABLE_MAP):
    return read_recording(folder, as_map(text))


def check_same(recording, motion) -> None:
    np.testing.assert_allclose(recording.ranges.t[::6], motion.t_r - motion.t_r[0], atol=1e-6)
    np.testing.assert_allclose(recording.ranges.r, motion.r.ravel(), atol=1e-6)
    np.testing.assert_array_equal(recording.ranges.anchor[:12], [0, 1, 2, 3, 4, 5] * 2)
    np.testing.assert_allclose(np.hstack([recording.imu.rates, recording.imu.force]), motion.imu, atol=1e-6)
    np.testing.assert_allclose(recording.imu.t, motion.t_imu - motion.t_r[0], atol=1e-6)
    np.testing.assert_allclose(recording.truth.p, motion.p, atol=1e-6)
    assert recording.truth_origin == pytest.approx(0.1 + OFFSET)
    assert recording.rejected == {}


def test_tables_are_read(folder, motion) -> None:
    recording = read(folder)
    check_same(recording, motion)
    np.testing.assert_allclose(recording.truth.R, motion.R, atol=1e-6)


@pytest.mark.family
@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap", "file"])
def test_bags_are_read(tmp_path, motion, kind) -> None:
    path = write_bag(tmp_path / ("all.bag" if kind == "ros1" else "all"), motion, "mcap" if kind == "file" else kind)
    if kind == "file":
        path = next(path.glob("*.mcap"))
        path = path.rename(tmp_path / "all.mcap")
    check_same(read(tmp_path, BAG_MAP.replace("BAG", path.name)), motion)


@pytest.mark.family
@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
@pytest.mark.parametrize("packed", ["", "file", "message"])
def test_a_bag_whose_metadata_was_never_written_is_read(tmp_path, motion, kind, packed) -> None:
    path = write_bag(tmp_path / "all", motion, kind, packed)
    (path / "metadata.yaml").unlink()
    check_same(read(tmp_path, BAG_MAP.replace("BAG", path.name)), motion)
    (file,) = path.iterdir()
    check_same(read(tmp_path, BAG_MAP.replace("BAG", f"{path.name}/{file.name}")), motion)


def test_parts_of_a_bag_without_metadata_are_one(tmp_path, motion) -> None:
    """The second, whose name has two digits, is the later one."""
    folder = write_bag(tmp_path / "all", between(motion, 0.0, 3.0), "mcap")
    more = write_bag(tmp_path / "more", between(motion, 3.0, 9.0), "mcap")
    (folder / "metadata.yaml").unlink()
    (folder / "all.mcap").rename(folder / "all_9.mcap")
    (more / "more.mcap").rename(folder / "all_10.mcap")
    check_same(read(tmp_path, BAG_MAP.replace("BAG", "all")), motion)


def between(motion, first, last):
    its = {}
    for t, names in (("t_r", ["r"]), ("t_imu", ["imu", "attitude"]), ("t_truth", ["p", "R"])):
        late = getattr(motion, t) - (OFFSET if t == "t_truth" else 0.0)
        its |= {name: getattr(motion, name)[(late >= first) & (late < last)] for name in (t, *names)}
    return motion._replace(**its)


def test_an_mcap_that_lost_its_end_with_the_power_is_read_up_to_there(tmp_path, motion) -> None:
    path = write_bag(tmp_path / "all", motion, "mcap")
    (path / "metadata.yaml").unlink()
    file = path / "all.mcap"
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 9 // 10])
    recording = read(tmp_path, BAG_MAP.replace("BAG", path.name).split("truth:")[0])
    assert any("the bag's end is missing" in line for line in recording.told)
    n = len(recording.ranges.r)
    np.testing.assert_allclose(recording.ranges.r, motion.r.ravel()[:n], atol=1e-6)
    assert n > motion.r.size / 2


def test_messages_that_came_late_are_put_in_order(folder, motion) -> None:
    """Of an IMU and a truth, which name no anchor; a clock that steps back is another matter."""

    def swap(rows):
        for k in range(3, len(rows) - 3, 3):
            rows[k], rows[k + 1] = rows[k + 1], rows[k]

    rewrite(folder / "imu.csv", swap)
    recording = read(folder)
    check_same(recording, motion)
    assert any("rows out of order, first in line 5; sorted by their stamps" in line for line in recording.told)

    def step_back(rows):
        for k in range(200, len(rows)):
            t, rest = rows[k].split(",", 1)
            rows[k] = f"{float(t) - 0.105:.6f},{rest}"

    write_tables(folder, motion)
    rewrite(folder / "imu.csv", step_back)
    assert {key.split(": ", 1)[1]: n for key, n in read(folder).rejected.items()} == {"backward stamps": 5}


def test_stamps_of_two_columns_are_seconds_and_nanoseconds(folder, motion) -> None:
    def split(rows):
        rows[0] = "secs,nsecs," + rows[0].split(",", 1)[1]
        for k in range(1, len(rows)):
            t, rest = rows[k].split(",", 1)
            rows[k] = f"{int(float(t))},{round(float(t) % 1 * 1e9)},{rest}"

    rewrite(folder / "ranges.csv", split)
    check_same(read(folder, TABLE_MAP.replace("ranges.csv, time: t", "ranges.csv, time: [secs, nsecs]")), motion)


def test_columns_by_number_other_delimiters_and_units(folder, motion) -> None:
    rows = lines(folder / "ranges.csv")[1:]
    in_ms = [";".join([f"{float(row.split(',')[0]) * 1e3:.6f}", *row.split(",")[1:]]) for row in rows]
    (folder / "ranges.csv").write_text("\n\n".join(in_ms))
    numbers = "ranges: {file: ranges.csv, time: 1, unit: ms, values: [2, 3, 4, 5, 6, 7]}"
    text = TABLE_MAP.replace("ranges: {file: ranges.csv, time: t, values: [r0, r1, r2, r3, r4, r5]}", numbers)
    check_same(read(folder, text), motion)


def test_quaternion_order_matrix_and_axes(folder, motion) -> None:
    wxyz = TABLE_MAP.replace("[qx, qy, qz, qw], order: xyzw", "[qw, qx, qy, qz], order: wxyz")
    np.testing.assert_allclose(read(folder, wxyz).truth.R, motion.R, atol=1e-6)
    inverse = TABLE_MAP.replace("order: xyzw", "order: xyzw, of: world")
    np.testing.assert_allclose(read(folder, inverse).truth.R, motion.R.transpose(0, 2, 1), atol=1e-6)
    np.testing.assert_array_equal(axes_matrix("frd", "imu.axes"), np.diag([1, -1, -1]))
    np.testing.assert_array_equal(axes_matrix(("y", "-x", "z"), "imu.axes") @ [1, 2, 3], [2, -1, 3])
    with pytest.raises(InputError, match="mirrors"):
        axes_matrix(("y", "x", "z"), "imu.axes")


def test_what_cannot_be_used_is_counted(folder, motion) -> None:
    def spoil(rows):
        rows[5] = rows[5].replace(rows[5].split(",")[2], "nan")  # one range of a row
        rows[8] = rows[8].split(",")[0] + ",-1" + "," + ",".join(rows[8].split(",")[2:])
        rows[10] = rows[9]  # a duplicate stamp
        rows[20] = rows[3]  # a backward one
        rows[30] = "nan" + rows[30][rows[30].index(",") :]
        rows[31] = rows[31].rsplit(",", 2)[0]  # cells missing
        rows[32] = rows[32].replace(",", ",x", 1)  # no number
        del rows[60:90]  # a gap

    rewrite(folder / "ranges.csv", spoil)
    rewrite(folder / "imu.csv", lambda rows: rows.__setitem__(4, "0.08,nan,0,0,0,0,9.8"))
    rewrite(folder / "truth.csv", lambda rows: rows.__setitem__(4, rows[4].split(",")[0] + ",0,0,0,0,0,0,1"))
    recording = read(folder)
    counts = {key.split(": ", 1)[1]: n for key, n in recording.rejected.items()}
    assert counts == {
        "duplicate stamps": 1,
        "backward stamps": 1,
        "rows without a stamp": 1,
        "rows with fewer than 7 cells": 1,
        "rows with a cell that is no number": 1,
        "ranges that are NaN or empty (the others of their row are kept)": 1,
        "ranges of 0 or less (the others of their row are kept)": 1,
        "rows with NaN, infinity or an empty cell": 1,
        "rows without a position (all zero)": 1,
    }
    assert any("1 gap between stamps" in line for line in recording.told)
    assert len(recording.ranges.t) == 6 * (len(motion.t_r) - 35) - 2
    for reason in counts:
        assert any(f": 1 {reason}" in line for line in recording.told)


BAD = {
    "no file": (lambda f: (f / "imu.csv").unlink(), TABLE_MAP, "imu.csv: cannot be read: No such file"),
    "missing header": (lambda f: rewrite(f / "imu.csv", lambda r: r.pop(0)), TABLE_MAP, "has no header, so column 't'"),
    "unknown column": (
        lambda f: None,
        TABLE_MAP.replace("[wx,", "[wxx,"),
        "no column 'wxx', did you mean 'wx'?; has t, wx",
    ),
    "empty": (lambda f: (f / "imu.csv").write_text(""), TABLE_MAP, "imu.csv: is empty"),
    "no numbers": (lambda f: (f / "imu.csv").write_text("t,wx,wy,wz,fx,fy,fz\n" + "a\n" * 9), TABLE_MAP, "0 of 9 rows"),
    "not text": (lambda f: (f / "imu.csv").write_bytes(b"\xff\xfe\x00"), TABLE_MAP, "not UTF-8"),
    "constant stamps": (lambda f: None, TABLE_MAP.replace("imu.csv, time: t", "imu.csv, time: 100"), "0 of"),
    "anchors": (lambda f: None, TABLE_MAP.replace("r4, r5]", "r4]"), "anchors: 6 of them, but the ranges are to 5"),
    "no quaternion": (lambda f: None, TABLE_MAP.replace("[qx,", "[x,"), "no unit quaternions"),
    "clocks apart": (lambda f: None, TABLE_MAP.replace("imu.csv,", "imu.csv, late: 1000,"), "do not overlap"),
    "two units": (
        lambda f: None,
        TABLE_MAP.replace("imu.csv,", "imu.csv, unit: ms,"),
        "imu.unit or ranges.unit is wrong",
    ),
    "no bag": (lambda f: None, BAG_MAP.replace("BAG", "none.bag"), "none.bag: no such bag"),
    "a folder": (
        lambda f: (f / "bags").mkdir(),
        BAG_MAP.replace("BAG", "bags"),
        "bags: a folder without metadata.yaml",
    ),
    "a table as a bag": (lambda f: None, BAG_MAP.replace("BAG", "imu.csv"), "cannot be read as a bag"),
}


@pytest.mark.parametrize(("spoil", "text", "line"), BAD.values(), ids=BAD)
def test_bad_input_gives_one_clear_line(folder, spoil, text, line) -> None:
    spoil(folder)
    with pytest.raises(InputError) as error:
        read(folder, text)
    assert line in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", ["ros1", "sqlite3"])
def test_a_truncated_bag_gives_one_clear_line(tmp_path, motion, kind) -> None:
    path = write_bag(tmp_path / ("all.bag" if kind == "ros1" else "all"), motion, kind)
    file = path if kind == "ros1" else next(p for p in path.iterdir() if p.suffix != ".yaml")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(InputError, match="cannot be read as a bag \\(cut short"):
        read(tmp_path, BAG_MAP.replace("BAG", path.name))


@pytest.mark.parametrize(
    ("before", "after", "line"),
    [
        ("/imu,", "/imus,", "no topic '/imus', did you mean '/imu'?; has /imu, /r0"),
        ("values: [range]", "values: [rang]", "sensor_msgs/msg/Range has no field 'rang'; has header, radiation_type"),
        ("values: [range]", "values: [header]", "is no number"),
    ],
)
def test_unknown_topics_and_fields(tmp_path, motion, before, after, line) -> None:
    write_bag(tmp_path / "all.bag", motion, "ros1")
    with pytest.raises(InputError) as error:
        read(tmp_path, BAG_MAP.replace("BAG", "all.bag").replace(before, after))
    assert line in str(error.value)


@pytest.mark.parametrize(
    ("before", "after", "line"),
    [
        ("time: t, values", "values", "time: a table needs the column"),
        ("anchors: ", "anchors: {find: 5} #", "5 of them, but the ranges are to 6"),
        ("file: imu.csv", "file: imu.csv, axes: [x, x, z]", "must name x, y and z once each"),
        ("file: imu.csv", "file: imu.csv, axes: flx", "imu.axes: 'flx': must be 'flu' or 'frd' or a list of 3"),
        ("file: imu.csv", "file: imu.csv, axes: [x, y, w]", "imu.axes.2: 'w' is not one of 'x', 'y', 'z'"),
        ("file: imu.csv", "file: 3", "imu.file: 3: must be text that is not empty or a list"),
        ("wx, wy, wz", "0, wy, wz", "imu.rates.0: 0: must be text that is not empty or an integer from 1 to 10000"),
        ("ranges:", "filter: {gate: -1}\nranges:", "filter.gate"),
        ("ranges:", "calibration: {clock: known}\nranges:", "clock: known: must be 'estimate' or a number [s]"),
        ("ranges:", "imposed: {gaps: {last: 3, every: 2}}\nranges:", "shorter than `every`"),
    ],
)
def test_a_wrong_map_names_the_field(before, after, line) -> None:
    with pytest.raises(InputError) as error:
        as_map(TABLE_MAP.replace(before, after))
    assert line in str(error.value)


def test_a_note_of_several_files_is_one_line() -> None:
    parts = [Rejections(f"a{i}", notes=["4 gaps"]) for i in range(3)] + [Rejections("b", notes=["1 gap"])]
    parts[1].add("NaN", "in line 3", 2)
    assert lines_of_all(parts) == ["a1: 2 NaN, first in line 3", "a0 and 2 more: 4 gaps", "b: 1 gap"]


def test_a_map_written_reads_back_the_same(tmp_path) -> None:
    map_ = as_map(TABLE_MAP)
    (tmp_path / "m.yaml").write_text(map_text(map_))
    assert load_map(tmp_path / "m.yaml") == map_


def test_a_recording_is_called_by_its_folder_though_that_is_a_link_or_the_working_one(
    folder, tmp_path, monkeypatch
) -> None:
    (tmp_path / "linked").symlink_to(folder)
    assert read(tmp_path / "linked", TABLE_MAP).name == "linked"
    monkeypatch.chdir(folder)
    assert read(Path(), TABLE_MAP).name == folder.name
