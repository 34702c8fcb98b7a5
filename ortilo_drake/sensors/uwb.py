"""The complete description of the uwb sensor, which measures ranges to the room's anchors."""

from collections.abc import Mapping
from itertools import product

import numpy as np
from pydrake.systems.framework import System

from ortilo_drake.loop.element import Box, Values
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.measurement import UWB
from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.range_pairs import ROW, THERE, A, B, differences_size
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, FIX_SIZE, PAYLOAD, uwb_size
from ortilo_drake.onboard.ranging.fix_element import fix_box
from ortilo_drake.onboard.ranging.multilateration import fix_message_at
from ortilo_drake.scenario import Belief, Scenario, Uwb
from ortilo_drake.sensors import uwb_theory
from ortilo_drake.sensors.envelope import SIGMAS, envelope_of
from ortilo_drake.sensors.information_rows import Information
from ortilo_drake.sensors.information_uwb import difference_rows, range_rows
from ortilo_drake.sensors.messages import solver_system
from ortilo_drake.world.drawn_truth import AtStart, Drawn, draw_truth
from ortilo_drake.world.faults.fault_element import fault_out
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.sensors.fitted_uwb import fitted_box, fitted_drawn, largest_sd, noise_of
from ortilo_drake.world.sensors.range_differences import differences_box, differences_drawn
from ortilo_drake.world.sensors.range_paths import STREAM as PATHS_STREAM
from ortilo_drake.world.sensors.range_paths import paths_box, paths_out
from ortilo_drake.world.sensors.uwb import receiver_of, uwb_box, uwb_message

MEANS = 50.0  # an exponential length above 50 times its mean is as rare as 10 standard deviations


def make_solver(scenario: Belief, room: Room) -> System:
    """Return the multilateration as a System."""
    solver = fix_box(scenario.multilateration, room.anchor_positions)
    return solver_system("uwb", uwb_size(len(room.anchors)), solver, scenario.h)


def believed_V(scenario: Belief) -> np.ndarray | None:
    """Return the fix's noise covariance in the filter's settings, None if each fix has its own covariance."""
    its = scenario.linear_filter
    return None if its is None or its.V.uwb is None else np.diag(its.V.uwb)


def messages_again(scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return a flight's uwb messages (m, 2 + 2 a), computed again from its true states (n, 12).

    The scenario has the flight's seed, the room is the surveyed one; messages reached the vehicle in the ticks marked
    in `seen` (n). InputError if the sensor is faster than the tick, gives differences, or has fitted errors.
    """
    if scenario.uwb.kind == "differences":
        raise InputError("uwb.kind: differences: must be ranges: a survey takes single ranges")
    if scenario.uwb.errors == "fitted":
        raise InputError("uwb.errors: fitted: the lasting errors cannot be computed again: give the flight's log")
    if scenario.samples("uwb") > 1:
        raise InputError("uwb.link.rate: ranges of a sensor faster than the tick are not computed again: give its log")
    size = uwb_size(len(room.anchors))
    drawn = draw_truth(scenario.truth, scenario.seed, room, {"uwb": size - PAYLOAD})
    anchors = np.ascontiguousarray(room.anchor_positions + drawn["survey.anchors"])
    receiver = receiver_of(scenario.uwb, room)._replace(anchors=anchors, bias=drawn["uwb.bias"])
    stream, h = stream_id("uwb"), scenario.h
    messages = [uwb_message(truth[k], receiver, scenario.seed, stream, k * h, h) for k in np.flatnonzero(seen)]
    return np.array(messages).reshape(-1, size)


def covariance(scenario: Scenario, room: Room, x: np.ndarray) -> np.ndarray | None:
    """Return the covariance of the fix if the estimate is x (12), computed by the onboard solver.

    None for differences: one message has too few.
    """
    if scenario.uwb.kind == "differences":
        return None
    ranges = uwb_theory.message_without_noise(scenario, room, x)
    fix = fix_message_at(scenario.multilateration, room.anchor_positions, ranges, x)
    return fix[PAYLOAD + 3 : FIX_SIZE].reshape(3, 3) if fix[ARRIVED] else None


def information(scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> Information:
    """Return the information of the ranges, or of their differences, see sensors/information_uwb.py."""
    if scenario.uwb.kind == "differences":
        return Information({"uwb": difference_rows(scenario, room, truth, seen)})
    return Information({"uwb": range_rows(scenario.uwb, room, truth, seen)})


def drawn(scenario: Scenario, room: Room, its: Drawn, boxes: Mapping[str, Box]) -> dict[str, Values]:
    """Return the anchors' true positions and the lasting errors of their ranges, for the sensor and its faults."""
    anchors = room.anchor_positions + its["survey.anchors"]
    numbers = {"factor": float(its["uwb.factor"])} if scenario.uwb.kind == "differences" else {}
    found = {"uwb": Values(numbers, tables={"receiver_anchors": anchors, "receiver_bias": its["uwb.bias"]})}
    moved = Values(tables={"anchors": anchors})
    return found | {name: moved for name, box in boxes.items() if box.element.out in (fault_out, paths_out)}


def solver(scenario: Belief, room: Room) -> Box:
    """Return the box of the multilateration; it also reads the survey and the noise scale if they are learned."""
    settings, box = scenario.multilateration, fix_box(scenario.multilateration, room.anchor_positions)
    if settings.noise_scale is None and settings.bias_bank is None:
        return box
    return box.with_inputs(noise="uwb_bank.noise", learned="uwb_bank.learned")


def errors_drawn(scenario: Scenario, room: Room, draw: AtStart) -> dict[str, Values]:
    """Return a seed's draws of slow and constant errors, for fitted errors and for differences."""
    if "uwb" not in scenario.sensors:
        return {}
    if scenario.uwb.kind == "differences":
        return {"uwb": differences_drawn(scenario, room, draw)}
    if scenario.uwb.errors != "fitted":
        return {}
    return {"uwb": fitted_drawn(scenario.uwb, len(room.anchors), scenario.h, draw)}


def paths_drawn(boxes: Mapping[str, Box], draw: AtStart) -> dict[str, Values]:
    """Return the draw of the initial excess lengths of ranges behind walls."""
    if "uwb_paths" not in boxes:
        return {}
    return {"uwb_paths": Values(start={"x": draw(PATHS_STREAM, len(boxes["uwb_paths"].given.start["x"]))})}


def payload(scenario: Belief, room: Room) -> int:
    """Return the size of a message's payload."""
    if scenario.uwb.kind == "differences":
        return differences_size(scenario.uwb.rows(scenario.h)) - PAYLOAD
    return uwb_size(len(room.anchors)) - PAYLOAD


def paths(scenario: Scenario, room: Room, message: Box, samples: int) -> Box | None:
    """Return the box that lengthens ranges to their signals' paths; None if all paths are straight and instant."""
    box = paths_box(scenario.uwb, room, scenario.h)
    return None if box is None else box.with_inputs(message=message.name)


def source(scenario: Scenario, room: Room, whole: bool) -> Box:
    """Return the box of the receiver: ranges with white or fitted errors, or differences."""
    if scenario.uwb.kind == "differences":
        return differences_box(scenario, room)
    box = fitted_box if scenario.uwb.errors == "fitted" else uwb_box
    return box(scenario.uwb, room, scenario.h)


def check(scenario: Scenario, room: Room) -> None:
    """Raise InputError if fitted constants and anchors differ in number, or anchors are too few for differences."""
    if scenario.uwb.kind == "differences" and len(room.anchors) < 2:
        raise InputError(f"uwb.kind: differences: needs two anchors or more, the room has {len(room.anchors)}")
    if scenario.uwb.errors != "fitted":
        return
    constants, n = noise_of(scenario.uwb).constants, len(room.anchors)
    if constants is not None and len(constants) != n:
        raise InputError(f"uwb.fitted.constants: {len(constants)} of them, but the room has {n} anchors")


def noise_numbers(scenario: Belief) -> dict[str, float]:
    """Return the settings of a range's noise in the multilateration, by their keys."""
    noise = scenario.multilateration.noise
    return {
        f"multilateration.noise.{name}": getattr(noise, name) for name in ("sd", "fraction") if hasattr(noise, name)
    }


def members(scenario: Belief, payload: int) -> tuple[tuple[str, str], ...]:
    """Return the payload's members in C."""
    if scenario.uwb.kind == "differences":
        what = "anchors a, b; r_b - r_a [m]; 1 where it is there, else 0; its age at the stamp [s]"
        return ((f"double differences[{payload // ROW}][{ROW}];", what),)
    n = payload // 2
    ranges = (f"double ranges[{n}];", "to each anchor, in the order of the room [m]")
    return (ranges, (f"double there[{n}];", "1 where its range is there, else 0"))


def largest_ranges(scenario: Scenario, room: Room, reach: float) -> np.ndarray:
    """Return the largest range to each anchor (n) [m] from a vehicle in the room or up to `reach` [m] outside."""
    low, high = np.array(room.interior.min) - reach, np.array(room.interior.max) + reach
    corners = np.array(list(product(*zip(low, high, strict=True))))
    distances = np.linalg.norm(corners[:, np.newaxis] - room.anchor_positions, axis=2).max(axis=0)
    (s_0, s_1), walls = scenario.uwb.sds, scenario.uwb.walls
    sd = s_0 + s_1 * distances
    if scenario.uwb.errors == "fitted":
        sd = np.full(len(distances), largest_sd(noise_of(scenario.uwb)))
    wall = walls.per_wall if walls.kind == "bias" else MEANS * walls.mean if walls.kind == "excess" else 0.0
    bias = wall * len(room.wall_boxes)
    return distances + bias + SIGMAS * sd


def limits(scenario: Scenario, room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and the largest payload: ranges and flags, or the rows of differences."""
    ranges = largest_ranges(scenario, room, envelope_of(scenario, room).speed * (scenario.h + scenario.uwb.round))
    n, uwb = ranges.size, scenario.uwb
    if uwb.kind == "ranges":
        return np.zeros(2 * n), np.concatenate((ranges, np.ones(n)))
    most, oldest = 2.0 * ranges.max(), uwb.link.every(scenario.h) * scenario.h
    low, high = [0.0, 0.0, -most, 0.0, 0.0], [n - 1.0, n - 1.0, most, 1.0, oldest]
    return np.tile(low, uwb.rows(scenario.h)), np.tile(high, uwb.rows(scenario.h))


def whole(scenario: Belief, room: Room) -> list[int]:
    """Return the indices of integers in the payload: flags, and the anchors of differences."""
    n = payload(scenario, room)
    if scenario.uwb.kind == "ranges":
        return list(range(n // 2, n))
    return [at + i for at in range(0, n, ROW) for i in (A, B, THERE)]


SENSOR = Sensor(
    "uwb",
    Uwb,
    UWB,
    make_onboard=make_solver,
    V=believed_V,
    covariance=covariance,
    information=information,
    unknown=uwb_theory.unknown,
    made=uwb_theory.made,
    learned=uwb_theory.learned,
    left_out=uwb_theory.left_out,
    mismatches=uwb_theory.MISMATCHES,
    payload=payload,
    members=members,
    limits=limits,
    whole=whole,
    element=source,
    check=check,
    after_sensor=paths,
    solver=solver,
    drawn=drawn,
    measures="anchors",
    title="UWB",
    components="xyz",
    noise_numbers=noise_numbers,
    noise_settings=("multilateration.noise",),
    nominal_variances=(0.05, 0.05, 0.05),  # as printed in the paper
)
