"""LCM's datagrams, packed as LCM does; whatever else comes is counted and costs a bounded memory."""

import os
import struct
import tracemalloc
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.hil.wire import udpm
from ortilo_drake.hil.wire.udpm import (
    AGE,
    HELD,
    LARGEST,
    MOST_FRAGMENT,
    MOST_SHORT,
    PENDING,
    SENDERS,
    Reassembly,
    encode,
)

CASES = int(os.environ.get("ORTILO_FUZZ_CASES", "2000"))
ME, YOU = ("127.0.0.1", 1000), ("127.0.0.1", 1001)


def listening(*channels: str) -> Reassembly:
    reassembly = Reassembly()
    reassembly.channels.update(channels or ("X",))
    return reassembly


def fragment(sequence: int, size: int, offset: int, number: int, count: int, rest: bytes) -> bytes:
    return struct.pack(">IIIIHH", 0x4C433033, sequence, size, offset, number, count) + rest


def long_message(parts: int = 3) -> tuple[bytes, list[bytes]]:
    """Return data and the datagrams of it on channel X."""
    data = np.random.default_rng(parts).bytes(MOST_FRAGMENT * (parts - 1) + 1000)
    datagrams = encode("X", 7, data)
    assert len(datagrams) == parts
    return data, datagrams


def taken(reassembly: Reassembly, datagrams: list[bytes], sender: udpm.Sender = ME) -> list[bytes]:
    whole = [reassembly.take(sender, datagram, 0.0) for datagram in datagrams]
    return [message.data for message in whole if message]


def test_the_wire_format_is_lcms() -> None:
    assert encode("X", 7, b"ab") == [b"LC02\0\0\0\7X\0ab"]
    data = bytes(65_500)
    first, second = encode("XY", 2**32 - 1, data)
    assert first == b"LC03\xff\xff\xff\xff" + struct.pack(">IIHH", 65_500, 0, 0, 2) + b"XY\0" + bytes(65_484)
    assert second == b"LC03\xff\xff\xff\xff" + struct.pack(">IIHH", 65_500, 65_484, 1, 2) + bytes(16)


@pytest.mark.parametrize("channel", ["", 64 * "x", "ä"])
def test_what_lcm_cannot_say_is_not_packed(channel: str) -> None:
    with pytest.raises(ValueError, match=r"LCM has no such message|can't encode"):
        encode(channel, 0, b"")
    with pytest.raises(ValueError, match="LCM has no such message"):
        encode("X", 0, bytes(LARGEST + 1))


@given(
    size=st.one_of(st.integers(0, 400), st.integers(MOST_SHORT - 70, MOST_SHORT + 70), st.integers(0, 4 * MOST_SHORT)),
    channel=st.text("aZ_9", min_size=1, max_size=63),
    sequence=st.integers(0, 2**32 - 1),
)
def test_messages_come_back_and_no_datagram_is_too_long(size: int, channel: str, sequence: int) -> None:
    data = np.random.default_rng(size).bytes(size)
    datagrams = encode(channel, sequence, data)
    assert max(map(len, datagrams)) <= 65_507  # UDP's own limit
    assert (len(datagrams) == 1) == (len(channel) + 1 + size <= MOST_SHORT)
    reassembly = listening(channel)
    assert taken(reassembly, datagrams) == [data]
    assert (reassembly.held, reassembly.refused) == (0, {})


def test_fragments_may_come_in_any_order_and_between_those_of_others() -> None:
    data, datagrams = long_message(4)
    for order in permutations(range(4)):
        reassembly, came = listening(), []
        for i in order:
            for sender in (ME, YOU):
                came += taken(reassembly, [datagrams[i]], sender)
        assert came == [data, data]
        assert (reassembly.held, reassembly.refused) == (0, {})


def test_the_datagram_that_overruns_lcms_buffer_is_refused() -> None:
    # lcm-proj/lcm pull request 628: who adds offset and length in 32 bits finds 50 - 2^31 below the size.
    wraps = fragment(1, 2**16, 2**31, 0, 2, b"ORTILO_HELLO\0" + 50 * b"A")
    assert len(wraps) == 83
    reassembly = listening("ORTILO_HELLO")
    assert taken(reassembly, [wraps]) == []
    assert reassembly.refused == {"fragment": 1}
    first = fragment(1, 2**16, 0, 0, 2, b"ORTILO_HELLO\0" + 50 * b"A")
    assert taken(reassembly, [first, fragment(1, 2**16, 2**32 - 32, 1, 2, bytes(63))]) == []
    assert reassembly.refused == {"fragment": 2}


@pytest.mark.parametrize(
    ("datagram", "reason"),
    [
        (b"", "datagram"),
        (b"LC0", "datagram"),
        (b"LC02\0\0\0", "datagram"),
        (b"LC04\0\0\0\0X\0", "datagram"),
        (b"LC03" + bytes(15), "datagram"),
        (b"LC02\0\0\0\0", "channel"),
        (b"LC02\0\0\0\0X", "channel"),
        (b"LC02\0\0\0\0\0data", "channel"),
        (b"LC02\0\0\0\0" + 64 * b"X" + b"\0", "channel"),
        (b"LC02\0\0\0\0\xe4\0", "channel"),
        (fragment(0, 10, 0, 0, 2, b"X"), "channel"),
        (fragment(0, 10, 0, 0, 0, b"X\0"), "fragment"),
        (fragment(0, 10, 0, 2, 2, b""), "fragment"),
        (fragment(0, 10, 5, 1, 2, bytes(6)), "fragment"),
        (fragment(0, 10, 1, 0, 2, b"X\0a"), "fragment"),
        (fragment(0, LARGEST + 1, 0, 0, 400, b"X\0"), "fragment"),
        (fragment(0, 2**32 - 1, 0, 0, 2**16 - 1, b"X\0"), "fragment"),
    ],
)
def test_each_lie_is_refused_for_its_reason(datagram: bytes, reason: str) -> None:
    reassembly = listening()
    assert taken(reassembly, [datagram]) == []
    assert (reassembly.refused, reassembly.held) == ({reason: 1}, 0)


@pytest.mark.parametrize(
    ("parts", "refused"),
    [
        ([(10, 0, 0, 2, b"X\0abcd"), (10, 3, 1, 2, b"defghij")], 1),  # overlap
        ([(10, 0, 0, 2, b"X\0abcd"), (10, 5, 1, 2, b"fghij")], 1),  # a hole
        ([(10, 0, 0, 2, b"X\0abcd"), (10, 4, 1, 2, b"efghi")], 1),  # an end too early
        ([(10, 0, 0, 2, b"X\0abcd"), (11, 4, 1, 2, b"efghij")], 1),  # of another size
        ([(10, 0, 0, 2, b"X\0abcd"), (10, 4, 1, 3, b"efghij")], 1),  # of another count
        ([(10, 0, 0, 2, b"X\0abcd"), (10, 0, 0, 2, b"X\0ABCD"), (10, 4, 1, 2, b"efghij")], 1),  # the first stays
    ],
)
def test_fragments_that_do_not_fit_make_no_message(parts: list[tuple[int, int, int, int, bytes]], refused: int) -> None:
    reassembly = listening()
    came = taken(reassembly, [fragment(3, *part) for part in parts])
    assert came == ([b"abcdefghij"] if len(parts) == 3 else [])
    assert reassembly.refused == {"overlap": refused}


def test_a_message_that_stays_incomplete_is_forgotten() -> None:
    _, datagrams = long_message(3)
    reassembly = listening()
    assert taken(reassembly, datagrams[:2]) == []
    assert reassembly.take(YOU, datagrams[0], AGE + 0.001) is None
    assert reassembly.refused == {"incomplete": 1}
    assert reassembly.take(ME, datagrams[2], AGE + 0.001) is None  # too late
    assert len(reassembly._pending) == 2


def test_what_nobody_listens_to_is_not_kept() -> None:
    _, datagrams = long_message(5)
    reassembly = listening("Y")
    assert taken(reassembly, datagrams[:4]) == []
    assert reassembly.held < 2000
    assert taken(reassembly, datagrams[4:]) == []
    assert (reassembly.held, reassembly.refused) == (0, {})


def test_a_flood_of_beginnings_neither_fills_the_memory_nor_stops_another_sender() -> None:
    data, datagrams = long_message(3)
    reassembly = listening()
    assert taken(reassembly, datagrams[:2], YOU) == []
    part = bytes(60_000)
    tracemalloc.start()
    for sequence in range(2000):  # 120 MB
        reassembly.take(ME, fragment(sequence, LARGEST, 0, 0, 300, b"X\0" + part[: 60_000 - sequence % 2]), 0.0)
    assert tracemalloc.get_traced_memory()[1] < 2e6
    tracemalloc.stop()
    assert taken(reassembly, datagrams[2:], YOU) == [data]


def test_many_senders_and_the_longest_messages_stay_within_their_memory() -> None:
    reassembly, rng, part = listening(), np.random.default_rng(1), bytes(60_000)
    for n in range(3000):
        sender, sequence = ("127.0.0.1", int(rng.integers(4 * SENDERS))), int(rng.integers(2 * PENDING))
        number = 1 + n % 200
        reassembly.take(sender, fragment(sequence, LARGEST, number * 60_000, number, 300, part), 0.0)
        assert reassembly.held <= HELD
        assert len(reassembly._pending) <= PENDING * SENDERS
    assert reassembly.held == sum(message.held for message in reassembly._pending.values())


def extreme(rng: np.random.Generator, bits: int) -> int:
    """Return a number of so many bits, more often than not one at which something might wrap."""
    edges = [0, 1, 2, 3, 63, 100, MOST_FRAGMENT, LARGEST, 2 ** (bits - 1), 2**bits - 2, 2**bits - 1, 2**bits - 63]
    return int(rng.choice(edges) if rng.random() < 0.8 else rng.integers(2**bits)) % 2**bits


def hostile(rng: np.random.Generator, valid: list[bytes]) -> bytes:
    """Return a datagram that LCM would not send, or one that it would."""
    match rng.integers(6):
        case 0:
            return rng.bytes(rng.integers(0, 100))
        case 1:
            return b"LC0" + rng.choice([b"2", b"3"]) + rng.bytes(rng.integers(0, 100))
        case 2:
            head = struct.pack(">IIIIHH", 0x4C433033, rng.integers(4), *(extreme(rng, n) for n in (32, 32, 16, 16)))
            return head + (b"X\0" if rng.random() < 0.5 else b"") + rng.bytes(rng.integers(0, 80))
        case 3:
            datagram = bytearray(valid[rng.integers(len(valid))])
            at = int(rng.integers(min(len(datagram), 30)))
            datagram[at] = rng.integers(256)
            return bytes(datagram)
        case 4:
            datagram = valid[rng.integers(len(valid))]
            return datagram[: rng.integers(len(datagram))]
        case _:
            return valid[rng.integers(len(valid))]


def walk_datagrams(cases: int, seed: int) -> None:
    """Give so many hostile datagrams to a reassembly: it must not raise, grow, or hear what was not sent."""
    rng, reassembly, now = np.random.default_rng(seed), listening(), 0.0
    sent = {b"short", b""} | {np.random.default_rng(i).bytes(70_000 + i) for i in range(3)}
    valid = [datagram for i, data in enumerate(sorted(sent)) for datagram in encode("X", i, data)]
    whole = [data for datagram in valid if (data := datagram[:4]) == b"LC02"]
    assert whole
    for _ in range(cases):
        now += float(rng.exponential(0.02))
        datagram = hostile(rng, valid)
        message = reassembly.take(("127.0.0.1", int(rng.integers(3))), datagram, now)
        if message and datagram[:4] == b"LC03":
            assert message.channel == "X"
            assert len(message.data) <= LARGEST
        assert 0 <= reassembly.held <= HELD
        assert len(reassembly._pending) <= PENDING * 3
    assert reassembly.refused.keys() >= {"datagram", "channel", "fragment", "overlap"}
    assert reassembly.refused.total() < cases
    for i, data in enumerate(sorted(sent)):  # and after all that it still listens
        assert taken(reassembly, encode("X", 100 + i, data), ("127.0.0.1", 9)) == [data]


@pytest.mark.parametrize("seed", range(3))
def test_hostile_datagrams(seed: int) -> None:
    walk_datagrams(CASES, seed)
