import struct

import pytest

from ortilo_drake.hil.wire.lcm_type import LcmType

# What lcm-gen 1.5.3 writes as a type's hash, before it is rotated.
HASHES = {
    "command": 0x1559153B34FF2D28,
    "goal": 0xD9C8B32783DCE55F,
    "hello": 0xE012AFBFD4B2270A,
    "picture": 0x8323765B85E57D06,
    "telemetry": 0x58854D68CB21DF47,
    "tick": 0x01C389E555CC427B,
    "vector": 0xF82BD2E21AD83C4C,
}


@pytest.mark.parametrize(("name", "value"), HASHES.items())
def test_fingerprint_is_that_of_lcm_gen(name, value):
    rotated = ((value << 1) & (2**64 - 1)) | (value >> 63)
    assert LcmType(name).fingerprint == rotated.to_bytes(8, "big")


def test_texts_numbers_and_arrays_stand_in_order():
    its = {"session": 7, "tick": -1, "number": 9, "role": "user", "p_W": (1.5, -2.0), "reason": "é"}
    goal = LcmType("goal")
    after = struct.pack(">qqqI", 7, -1, 9, 5) + b"user\0" + struct.pack(">2dI", 1.5, -2.0, 3) + "é".encode() + b"\0"
    data = goal.encode(**its)
    assert data == goal.fingerprint + after
    assert vars(goal.decode(data)) == its


def test_arrays_are_counted():
    tick, picture = LcmType("tick"), LcmType("picture")
    data = tick.encode(session=1, tick=2, sent=("imu", "uwb"))
    assert data[8:] == struct.pack(">qqiI", 1, 2, 2, 4) + b"imu\0" + struct.pack(">I", 4) + b"uwb\0"
    assert tick.decode(data).sent == ["imu", "uwb"]
    data = picture.encode(session=1, tick=2, stamp=0.5, data=b"\1\2\3")
    assert data[8:] == struct.pack(">qqdi", 1, 2, 0.5, 3) + b"\1\2\3"
    assert picture.decode(data).data == b"\1\2\3"


@pytest.mark.parametrize(
    ("name", "size_at", "content"),
    [("vector", 24, {"values": [1.0, 2.0]}), ("picture", 32, {"stamp": 0.5, "data": b"ab"})],
)
def test_what_ends_too_early_is_refused_and_so_is_a_negative_size(name, size_at, content):
    data = LcmType(name).encode(session=1, tick=2, **content)
    assert data[size_at : size_at + 4] == struct.pack(">i", 2)
    for bad in (data[:-1], data[:size_at] + struct.pack(">i", -2) + data[size_at + 4 :]):
        with pytest.raises(struct.error):
            LcmType(name).decode(bad)
