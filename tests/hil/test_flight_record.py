"""The record of a flight in real time, from packets that come late, out of order or never."""

from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.flight.signals import Signals, output_sizes
from ortilo_drake.hil.real_time.real_time_world import COMMAND_PERIOD, FlightRecord, look_times
from ortilo_drake.hil.wire.unpack import Packet
from ortilo_drake.scenario import load_scenario

SCENARIO = load_scenario("nominal_imu_uwb")
OUTPUTS = output_sizes(SCENARIO.measurement)


def telemetry(k: int) -> Signals:
    return {name: np.full(size, float(k)) for name, size in OUTPUTS.items() if name != "control"}


@given(st.lists(st.sampled_from(["nothing", "command", "telemetry", "both"]), min_size=1, max_size=20), st.randoms())
def test_every_tick_is_told_once_in_order_with_what_came(fates: list[str], chance: Random) -> None:
    told: list[tuple[int, np.ndarray | None, Signals, Signals]] = []
    flown = FlightRecord(SCENARIO, lambda *tick: told.append(tick))
    packets = []
    for k, fate in enumerate(fates):
        flown.send(np.full(12, float(k)), {"imu": np.full(5, float(k))})
        if fate in ("command", "both"):
            packets.append(Packet("command", k, np.full(4, float(k))))
        if fate in ("telemetry", "both"):
            packets.append(Packet("telemetry", k, telemetry(k)))
    chance.shuffle(packets)
    for packet in packets:
        flown.receive(packet)
    flown.record_until(len(fates) // 2)
    assert [k for k, *_ in told] == list(range(len(fates) // 2))
    flown.record_until(len(fates) + 5)
    assert [k for k, *_ in told] == list(range(len(fates)))
    for (k, x, messages, outputs), fate in zip(told, fates, strict=True):
        assert x is not None
        assert set(x) == {k} == set(messages["imu"])
        there = {"nothing": set(), "command": {"control"}, "telemetry": set(telemetry(0)), "both": set(OUTPUTS)}[fate]
        assert list(outputs) == list(OUTPUTS)  # the order of the log's rows
        for name, value in outputs.items():
            assert value.shape == (OUTPUTS[name],)
            assert (value == k).all() if name in there else np.isnan(value).all()


@given(st.integers(0, 10**5), st.sampled_from([5.0, 30.0, 100.0, 333.0, 1000.0]))
def test_the_world_looks_once_a_millisecond_and_at_the_end_of_every_tick(k: int, rate: float) -> None:
    h = 1.0 / rate
    moments = np.array(look_times(k * h, (k + 1) * h))
    assert moments[-1] == (k + 1) * h
    steps = np.diff([k * h, *moments])
    assert (steps > 0.0).all()
    assert (steps < COMMAND_PERIOD + 1e-6).all()
    np.testing.assert_allclose(moments[:-1] / COMMAND_PERIOD, np.round(moments[:-1] / COMMAND_PERIOD), atol=1e-6)
    assert len(moments) == pytest.approx(h / COMMAND_PERIOD, abs=1.001)
