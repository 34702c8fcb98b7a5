"""An inbox that nothing upsets."""

import json
import tracemalloc

import numpy as np
import pytest
from hil_link import open_bus
from waiting import HANGS

from ortilo_drake.hil.bus import MEMORY_URL
from ortilo_drake.hil.inbox import Inbox
from ortilo_drake.hil.packet_checks import Flight
from ortilo_drake.hil.packets import CHANNELS, Hello, encode_command, encode_hello, encode_vector

FLIGHT = Flight(77, 1 / 30, 8, (6, 9))


def u(value: float) -> np.ndarray:
    return np.array([value, 0.0, 0.0, 0.0])


def test_counts() -> None:
    joined = open_bus(MEMORY_URL)
    inbox = Inbox(joined, ["command", "hello"])
    joined.publish(CHANNELS["command"], encode_command(77, 0, u(0.0)))  # before the handshake
    joined.publish(CHANNELS["hello"], encode_hello(Hello("world", "ab", 77)))
    assert [arrival.packet.name for arrival in inbox.poll()] == ["hello"]
    inbox.begin(FLIGHT)
    joined.publish(CHANNELS["hello"], encode_hello(Hello("world", "ab", 78)))  # another flight's
    for tick in (2, 3, 3, 7, 5, 5, 10):  # it joined in flight: 0 and 1 are nobody's loss
        joined.publish(CHANNELS["command"], encode_command(77, tick, u(tick)))
    joined.publish(CHANNELS["command"], encode_command(78, 9, u(0.0)))
    joined.publish(CHANNELS["command"], b"")
    assert [arrival.packet.tick for arrival in inbox.poll()] == [2, 3, 7, 5, 10]
    counts = inbox.counts("command")
    assert counts == {
        "accepted": 5, "late": 1, "duplicates": 2, "lost": 4, "rejected": 3, "refused": {"foreign": 2, "length": 1},
    }  # fmt: skip
    assert json.loads(json.dumps(counts)) == counts


def test_a_long_flight_takes_no_more_memory_and_its_counts_stay_right(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ortilo_drake.hil.inbox.REMEMBERED", 64)
    joined = open_bus(MEMORY_URL)
    inbox = Inbox(joined, ["command"], FLIGHT)

    def send(*ticks: int) -> int:
        for tick in ticks:
            joined.publish(CHANNELS["command"], encode_command(77, tick, u(0.0)))
        return sum(len(inbox.poll()) for _ in ticks)

    assert send(*range(100)) == 100
    tracemalloc.start()
    for tick in range(100, 3000):
        assert send(tick) == 1
    assert tracemalloc.get_traced_memory()[0] < 20_000  # a set of 2900 numbers takes 200 kB
    tracemalloc.stop()
    assert send(*range(2936, 3000)) == 0  # the last 64 are known
    assert send(*range(3000, 3064, 2), *range(3000, 3064, 2)) == 32
    assert send(2**40, 3001, 2**40) == 2  # one from far ahead shuts nothing out
    counts = inbox.counts("command")
    assert (counts["accepted"], counts["duplicates"], counts["late"]) == (3034, 97, 1)
    assert counts["lost"] == 2**40 + 1 - 3034


@pytest.mark.parametrize("udp", [False, True])
def test_thousands_of_bad_packets_on_a_real_bus_are_counted_one_by_one(bus: str, udp: bool) -> None:
    joined = open_bus(bus) if udp else open_bus(MEMORY_URL)
    inbox = Inbox(joined, CHANNELS, FLIGHT)
    rng, rounds, heard = np.random.default_rng(3), 300, 0
    valid = bytearray(encode_vector(77, 3, np.concatenate(([1.0, 0.1], np.zeros(9)))))
    for _ in range(rounds):
        for channel in CHANNELS.values():
            data = valid.copy()
            data[rng.integers(len(data))] ^= 1 << rng.integers(8)
            joined.publish(channel, bytes(data) if rng.random() < 0.5 else rng.bytes(rng.integers(0, 200)))
        heard += len(CHANNELS)
        while inbox.counts()["rejected"] < heard:  # for ever, were one lost
            assert inbox.poll(10) == []
    counts = inbox.counts()
    assert counts["rejected"] == rounds * len(CHANNELS) == sum(counts["refused"].values())
    assert counts["accepted"] == 0
    joined.publish(CHANNELS["imu"], bytes(valid))  # and after all that it still listens
    assert len(inbox.poll(round(1e3 * HANGS))) == 1
