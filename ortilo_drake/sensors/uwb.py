"""The uwb sensor, ranges to the room's anchors: what the theory knows of it."""

from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import System

from ortilo_drake.loop.element import Box, Given
from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.measurement import UWB
from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, FIX_SIZE, PAYLOAD, uwb_size
from ortilo_drake.onboard.ranging.fix_element import fix_box
from ortilo_drake.onboard.ranging.multilateration import fix_of
from ortilo_drake.scenario import Belief, Scenario, Uwb
from ortilo_drake.sensors.information_ranges import range_rows
from ortilo_drake.sensors.information_rows import Information
from ortilo_drake.sensors.messages import solver_system
from ortilo_drake.sensors.unknown_error import Error, gauss_markov, moved, own, spread, walk
from ortilo_drake.world.drawn_truth import AtStart, Drawn, draw_truth
from ortilo_drake.world.faults.fault_element import fault_out
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.sensors.fitted_uwb import fitted_box, fitted_drawn, noise_of
from ortilo_drake.world.sensors.range_paths import STREAM as PATHS_STREAM
from ortilo_drake.world.sensors.range_paths import paths_box, paths_out
from ortilo_drake.world.sensors.uwb import ranging_settings, uwb_box, uwb_message


def make_solver(scenario: Belief, room: Room) -> System:
    """Return the multilateration as a System."""
    solver = fix_box(scenario.multilateration, room.anchor_positions)
    return solver_system("uwb", uwb_size(len(room.anchors)), solver, scenario.h)


def believed_V(scenario: Belief) -> np.ndarray | None:
    """Return the covariance of a fix as the filter believes it, None where it comes with each."""
    V = getattr(scenario.estimator, "V", None)  # of the paper's filter
    return None if V is None or V.uwb is None else np.diag(V.uwb)


def message_without_noise(scenario: Scenario, room: Room, x: np.ndarray) -> np.ndarray:
    """Return the message at state x (12), its ranges without noise but behind the scenario's walls."""
    boxes = room.wall_boxes if scenario.uwb.walls.kind != "none" else np.empty((0, 7))
    settings = ranging_settings(scenario.uwb)
    settings[:2] = 0.0
    unbiased = np.zeros(len(room.anchors))
    message = np.asarray(
        uwb_message(x, room.anchor_positions, unbiased, boxes, settings, 0, stream_id("uwb"), 0.0, scenario.h)
    )
    if scenario.belief.uwb.behind_walls == "left_out":
        n = len(unbiased)
        for i, anchor in enumerate(room.anchor_positions):
            if walls_crossed(x[:3], anchor, room.wall_boxes):
                message[PAYLOAD + i] = message[PAYLOAD + n + i] = 0.0
    return message


def messages_again(scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the messages (m, 2 + 2 a) that a flight was sent, repeated from its true states (n, 12).

    Args:
        scenario: the scenario flown, its seed included.
        room: as it was surveyed.
        truth: true states x_k (n, 12).
        seen: in which ticks a message reached the vehicle (n).

    Raises:
        InputError: if the sensor is faster than the tick, or its errors are fitted.
    """
    if scenario.uwb.errors == "fitted":
        raise InputError("uwb.errors: fitted: what lasts of these errors cannot be repeated: give the flight's log")
    if scenario.samples("uwb") > 1:
        raise InputError("uwb.link.rate: of a sensor faster than the tick no ranges can be repeated: give its log")
    size = uwb_size(len(room.anchors))
    drawn = draw_truth(scenario.truth, scenario.seed, room, {"uwb": size - PAYLOAD})
    boxes = room.wall_boxes if scenario.uwb.walls.kind != "none" else np.empty((0, 7))
    anchors = np.ascontiguousarray(room.anchor_positions + drawn["survey.anchors"])
    settings, stream, h = ranging_settings(scenario.uwb), stream_id("uwb"), scenario.h
    messages = [
        uwb_message(truth[k], anchors, drawn["uwb.bias"], boxes, settings, scenario.seed, stream, k * h, h)
        for k in np.flatnonzero(seen)
    ]
    return np.array(messages).reshape(-1, size)


def covariance(scenario: Scenario, room: Room, x: np.ndarray) -> np.ndarray | None:
    """Return the covariance of the fix where the filter believes x (12) to be, by the solver that flies."""
    ranges = message_without_noise(scenario, room, x)
    fix = fix_of(scenario.multilateration, room.anchor_positions, ranges, x)
    return fix[PAYLOAD + 3 : FIX_SIZE].reshape(3, 3) if fix[ARRIVED] else None


def information(scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> Information:
    """Return the information of the ranges; see sensors/information_ranges.py."""
    return Information({"uwb": range_rows(scenario.uwb, room, truth, seen)})


def unknown(scenario: Scenario, room: Room) -> list[Error]:
    """Return the unknown errors of the ranges and of the anchors' places."""
    uwb, survey, n = scenario.truth.uwb, scenario.truth.survey, len(room.anchor_positions)
    return [
        *unknown_fitted(scenario, n),
        walk(spread(uwb.bias, number=1), 0.0, {"uwb": lambda rows: np.ones((len(rows), 1))}),
        walk(spread(uwb.bias_sd, number=n), 0.0, {"uwb": own(n)}),
        gauss_markov(spread(uwb.slow_sd, number=n), uwb.slow_time, scenario.h, {"uwb": own(n)}),
        walk(spread(survey.anchors), 0.0, {"uwb": moved(-1.0)}),
        walk(spread(survey.anchors_sd, number=3 * n), 0.0, {"uwb": moved(-1.0, n)}),
    ]


def unknown_fitted(scenario: Scenario, n: int) -> list[Error]:
    """Return the unknown errors that were fitted; a field counts as constant, which is the best that can be known."""
    if scenario.uwb.errors != "fitted":
        return []
    noise = noise_of(scenario.uwb)
    constant = 0.0 if noise.field is None else noise.field.sd
    if noise.constants is None:
        constant = float(np.hypot(constant, noise.constants_sd))
    found = [walk(spread(constant, number=n), 0.0, {"uwb": own(n)})]
    if noise.lasting is not None:
        found.append(gauss_markov(spread(noise.lasting.sd, number=n), noise.lasting.time, scenario.h, {"uwb": own(n)}))
    return found


def drawn(scenario: Scenario, room: Room, its: Drawn, boxes: Mapping[str, Box]) -> dict[str, Given]:
    """Return the true places of the anchors and the lasting errors of their ranges, for the sensor and its faults."""
    anchors = Given(tables={"anchors": room.anchor_positions + its["survey.anchors"]})
    found = {"uwb": anchors.with_(Given(tables={"bias": its["uwb.bias"]}))}
    return found | {name: anchors for name, box in boxes.items() if box.element.out in (fault_out, paths_out)}


def solver(scenario: Belief, room: Room) -> Box:
    """Return the multilateration; where the survey or the noise's scale is learned it reads what was."""
    settings, box = scenario.multilateration, fix_box(scenario.multilateration, room.anchor_positions)
    if settings.noise_scale is None:
        return box if settings.bias_bank is None else box.reading(learned="uwb_bank")
    box = box.reading(noise="uwb_bank.noise")
    return box if settings.bias_bank is None else box.reading(learned="uwb_bank.learned")


def errors_drawn(scenario: Scenario, room: Room, draw: AtStart) -> dict[str, Given]:
    """Return the fitted errors that a seed draws."""
    if "uwb" not in scenario.sensors or scenario.uwb.errors != "fitted":
        return {}
    return {"uwb": fitted_drawn(scenario.uwb, len(room.anchors), scenario.h, draw)}


def paths_drawn(boxes: Mapping[str, Box], draw: AtStart) -> dict[str, Given]:
    """Return the first of what walls lengthen ranges by."""
    if "uwb_paths" not in boxes:
        return {}
    return {"uwb_paths": Given(start={"x": draw(PATHS_STREAM, len(boxes["uwb_paths"].given.start["x"]))})}


def paths(scenario: Scenario, room: Room, message: Box, samples: int) -> Box | None:
    """Return the box that makes the ranges as long as their signals' paths; None if straight and instant."""
    box = paths_box(scenario.uwb, room, scenario.h)
    return None if box is None else box.reading(message=message.name)


def source(scenario: Scenario, room: Room, whole: bool) -> Box:
    """Return the receiver, with white or with fitted errors."""
    box = fitted_box if scenario.uwb.errors == "fitted" else uwb_box
    return box(scenario.uwb, room, scenario.h)


def check(scenario: Scenario, room: Room) -> None:
    """Raise InputError if errors that were fitted are of other anchors than the room's."""
    if scenario.uwb.errors != "fitted":
        return
    constants, n = noise_of(scenario.uwb).constants, len(room.anchors)
    if constants is not None and len(constants) != n:
        raise InputError(f"uwb.fitted.constants: {len(constants)} of them, but the room has {n} anchors")


def noise_numbers(scenario: Belief) -> dict[str, float]:
    """Return the number by which a range's noise is believed."""
    noise = scenario.multilateration.noise
    return {
        f"multilateration.noise.{name}": getattr(noise, name) for name in ("sd", "fraction") if hasattr(noise, name)
    }


SENSOR = Sensor(
    "uwb",
    Uwb,
    UWB,
    make_onboard=make_solver,
    V=believed_V,
    covariance=covariance,
    information=information,
    unknown=unknown,
    payload=lambda scenario, room: 2 * len(room.anchors),
    element=source,
    check=check,
    behind=paths,
    solver=solver,
    drawn=drawn,
    measures="anchors",
    title="UWB",
    components="xyz",
    noise_numbers=noise_numbers,
    scaled_by=("multilateration.noise",),
    stand_in=(0.05, 0.05, 0.05),  # as printed in the paper
)
