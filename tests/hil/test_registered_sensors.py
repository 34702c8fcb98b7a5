"""What registered sensors send crosses between the halves as the built-in ones' messages do, within limits."""

import numpy as np
import pytest
import xarray as xr
from hil_link import KEY, answering, flight_for_packets
from waiting import HANGS

from ortilo_drake.flight.flight import fly
from ortilo_drake.hil import sessions
from ortilo_drake.hil.wire.handshake import flight_of
from ortilo_drake.hil.wire.limits import LARGEST, limits_of
from ortilo_drake.hil.wire.packets import PORTS, TELEMETRY, encode_telemetry, encode_tick, encode_vector, ports
from ortilo_drake.hil.wire.unpack import BadPacket, Flight, Packet, decode
from ortilo_drake.model import parts
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.parts import find_sensor, register_sensor
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.scenario import load_scenario

LATE = ("altimeter.link.delay=2", "flow.link={delay: 1, random_delay: 3}")
SCENARIO = load_scenario("flow", LATE)
SESSION, TICK = 77, 300
FLIGHT = flight_of(SCENARIO, SESSION)
SIZES = {"y": 9 + 1 + 2, "delta": 3 + 1 + 1, "V2": 3 * 9 + 1 + 4}  # of the paper's sensors, altimeter and flow
MESSAGES = {"altimeter": np.array([1.0, TICK * FLIGHT.h, 1.4]), "flow": np.array([1.0, TICK * FLIGHT.h, *5 * [0.5]])}


def opened(name: str, body: bytes, flight: Flight = FLIGHT) -> Packet:
    return decode(name, body, flight)


def verdict(name: str, body: bytes, flight: Flight = FLIGHT) -> str:
    try:
        opened(name, body, flight)
    except BadPacket as problem:
        return problem.reason
    return "accepted"


def test_messages_and_their_list_come_back_as_they_were_sent() -> None:
    for name, message in MESSAGES.items():
        assert name in ports()
        assert name not in PORTS
        packet = opened(name, encode_vector(SESSION, TICK, message))
        assert (packet.name, packet.tick) == (name, TICK)
        np.testing.assert_array_equal(packet.value, message)
    assert opened("tick", encode_tick(SESSION, TICK, ("imu", *MESSAGES))).value == ("imu", *MESSAGES)
    assert verdict("tick", encode_tick(SESSION, TICK, ("imu", "nobody_has_it"))) == "text"


@pytest.mark.parametrize("name", MESSAGES)
def test_what_no_such_sensor_sends_is_refused(name: str) -> None:
    message = MESSAGES[name]
    assert verdict(name, encode_vector(SESSION, TICK, message[:-1])) == "length"
    assert verdict(name, encode_vector(SESSION, TICK, np.append(message, 0.0))) == "length"
    assert verdict(name, encode_vector(SESSION, TICK, np.where(message == 1.0, 0.5, message))) == "value"
    for i in range(PAYLOAD, len(message)):
        for wrong in (np.nan, np.inf, -np.inf):
            spoilt = message.copy()
            spoilt[i] = wrong
            assert verdict(name, encode_vector(SESSION, TICK, spoilt)) == "value"
    assert verdict(name, encode_vector(SESSION, TICK, message), flight_for_packets(SESSION)) == "channel"


def test_both_sides_of_each_bound() -> None:
    """By hand: 8 m and ten times hypot(0.02, 0.08) m; 7.4 rad/s and ten times the noise at the worst quality."""
    largest = {"altimeter": [8.0 + 10.0 * np.hypot(0.02, 0.08)], "flow": [11.4, 11.4, 1e3, 1e3, 1.0]}
    least = {"altimeter": [0.0], "flow": [-11.4, -11.4, -1e3, -1e3, 0.0]}
    for name, message in MESSAGES.items():
        limits = FLIGHT.limits[name]
        np.testing.assert_allclose(limits.high[PAYLOAD:], largest[name], rtol=1e-12)
        np.testing.assert_allclose(limits.low[PAYLOAD:], least[name], rtol=1e-12)
        for i in range(PAYLOAD, len(message)):
            for bound, beyond in ((limits.low[i], -np.inf), (limits.high[i], np.inf)):
                for value, expected in ((bound, "accepted"), (np.nextafter(bound, beyond), "value")):
                    at = message.copy()
                    at[i] = value
                    assert verdict(name, encode_vector(SESSION, TICK, at)) == expected


@pytest.mark.parametrize(("name", "oldest"), [("altimeter", 2), ("flow", 4)])
def test_a_stamp_is_as_old_as_the_sensor_s_link_may_delay_it(name: str, oldest: int) -> None:
    for age, expected in {0.0: "accepted", -0.01: "stamp", oldest: "accepted", oldest + 0.01: "stamp"}.items():
        message = MESSAGES[name].copy()
        message[1] = (TICK - age) * FLIGHT.h
        assert verdict(name, encode_vector(SESSION, TICK, message)) == expected


def test_telemetry_has_the_sizes_of_the_flight_s_sensors() -> None:
    rng = np.random.default_rng(4)
    outputs = {name: rng.uniform(0.0, 1.0, size) for name, size in (SIZES | TELEMETRY).items()}
    body = encode_telemetry(SESSION, TICK, outputs)
    found = opened("telemetry", body).value
    assert found.keys() == outputs.keys()
    for name, values in outputs.items():
        np.testing.assert_array_equal(found[name], values)
    assert verdict("telemetry", body, flight_for_packets(SESSION)) == "length"
    fewer = encode_telemetry(SESSION, TICK, outputs | {"V2": outputs["V2"][:-1]})
    assert verdict("telemetry", fewer) == "length"
    assert verdict("telemetry", encode_telemetry(SESSION, TICK, outputs | {"delta": np.full(5, 2.0)})) == "value"


def test_a_sensor_without_limits_of_its_own_has_wide_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    altimeter = find_sensor("altimeter")
    assert altimeter is not None
    monkeypatch.setitem(parts._SENSORS, "altimeter", parts.Sensor(**vars(altimeter) | {"limits": None}))
    limits = limits_of(SCENARIO)["altimeter"]
    np.testing.assert_array_equal(limits.low, [0.0, -np.inf, -LARGEST])
    np.testing.assert_array_equal(limits.high, [1.0, np.inf, LARGEST])


@pytest.mark.parametrize("name", ["hello", "goal", "telemetry", "measurement", "y", "estimate", "state"])
def test_no_sensor_takes_the_name_of_another_signal_or_packet(name: str) -> None:
    altimeter = find_sensor("altimeter")
    assert altimeter is not None
    with pytest.raises(InputError, match=f"sensor: '{name}': must be"):
        register_sensor(parts.Sensor(**vars(altimeter) | {"name": name}))


@pytest.mark.family
@pytest.mark.parametrize(
    "settings",
    [(), (*LATE, "estimator.delay=replay"), ("imu.link.rate=240", "altimeter.link.rate=60", "flow.link.rate=90")],
    ids=["punctual", "late", "faster"],
)
def test_in_lockstep_the_flight_is_that_of_a_single_process(settings: tuple[str, ...], bus: str) -> None:
    scenario = load_scenario("flow", ("settle=0", "planner={kind: hover, duration: 1.0}", *settings))
    alone = fly(scenario)
    del alone.attrs["real_time_factor"]
    with answering(scenario, bus) as answered:
        flight, report = sessions.run_world(scenario, bus, KEY, True, HANGS)
        assert answered.result(HANGS) == flight.sizes["tick"]
    assert xr.Dataset.identical(flight, alone)
    assert report.packets.rejected == 0
    used = flight["arrival"].sel(sensor=["altimeter", "flow"]).sum("tick").values
    assert (used > 15).all()  # of 31 ticks; messages that come in one tick take each other's place
