"""Files as people have them: heads with a sign, several files, rows in any order, anchors by name, odd bags."""

import contextlib
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_motion import ANCHORS, TABLE_MAP, made_up, write_tables
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ortilo_drake.interop.recorded.anchors import anchors_of, read_anchors
from ortilo_drake.interop.recorded.csv_columns import read_csv
from ortilo_drake.interop.recorded.lec_console import read_lec
from ortilo_drake.interop.recorded.map_edit import map_text
from ortilo_drake.interop.recorded.map_file import load_map
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Source
from ortilo_drake.model.typed_yaml import InputError

ADDRESSES = ["0E15", "1516", "41B1", "089F", "0715", "2E03"]
RANGES = TABLE_MAP.splitlines()[1]
IMU = TABLE_MAP.splitlines()[3]
ANCHORED = TABLE_MAP.splitlines()[2]


@pytest.fixture(scope="module")
def motion():
    return made_up(duration=3.0)


@pytest.fixture
def folder(tmp_path, motion):
    return write_tables(tmp_path / "motion", motion)


def read(folder, text):
    path = folder.parent / "MAP.yaml"
    path.write_text(text)
    return read_recording(folder, load_map(path))


def with_ranges(line: str, anchors: str = "") -> str:
    text = TABLE_MAP.replace(RANGES, f"ranges: {line}")
    return text.replace(f"anchors: {ANCHORS.tolist()}", f"anchors: {anchors}") if anchors else text


def check_ranges(recording, motion) -> None:
    np.testing.assert_array_equal(recording.anchors, ANCHORS)
    np.testing.assert_allclose(recording.ranges.r, motion.r.ravel(), atol=1e-6)
    np.testing.assert_array_equal(recording.ranges.anchor, np.tile(np.arange(6), len(motion.t_r)))
    np.testing.assert_allclose(recording.ranges.t, np.repeat(motion.t_r - motion.t_r[0], 6), atol=1e-6)


def rows_of(motion, names=range(6)):
    return [
        f"{t:.6f},{name},{r:.9g}"
        for t, row in zip(motion.t_r, motion.r, strict=True)
        for name, r in zip(names, row, strict=True)
    ]


@pytest.mark.parametrize(
    ("head", "mark", "told"),
    [
        ("# t r0 r1 r2 r3 r4 r5", ",", []),  # numpy's savetxt with a header of its own
        ("#t, r0, r1, r2, r3, r4, r5", " ", []),
        ("% t,r0,r1,r2,r3,r4,r5", ",", []),
        ("# ranges of 3 May\n# made by hand\n# t\tr0\tr1\tr2\tr3\tr4\tr5", "\t", []),
        ("# t r0 r1 r2 r3 r4 r5\n#0.01 1 2 3 4 5 6", " ", ["ranges.csv (ranges): 1 rows that are commented out"]),
        ("# an export\nt;r0;r1;r2;r3;r4;r5", ";", []),
    ],
)
def test_a_sign_before_the_head_is_taken_off(folder, motion, head, mark, told) -> None:
    rows = [mark.join(f"{value:.9g}" for value in row) for row in np.column_stack([motion.t_r, motion.r])]
    rows.insert(20, "# lap 2")
    (folder / "ranges.csv").write_text("\n".join([head, *rows]))
    recording = read(folder, TABLE_MAP)
    check_ranges(recording, motion)
    assert [line.split(", first")[0] for line in recording.told[:-1]] == told
    assert recording.told[-1].startswith("ranges.csv (ranges): 1 comments among the rows, first in line ")
    by_sign = TABLE_MAP.replace("time: t, values: [r0", "time: '#t', values: [r0")
    check_ranges(read(folder, by_sign), motion)


def excel_text(head: str, rows: list[str]) -> bytes:
    """Return a table as Excel saves its Unicode text: UTF-16, tabs, Windows' line ends, decimal commas."""
    return "\r\n".join(line.replace(",", "\t").replace(".", ",") for line in [head, *rows]).encode("utf-16")


@pytest.mark.parametrize(
    "written",
    [
        lambda head, rows: "\n".join([head, *rows]).replace(",", ";").replace(".", ",").encode(),
        lambda head, rows: "\n".join([head, *rows]).replace(",", " ").replace(".", ",").encode(),
        lambda head, rows: ("sep=;\n" + "\n".join([head, *rows]).replace(",", ";")).encode(),
        lambda head, rows: "\n".join(
            [head, *(f'"{row}"'.replace(",", '","').replace(".", ",") for row in rows)]
        ).encode(),
        lambda head, rows: "\n".join(["Log of 3 May", "rate,10,Hz", "NO_OF_TAGS\t6", "", head, *rows]).encode(),
        excel_text,
        lambda head, rows: "\n".join(["Objects", "100", ",,drone", head, *rows]).encode(),
        lambda head, rows: "\n".join([head, *rows]).replace(",", " | ").encode(),
    ],
    ids=["semicolons", "spaces", "sep=", "quotes", "lines above", "Excel", "Vicon's rate", "bars"],
)
def test_tables_as_spreadsheets_write_them(folder, motion, written) -> None:
    head, *rows = (folder / "ranges.csv").read_text().splitlines()
    (folder / "ranges.csv").write_bytes(written(head, rows))
    recording = read(folder, TABLE_MAP)
    check_ranges(recording, motion)
    assert recording.rejected == {}


def test_a_column_called_by_a_sign_is_a_column(folder, motion) -> None:
    table = np.column_stack([np.arange(len(motion.t_r)), motion.t_r, motion.r])
    np.savetxt(folder / "ranges.csv", table, "%.9g", header="# t r0 r1 r2 r3 r4 r5", comments="")
    check_ranges(read(folder, TABLE_MAP), motion)


def test_columns_by_number_lose_no_row_to_a_head(folder, motion) -> None:
    rows = [f"{t:.9g},DIST," + ",".join(f"{r:.9g}" for r in row) for t, row in zip(motion.t_r, motion.r, strict=True)]
    (folder / "ranges.csv").write_text("\n".join(rows))
    check_ranges(read(folder, with_ranges("{file: ranges.csv, time: 1, values: [3, 4, 5, 6, 7, 8]}")), motion)


@pytest.mark.parametrize(("word", "rows"), [("yes", 0), ("true", 0), ("'no'", 1), ("no", 1), ("false", 1)])
def test_header_takes_yaml_s_words(folder, motion, word, rows) -> None:
    text = with_ranges(f"{{file: ranges.csv, time: 1, header: {word}, values: [2, 3, 4, 5, 6, 7]}}")
    recording = read(folder, text)
    check_ranges(recording, motion)
    assert sum(recording.rejected.values()) == rows  # the head, taken for a row
    assert read(folder, map_text(load_map(folder.parent / "MAP.yaml"))).rejected == recording.rejected


def test_a_column_that_stands_twice_is_refused(folder) -> None:
    (folder / "ranges.csv").write_text("t,r0,r1,r2,r3,r4,r5,r1\n" + "1,2,3,4,5,6,7,8\n" * 9)
    with pytest.raises(InputError, match="column 'r1' stands 2 times"):
        read(folder, TABLE_MAP)


FILES = {
    "list": "{file: [a9.csv, a10.csv, a11.csv, a12.csv, a13.csv, a14.csv], time: t, values: [r]}",
    "pattern": "{file: 'a*.csv', time: t, values: [r]}",
    "named rows": "{file: 'a*.csv', time: t, anchor: id, names: [0, 1, 2, 3, 4, 5], values: [r]}",
    "named files": "{file: ["
    + ", ".join(f"{{file: a{9 + i}.csv, anchor: {ADDRESSES[i]}}}" for i in (3, 0, 5, 4, 2, 1))
    + f"], names: [{', '.join(ADDRESSES)}], time: t, values: [r]}}",
}


@pytest.mark.parametrize("line", FILES.values(), ids=FILES)
def test_a_file_for_each_anchor(folder, motion, line) -> None:
    rows = rows_of(motion)
    for i in range(6):
        (folder / f"a{9 + i}.csv").write_text("\n".join(["t,id,r", *rows[i::6]]))
    recording = read(folder, with_ranges(line))
    check_ranges(recording, motion)
    assert recording.rejected == {}
    (folder / "a11.csv").unlink()
    if line == FILES["pattern"]:
        with pytest.raises(InputError, match=r"ranges.file: 5 files of one range a row, but 6 anchors"):
            read(folder, line := with_ranges(line))


def test_a_stream_in_several_files_is_merged(folder, motion) -> None:
    head, *rows = (folder / "imu.csv").read_text().splitlines()
    for name, part in (("imu_1.csv", rows[:70]), ("imu_2.csv", rows[60:])):  # ten rows in both
        (folder / name).write_text("\n".join([head, *part]))
    recording = read(folder, TABLE_MAP.replace("{file: imu.csv", "{file: [imu_2.csv, imu_1.csv]"))
    np.testing.assert_allclose(recording.imu.t, motion.t_imu - motion.t_r[0], atol=1e-6)
    np.testing.assert_allclose(recording.imu.force, motion.imu[:, 3:], atol=1e-6)
    assert recording.rejected == {"2 files (imu): stamps that two files have": 10}
    with pytest.raises(InputError, match="not a pattern of files"):
        read(folder, TABLE_MAP.replace("{file: imu.csv", "{file: /imu_*.csv"))
    with pytest.raises(InputError, match=r"imu_x\*\.csv: no file fits this pattern"):
        read(folder, TABLE_MAP.replace("{file: imu.csv", "{file: imu_x*.csv"))


@pytest.mark.parametrize("order", ["one anchor after the other", "reversed", "shuffled"])
def test_rows_that_name_their_anchor_may_come_in_any_order(folder, motion, order) -> None:
    rows = rows_of(motion)
    random = np.random.default_rng(3).permutation(rows).tolist()
    rows = {"reversed": rows[::-1], "shuffled": random}.get(order, [row for i in range(6) for row in rows[i::6]])
    (folder / "ranges.csv").write_text("\n".join(["t,id,r", *rows]))
    line = "{file: ranges.csv, time: t, anchor: id, names: [0, 1, 2, 3, 4, 5], values: [r]}"
    recording = read(folder, with_ranges(line))
    check_ranges(recording, motion)
    assert recording.rejected == {}
    stamps = np.array([float(row.split(",")[0]) for row in rows])
    late = stamps < np.maximum.accumulate(stamps)
    first = f"first in line {np.argmax(late) + 2}; sorted by their stamps"
    assert recording.told == [f"ranges.csv (ranges): {late.sum()} rows out of order, {first}"]


def test_a_stamp_before_the_clock_was_set_is_left_out(folder, motion) -> None:
    rows = [f"0.000,3,{motion.r[0, 3]}", *rows_of(motion._replace(t_r=motion.t_r + 1.6e9))]
    rows[300] = f"9{rows[300]}"
    (folder / "ranges.csv").write_text("\n".join(["t,id,r", *rows]))
    line = "{file: ranges.csv, time: t, anchor: id, names: [0, 1, 2, 3, 4, 5], values: [r]}"
    recording = read(folder, with_ranges(line).replace("imu:", "#"))
    assert recording.rejected == {"ranges.csv (ranges): rows with a stamp more than an hour from the others": 2}
    assert "first in line 2" in recording.told[0]
    assert len(recording.ranges.t) == len(rows) - 2


def test_a_table_that_is_no_utf8_is_read_and_told(folder, motion) -> None:
    head, *rows = (folder / "ranges.csv").read_text().splitlines()
    lines = [f"temp [°C],{head}", *(f"20,{row}" for row in rows)]
    (folder / "ranges.csv").write_bytes("\n".join(lines).encode("latin-1"))
    recording = read(folder, TABLE_MAP)
    check_ranges(recording, motion)
    assert "ranges.csv (ranges): not UTF-8, first in line 1; read as Latin-1" in recording.told


@pytest.mark.parametrize(
    ("names", "written"),
    [
        ('["0E15", "1516", "41B1", "089F", "0715", "2E03"]', str),
        ("[0E15, 1516, 41B1, 089F, 0715, 2E03]", str),  # 0715 is octal to YAML, 2E03 a float to many
        ("[0x0E15, 0x1516, 0x41B1, 0x089F, 0x0715, 0x2E03]", str.lower),
        ("[0e15, 1516, 41b1, 89f, 715, 2e03]", lambda name: f"0x{name}"),
        ("[3605, 5398, 16817, 2207, 1813, 11779]", str),
        ("[0E15, 1516, 41B1, 089F, 0715, 2E03]", lambda name: f"0x{name}"),
        ("[0x0E15, 0x1516, 0x41B1, 0x089F, 0x0715, 0x2E03]", lambda name: str(int(name, 16))),
        ("[0x0E15, 0x1516, 0x41B1, 0x089F, 0x0715, 0x2E03]", lambda name: f"{int(name, 16)}.0"),  # pandas
        ("['0E:15', '15:16', '41:B1', '08:9F', '07:15', '2E:03']", lambda name: f"{name[:2]}-{name[2:]}".lower()),
    ],
)
def test_anchors_are_named_by_text(folder, motion, names, written) -> None:
    (folder / "ranges.csv").write_text("\n".join(["t,id,r", *rows_of(motion, [written(name) for name in ADDRESSES])]))
    recording = read(folder, with_ranges(f"{{file: ranges.csv, time: t, anchor: id, names: {names}, values: [r]}}"))
    check_ranges(recording, motion)


@pytest.mark.long
@given(st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=12, unique=True), st.data())
def test_an_address_is_the_same_in_any_spelling(addresses, data) -> None:
    spellings = ["{:x}", "{:X}", "0x{:04x}", "{:04X}", "0X{:08X}"]
    names = [data.draw(st.sampled_from(spellings)).format(address) for address in addresses]
    rows = [data.draw(st.sampled_from(spellings)).format(address) for address in addresses]
    np.testing.assert_array_equal(anchors_of(rows, names), np.arange(len(addresses)))


def test_rows_to_anchors_that_are_unknown_are_named(folder, motion) -> None:
    rows = rows_of(motion, ADDRESSES)
    rows[7] = rows[7].replace("1516", "DECA0001")
    (folder / "ranges.csv").write_text("\n".join(["t,id,r", *rows]))
    names = ", ".join(ADDRESSES)
    line = f"{{file: ranges.csv, time: t, anchor: id, names: [{names}], values: [r]}}"
    place = "1 ranges to anchors that the map does not name, first in line 9 ('DECA0001')"
    assert f"ranges.csv (ranges): {place}" in read(folder, with_ranges(line)).told
    with pytest.raises(InputError, match=r"no row names an anchor of the map: 0715, 089F, .*, not A, B, C, D, E, F"):
        read(folder, with_ranges(line.replace(names, "A, B, C, D, E, F")))
    with pytest.raises(InputError, match="names: '0x0715' stands twice"):
        read(folder, with_ranges(line.replace("2E03", "0x0715")))


def cfclient(names=range(6)) -> str:
    lines = (f"  {n}: {{x: {p[0]}, y: {p[1]}, z: {p[2]}}}" for n, p in zip(names, ANCHORS.tolist(), strict=True))
    return "\n" + "\n".join(lines)


TABLE = "\n".join(f"{name},{x},{y},{z}" for name, (x, y, z) in zip(ADDRESSES, ANCHORS, strict=True))
ANCHOR_FILES = {
    "a.yaml": cfclient(ADDRESSES).replace("\n  ", "\n"),
    "b.yml": "anchors:" + cfclient(ADDRESSES),
    "c.csv": TABLE,
    "d.csv": "id,x,y,z\n" + TABLE,
    "e.txt": "# surveyed in May\nx [m];y [m];z [m];name\n"
    + "\n".join(f"{x};{y};{z};{name}" for name, (x, y, z) in zip(ADDRESSES, ANCHORS, strict=True)),
    "f.log": "dwm> lec\n"
    + "\n".join(
        "DIST,6," + ",".join(f"AN{i},{ADDRESSES[i]},{x},{y},{z},{1 + i}" for i, (x, y, z) in enumerate(ANCHORS))
        for _ in range(3)
    ),
}


@pytest.mark.parametrize("name", ANCHOR_FILES)
@pytest.mark.parametrize("beside", ["map", "motion"])
def test_anchors_come_from_a_file(folder, motion, name, beside) -> None:
    (folder.parent / name if beside == "map" else folder / name).write_text(ANCHOR_FILES[name])
    (folder / "ranges.csv").write_text("\n".join(["t,id,r", *rows_of(motion, ADDRESSES)]))
    check_ranges(read(folder, with_ranges("{file: ranges.csv, time: t, anchor: id, values: [r]}", name)), motion)


def test_anchors_of_cfclient_are_in_the_order_of_the_columns(folder, motion) -> None:
    check_ranges(read(folder, with_ranges(RANGES.removeprefix("ranges: "), cfclient())), motion)


def test_anchors_by_name_are_chosen_by_the_ranges_names(folder, motion) -> None:
    rows = rows_of(motion, ADDRESSES)
    (folder / "ranges.csv").write_text("\n".join(["t,id,r", *rows]))
    shuffled = cfclient(ADDRESSES) + "\n  FFFF: [9, 9, 9]"
    line = f"{{file: ranges.csv, time: t, anchor: id, names: [{', '.join(ADDRESSES)}], values: [r]}}"
    check_ranges(read(folder, with_ranges(line, shuffled)), motion)
    with pytest.raises(InputError, match=r"ranges.names: '0E15' is none of the anchors, which are 0, 1, 2"):
        read(folder, with_ranges(line, cfclient()))


@pytest.mark.parametrize(
    ("anchors", "line"),
    [
        ("{0: {x: 1, y: 2}, 1: [1, 2, 3], 2: [1, 2, 4]}", "anchors.0: {'x': 1, 'y': 2}: must be [x, y, z] or {x: "),
        ("[[0, 0, 0], [1, 0, zero], [0, 1, 0]]", "anchors.1: [1, 0, 'zero']: must be [x, y, z] or"),
        ("{0: [0, 0, 1], 1: [1, 2, 3]}", "anchors: 2 of them, must be 3 to 256"),
        ("{find: 2}", "anchors.find: 2: must be a whole number from 3"),
        ("none.yaml", "none.yaml: cannot be read: No such file"),
    ],
)
def test_wrong_anchors_give_one_clear_line(folder, anchors, line) -> None:
    with pytest.raises(InputError) as error:
        read(folder, with_ranges(RANGES.removeprefix("ranges: "), anchors))
    assert line in str(error.value)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("id,x,y,z\nA,1,2,3\nB,1,x,3\nC,3,4,5\n", "line 3: B, 1, x, 3: must be id, x, y, z in m"),
        ("A,1,2,3\nB,1,2,3\n", "2 anchors, must be 3 to 256"),
        ("A,1,2,3\n0xa,1,2,3\nC,3,4,5\n", "line 2: anchor '0xa' stands twice"),
    ],
)
def test_a_wrong_file_of_anchors_names_the_line(tmp_path, text, line) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError) as error:
        read_anchors(tmp_path / "a.csv")
    assert line in str(error.value)


def test_anchors_in_json_are_read_as_json_or_refused_in_a_line(tmp_path) -> None:
    """Tabs and 1e-3 are none of YAML's; names stay text."""
    path = tmp_path / "a.json"
    path.write_text('{"anchors": {\n\t"0E15": [1e-3, 0, 0],\n\t"7": {"x": 0, "y": 8, "z": 2},\n\t"A": [9, 8, 2]}}')
    assert read_anchors(path) == {"0E15": (0.001, 0.0, 0.0), "7": (0.0, 8.0, 2.0), "A": (9.0, 8.0, 2.0)}
    for text, said in (
        ("{", "not valid JSON"),
        ('{"a": 1, "a": 2}', "a, a: a name stands twice"),
        ("[1]", "anchors.0"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=rf"a\.json: .*{said}"):
            read_anchors(path)


@pytest.mark.parametrize("kind", ["lec", "les"])
@pytest.mark.parametrize("stamp", ["{:.3f},", "{:.3f} ", "[{:.3f}] ", "2024-05-03T10:00:{:06.3f}+00:00 "])
def test_a_dwm1001_console_is_read(folder, motion, kind, stamp) -> None:
    log = ["dwm> lec"]
    for t, row in zip(motion.t_r, motion.r, strict=True):
        heard = [(ADDRESSES[i], *ANCHORS[i], r) for i, r in reversed(list(enumerate(row)))]
        lec = ",".join(f"AN{i},{n},{x:.2f},{y:.2f},{z:.2f},{r:.7f}" for i, (n, x, y, z, r) in enumerate(heard))
        les = " ".join(f"{n}[{x:.2f},{y:.2f},{z:.2f}]={r:.7f}" for n, x, y, z, r in heard)
        line = f"DIST,6,{lec},POS,1.0,2.0,0.9,87" if kind == "lec" else f"{les} est[1.0,2.0,0.9,87]"
        log += [stamp.format(t) + line, stamp.format(t) + "POS,1.0,2.0,0.9,87"]
    cut = stamp.format(99) + ("DIST,6,AN0,0E15,0.0,0.0,0.2,3" if kind == "lec" else "0E15[0.0,0.0,0.")
    (folder / "lec.txt").write_text("\n".join([*log, cut]))
    text = with_ranges("{file: lec.txt, format: lec}", "lec.txt").replace("imu:", "#")
    recording = read(folder, text + "\n")
    assert sorted(map(tuple, recording.anchors)) == sorted(map(tuple, ANCHORS))
    order = [int(np.flatnonzero((anchor == ANCHORS).all(axis=1))[0]) for anchor in recording.anchors]
    found = np.empty_like(motion.r)
    found[:, order] = recording.ranges.r.reshape(-1, 6)
    np.testing.assert_allclose(found, motion.r, atol=1e-6)
    np.testing.assert_allclose(np.diff(recording.ranges.t[::6]), 0.05, atol=2e-6)
    counts = {key.split(": ")[1]: n for key, n in recording.rejected.items()}
    assert counts["lines of POS without ranges"] == len(motion.t_r)
    assert counts["lines that are none of lec or les"] == 1 + (kind == "les")
    assert counts.get("lines of DIST that do not hold the ranges they announce", 0) == (kind == "lec")


def test_a_console_without_stamps_is_refused(folder) -> None:
    (folder / "lec.txt").write_text(ANCHOR_FILES["f.log"])
    with pytest.raises(InputError, match="18 ranges without a stamp before their line, first in line 2"):
        read(folder, with_ranges("{file: lec.txt, format: lec}", "lec.txt"))


@pytest.mark.parametrize("bad", ["0,0,0,0", "nan,0,0,0", "3,4,0,1e200"])
def test_a_row_without_a_quaternion_is_counted(folder, motion, bad) -> None:
    rows = (folder / "truth.csv").read_text().splitlines()
    rows[9] = rows[9].rsplit(",", 4)[0] + "," + bad
    (folder / "truth.csv").write_text("\n".join(rows))
    recording = read(folder, TABLE_MAP)
    assert len(recording.truth.t) == len(recording.truth.R) == len(motion.t_truth) - 1
    np.testing.assert_allclose(recording.truth.R, np.delete(motion.R, 8, axis=0), atol=1e-6)
    assert len(recording.told) == 1
    assert recording.told[0].endswith(", first in line 10")
    for k in range(1, len(rows) * 2 // 3):
        rows[k] = rows[k].rsplit(",", 4)[0] + "," + bad
    (folder / "truth.csv").write_text("\n".join(rows))
    if "nan" not in bad:
        with pytest.raises(InputError, match="no unit quaternions: norms"):
            read(folder, TABLE_MAP)


def test_a_matrix_that_does_not_turn_is_counted(folder, motion) -> None:
    table = np.column_stack([motion.t_truth, motion.p, motion.R.reshape(-1, 9)])
    table[4, 4:] = 0.0
    np.savetxt(folder / "truth.csv", table, "%.9g", ",")
    text = TABLE_MAP[: TABLE_MAP.index("truth:")] + "truth: {file: truth.csv, time: 1, position: [2, 3, 4], "
    recording = read(folder, text + "rotation: {columns: [5, 6, 7, 8, 9, 10, 11, 12, 13]}}")
    np.testing.assert_allclose(recording.truth.R, np.delete(motion.R, 4, axis=0), atol=1e-6)
    assert recording.told == ["truth.csv (truth): 1 rows without a rotation matrix, first in line 5"]


def write_odd_bag(path: Path, motion) -> None:
    """Write a ROS 1 bag whose definitions have a byte that is no UTF-8, and a topic with a type that has no fields."""
    definition = "# range in m, \x01C\nuint32 anchor\nfloat64 distance\n"
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(definition, "lab/msg/Uwb"))
    md5 = store.generate_msgdef("lab/msg/Uwb")[1]
    with Writer(path) as writer:
        odd = writer.add_connection("/odd", "lab/msg/Odd", msgdef="what is \x01 this?\n", md5sum="0" * 32)
        uwb = writer.add_connection("/uwb", "lab/msg/Uwb", msgdef=definition, md5sum=md5)
        writer.write(odd, 0, b"1234")
        for t, row in zip(motion.t_r, motion.r, strict=True):
            for i, r in enumerate(row):
                message = store.types["lab/msg/Uwb"](anchor=100 + i, distance=float(r))
                writer.write(uwb, round(t * 1e9), store.serialize_ros1(message, "lab/msg/Uwb"))
    path.write_bytes(path.read_bytes().replace(b"\x01C\n", b"\xb0C\n").replace(b"\x01 this", b"\xe9 this"))


BAG = "topic: /uwb, anchor: anchor, names: [100, 101, 102, 103, 104, 105], values: [distance]}"


def test_a_bag_with_definitions_that_are_no_utf8_is_read(folder, motion) -> None:
    write_odd_bag(folder / "log.bag", motion)
    check_ranges(read(folder, with_ranges("{file: log.bag, " + BAG)), motion)
    with pytest.raises(InputError, match=r"no topic '/uwbs', did you mean '/uwb'\?; has /odd, /uwb"):
        read(folder, with_ranges("{file: log.bag, " + BAG.replace("/uwb,", "/uwbs,")))
    with pytest.raises(InputError, match=r"log\.bag: cannot be read as a bag"):
        read(folder, with_ranges("{file: log.bag, " + BAG.replace("/uwb,", "/odd,")))


def write_mcap(path: Path, motion, encoding: str) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("uint32 anchor\nfloat64 distance\n", "lab/msg/Uwb"))
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        kind = {"json": "jsonschema", "ros1": "ros1msg"}.get(encoding, encoding)
        text = b"uint32 anchor\nfloat64 distance\n" if encoding == "ros1" else b"{}"
        schema = writer.register_schema("lab/Uwb", kind, text)
        channel = writer.register_channel("/uwb", encoding, schema)
        for t, row in zip(motion.t_r, motion.r, strict=True):
            for i, r in enumerate(row):
                message = store.types["lab/msg/Uwb"](anchor=100 + i, distance=float(r))
                data = json.dumps({"anchor": 100 + i, "distance": float(r)}).encode()
                data = bytes(store.serialize_ros1(message, "lab/msg/Uwb")) if encoding == "ros1" else data
                writer.add_message(channel, round(t * 1e9), data, round(t * 1e9))
        writer.finish()


@pytest.mark.parametrize("encoding", ["json", "ros1"])
def test_an_mcap_is_read_by_its_encoding(folder, motion, encoding) -> None:
    write_mcap(folder / "log.mcap", motion, encoding)
    check_ranges(read(folder, with_ranges("{file: log.mcap, " + BAG)), motion)
    with pytest.raises(InputError, match="lab/Uwb has no field 'range'; has anchor, distance"):
        read(folder, with_ranges("{file: log.mcap, " + BAG.replace("[distance]", "[range]")))
    (folder / "log.mcap").write_bytes((folder / "log.mcap").read_bytes()[:2000])
    with pytest.raises(InputError, match="cannot be read as a bag"):
        read(folder, with_ranges("{file: log.mcap, " + BAG))


@pytest.mark.parametrize("nested", [True, False])
def test_a_message_with_a_list_of_anchors_and_one_of_ranges_is_a_row_for_each(folder, motion, nested) -> None:
    """Every message has the ranges to other anchors, in another order; some have none."""
    rng = np.random.default_rng(0)
    heard = [rng.permutation(6)[: k % 7] for k in range(len(motion.t_r))]
    with (folder / "log.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/uwb", "json", writer.register_schema("lab/All", "jsonschema", b"{}"))
        for t, row, its in zip(motion.t_r, motion.r, heard, strict=True):
            both = {"id": [100 + int(i) for i in its], "range": [float(row[i]) for i in its]}
            each = [dict(zip(both, pair, strict=True)) for pair in zip(*both.values(), strict=True)]
            data = json.dumps({"heard": each} if nested else both).encode()
            writer.add_message(channel, round(t * 1e9), data, round(t * 1e9))
        writer.finish()
    of = "heard." if nested else ""
    names = "names: [100, 101, 102, 103, 104, 105]"
    ranges = read(
        folder, with_ranges(f"{{file: log.mcap, topic: /uwb, anchor: {of}id, values: [{of}range], {names}}}")
    ).ranges
    k = np.repeat(np.arange(len(heard)), [len(its) for its in heard])
    order = np.lexsort((np.concatenate(heard), k))
    found = np.lexsort((ranges.anchor, ranges.t))
    np.testing.assert_array_equal(ranges.anchor[found], np.concatenate(heard)[order])
    np.testing.assert_allclose(ranges.r[found], motion.r[k, np.concatenate(heard)][order])


def test_an_mcap_of_another_encoding_is_refused_by_its_name(folder, motion) -> None:
    write_mcap(folder / "log.mcap", motion, "protobuf")
    said = r"topic '/uwb' has protobuf messages \(protobuf\); cdr \(ROS 2\), ros1 and json are read"
    with pytest.raises(InputError, match=said):
        read(folder, with_ranges("{file: log.mcap, " + BAG))


def test_the_maps_of_the_how_to_are_maps(tmp_path) -> None:
    text = (Path(__file__).parents[2] / "docs/how_to/recorded.md").read_text(encoding="utf-8")
    maps = text.split("### Files as they come")[1].split("```")[1].removeprefix("yaml").split("---\n")
    (tmp_path / "lec.txt").write_text(ANCHOR_FILES["f.log"])
    for i, text in enumerate(maps):
        (tmp_path / f"{i}.yaml").write_text(text)
        load_map(tmp_path / f"{i}.yaml")
    assert len(maps) == 4
    assert list(load_map(tmp_path / "2.yaml").anchors) == ["0E15", "1516", "2E03", "DECA0001"]
    assert list(load_map(tmp_path / "3.yaml").anchors) == ADDRESSES


LINES = st.lists(st.text('#%,;\t 01.eE-nax"[]=:AN°DIST\0', max_size=12), max_size=8)


@given(LINES, st.sampled_from(["auto", "yes", "no"]), st.sampled_from([1, "a", "#n"]))
def test_no_text_is_answered_with_a_traceback(tmp_path_factory, lines, header, column) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_text("\n".join(lines))
    told = Rejections("any.csv")
    source = Source(file="any.csv", time=column, header=header)
    for reads in (lambda: read_csv(path, source, (2,), told), lambda: read_anchors(path), lambda: read_lec(path, told)):
        with contextlib.suppress(InputError):
            reads()


@pytest.mark.parametrize(
    ("start", "said"),
    [
        ("{position: [3, 4, 0.2]}", "start.heading: is missing: .*radians .*90 degrees are 1.571"),
        ("{position: [3, 4, 0.2], heading: 29}", "start.heading: 29: must be .*radians; 29 degrees are 0.506"),
    ],
)
def test_a_start_needs_its_heading_in_radians(tmp_path: Path, start: str, said: str) -> None:
    """Half a turn wrong and claimed to 0.1 rad, it costs metres before the ranges show it."""
    file = tmp_path / "MAP.yaml"
    file.write_text(f"{RANGES}\n{ANCHORED}\n{IMU}\nstart: {start}\n")
    with pytest.raises(InputError, match=f"MAP.yaml: {said}"):
        load_map(file)


def test_without_an_imu_a_start_needs_no_heading(tmp_path: Path) -> None:
    (tmp_path / "MAP.yaml").write_text(f"{RANGES}\n{ANCHORED}\nstart: {{position: [3, 4, 0.2]}}\n")
    start = load_map(tmp_path / "MAP.yaml").start
    assert start is not None
    assert start.heading is None
