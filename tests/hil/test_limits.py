"""Limits that no flight reaches, and what lies beyond them is refused."""

from itertools import product

import numpy as np
import pytest

from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.hil.wire.handshake import flight_of
from ortilo_drake.hil.wire.limits import FARTHEST, limits_of
from ortilo_drake.hil.wire.packets import (
    TELEMETRY,
    Goal,
    Outbox,
    encode_command,
    encode_goal,
    encode_telemetry,
    encode_vector,
    publish_command,
    publish_messages,
    publish_telemetry,
)
from ortilo_drake.hil.wire.unpack import BadPacket, Flight, decode
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.model.vehicle import Arm, Vehicle, mixing_matrix
from ortilo_drake.scenario import Scenario, load_scenario, scenario_names
from ortilo_drake.sensors.envelope import largest_command

LATE = ("camera.link.delay=2", "camera.link.random_delay=1", "imu.link.delay=3")
SETTINGS = ("camera.kind=projected", "servo.velocities=truth", *LATE)
SCENARIO = load_scenario("nominal_imu_uwb_yolo", SETTINGS)
FLIGHT = flight_of(SCENARIO, 7)
LISTENS = flight_of(load_scenario("tight_differences"), 7)
TICK = 300
OUTPUTS = SCENARIO.measurement.sizes | TELEMETRY


def verdict(name: str, body: bytes, flight: Flight = FLIGHT) -> str:
    try:
        decode(name, body, flight)
    except BadPacket as problem:
        return problem.reason
    return "accepted"


def vector(name: str, flight: Flight = FLIGHT) -> np.ndarray:
    limits = flight.limits[name]
    values = np.zeros(limits.low.size)
    values[:PAYLOAD] = 1.0, TICK * FLIGHT.h
    return values


def bounds(low: np.ndarray, high: np.ndarray) -> list[tuple[int, float, float]]:
    """Return for each bound its index, the number at it and the next one beyond."""
    lower = [(i, bound, np.nextafter(bound, -np.inf)) for i, bound in enumerate(low)]
    upper = [(i, bound, np.nextafter(bound, np.inf)) for i, bound in enumerate(high)]
    return [*lower, *upper]


@pytest.mark.parametrize(
    ("name", "flight"), [*((name, FLIGHT) for name in ("imu", "uwb", "detections", "velocity")), ("uwb", LISTENS)]
)
def test_both_sides_of_each_bound_of_a_message(name: str, flight: Flight) -> None:
    limits = flight.limits[name]
    for i, at, beyond in bounds(limits.low[PAYLOAD:], limits.high[PAYLOAD:]):
        for value, expected in ((at, "accepted"), (beyond, "value")):
            values = vector(name, flight)
            values[PAYLOAD + i] = value
            assert verdict(name, encode_vector(7, TICK, values), flight) == expected, (i, value)


def test_both_sides_of_each_bound_of_a_command_and_of_a_goal() -> None:
    for i, at, beyond in bounds(FLIGHT.limits["command"].low, FLIGHT.limits["command"].high):
        for value, expected in ((at, "accepted"), (beyond, "value")):
            u = np.zeros(4)
            u[i] = value
            assert verdict("command", encode_command(7, TICK, u)) == expected
    for value, expected in ((FARTHEST, "accepted"), (np.nextafter(FARTHEST, np.inf), "value")):
        for x, y in ((value, 0.0), (-value, 0.0), (0.0, value), (0.0, -value)):
            assert verdict("goal", encode_goal(Goal(7, TICK, 1, "user", x, y))) == expected


@pytest.mark.parametrize("name", OUTPUTS)
def test_both_sides_of_each_bound_of_telemetry(name: str) -> None:
    limits = FLIGHT.limits[name]
    for i, at, beyond in bounds(limits.low, limits.high):
        for value, expected in ((at, "accepted"), (beyond, "value")):
            outputs = {key: np.zeros(size) for key, size in OUTPUTS.items()}
            outputs["reference"][:3] = SCENARIO.load_room().interior.min
            outputs[name][i] = value
            assert verdict("telemetry", encode_telemetry(7, TICK, outputs)) == expected


@pytest.mark.parametrize(("name", "oldest"), [("imu", 3), ("uwb", 0), ("detections", 4), ("velocity", 0)])
def test_both_sides_of_the_oldest_and_the_newest_stamp(name: str, oldest: int) -> None:
    ages = {0.0: "accepted", -0.01: "stamp", oldest: "accepted", oldest + 0.01: "stamp"}
    for age, expected in ages.items():
        values = vector(name)
        values[1] = (TICK - age) * FLIGHT.h
        assert verdict(name, encode_vector(7, TICK, values)) == expected


def test_the_limits_are_what_they_say() -> None:
    # By hand for the M100 (52.2 N, 3.14 N m, 2.7 kg) in the authors' room, whose diagonal is 32.4 m.
    limits, room = FLIGHT.limits, SCENARIO.load_room()
    diagonal = np.linalg.norm(np.subtract(room.interior.max, room.interior.min))
    np.testing.assert_allclose(limits["command"].high, 8 * np.array([52.2, 3.138, 3.138, 1.110]), rtol=1e-3)
    assert 3 * np.pi / 4 < limits["imu"].high[PAYLOAD] < np.pi  # of tilt: 60 degrees, and what a tick may add
    assert limits["velocity"].high[PAYLOAD] == pytest.approx(np.sqrt(2 * (8 * 53.2 / 2.7) * diagonal), rel=0.05)
    assert (limits["uwb"].high[PAYLOAD : PAYLOAD + len(SCENARIO.load_room().anchors)] < 1.5 * diagonal).all()
    assert limits["uwb"].low.min() == -np.inf  # the stamp's, which has a check of its own
    row, classes = limits["detections"].high[PAYLOAD : PAYLOAD + 6], len(room.classes)
    np.testing.assert_array_equal(row, [classes - 1, 1, 319.5, 239.5, 319.5, 239.5])


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.long] * (name != "nominal_imu_uwb_yolo")) for name in scenario_names()],
)
def test_no_ready_made_flight_reaches_a_limit(name: str) -> None:
    """The whole flight, but for rendered pictures, through the bytes."""
    scenario = load_scenario(name, ("camera.kind=projected",))
    check_packets(scenario)


@pytest.mark.family
@pytest.mark.parametrize(
    "settings",
    [
        ("estimator.initial_sd=[0.5, 0.3, 0.5, 0.5]", "world.disturbance.force_density=1.64"),
        ("uwb.link.blackouts=[{kind: time, start: 3, end: 1000}]", "sensors=[uwb]"),
    ],
)
def test_a_flight_that_is_lost_reaches_no_limit_before_it_counts_as_lost(settings: tuple[str, ...]) -> None:
    flight = check_packets(load_scenario("nominal_imu_uwb", settings))
    assert flight.attrs["lost"] != "null"


class Reader:
    """In place of a bus: every packet of a flight must pass the other half's checks."""

    def __init__(self, scenario: Scenario):
        self.flight, self.read = flight_of(scenario, 7), 0

    def publish(self, channel: str, data: bytes) -> None:
        decode(channel.removeprefix("ORTILO_").lower(), data, self.flight)
        self.read += 1


def check_packets(scenario: Scenario):  # type: ignore[no-untyped-def]
    reader = Reader(scenario)
    outbox = Outbox(reader, 7)  # type: ignore[arg-type]

    def record(k: int, x: np.ndarray, messages: dict[str, np.ndarray], outputs: dict[str, np.ndarray]) -> None:
        publish_messages(outbox, k, messages)
        publish_command(outbox, k, outputs)
        publish_telemetry(outbox, k, outputs)

    flight = fly_lockstep(scenario, in_this_process(scenario), record=record)
    assert reader.read > 3 * flight.sizes["tick"]
    return flight


def test_limits_grow_with_what_they_come_from() -> None:
    density = SCENARIO.imu.angle_density  # of 0.01 rad in a tick
    noisy = limits_of(load_scenario("nominal_imu_uwb_yolo", (*SETTINGS, f"imu.angle_density={2.0 * density!r}")))
    here = limits_of(SCENARIO)
    np.testing.assert_allclose(noisy["imu"].high[2:5] - here["imu"].high[2:5], 0.1)
    biased = limits_of(load_scenario("nominal_imu_uwb_yolo", (*SETTINGS, "uwb.walls={kind: bias, per_wall: 1}")))
    walls = len(SCENARIO.load_room().wall_boxes)
    ranges = slice(PAYLOAD, PAYLOAD + len(SCENARIO.load_room().anchors))
    np.testing.assert_allclose(biased["uwb"].high[ranges] - here["uwb"].high[ranges], walls)


def test_the_largest_command_is_the_most_that_some_of_the_rotors_make() -> None:
    arms = [Arm(angle=a, length=0.3, spin=spin) for a, spin in ((0.1, 1), (1.2, -1), (2.2, 1), (-2.9, -1), (-1.3, 1))]
    vehicle = Vehicle(arms=tuple(arms))
    at_full_speed = np.array(list(product((0.0, 838.0**2), repeat=5)))
    most = np.abs(at_full_speed @ mixing_matrix(vehicle).T).max(axis=0)
    np.testing.assert_allclose(largest_command(vehicle), 8.0 * most, rtol=1e-12)


def test_both_sides_of_each_bound_of_a_report_of_what_acted() -> None:
    message = vector("acted")
    assert verdict("acted", encode_vector(7, TICK, message)) == "accepted"
    limits = FLIGHT.limits["acted"]
    for i in range(PAYLOAD, message.size):
        for bound, beyond in ((limits.low[i], -np.inf), (limits.high[i], np.inf)):
            for value, expected in ((bound, "accepted"), (np.nextafter(bound, beyond), "value"), (np.nan, "value")):
                at = message.copy()
                at[i] = value
                assert verdict("acted", encode_vector(7, TICK, at)) == expected
    message[1] += FLIGHT.h
    assert verdict("acted", encode_vector(7, TICK, message)) == "stamp"
