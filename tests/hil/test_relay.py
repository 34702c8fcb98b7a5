"""The relay's faults follow their laws and their seed, and packets pass both ways."""

import subprocess
import sys
import threading
from typing import Any

import numpy as np
import pytest
from hil_link import KEY, flight_for_packets, open_bus, refuses
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, geom, kstest
from waiting import HANGS, wait_for

from ortilo_drake.hil.relay.relay import FaultModel, Faults, run_relay
from ortilo_drake.hil.wire.address import address
from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.handshake import say_hello
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.packets import Goal, Hello, Outbox, channel_of, encode_command, encode_vector, publish_goal
from ortilo_drake.hil.wire.urls import DEFAULT_URL, ONBOARD_URL
from ortilo_drake.model.typed_yaml import InputError

N = 4000
FLIGHT = flight_for_packets()


def fates(faults: Faults, seed: int = 1, n: int = N, period: float = 0.01) -> list[list[float]]:
    """Return the delays of the copies of each of n packets."""
    line = FaultModel(faults, seed, "to_onboard")
    return [[due - k * period for due in line.due_times("imu", k * period)] for k in range(n)]


def test_without_faults_everything_passes_at_once() -> None:
    assert fates(Faults()) == N * [[0.0]]


def test_loss_and_duplication_are_binomial() -> None:
    copies = [len(fate) for fate in fates(Faults(loss=0.2, duplicate=0.1))]
    lost = copies.count(0)
    assert binomtest(lost, N, 0.2).pvalue > 1e-3
    assert binomtest(copies.count(2), N - lost, 0.1).pvalue > 1e-3
    # Independent: as many pairs of losses as p^2 says.
    pairs = sum(a == b == 0 for a, b in zip(copies[::2], copies[1::2], strict=True))
    assert binomtest(pairs, N // 2, 0.04).pvalue > 1e-3


def test_delays_are_uniform_and_overtake() -> None:
    delays = np.array([fate[0] for fate in fates(Faults(delay=0.04, spread=0.02))])
    assert kstest(delays, "uniform", args=(0.02, 0.04)).pvalue > 1e-3
    arrivals = np.arange(N) * 0.01 + delays
    # Two that start 10 ms apart overtake if their delays, uniform over 40 ms, differ by more: (1 - 1/4)^2 / 2.
    overtaken = int((np.diff(arrivals)[::2] < 0.0).sum())
    assert binomtest(overtaken, N // 2, 0.75**2 / 2).pvalue > 1e-3


def test_bursts_are_geometric() -> None:
    faults = Faults(into_burst=0.05, out_of_burst=0.25)
    lost = np.array([not fate for fate in fates(faults)])
    edges = np.flatnonzero(np.diff(np.concatenate(([False], lost, [False]))))
    lengths = edges[1::2] - edges[::2]
    assert abs(lost.mean() - 0.05 / 0.30) < 0.03  # the chain's stationary law; its standard error is 0.014
    # Mean 4, standard deviation sqrt(1 - p) / p.
    assert abs(lengths.mean() - 4.0) < 3.3 * geom.std(0.25) / np.sqrt(lengths.size)


def test_held_packets_come_later() -> None:
    delays = [fate[0] for fate in fates(Faults(held=0.3, hold=0.5))]
    np.testing.assert_allclose(np.unique(np.round(delays, 9)), [0.0, 0.5])
    assert binomtest(sum(delay > 0.25 for delay in delays), N, 0.3).pvalue > 1e-3


def test_a_rate_spaces_packets_and_a_full_queue_loses_them() -> None:
    line = FaultModel(Faults(rate=100.0, queue=10), 1, "to_world")
    arrivals = [due for _ in range(50) for due in line.due_times("command", 2.0)]
    np.testing.assert_allclose(arrivals, 2.0 + 0.01 * np.arange(11))  # one goes at once, ten wait
    assert line.counts["crowded"] == 39
    np.testing.assert_allclose(line.due_times("command", 3.0), [3.0])


@given(seed=st.integers(0, 2**31), loss=st.floats(0, 1), other=st.integers(1, 5))
def test_the_same_seed_gives_the_same_fate_whatever_else_is_sent(seed: int, loss: float, other: int) -> None:
    faults = Faults(loss=loss, delay=0.04, spread=0.02, duplicate=0.2, into_burst=0.1)
    mixed, fate = FaultModel(faults, seed, "to_onboard"), []
    for k in range(30):
        for _ in range(k % other):
            mixed.due_times("uwb", 0.0)
        fate.append(mixed.due_times("imu", 0.0))
    assert fate == fates(faults, seed, 30, 0.0)


def test_seeds_directions_and_channels_differ() -> None:
    faults = Faults(delay=0.04, spread=0.02)
    lines = [
        ("imu", FaultModel(faults, 1, "a")),
        ("imu", FaultModel(faults, 2, "a")),
        ("imu", FaultModel(faults, 1, "b")),
    ]
    lines.append(("uwb", FaultModel(faults, 1, "a")))
    assert len({line.due_times(channel, 0.0)[0] for channel, line in lines}) == 4


@pytest.mark.parametrize(
    "bad", [{"loss": 1.1}, {"loss": -0.1}, {"delay": -1.0}, {"queue": 0}, {"losss": 0.1}, {"rate": -1.0}]
)
def test_bad_faults_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(InputError):
        Faults(**bad)


def test_one_bus_is_not_enough(bus: str) -> None:
    for same in (bus, bus.replace("127.0.0.1", "localhost")):
        with pytest.raises(InputError, match="two different buses"):
            run_relay(KEY, bus, same)


@pytest.mark.processes
@pytest.mark.parametrize("module", ["ortilo_drake.hil.wire.urls", "ortilo_drake.commands.hil.app"])
def test_the_buses_are_known_without_drake(module: str) -> None:
    code = f"import sys, {module}; print(sorted(sys.modules.keys() & {{'pydrake', {module!r}}}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str([module])
    assert address(DEFAULT_URL) != address(ONBOARD_URL)


def hear(inbox: Inbox, n: int = 1) -> list[Any]:
    """Return the next n packets or more."""
    came: list[Any] = []

    def listen() -> bool:
        came.extend(arrival.packet for arrival in inbox.poll(10))
        return len(came) >= n

    wait_for(listen, f"{n} packets")
    return came


def join(onboard: Bus, at_world: Inbox, of_world: Outbox, line: FaultModel) -> int:
    """Return how many ticks were sent to the onboard half until packets pass a relay both ways.

    All that passes is there then: `line` says which tick is the last that does, and of the hellos the last is another.
    """
    there: list[bytes] = []
    onboard.subscribe(channel_of("tick"), there.append)
    heard = sent = 0

    def passes() -> bool:
        nonlocal heard, sent
        say_hello(onboard, Hello("onboard", 16 * "0", 77))
        of_world.send("tick", b"%d" % sent)
        sent += 1
        onboard.handle(10)
        heard += len(at_world.poll(10))
        return bool(heard and there)

    wait_for(passes, "packets")
    passing, last = [k for k in range(sent) if line.due_times("tick", 0.0)], Hello("onboard", 16 * "0", 77, nonce=1)
    say_hello(onboard, last)
    wait_for(lambda: onboard.handle(10) == 0 and there[-1] == b"%d" % passing[-1], "the last tick")
    wait_for(lambda: last in [arrival.packet.value for arrival in at_world.poll(10)], "the last hello")
    return sent


def test_a_relay_passes_both_ways_without_echo_and_with_its_faults(bus: str, other_bus: str) -> None:
    world, onboard = open_bus(bus, serves=True), open_bus(other_bus)
    stop, ready, result = threading.Event(), threading.Event(), {}
    relay = threading.Thread(
        target=lambda: result.update(run_relay(KEY, bus, other_bus, Faults(loss=0.5), None, 5, HANGS, stop, ready)),
        daemon=True,
    )
    relay.start()
    assert ready.wait(HANGS)
    of_world, of_onboard = Outbox(world, 77), Outbox(onboard, 77)
    at_world, at_onboard = Inbox(world, ["command", "hello", "goal"], FLIGHT), Inbox(onboard, ["imu", "goal"], FLIGHT)
    wait_for(lambda: world.handle(10) or world._others, "the relay")
    ticks = join(onboard, at_world, of_world, FaultModel(Faults(loss=0.5), 5, "to_onboard"))
    line = FaultModel(Faults(loss=0.5), 5, "to_onboard")
    passed = [tick for tick in range(12) if line.due_times("imu", 0.0)]
    for tick in range(12):
        of_world.send("imu", encode_vector(77, tick, np.concatenate(([1.0, tick / 30], np.zeros(9)))))
    came = [(packet.name, packet.tick) for packet in hear(at_onboard, len(passed))]
    assert came == [("imu", tick) for tick in passed]  # the very packets that the seed lets pass
    for tick in range(3):
        of_onboard.send("command", encode_command(77, tick, np.zeros(4)))
    say_hello(onboard, Hello("onboard", 16 * "0", 77))
    came = [(packet.name, packet.tick) for packet in hear(at_world, 4)]
    assert came == [*(("command", tick) for tick in range(3)), ("hello", -1)]
    wish = Goal(77, 2, 2**61 + 1, "user", 1.5, -2.0)
    answer = wish._replace(role="onboard", reason="no way")
    fate = [bool(line.due_times("goal", 0.0)) for _ in range(8)]
    for passes in fate:
        publish_goal(of_world, wish)
        if passes:
            assert [packet.value for packet in hear(at_onboard)] == [wish]
    publish_goal(of_onboard, answer)
    assert [packet.value for packet in hear(at_world)] == [answer]
    assert at_onboard.poll(50) == []  # no echo
    stop.set()
    relay.join(HANGS)
    assert not relay.is_alive()
    passed_back = result["to_world"]
    assert (passed_back["lost"], passed_back["crowded"], passed_back["duplicated"]) == (0, 0, 0)
    assert passed_back["taken"] == passed_back["sent"] >= 6  # the hellos at the start among them
    assert (result["to_onboard"]["taken"], result["to_onboard"]["sent"]) == (
        ticks + 12 + 8,
        sum(bool(line.due_times("tick", 0.0)) for _ in range(ticks)) + len(passed) + sum(fate),
    )


def test_a_stranger_at_the_onboard_halfs_bus_fills_no_memory(bus: str, other_bus: str) -> None:
    stop, ready = threading.Event(), threading.Event()
    relay = threading.Thread(
        target=run_relay, args=(KEY, bus, other_bus, None, None, 1, HANGS, stop, ready), daemon=True
    )
    relay.start()
    assert ready.wait(HANGS)
    try:
        assert refuses(other_bus, 2**19)
    finally:
        stop.set()
        relay.join(HANGS)
    assert not relay.is_alive()
