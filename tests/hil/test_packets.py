"""Packets come back as they were sent; whatever else comes is refused, for the reason it should be."""

import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.hil.packet_checks import BadPacket, Flight
from ortilo_drake.hil.packets import (
    CHANNELS,
    FLYING,
    NO_TICK,
    STATES,
    TELEMETRY,
    Goal,
    Hello,
    encode_command,
    encode_goal,
    encode_hello,
    encode_picture,
    encode_telemetry,
    encode_tick,
    encode_vector,
)
from ortilo_drake.hil.unpack import decode
from ortilo_drake.model.signals import IMU_SIZE, MAX_DETECTIONS, VELOCITY_SIZE

SESSION, TICK, ANCHORS, SHAPE, CLASSES = 77, 30, 8, (6, 9), 12
FLIGHT = Flight(SESSION, 1 / 30, ANCHORS, SHAPE, CLASSES)
RNG = np.random.default_rng(5)

finite = st.floats(-1e6, 1e6)


def message(size: int) -> np.ndarray:
    return np.concatenate(([1.0, 0.5], RNG.normal(size=size - 2)))


def uwb() -> np.ndarray:
    return np.concatenate((message(2 + ANCHORS), RNG.integers(0, 2, ANCHORS)))


def detections() -> np.ndarray:
    boxes = RNG.uniform(0, 600, (MAX_DETECTIONS, 6))
    boxes[:, 0] = RNG.integers(-1, CLASSES, MAX_DETECTIONS)
    return np.concatenate(([1.0, 0.5], boxes.ravel()))


OUTPUTS = {name: RNG.normal(size=size) for name, size in TELEMETRY.items()}
PICTURE = RNG.integers(0, 256, (*SHAPE, 4), dtype=np.uint8)
VALID = {
    "imu": encode_vector(SESSION, TICK, message(IMU_SIZE)),
    "uwb": encode_vector(SESSION, TICK, uwb()),
    "detections": encode_vector(SESSION, TICK, detections()),
    "shutter": encode_vector(SESSION, TICK, np.array([1.0, 0.5])),
    "velocity": encode_vector(SESSION, TICK, message(VELOCITY_SIZE)),
    "image": encode_picture(SESSION, TICK, 0.5, PICTURE),
    "tick": encode_tick(SESSION, TICK, ("imu", "uwb")),
    "command": encode_command(SESSION, TICK, RNG.normal(size=4)),
    "telemetry": encode_telemetry(SESSION, TICK, OUTPUTS),
    "hello": encode_hello(Hello("world", "0123abcd", SESSION, True, FLYING, "ä")),
    "goal": encode_goal(Goal(SESSION, 2**61 + 1, "onboard", -1.5, 2.25, "ä")),
}


REASONS = ("length", "fingerprint", "crc", "foreign", "tick", "stamp", "value", "text", "picture")


def reason(name: str, data: bytes, flight: Flight | None = FLIGHT) -> str:
    try:
        decode(name, data, flight)
    except BadPacket as problem:
        return problem.reason
    return "accepted"


def seal(body: bytes) -> bytes:
    return body + struct.pack(">q", zlib.crc32(body))


def changed(data: bytes, at: int, field: bytes) -> bytes:
    """Return a packet with other bytes somewhere and a crc that fits."""
    return seal(data[:at] + field + data[at + len(field) : -8])


def malformed(name: str, n: int, rng: np.random.Generator) -> list[bytes]:
    """Return n damaged packets for a channel: noise, flipped bits, cuts, extensions, other channels' types."""
    valid, packets = VALID[name], []
    others = [data for data in VALID.values() if data[:8] != valid[:8]]
    for i in range(n):
        data = bytearray(valid)
        match i % 5:
            case 0:
                data = bytearray(rng.bytes(rng.integers(0, 2 * len(valid))))
            case 1:  # any three bits: crc32 finds all of them in packets this short (Hamming distance 4 to 11 kB)
                for bit in rng.choice(8 * len(data), rng.integers(1, 4), replace=False):
                    data[bit // 8] ^= 1 << bit % 8
            case 2:
                data = data[: rng.integers(0, len(data))]
            case 3:
                data += rng.bytes(rng.integers(1, 50))
            case _:
                data = bytearray(seal(others[rng.integers(len(others))][:-8]))
        packets.append(bytes(data))
    return packets


@pytest.mark.parametrize("name", CHANNELS)
def test_ten_thousand_malformed_packets_on_each_channel_are_refused(name: str) -> None:
    assert reason(name, VALID[name]) == "accepted"
    reasons = [reason(name, data) for data in malformed(name, 10_000, np.random.default_rng(len(name)))]
    assert "accepted" not in reasons
    assert set(reasons) == {"length", "fingerprint", "crc"}


@given(name=st.sampled_from(list(CHANNELS)), data=st.binary(max_size=400), flight=st.sampled_from([FLIGHT, None]))
def test_any_bytes_are_refused(name: str, data: bytes, flight: Flight | None) -> None:
    assert reason(name, data, flight) != "accepted"


@given(name=st.sampled_from(list(CHANNELS)), at=st.integers(8, 600), field=st.binary(min_size=1, max_size=30))
def test_lies_with_a_right_crc_are_decided_without_another_error(name: str, at: int, field: bytes) -> None:
    data = changed(VALID[name], min(at, len(VALID[name]) - 8), field)
    assert reason(name, data) in ("accepted", *REASONS)
    assert reason(name, data, None) in (("accepted", *REASONS) if name == "hello" else REASONS)


@pytest.mark.parametrize("size", [-(2**31), -1, 0, 10, 2**27, 2**31 - 1])
@pytest.mark.parametrize(
    ("name", "at"),
    [("imu", 24), ("uwb", 24), ("image", 32), ("tick", 24), ("tick", 28), ("hello", 12), ("goal", 24), ("goal", 52)],
)
def test_sizes_that_lie_allocate_nothing(name: str, at: int, size: int) -> None:
    data = changed(VALID[name], at, struct.pack(">i", size))
    tracemalloc.start()
    why = reason(name, data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert why in ("length", "text")
    assert peak < 100_000


@pytest.mark.parametrize(
    ("name", "at", "field", "why"),
    [
        *[(name, 8, struct.pack(">q", SESSION + 1), "foreign") for name in CHANNELS if name != "hello"],
        *[(name, 16, struct.pack(">q", -1), "tick") for name in CHANNELS if name not in NO_TICK],
        *[("imu", 28, struct.pack(">d", flag), "value") for flag in (2.0, 0.5, -1.0, np.nan)],
        *[("imu", 36, struct.pack(">d", stamp), "stamp") for stamp in (-0.1, 1.1)],
        *[("imu", 44, struct.pack(">d", value), "value") for value in (np.nan, np.inf, -np.inf, 1e13)],
        ("uwb", 28 + 8 * (2 + ANCHORS), struct.pack(">d", 0.5), "value"),
        *[("detections", 44, struct.pack(">d", label), "value") for label in (0.5, -2.0, float(CLASSES))],
        *[("image", 24, struct.pack(">d", stamp), "stamp") for stamp in (-0.1, 1.1, np.nan)],
        *[("image", 36 + at, b"\x7f", "picture") for at in (0, 12, 16, 20, 24, 25, 28, 45, 60)],
        ("tick", 32, b"abc", "text"),
        ("tick", 32, b"\xff\xff\xff", "text"),
        ("tick", 40, b"imu", "text"),  # twice
        ("command", 24, struct.pack(">d", np.nan), "value"),
        ("telemetry", 24, struct.pack(">d", np.inf), "value"),
        ("hello", 16, b"w\xffrld", "text"),
        ("hello", 16, b"wurld", "text"),
        ("hello", 48, b"frying", "text"),
        *[("goal", 16, struct.pack(">q", number), "value") for number in (0, -1, -(2**63))],
        ("goal", 28, b"onb\xffard", "text"),
        ("goal", 28, b"onbuard", "text"),
        *[("goal", 36 + 8 * i, struct.pack(">d", p), "value") for i in (0, 1) for p in (np.nan, np.inf, -1e13)],
        ("goal", 36, bytes.fromhex("7ff0000000000001"), "value"),  # a signalling NaN
        ("goal", 56, b"\xff", "text"),
        ("goal", 58, b"x", "text"),  # no end
    ],
)
def test_each_lie_is_refused_for_its_reason(name: str, at: int, field: bytes, why: str) -> None:
    assert reason(name, changed(VALID[name], at, field)) == why


def png(width: int, height: int, rows: bytes, extra: bytes = b"", depth: int = 8) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, 6, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + extra + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def picture_packet(data: bytes) -> bytes:
    head = VALID["image"][:8] + struct.pack(">qqd", SESSION, TICK, 0.5)
    return seal(head + struct.pack(">i", len(data)) + data)


def test_a_bomb_is_not_unpacked() -> None:
    height, width = SHAPE
    rows = height * bytes(1 + 4 * width)
    assert reason("image", picture_packet(png(width, height, rows))) == "accepted"
    text = struct.pack(">I", 2) + b"tEXt" + b"a\0" + struct.pack(">I", zlib.crc32(b"tEXta\0"))
    bad = {
        "short": png(width, height, rows[:-1]),
        "long": png(width, height, rows + b"\0"),
        "filter": png(width, height, b"\5" + rows[1:]),
        "huge": png(width, height, bytes(50_000_000)),
        "declared": png(2**31 - 1, 2**31 - 1, rows),
        "turned": png(height, width, rows),
        "deep": png(width, height, rows, depth=16),
        "chunk": png(width, height, rows, extra=text),
        "open": png(width, height, rows)[:-12],
        "more": png(width, height, rows) + b"\0",
        "none": b"",
    }
    tracemalloc.start()
    assert {name: reason("image", picture_packet(data)) for name, data in bad.items()} == dict.fromkeys(bad, "picture")
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


def test_without_a_flight_only_hello_passes() -> None:
    passed = [name for name in CHANNELS if reason(name, VALID[name], None) == "accepted"]
    assert passed == ["hello"]
    assert reason("nothing", VALID["imu"]) == "channel"


@given(
    tick=st.integers(0, 2**40),
    values=st.lists(finite, min_size=9, max_size=9),
    u=st.lists(finite, min_size=4, max_size=4),
)
def test_vectors_and_commands_come_back_bit_for_bit(tick: int, values: list[float], u: list[float]) -> None:
    imu = np.array([1.0, 0.0, *values])
    packet = decode("imu", encode_vector(SESSION, tick, imu), FLIGHT)
    assert (packet.name, packet.tick, packet.value.tobytes()) == ("imu", tick, imu.tobytes())
    command = decode("command", encode_command(SESSION, tick, np.array(u)), FLIGHT)
    assert command.value.tobytes() == np.array(u).tobytes()


def test_telemetry_and_ticks_come_back() -> None:
    outputs = decode("telemetry", VALID["telemetry"], FLIGHT).value
    assert {name: values.tobytes() for name, values in outputs.items()} == {k: v.tobytes() for k, v in OUTPUTS.items()}
    assert decode("tick", VALID["tick"], FLIGHT).value == ("imu", "uwb")
    assert decode("tick", encode_tick(SESSION, 0, ()), FLIGHT).value == ()


@given(
    height=st.integers(1, 40), width=st.integers(1, 40), seed=st.integers(0, 99), alpha=st.sampled_from([None, 0, 255])
)
def test_pictures_come_back_bit_for_bit(height: int, width: int, seed: int, alpha: int | None) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 4), dtype=np.uint8)
    if alpha is not None:
        image[..., 3] = alpha
    packet = decode("image", encode_picture(SESSION, TICK, 0.5, image), FLIGHT._replace(shape=(height, width)))
    assert packet.stamp == 0.5
    np.testing.assert_array_equal(packet.value, image)


@given(
    digest=st.text(max_size=100),
    why=st.text(),
    session=st.integers(0, 2**63 - 1),
    lockstep=st.booleans(),
    state=st.sampled_from(STATES),
)
def test_hello_comes_back(digest: str, why: str, session: int, lockstep: bool, state: str) -> None:
    hello = Hello("onboard", digest, session, lockstep, state, why)
    assert decode("hello", encode_hello(hello), None).value == hello


@given(
    session=st.integers(1, 2**63 - 1),
    number=st.integers(1, 2**63 - 1),
    role=st.sampled_from(["user", "onboard"]),
    p_W=st.tuples(finite, finite),
    why=st.text(max_size=120),
)
def test_goals_come_back_bit_for_bit(session: int, number: int, role: str, p_W: tuple[float, float], why: str) -> None:
    goal = Goal(session, number, role, *p_W, why)
    packet = decode("goal", encode_goal(goal), FLIGHT._replace(session=session))
    assert (packet.name, packet.tick, packet.value) == ("goal", -1, goal)


def test_a_long_reason_is_cut() -> None:
    goal = Goal(SESSION, 1, "onboard", 0.0, 0.0, 3000 * "ä")
    assert decode("goal", encode_goal(goal), FLIGHT).value.reason == 250 * "ä"
    hello = Hello("world", "", reason=3000 * "ä")
    assert decode("hello", encode_hello(hello), None).value.reason == 250 * "ä"
