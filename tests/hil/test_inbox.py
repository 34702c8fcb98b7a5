"""An inbox that nothing upsets."""

import gc
import json
import tracemalloc
from dataclasses import asdict

import numpy as np
import pytest
from hil_link import Loop, flight_for_packets, open_bus, settle
from waiting import HANGS

from ortilo_drake.hil.wire.handshake import draw, say_hello
from ortilo_drake.hil.wire.inbox import GOAL_AGE, Inbox
from ortilo_drake.hil.wire.packets import (
    KINDS,
    TELEMETRY,
    Goal,
    Hello,
    Outbox,
    channel_of,
    encode_command,
    encode_vector,
    publish_command,
    publish_goal,
    publish_messages,
    publish_telemetry,
)
from ortilo_drake.model.measurement import make_measurement

FLIGHT = flight_for_packets()
HELLO = Hello("world", 16 * "a", 77, nonce=5)


def u(value: float) -> np.ndarray:
    return np.array([value, 0.0, 0.0, 0.0])


def imu(tick: int) -> bytes:
    return encode_vector(77, tick, np.concatenate(([1.0, tick / 30], np.zeros(9))))


def inbox_and_outbox(*names: str) -> tuple[Inbox, Outbox]:
    joined = Loop()
    return Inbox(joined, names, FLIGHT), Outbox(joined, 77)


def ticks_of(inbox: Inbox) -> list[int]:
    return [arrival.packet.tick for arrival in inbox.poll()]


def test_counts() -> None:
    joined = Loop()
    inbox, outbox, foreign = Inbox(joined, ["command", "hello"]), Outbox(joined, 77), draw()
    outbox.send("command", encode_command(77, 0, u(0.0)))  # before the handshake
    say_hello(joined, HELLO)
    assert [arrival.packet.name for arrival in inbox.poll()] == ["hello"]
    inbox.begin(FLIGHT)
    say_hello(joined, HELLO._replace(session=foreign))
    for tick in (2, 3, 3, 7, 5, 5, 10):  # it joined in flight: 0 and 1 are nobody's loss
        outbox.send("command", encode_command(77, tick, u(tick)))
    outbox.send("command", encode_command(78, 9, u(0.0)))
    joined.publish(channel_of("command"), b"")
    assert ticks_of(inbox) == [2, 3, 7, 5, 10]
    counts = inbox.counts("command")
    assert asdict(counts) == {
        "accepted": 5, "late": 1, "duplicates": 2, "lost": 4, "rejected": 3, "refused": {"foreign": 2, "length": 1},
    }  # fmt: skip
    assert json.loads(json.dumps(asdict(counts))) == asdict(counts)


def test_a_long_flight_takes_no_more_memory_and_its_counts_stay_right(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ortilo_drake.hil.wire.inbox.REMEMBERED", 64)
    inbox, outbox = inbox_and_outbox("command")

    def send(*ticks: int) -> int:
        for tick in ticks:
            outbox.send("command", encode_command(77, tick, u(0.0)))
        return sum(len(inbox.poll()) for _ in ticks)

    assert send(*range(100)) == 100
    tracemalloc.start()
    for tick in range(100, 3000):
        assert send(tick) == 1
    gc.collect()  # what waits on Python's free lists is not kept
    assert tracemalloc.get_traced_memory()[0] < 20_000  # a set of 2900 numbers takes 200 kB
    tracemalloc.stop()
    assert send(*range(2936, 3000)) == 0  # the last 64 are known
    assert inbox.counts().refused == {}
    assert send(2935, 0) == 0  # the others are too old to tell
    assert inbox.counts().refused == {"old": 2}
    assert send(*range(3000, 3064, 2), *range(3000, 3064, 2)) == 32
    assert send(2**24, 3001, 2**24) == 2  # one from far ahead shuts nothing out
    counts = inbox.counts("command")
    assert (counts.accepted, counts.duplicates, counts.late) == (3034, 97, 1)
    assert counts.lost == 2**24 + 1 - 3034


@pytest.mark.long
def test_thousands_of_bad_packets_on_a_real_bus_are_counted_one_by_one(bus: str) -> None:
    server, joined = open_bus(bus, serves=True), open_bus(bus)
    inbox = Inbox(joined, KINDS, FLIGHT)
    settle(server, joined)
    rng, rounds, heard = np.random.default_rng(3), 300, 0
    valid = imu(3)
    for _ in range(rounds):
        for channel in map(channel_of, KINDS):
            data = bytearray(valid)
            data[rng.integers(16)] ^= 1 << rng.integers(8)  # its type, or its session
            server.publish(channel, bytes(data) if rng.random() < 0.5 else rng.bytes(rng.integers(0, 200)))
        heard += len(KINDS)
        while inbox.counts().rejected < heard:  # for ever, were one lost
            assert inbox.poll(10) == []
    counts = inbox.counts()
    assert counts.rejected == rounds * len(KINDS) == sum(counts.refused.values())
    assert counts.accepted == 0
    server.publish(channel_of("imu"), valid)  # and after all that it still listens
    assert len(inbox.poll(round(1e3 * HANGS))) == 1


def test_what_was_there_is_not_taken_again() -> None:
    inbox, outbox = inbox_and_outbox("imu", "tick", "command", "telemetry")
    outputs = {name: np.zeros(size) for name, size in (make_measurement().sizes | TELEMETRY).items()}
    for _ in range(3):  # the same bytes
        outbox.send("imu", imu(5))
        publish_messages(outbox, 5, {})
        publish_command(outbox, 5, {"control": u(1.0)})
        publish_telemetry(outbox, 5, outputs)
    assert sorted(arrival.packet.name for arrival in inbox.poll()) == ["command", "imu", "telemetry", "tick"]
    assert inbox.counts().duplicates == 8


def test_a_half_that_joins_takes_nothing_from_before() -> None:
    inbox, outbox = inbox_and_outbox("imu")
    inbox.begin(FLIGHT, 100)
    for tick in (3, 99, 100, 101):
        outbox.send("imu", imu(tick))
    assert ticks_of(inbox) == [100, 101]
    assert inbox.counts().refused == {"old": 2}


def test_a_flight_that_begins_anew_counts_nothing_of_the_one_before() -> None:
    inbox, outbox = inbox_and_outbox("command")
    for begins, ticks in ((0, (5, 9, 7)), (2, (2, 4))):
        inbox.begin(FLIGHT, begins)
        for tick in ticks:
            outbox.send("command", encode_command(77, tick, u(0.0)))
        assert ticks_of(inbox) == list(ticks)
    assert asdict(inbox.counts("command")) == {
        "accepted": 2,
        "late": 0,
        "duplicates": 0,
        "lost": 1,
        "rejected": 0,
        "refused": {},
    }


def test_the_worlds_hellos_tell_its_tick_and_nobody_elses_do() -> None:
    joined = Loop()
    inbox = Inbox(joined, ["hello"], FLIGHT)
    for tick in (3, 8, 5):
        say_hello(joined, HELLO._replace(tick=tick))
        say_hello(joined, HELLO._replace(role="onboard", tick=1000))
    assert len(inbox.poll()) == 6
    assert inbox.tick == 8


def test_who_has_left_takes_nothing() -> None:
    joined = Loop()
    inbox, stays = Inbox(joined, ["imu", "hello"], FLIGHT), Inbox(joined, ["imu"], FLIGHT)
    inbox.leave()
    Outbox(joined, 77).send("imu", imu(5))
    say_hello(joined, HELLO)
    assert len(stays.poll()) == 1
    assert inbox.poll() == []


def test_an_old_wish_is_not_heard() -> None:
    inbox, outbox = inbox_and_outbox("imu", "goal")
    wish = Goal(77, 400, 1, "user", 1.0, 2.0)
    age = round(GOAL_AGE * 30)
    outbox.send("imu", imu(400 + age))
    publish_goal(outbox, wish)
    publish_goal(outbox, wish)  # may be repeated
    assert [arrival.packet.name for arrival in inbox.poll()] == ["imu", "goal", "goal"]
    outbox.send("imu", imu(401 + age))
    publish_goal(outbox, wish)
    assert [arrival.packet.name for arrival in inbox.poll()] == ["imu"]
    inbox.begin(FLIGHT, 401)  # as a half that was killed, and knows of no wish
    publish_goal(outbox, wish)
    publish_goal(outbox, wish._replace(tick=401))
    assert [arrival.packet.value.tick for arrival in inbox.poll()] == [401]
    assert inbox.counts().refused == {"old": 1}
