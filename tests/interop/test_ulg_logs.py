"""PX4's log: what struct wrote by the format's description is read, and one line or a count tells a spoilt one.

Source of the format: PX4 guide, "ULog File Format".
"""

import struct
import sys

import numpy as np
import pytest

from ortilo_drake.interop.recorded.columns import read_stream
from ortilo_drake.interop.recorded.sources import Source
from ortilo_drake.model.typed_yaml import InputError

pytest.importorskip("pyulog", reason="pyulog is not installed: no ULog can be read")
GYRO = [(10_000, 0.1, 0.2, 0.3, 5), (14_000, 0.4, 0.5, 0.6, 5), (18_000, 0.7, 0.8, 0.9, 6)]


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def ulg() -> bytes:
    """Return a log with three samples of one gyroscope, two of another, and a topic with a single message."""
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 9_000)
    data += message("B", bytes(40))
    data += message("F", b"sensor_gyro:uint64_t timestamp;float[3] rad;uint8_t id;")
    data += message("F", b"once:uint64_t timestamp;int32_t value;")
    for instance, number, name in ((0, 3, b"sensor_gyro"), (1, 4, b"sensor_gyro"), (0, 5, b"once")):
        data += message("A", struct.pack("<BH", instance, number) + name)
    for sample in GYRO:
        data += message("D", struct.pack("<HQ3fB", 3, *sample))
    data += message("D", struct.pack("<HQi", 5, 11_000, 1))
    for sample in GYRO[:2]:
        data += message("D", struct.pack("<HQ3fB", 4, sample[0] + 7, *(-v for v in sample[1:4]), 9))
    return data


def read(path, topic="sensor_gyro", columns=("rad[0]", "rad[2]"), names=(), **of):
    return read_stream([path], Source(file=path.name, topic=topic, **of), columns, "imu", topic, names)


def test_messages_of_an_instance_are_read(tmp_path) -> None:
    path = tmp_path / "log.ulg"
    path.write_bytes(ulg())
    first = read(path, names=("id",))
    np.testing.assert_allclose(first.t, [0.010, 0.014, 0.018])
    np.testing.assert_allclose(first.values, [[0.1, 0.3], [0.4, 0.6], [0.7, 0.9]], rtol=1e-6)
    assert first.names[:, 0].tolist() == ["5", "5", "6"]
    np.testing.assert_array_equal(read(path, "sensor_gyro[0]").values, first.values)
    second = read(path, "sensor_gyro[1]", (2, 3), time="timestamp", unit="us")
    np.testing.assert_allclose(second.t, [0.010007, 0.014007])
    np.testing.assert_allclose(second.values, [[-0.1, -0.2], [-0.4, -0.5]], rtol=1e-6)
    assert not second.rejected.counts


def test_what_is_spoilt_is_one_line_or_counted(tmp_path) -> None:
    path, log = tmp_path / "log.ulg", ulg()
    for line, data in {"Header too short": log[:9], "Failed to parse header": b"\0" + log[1:]}.items():
        path.write_bytes(data)
        with pytest.raises(InputError, match=line):
            read(path)
    path.write_bytes(log[: 16 + 20])
    with pytest.raises(InputError, match=r"no topic 'sensor_gyro'; has none"):
        read(path)
    path.write_bytes(log[:-5])
    cut = read(path)
    assert len(cut.t) == 3
    assert list(cut.rejected.counts) == ["log that is cut short or spoilt: what could be read of it is used"]
    path.write_bytes(log)
    for line, topic, columns in (
        (r"no topic 'sensor_gyr'.*sensor_gyro.*has .*sensor_gyro\[1\]", "sensor_gyr", (1,)),
        (r"has no field 'rad\[3\]'; has timestamp, rad\[0\]", "sensor_gyro", ("rad[3]",)),
        (r"has no field '9'", "sensor_gyro", (9,)),
        (r"once: 1 rows", "once", (1,)),
    ):
        with pytest.raises(InputError, match=line):
            read(path, topic, columns)


def test_without_pyulog_a_line_names_the_extra(tmp_path, monkeypatch) -> None:
    path = tmp_path / "without.ulg"
    path.write_bytes(ulg())
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "pyulog" else sys.modules.get(name))
    with pytest.raises(InputError, match=r"pyulog: is not installed.*ortilo-drake\[recorded\]"):
        read(path)
