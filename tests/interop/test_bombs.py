"""Small files that unpack to gigabytes, lengths that are not true, and folders whose entries are no files."""

import bz2
import math
import os
import resource
import sqlite3
import struct
import zlib
from contextlib import closing
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from logged_flights import scenario, ticks
from made_up_motion import BAG_MAP, TABLE_MAP, as_map, made_up, write_bag, write_tables
from mcap.opcode import Opcode

from ortilo_drake.interop import unpack
from ortilo_drake.interop.log import mcap_records, reader
from ortilo_drake.interop.log.writer import LogWriter
from ortilo_drake.interop.recorded import csv_columns, lenient_bag, tables
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.model.typed_yaml import InputError, parse_yaml, validate

MAGIC = b"\x89MCAP0\r\n"
ZEROS = bytes(2**20)
LIMIT = 2**20  # in place of 128 MiB
SIZE = 64 * LIMIT
GROWTH = 24 * 2**20  # of the peak memory allowed [bytes]; the bombs of 64 MiB are beyond


def zstd(size: int, stated: bool) -> bytes:
    packer = zstandard.ZstdCompressor(write_content_size=stated).compressobj(size if stated else -1)
    return b"".join([*(packer.compress(ZEROS) for _ in range(size // len(ZEROS))), packer.flush()])


BOMBS = {
    "zstd": zstd(SIZE, True),
    "zstd, no size": zstd(SIZE, False),
    "lz4": lz4.frame.compress(bytes(SIZE)),
    "bz2": bz2.compress(bytes(SIZE)),
}


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def chunk(kind: str, packed: bytes, size: int, crc: int = 0) -> bytes:
    head = struct.pack("<QQQI", 0, 1, size, crc) + text(kind)
    return record(Opcode.CHUNK, head + struct.pack("<Q", len(packed)) + packed)


def mcap(path: Path, *records: bytes) -> Path:
    head, end = record(Opcode.HEADER, text("ros2") + text("")), record(Opcode.DATA_END, bytes(4))
    path.write_bytes(MAGIC + head + b"".join(records) + end + record(Opcode.FOOTER, bytes(20)) + MAGIC)
    return path


def bag(path: Path, kind: str, packed: bytes, size: int, entries: int = 2, chunks: int = 1) -> Path:
    """Write a ROS 1 bag with one chunk, whose index holds so many entries and is pointed to so many times."""

    def header(**fields: bytes) -> bytes:
        parts = [name.encode() + b"=" + value for name, value in fields.items()]
        content = b"".join(struct.pack("<I", len(part)) + part for part in parts)
        return struct.pack("<I", len(content)) + content

    def number(value: int) -> bytes:
        return struct.pack("<I", value)

    magic = b"#ROSBAG V2.0\n"
    at = len(magic) + 4096
    body = header(op=b"\5", compression=kind.encode(), size=number(size)) + number(len(packed)) + packed
    body += header(op=b"\4", ver=number(1), conn=number(0), count=number(entries))
    body += number(12 * entries) + bytes(12 * entries)
    end = header(op=b"\7", conn=number(0), topic=b"/r0")
    end += header(topic=b"/r0", type=b"std_msgs/String", md5sum=b"", message_definition=b"string data")
    info = header(
        op=b"\6",
        ver=number(1),
        chunk_pos=struct.pack("<Q", at),
        start_time=bytes(8),
        end_time=bytes(8),
        count=number(1),
    )
    end += (info + number(8) + number(0) + number(entries)) * chunks
    first = header(
        op=b"\3", index_pos=struct.pack("<Q", at + len(body)), conn_count=number(1), chunk_count=number(chunks)
    )
    path.write_bytes(magic + first + number(4092 - len(first)) + b" " * (4092 - len(first)) + body + end)
    return path


METADATA = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: {storage}
  relative_file_paths: [{file}]
  compression_format: zstd
  compression_mode: '{mode}'
"""


def ros2_folder(folder: Path, storage: str, mode: str = "", name: str | None = None) -> Path:
    folder.mkdir()
    name = name or f"part.{'mcap' if storage == 'mcap' else 'db3'}{'.zstd' if mode == 'FILE' else ''}"
    (folder / "metadata.yaml").write_text(METADATA.format(storage=storage, file=name, mode=mode))
    return folder / name


def database(path: Path, messages: list[bytes], table: str = "") -> None:
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format)")
        db.execute("INSERT INTO topics VALUES(1, '/r0', 'std_msgs/msg/String', 'cdr')")
        db.execute(table or "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INT, timestamp INT, data BLOB)")
        for k, data in enumerate(messages):
            db.execute("INSERT INTO messages VALUES(?, 1, ?, ?)", (k, k, data))
        db.commit()


def read(path: Path, values: str = "data"):
    anchors = "anchors: [[0, 0, 0], [1, 0, 0], [0, 1, 1]]"
    line = f"ranges: {{file: {path.name}, topic: /r0, values: [{values}, x, y]}}\n{anchors}"
    return read_recording(path.parent, as_map(line))


def peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def refusal(act, path: Path) -> str:
    """Return the one line with which a file is refused, naming it, at no cost of memory."""
    before = peak()
    with pytest.raises(InputError) as error:
        act(path)
    assert peak() - before < GROWTH
    line = str(error.value)
    assert line.startswith(str(path))
    assert "\n" not in line
    return line


@pytest.fixture
def small(monkeypatch):
    for module in (unpack, mcap_records, lenient_bag):
        monkeypatch.setattr(module, "CHUNK_LIMIT", LIMIT)
    monkeypatch.setattr(unpack, "PIECE", 2**16)


@pytest.mark.parametrize("act", [read, reader.read_log])
@pytest.mark.parametrize("kind", ["zstd", "zstd, no size", "lz4", "bz2"])
@pytest.mark.parametrize("size", [0, 100, SIZE, 2**63])
def test_a_chunk_of_mcap_is_unpacked_to_the_limit_whatever_size_it_states(tmp_path, small, act, kind, size) -> None:
    path = mcap(tmp_path / "a.mcap", chunk(kind.partition(",")[0], BOMBS[kind], size))
    line = refusal(act, path)
    # zstd's own limit of a window may come first where the frame states its size
    assert "unpacks to more than 1 MiB" in line or "too much memory" in line


def test_many_chunks_of_mcap_are_unpacked_to_the_limit_of_a_file(tmp_path, small, monkeypatch) -> None:
    monkeypatch.setattr(unpack, "FILE_LIMIT", 3 * LIMIT)
    part = chunk("lz4", lz4.frame.compress(record(200, bytes(LIMIT - 9))), LIMIT, 0)
    mcap_ok = mcap(tmp_path / "a.mcap", part, part)
    assert list(mcap_records.read_records(mcap_ok)) == []
    line = refusal(read, mcap(tmp_path / "b.mcap", part, part, part, part))
    assert "unpacks to more than 3 MiB, the most that is read of a file" in line


@pytest.mark.parametrize("act", [read, reader.read_log])
@pytest.mark.parametrize(
    ("kind", "packed", "size", "said"),
    [
        ("lz4", b"no lz4", 9, "a chunk is damaged: lz4: "),
        ("lz4", lz4.frame.compress(bytes(99))[:-9], 99, "a chunk is damaged: lz4: "),
        ("zstd", b"no zstd", 9, "a chunk is damaged: zstd: "),
        ("zstd", zstandard.compress(bytes(99))[:-3], 99, "a chunk holds 0 bytes, and states 99"),
        ("brotli", b"x", 9, "compression 'brotli': zstd, lz4 and bz2 are read"),
        ("", b"x", 9, "a chunk holds 1 bytes, and states 9"),
        ("", bytes(99), 99, "damaged: a record of no kind"),
        ("", record(200, b"") + b"x", 10, "damaged: a record goes beyond its chunk"),
        ("", record(200, b"x")[:-1], 9, "damaged: a record goes beyond its chunk"),
    ],
)
def test_a_damaged_chunk_is_refused_in_one_line(tmp_path, act, kind, packed, size, said) -> None:
    assert said in refusal(act, mcap(tmp_path / "a.mcap", chunk(kind, packed, size)))


def test_lz4_without_its_library_is_refused_in_one_line(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "lz4.frame", None)
    line = refusal(reader.read_log, mcap(tmp_path / "a.mcap", chunk("lz4", b"x", 9)))
    assert "a chunk is packed with lz4, whose library is not installed" in line


@pytest.mark.parametrize("opcode", [Opcode.CHUNK, Opcode.MESSAGE, Opcode.SCHEMA])
def test_a_record_of_gigabytes_is_not_read(tmp_path, opcode) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(MAGIC + struct.pack("<BQ", opcode, 2**31))
    os.truncate(path, 2**31 + 100)  # a file with a hole: it takes no disk
    for act in (read, reader.read_log):
        assert "a record of 2048 MiB; at most 128 MiB are read" in refusal(act, path)


@pytest.mark.parametrize("kind", ["bz2", "lz4"])
@pytest.mark.parametrize("size", [100, SIZE])
def test_a_chunk_of_a_bag_is_unpacked_to_the_limit(tmp_path, small, kind, size) -> None:
    assert "a chunk unpacks to more than 1 MiB" in refusal(read, bag(tmp_path / "a.bag", kind, BOMBS[kind], size))
    line = refusal(read, bag(tmp_path / "b.bag", kind, b"damaged", size))
    assert f"a chunk is damaged: {kind}: " in line


def test_an_index_of_a_bag_that_is_read_many_times_ends(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(lenient_bag, "INDEXED", 1000)
    path = bag(tmp_path / "a.bag", "none", b"", 0, entries=100, chunks=100)
    assert "more than 1,000 messages of a topic" in refusal(read, path)


@pytest.mark.parametrize("stated", [True, False])
def test_packed_messages_and_files_of_ros2_are_unpacked_to_the_limit(tmp_path, small, monkeypatch, stated) -> None:
    bomb = BOMBS["zstd" if stated else "zstd, no size"]
    database(ros2_folder(tmp_path / "m", "sqlite3", "MESSAGE"), [bomb, bomb])
    with pytest.raises(InputError, match=r"a message (unpacks to more than 1 MiB|is damaged: .*too much memory)"):
        read(tmp_path / "m")
    monkeypatch.setattr("ortilo_drake.interop.recorded.ros2_folder.FILE_LIMIT", LIMIT)
    for storage in ("mcap", "sqlite3"):
        ros2_folder(tmp_path / storage, storage, "FILE").write_bytes(bomb)
        with pytest.raises(InputError, match=r"zstd (unpacks to more than 1 MiB|is damaged: .*too much memory)"):
            read(tmp_path / storage)


@pytest.mark.family
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("mode", ["file", "message"])
def test_packed_bags_of_ros2_are_read(tmp_path, storage, mode) -> None:
    motion = made_up(duration=1.0)
    plain = write_bag(tmp_path / "plain", motion, storage)
    packed = write_bag(tmp_path / "all", motion, storage, mode)
    assert packed != plain
    expected, found = (read_recording(tmp_path, as_map(BAG_MAP.replace("BAG", name))) for name in ("plain", "all"))
    np.testing.assert_array_equal(found.ranges.r, expected.ranges.r)
    np.testing.assert_array_equal(found.imu.force, expected.imu.force)
    assert len(found.ranges.r) == motion.r.size


ENTRIES = {
    "a pipe": (os.mkfifo, "is no regular file"),
    "a device": (lambda path: path.symlink_to("/dev/zero"), "is no regular file"),
    "a folder": (lambda path: path.mkdir(), "Is a directory"),
    "nothing": (lambda path: None, "No such file or directory"),
}


@pytest.mark.parametrize(("make", "said"), ENTRIES.values(), ids=ENTRIES)
@pytest.mark.parametrize(("storage", "mode"), [("mcap", ""), ("sqlite3", ""), ("mcap", "FILE"), ("sqlite3", "MESSAGE")])
def test_an_entry_of_a_bag_s_folder_is_checked_as_a_file(tmp_path, make, said, storage, mode) -> None:
    make(entry := ros2_folder(tmp_path / "bag", storage, mode))
    with pytest.raises(InputError) as error:
        read(tmp_path / "bag")
    assert str(error.value) == f"{entry}: cannot be read: {said}"


@pytest.mark.parametrize(("make", "said"), list(ENTRIES.values())[:3], ids=list(ENTRIES)[:3])
def test_metadata_of_a_bag_is_checked_as_a_file(tmp_path, make, said) -> None:
    ros2_folder(tmp_path / "bag", "mcap")
    (entry := tmp_path / "bag" / "metadata.yaml").unlink()
    make(entry)
    with pytest.raises(InputError) as error:
        read(tmp_path / "bag")
    assert str(error.value) == f"{entry}: cannot be read: {said}"


@pytest.mark.parametrize(("make", "said"), list(ENTRIES.values())[:2], ids=list(ENTRIES)[:2])
def test_entries_of_other_folders_are_checked_as_files(tmp_path, make, said) -> None:
    (tmp_path / "log").mkdir()
    make(tmp_path / "log" / "flight.mcap")
    assert said in refusal(reader.read_log, tmp_path / "log")
    folder = write_tables(tmp_path / "motion", made_up(duration=1.0))
    (folder / "imu.csv").unlink()
    make(folder / "imu.csv")
    for name in ("imu.csv", "im*.csv"):
        with pytest.raises(InputError, match=r"is no regular file|no file fits this pattern"):
            read_recording(folder, as_map(TABLE_MAP.replace("imu.csv", f"'{name}'")))


def test_a_file_of_another_folder_is_not_read_as_part_of_a_bag(tmp_path) -> None:
    database(tmp_path / "a.db3", [b"x", b"x"])
    ros2_folder(tmp_path / "bag", "sqlite3", name="../a.db3")
    with pytest.raises(InputError, match=r"bag/a\.db3: cannot be read: No such file"):
        read(tmp_path / "bag")


ENDLESS = (
    "CREATE VIEW messages AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) "
    "SELECT x AS id, 1 AS topic_id, x AS timestamp, zeroblob(9) AS data FROM c",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INT, timestamp INT, "
    "data BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL)",
)


@pytest.mark.parametrize("table", ENDLESS)
def test_a_database_that_computes_its_messages_is_refused(tmp_path, table) -> None:
    database(ros2_folder(tmp_path / "bag", "sqlite3"), [], table)
    with pytest.raises(InputError, match=r"part\.db3: no ROS 2 bag: messages(\.data)? is computed"):
        read(tmp_path / "bag")


@pytest.mark.parametrize("mode", ["both", "folder", "x", "zip"])
def test_metadata_that_say_nothing_known_are_refused(tmp_path, mode) -> None:
    ros2_folder(tmp_path / "bag", "mcap", mode)
    with pytest.raises(InputError, match=rf"metadata\.yaml: compression: 'zstd' of '{mode}': must be zstd of file"):
        read(tmp_path / "bag")


NO_BAG = "is no rosbag2_bagfile_information with files and storage_identifier"
LAUGHS = "a0: &a0 [x]\n" + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12))


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        ("", NO_BAG),
        ("rosbag2_bagfile_information: {version: 5}", NO_BAG),
        ("rosbag2_bagfile_information: {relative_file_paths: [[]], storage_identifier: mcap}", NO_BAG),
        ("rosbag2_bagfile_information: {relative_file_paths: [a], storage_identifier: [1]}", NO_BAG),
        ("[", "not valid YAML"),
        ("[" * 1500, "nested more than"),
        (LAUGHS + "rosbag2_bagfile_information: {relative_file_paths: [*a11]}", "aliases are not allowed"),
    ],
)
def test_metadata_of_another_kind_are_refused(tmp_path, broken, said) -> None:
    ros2_folder(tmp_path / "bag", "mcap")
    (tmp_path / "bag" / "metadata.yaml").write_text(broken)
    with pytest.raises(InputError, match=said):
        read(tmp_path / "bag")


DEFINITIONS = {
    "an array of nothing": ("x/E[] data\n" + "=" * 80 + "\nMSG: x/E\n", "has no fields"),
    "four billion texts": ("string[4000000000] data", "4000000000 items, at most 1000"),
    "itself": ("x/T data", "0 of 2 messages can be read"),
}


@pytest.mark.parametrize(("definition", "said"), DEFINITIONS.values(), ids=DEFINITIONS)
def test_a_message_type_that_never_ends_is_refused(tmp_path, definition, said) -> None:
    schema = record(Opcode.SCHEMA, struct.pack("<H", 1) + text("x/T") + text("ros1msg") + text(definition))
    channel = record(Opcode.CHANNEL, struct.pack("<HH", 1, 1) + text("/r0") + text("ros1") + bytes(4))
    message = record(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 1, 1) + b"\xff" * 8)
    assert said in refusal(read, mcap(tmp_path / "a.mcap", schema, channel, message, message))


def log(path: Path, ks: list[int]) -> Path:
    """Write a log whose ticks have these numbers, in this order."""
    with LogWriter(path, scenario()) as writer:
        for k, tick in zip(range(len(ks)), ticks(), strict=False):
            writer.write_tick(k, *tick[1:])
    h = scenario().h * 1e9
    raw, at, parts = next(path.glob("*.mcap")).read_bytes(), len(MAGIC), [MAGIC]
    times = {round(k * h): round(wanted * h) for k, wanted in enumerate(ks)}
    while at < len(raw) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", raw, at)
        content = raw[at + 9 : at + 9 + length]
        if opcode == Opcode.CHUNK:
            kind = 32 + struct.unpack_from("<I", content, 28)[0]
            plain = zstandard.decompress(content[kind + 8 :])
            changed, place = [], 0
            while place < len(plain):
                code, size = struct.unpack_from("<BQ", plain, place)
                inner = plain[place + 9 : place + 9 + size]
                if code == Opcode.MESSAGE:
                    old = struct.unpack_from("<Q", inner, 6)[0]
                    inner = inner[:6] + struct.pack("<Q", times.get(old, old)) + inner[14:]
                changed.append(record(code, inner))
                place += 9 + size
            parts.append(chunk("", data := b"".join(changed), len(data), zlib.crc32(data)))
        else:
            parts.append(record(opcode, content))
        at += 9 + length
    (path.parent / "changed.mcap").write_bytes(b"".join(parts) + MAGIC)
    return path.parent / "changed.mcap"


@pytest.mark.parametrize(
    ("ks", "said"),
    [
        ([0, 1, 3, 2], "tick 2 after tick 3: log times must rise"),
        ([0, 1, 2, 10**8], "tick 100000000, of which 99999997 are missing: at most 2048 MiB"),
        ([0, 10**6], "of which 999999 are missing"),
    ],
)
def test_log_times_that_fall_or_leap_are_refused(tmp_path, ks, said) -> None:
    assert said in refusal(reader.read_log, log(tmp_path / "log", ks))


def test_log_times_that_leave_out_some_ticks_are_read(tmp_path) -> None:
    flight = reader.read_log(log(tmp_path / "log", [0, 1, 2, 40]))
    assert flight.sizes["tick"] == 41
    assert np.flatnonzero(np.isfinite(flight["estimate"].values[:, 0])).tolist() == [0, 1, 2, 40]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("huge", ["1e308", "-1e308", "1e200"])
@pytest.mark.parametrize("column", ["ranges.csv", "imu.csv", "truth.csv"])
def test_numbers_whose_square_overflows_are_left_out_and_counted(tmp_path, column, huge) -> None:
    motion = made_up(duration=2.0)
    folder = write_tables(tmp_path / "motion", motion)
    rows = (folder / column).read_text().splitlines()
    cells = rows[9].split(",")
    rows[9] = ",".join([cells[0], huge, *cells[2:]])
    (folder / column).write_text("\n".join(rows))
    found = read_recording(folder, as_map(TABLE_MAP))
    assert list(found.rejected.values()) == [1]
    assert len(found.ranges.r) + len(found.imu.t) + len(found.truth.t) == (
        motion.r.size + len(motion.t_imu) + len(motion.t_truth) - 1
    )


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("stamp", ["1e308", "-1e308", "1e15", "1e300"])
def test_a_stamp_of_another_age_is_left_out_and_counted(tmp_path, stamp) -> None:
    motion = made_up(duration=2.0)
    folder = write_tables(tmp_path / "motion", motion)
    rows = (folder / "imu.csv").read_text().splitlines()
    rows[9] = f"{stamp},{rows[9].partition(',')[2]}"
    (folder / "imu.csv").write_text("\n".join(rows))
    found = read_recording(folder, as_map(TABLE_MAP))
    assert list(found.rejected.values()) == [1]
    assert len(found.imu.t) == len(motion.t_imu) - 1


@pytest.mark.long
def test_a_table_of_many_rows_is_read_in_pieces(tmp_path) -> None:
    """100,000 rows take 32 bytes of numbers each; as lists of numbers they took 200, beside the whole text."""
    t = np.arange(100_000) * 1e-3
    path = tmp_path / "imu.csv"
    np.savetxt(path, np.column_stack([t, np.sin(t)]), "%.6f", ",")
    source = parse_yaml("{file: imu.csv, time: 1, position: [2, 2, 2]}", "m")
    from ortilo_drake.interop.recorded.rejected import Rejections
    from ortilo_drake.interop.recorded.sources import TruthSource

    before = peak()
    table = csv_columns.read_csv(path, validate(TruthSource, source, "m"), (2,), Rejections("imu"))
    assert peak() - before < 12 * 2**20
    np.testing.assert_allclose(table.t, t, atol=1e-6)
    np.testing.assert_allclose(table.values[:, 0], np.sin(t), atol=1e-6)
    assert table.rows[-1] == len(t)


def test_rows_beyond_the_limits_are_refused(tmp_path, monkeypatch) -> None:
    folder = write_tables(tmp_path / "motion", made_up(duration=2.0))
    map_ = as_map(TABLE_MAP)
    monkeypatch.setattr(tables, "NUMBERS", 100)
    with pytest.raises(InputError, match=r"ranges\.csv: more than 100 numbers in its rows; cut it"):
        read_recording(folder, map_)
    monkeypatch.setattr(tables, "NUMBERS", math.inf)
    monkeypatch.setattr(csv_columns, "LINE", 60)
    with pytest.raises(InputError, match=r"csv: line \d+: more than 60 characters"):
        read_recording(folder, map_)
