"""Checks that a scenario can be flown, the same for `ortilo scenario check` and `ortilo fly`."""

from ortilo_drake.model.input_files import MIB
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.planned import Planned, duration_of, planned
from ortilo_drake.onboard.servo.lq_gain import gain_of, why_no_servo_gain
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import described
from ortilo_drake.sensors.messages import message_size
from ortilo_drake.world.drawn_truth import check_size
from ortilo_drake.world.faults.table import check_room

LARGEST_LOG = 2048 * MIB  # size of one flight's log, 8 hours at 30 Hz; the flight takes about four times that in memory


def flight_ticks(scenario: Scenario, plan: Planned | None = None) -> int:
    """Return the length of a flight in ticks: the duration of its plan plus the time to settle, or its `seconds`.

    `plan` is by default the scenario's. InputError if there is no path, `seconds` is longer, or the log is too large.
    """
    seconds = duration_of(scenario, plan or planned(scenario)) + scenario.settle
    if scenario.seconds is not None:
        if scenario.seconds > seconds:
            longest = f"{seconds:.1f}, the length of the flight of {scenario.name}"
            raise InputError(f"seconds: {scenario.seconds:g}: must be at most {longest}")
        seconds = scenario.seconds
    ticks = round(seconds * scenario.control_rate)
    size = 8 * sum(scenario.measurement.logged_sizes().values()) * ticks
    if size > LARGEST_LOG:
        raise InputError(
            f"control_rate: {scenario.control_rate:g}: a flight of {seconds:g} s logs "
            f"{size / MIB:.0f} MiB, must not exceed {LARGEST_LOG / MIB:.0f} MiB: lower seconds or control_rate"
        )
    return ticks


def check_flyable(scenario: Scenario, plan: Planned | None = None) -> int:
    """Return the length of a flight in ticks, after a check that everything the flight needs is there.

    InputError if there is no path or no servo gain, if the flight needs too much memory, if a registered sensor's
    errors and payload differ in number, if a fault names something that does not exist, if a detector or calibration
    file is wrong, or if this machine cannot render pictures.
    """
    room = scenario.load_room()
    check_room(scenario, room)
    ticks = flight_ticks(scenario, plan)
    if why_no_servo_gain(scenario) is None:
        gain_of(scenario)
    for sensor, errors in dict(scenario.truth.sensors).items():
        if sensor in scenario.sensors:
            check_size(sensor, errors, message_size(described(sensor), scenario, room) - PAYLOAD)
    for sensor in scenario.sensors:
        check = described(sensor).check
        if check is not None:
            check(scenario, room)
    return ticks
