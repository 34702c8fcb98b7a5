"""Packets come back as they were sent; whatever else comes is refused, for the reason it should be."""

import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from hil_link import flight_for_packets
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.hil.wire.limits import Limits
from ortilo_drake.hil.wire.packets import (
    FLYING,
    KINDS,
    ROLES,
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
from ortilo_drake.hil.wire.unpack import BadPacket, Flight, Packet, decode, largest_to_world, plain
from ortilo_drake.model.measurement import make_measurement
from ortilo_drake.model.room import load_room
from ortilo_drake.model.signals import ACTED_SIZE, IMU_SIZE, MAX_DETECTIONS, VELOCITY_SIZE

SESSION, TICK, SHAPE = 77, 30, (6, 9)
FLIGHT = flight_for_packets(SESSION, SHAPE)
ANCHORS, CLASSES = len(load_room().anchors), round(FLIGHT.limits["detections"].high[2]) + 1
REASONS = ("length", "fingerprint", "foreign", "tick", "stamp", "value", "text", "picture")
RNG = np.random.default_rng(5)


def message(size: int) -> np.ndarray:
    return np.concatenate(([1.0, 1.0], RNG.uniform(-1.0, 1.0, size=size - 2)))


def uwb() -> np.ndarray:
    return np.concatenate(([1.0, 1.0], RNG.uniform(0.0, 10.0, ANCHORS), RNG.integers(0, 2, ANCHORS)))


def detections() -> np.ndarray:
    boxes = RNG.uniform(0, 230, (MAX_DETECTIONS, 6))
    boxes[:, 0] = RNG.integers(-1, CLASSES, MAX_DETECTIONS)
    boxes[:, 1] = RNG.uniform(0.0, 1.0, MAX_DETECTIONS)
    return np.concatenate(([1.0, 29 / 30], boxes.ravel()))


OUTPUTS = {name: RNG.uniform(0.0, 1.0, size=size) for name, size in (make_measurement().sizes | TELEMETRY).items()}
PICTURE = RNG.integers(0, 256, (*SHAPE, 4), dtype=np.uint8)


HELLO = Hello("world", 16 * "a", SESSION, True, FLYING, 2**61 + 1, 30)
GOAL = Goal(SESSION, TICK, 2**61 + 1, "onboard", -1.5, 2.25, "ä")
VALID = {
    "imu": encode_vector(SESSION, TICK, message(IMU_SIZE)),
    "uwb": encode_vector(SESSION, TICK, uwb()),
    "detections": encode_vector(SESSION, TICK, detections()),
    "shutter": encode_vector(SESSION, TICK, np.array([1.0, 1.0])),
    "velocity": encode_vector(SESSION, TICK, message(VELOCITY_SIZE)),
    "acted": encode_vector(SESSION, TICK, np.concatenate(([1.0, 1.0], np.zeros(ACTED_SIZE - 2)))),
    "image": encode_picture(SESSION, TICK, 1.0, PICTURE),
    "tick": encode_tick(SESSION, TICK, ("imu", "uwb")),
    "command": encode_command(SESSION, TICK, RNG.normal(size=4)),
    "telemetry": encode_telemetry(SESSION, TICK, OUTPUTS),
    "hello": encode_hello(HELLO),
    "goal": encode_goal(GOAL),
}


def reason(name: str, data: bytes, flight: Flight | None = FLIGHT) -> str:
    try:
        decode(name, data, flight)
    except BadPacket as problem:
        return problem.reason
    return "accepted"


def opened(name: str, body: bytes, flight: Flight | None = FLIGHT) -> Packet:
    return decode(name, body, flight)


def changed(name: str, at: int, field: bytes) -> bytes:
    """Return a packet with other bytes somewhere."""
    body = VALID[name]
    return (body[:at] + field + body[at + len(field) :])[: len(body)]


def malformed(name: str, n: int, rng: np.random.Generator) -> list[bytes]:
    """Return n damaged packets for a channel: noise, wrong types and sessions, cuts, extensions."""
    valid, packets = VALID[name], []
    others = [data for data in VALID.values() if data[:8] != valid[:8]]
    for i in range(n):
        data = bytearray(valid)
        match i % 5:
            case 0:
                data = bytearray(rng.bytes(rng.integers(0, 2 * len(valid))))
            case 1:
                data[rng.integers(8 if name == "hello" else 16)] ^= 1 << rng.integers(8)
            case 2:
                data = data[: rng.integers(0, len(data))]
            case 3:
                data += rng.bytes(rng.integers(1, 50))
            case _:
                data = bytearray(others[rng.integers(len(others))])
        packets.append(bytes(data))
    return packets


@pytest.mark.family
@pytest.mark.parametrize("name", KINDS)
def test_ten_thousand_malformed_packets_on_each_channel_are_refused(name: str) -> None:
    assert reason(name, VALID[name]) == "accepted"
    reasons = [reason(name, data) for data in malformed(name, 10_000, np.random.default_rng(len(name)))]
    assert "accepted" not in reasons
    assert {"length", "fingerprint"} <= set(reasons) <= {"length", "fingerprint", "foreign", "text"}


@given(name=st.sampled_from(list(KINDS)), data=st.binary(max_size=400), flight=st.sampled_from([FLIGHT, None]))
def test_any_bytes_are_refused(name: str, data: bytes, flight: Flight | None) -> None:
    assert reason(name, data, flight) != "accepted"


@given(name=st.sampled_from(list(KINDS)), at=st.integers(8, 600), field=st.binary(min_size=1, max_size=30))
def test_lies_are_decided_without_another_error(name: str, at: int, field: bytes) -> None:
    data = changed(name, min(at, len(VALID[name])), field)
    assert reason(name, data) in ("accepted", *REASONS)
    assert reason(name, data, None) in (("accepted", *REASONS) if name == "hello" else REASONS)


@pytest.mark.parametrize("size", [-(2**31), -1, 0, 10, 2**27, 2**31 - 1])
@pytest.mark.parametrize(
    ("name", "at"),
    [
        *[("imu", 24), ("uwb", 24), ("image", 32), ("tick", 24), ("tick", 28), ("hello", 12), ("hello", 22)],
        *[("goal", 32), ("goal", 60)],
    ],
)
def test_sizes_that_lie_allocate_nothing(name: str, at: int, size: int) -> None:
    data = changed(name, at, struct.pack(">i", size))
    tracemalloc.start()
    why = reason(name, data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert why in ("length", "text", "value")
    assert peak < 100_000


@pytest.mark.parametrize(
    ("name", "at", "field", "why"),
    [
        *[(name, 8, struct.pack(">q", SESSION + 1), "foreign") for name in KINDS if name != "hello"],
        *[(name, 16, struct.pack(">q", -1), "tick") for name in KINDS if name != "hello"],
        *[("imu", 28, struct.pack(">d", flag), "value") for flag in (2.0, 0.5, -1.0, np.nan)],
        *[(name, 16, struct.pack(">q", 2**40), "tick") for name in KINDS if name != "hello"],
        *[("imu", 36, struct.pack(">d", stamp), "stamp") for stamp in (-0.1, 0.99, 1.1)],
        *[("imu", 44, struct.pack(">d", value), "value") for value in (np.nan, np.inf, -np.inf, 10.0)],
        ("uwb", 28 + 8 * (2 + ANCHORS), struct.pack(">d", 0.5), "value"),
        *[("detections", 44, struct.pack(">d", label), "value") for label in (0.5, -2.0, float(CLASSES))],
        *[("image", 24, struct.pack(">d", stamp), "stamp") for stamp in (-0.1, 0.99, 1.1, np.nan)],
        *[("image", 36 + at, b"\x7f", "picture") for at in (0, 12, 16, 20, 24, 25, 28, 45, 60)],
        ("tick", 32, b"abc", "text"),
        ("tick", 32, b"\xff\xff\xff", "text"),
        ("tick", 40, b"imu", "text"),  # twice
        ("command", 24, struct.pack(">d", np.nan), "value"),
        ("telemetry", 24, struct.pack(">d", np.inf), "value"),
        ("hello", 16, b"w\xffrld", "text"),
        ("hello", 16, b"wurld", "text"),
        ("hello", 26, b"A", "text"),  # a digest is of small hexadecimal digits
        ("hello", 56, b"frying", "text"),
        *[("hello", 43, struct.pack(">q", session), "foreign") for session in (0, -1)],
        ("hello", 51, b"\2", "text"),
        ("hello", 71, struct.pack(">q", -2), "value"),
        *[("goal", 24, struct.pack(">q", number), "value") for number in (0, -1, -(2**63))],
        ("goal", 36, b"onb\xffard", "text"),
        ("goal", 36, b"onbuard", "text"),
        *[("goal", 44 + 8 * i, struct.pack(">d", p), "value") for i in (0, 1) for p in (np.nan, np.inf, -1e5)],
        ("goal", 44, bytes.fromhex("7ff0000000000001"), "value"),  # a signalling NaN
        ("goal", 64, b"\xff", "text"),
        ("goal", 66, b"x", "text"),  # no end
    ],
)
def test_each_lie_is_refused_for_its_reason(name: str, at: int, field: bytes, why: str) -> None:
    assert reason(name, changed(name, at, field)) == why


def png(width: int, height: int, rows: bytes, extra: bytes = b"", depth: int = 8) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, 6, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + extra + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def picture_packet(data: bytes) -> bytes:
    head = VALID["image"][:8] + struct.pack(">qqd", SESSION, TICK, 1.0)
    return head + struct.pack(">i", len(data)) + data


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
    passed = [name for name in KINDS if reason(name, VALID[name], None) == "accepted"]
    assert passed == ["hello"]
    assert reason("nothing", VALID["imu"]) == "channel"


@given(
    tick=st.integers(0, 2**24),
    values=st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9),
    u=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4),
)
def test_vectors_and_commands_come_back_bit_for_bit(tick: int, values: list[float], u: list[float]) -> None:
    imu = np.array([1.0, tick * FLIGHT.h, *values])
    packet = opened("imu", encode_vector(SESSION, tick, imu))
    assert (packet.name, packet.tick, packet.value.tobytes()) == ("imu", tick, imu.tobytes())
    command = opened("command", encode_command(SESSION, tick, np.array(u)))
    assert command.value.tobytes() == np.array(u).tobytes()


def test_telemetry_and_ticks_come_back() -> None:
    outputs = opened("telemetry", encode_telemetry(SESSION, TICK, OUTPUTS)).value
    assert {name: values.tobytes() for name, values in outputs.items()} == {k: v.tobytes() for k, v in OUTPUTS.items()}
    assert opened("tick", encode_tick(SESSION, TICK, ("imu", "uwb"))).value == ("imu", "uwb")
    assert opened("tick", encode_tick(SESSION, 0, ())).value == ()


@given(
    height=st.integers(1, 40), width=st.integers(1, 40), seed=st.integers(0, 99), alpha=st.sampled_from([None, 0, 255])
)
def test_pictures_come_back_bit_for_bit(height: int, width: int, seed: int, alpha: int | None) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 4), dtype=np.uint8)
    if alpha is not None:
        image[..., 3] = alpha
    packet = opened("image", encode_picture(SESSION, TICK, 1.0, image), FLIGHT._replace(shape=(height, width)))
    assert packet.stamp == 1.0
    np.testing.assert_array_equal(packet.value, image)


@pytest.mark.parametrize("shape", [None, (1, 1), (240, 320)])
def test_whatever_comes_to_the_world_fits_into_its_largest_message(shape: tuple[int, int] | None) -> None:
    """Pictures of noise, which does not compress, and telemetry of a sensor with 200 rows."""
    flight = FLIGHT._replace(shape=shape)
    sent = dict(VALID)
    if shape:
        sent["image"] = encode_picture(SESSION, TICK, 1.0, RNG.integers(0, 256, (*shape, 4), dtype=np.uint8))
        assert reason("image", sent["image"], flight) == "accepted"
    assert max(map(len, sent.values())) <= largest_to_world(flight) < 2**20
    rows = np.ones(200 * 200)
    limits = FLIGHT.limits | {"V2": Limits(0.0 * rows, 2.0 * rows)}
    telemetry = encode_telemetry(SESSION, TICK, OUTPUTS | {"V2": rows})
    assert reason("telemetry", telemetry, FLIGHT._replace(limits=limits)) == "accepted"
    assert len(telemetry) <= largest_to_world(flight._replace(limits=limits))


@given(
    role=st.sampled_from(ROLES),
    digest=st.text("0123456789abcdef", min_size=16, max_size=16),
    session=st.integers(1, 2**63 - 1),
    lockstep=st.booleans(),
    state=st.sampled_from(STATES),
    numbers=st.lists(st.integers(0, 2**63 - 1), min_size=2, max_size=2),
)
def test_hello_comes_back(role: str, digest: str, session: int, lockstep: bool, state: str, numbers: list[int]) -> None:
    hello = Hello(role, digest, session, lockstep, state, *numbers)
    assert opened("hello", encode_hello(hello), None).value == hello


printable = st.characters(exclude_categories=["C", "Z"], include_characters=" ")


@pytest.mark.long
@given(
    session=st.integers(1, 2**63 - 1),
    tick=st.integers(0, 2**24),
    number=st.integers(1, 2**63 - 1),
    role=st.sampled_from(["user", "onboard"]),
    p_W=st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
    why=st.text(printable, max_size=120),
)
def test_goals_come_back_bit_for_bit(
    session: int, tick: int, number: int, role: str, p_W: tuple[float, float], why: str
) -> None:
    goal = Goal(session, tick, number, role, *p_W, why)
    packet = opened("goal", encode_goal(goal), FLIGHT._replace(session=session))
    assert (packet.name, packet.tick, packet.value) == ("goal", -1, goal)


def test_a_long_reason_is_cut() -> None:
    goal = GOAL._replace(reason=3000 * "ä")
    assert opened("goal", encode_goal(goal)).value.reason == 250 * "ä"


# ESC clears a terminal or sets its title, C1 does the same in one character, U+202E turns the direction of writing.
HOSTILE = ["\x1b[2J", "\x1b]0;t\x07", "\x9b31m", "\r\n", "\x00", "\x7f", "\u202e", "\u2066", "\u200b", "\u2028"]


@pytest.mark.parametrize("control", HOSTILE)
def test_a_reason_reaches_a_terminal_without_control_characters(control: str) -> None:
    reason = opened("goal", encode_goal(GOAL._replace(reason=f"no{control}way"))).value.reason
    assert reason.startswith("no\ufffd")
    assert reason.endswith("way")
    assert reason.isprintable()


@pytest.mark.long
@given(text=st.text())
def test_plain_text_is_printable_and_what_is_plain_stays(text: str) -> None:
    shown = plain(text)
    assert len(shown) == len(text)
    assert shown.isprintable()
    assert all(there == here for here, there in zip(text, shown, strict=True) if here.isprintable())


def test_a_packet_is_none_of_a_channel_of_another_type() -> None:
    for name, data in VALID.items():
        for other in KINDS:
            if VALID[other][:8] != data[:8]:
                assert reason(other, data) in ("length", "fingerprint"), (name, other)
