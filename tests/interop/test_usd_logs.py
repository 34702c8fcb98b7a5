"""A Crazyflie's uSD log: what struct wrote is read, and one line or a count says what is wrong with a spoilt one."""

import struct
from zlib import crc32

import numpy as np
import pytest
from module_of import module_of
from usd_logs import usd_log, util_folder

from ortilo_drake.interop.recorded.columns import read_stream
from ortilo_drake.interop.recorded.sources import Source
from ortilo_drake.model.typed_yaml import InputError

KINDS = {
    0: ("estTDOA", [("idA", "B"), ("idB", "B"), ("distanceDiff", "f")]),
    7: ("estFlow", [("deltaX", "h"), ("count", "L")]),
}
EVENTS = [(0, 10_000, (1, 2, 0.5)), (7, 11_500, (-3, 70_000)), (0, 12_000, (2, 3, -0.25)), (7, 13_000, (4, 5))]


def read(path, topic="estTDOA", columns=("distanceDiff",), names=()):
    return read_stream([path], Source(file=path.name, topic=topic), columns, "ranges", topic, names)


@pytest.mark.parametrize(("version", "unit"), [(1, 1e-3), (2, 1e-6)])
def test_both_versions_are_read(tmp_path, version, unit) -> None:
    path = tmp_path / "log07"
    path.write_bytes(usd_log(KINDS, EVENTS, version))
    tdoa, flow = read(path, names=("idB",)), read(path, "estFlow", ("deltaX", 2))
    np.testing.assert_allclose(tdoa.t, np.array([10_000, 12_000]) * unit)
    np.testing.assert_array_equal(tdoa.values, [[0.5], [-0.25]])
    assert tdoa.names[:, 0].tolist() == ["2", "3"]
    np.testing.assert_array_equal(flow.values, [[-3, 70_000], [4, 5]])
    assert not tdoa.rejected.counts


def test_what_is_spoilt_is_one_line(tmp_path) -> None:
    path, log = tmp_path / "log", usd_log(KINDS, EVENTS)
    spoilt = {
        "its CRC is wrong": log[:-1] + bytes([log[-1] ^ 1]),
        "CRC is wrong": log[:-4].replace(b"\7\0" + (13_000).to_bytes(8, "little"), b"\x17\0" + b"\0" * 8) + b"1234",
        "cut short: 4 bytes": log[:4],
        "version 3": b"\xbc\3\0" + log[3:],
        "field 'idA.Z.' must be name.T.": _sealed(log[:-4].replace(b"idA(B)", b"idA(Z)")),
        "names of its events": _sealed(log[:20]),
    }
    for line, data in spoilt.items():
        path.write_bytes(data)
        with pytest.raises(InputError, match=line):
            read(path)
    path.write_bytes(log)
    with pytest.raises(InputError, match=r"no topic 'estTOF'.*has estTDOA, estFlow"):
        read(path, "estTOF")
    with pytest.raises(InputError, match=r"no field 'range'; has idA, idB, distanceDiff"):
        read(path, columns=("range",))


@pytest.mark.parametrize("pad", [b"", b"\0", b"\xff"])
def test_a_log_that_lost_its_end_with_the_power_is_read_up_to_there(tmp_path, pad) -> None:
    path, log = tmp_path / "log", usd_log(KINDS, [*EVENTS, (0, 14_000, (3, 4, 0.125))])
    last = 10 + 6  # bytes of the last event
    for cut in (1, 3, 4, 5, 4 + last - 1, 4 + last):
        path.write_bytes(log[:-cut] + 600 * pad)
        found = read(path)
        whole = cut <= 4
        np.testing.assert_array_equal(found.values, [[0.5], [-0.25], [0.125]][: 2 + whole])
        assert found.rejected.counts == {}
        (note,) = found.rejected.notes
        assert "the log's end is missing" in note


def test_a_log_that_lost_its_checksum_and_is_spoilt_too_is_refused(tmp_path) -> None:
    path = tmp_path / "log"
    path.write_bytes(usd_log(KINDS, [*EVENTS, (9, 14_000, ()), *EVENTS])[:-9])
    with pytest.raises(InputError, match="its CRC is wrong"):
        read(path)


def _sealed(data: bytes) -> bytes:
    return data + struct.pack("<I", crc32(data))


def test_an_event_that_nobody_announced_ends_what_is_read_and_is_counted(tmp_path) -> None:
    path = tmp_path / "log"
    path.write_bytes(usd_log(KINDS, [*EVENTS, (9, 14_000, ()), *EVENTS]))
    found = read(path)
    assert len(found.t) == 2
    assert "unknown number 9" in found.rejected.lines()[0]
    path.write_bytes(_sealed(usd_log(KINDS, EVENTS)[:-7]))
    assert "an event that is cut short" in read(path, "estTDOA").rejected.lines()[0]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # their loader leaves its file open
def test_a_recorded_log_is_read_as_its_publishers_loader_reads_it() -> None:
    folder = util_folder()
    events, _ = module_of(folder / "read_usd.py").decode(folder / "0425-traj20")
    for topic, columns in {"estTDOA": ("distanceDiff",), "estAcceleration": ("acc.x", "acc.y", "acc.z")}.items():
        expected, names, _ = events[topic]
        columns = tuple(names[-len(columns) :])
        found = read(folder / "0425-traj20", topic, columns)
        np.testing.assert_allclose(found.t, expected[:, 0], rtol=1e-12)
        np.testing.assert_array_equal(found.values, expected[:, -len(columns) :])
    assert found.rejected.counts == {}
