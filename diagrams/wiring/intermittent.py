"""The boxes of the paper's estimator: fixes, handler, what refuses and weighs, and the filter.

    message -> [heard] -> [fix] -> handler -> [robust gate] -> [imu's rows] -> filter

What stands in brackets is there where a scenario wants it. Fixes are solved about the filter's belief: the present one
or, where late measurements are replayed, that of the message's own tick.
"""

from typing import Any, NamedTuple

import numpy as np

from ortilo_drake.diagrams.wiring.messages import solver_boxes
from ortilo_drake.loop.element import Box, bundle, constant
from ortilo_drake.model.clock import history_ticks
from ortilo_drake.model.measurement import CAMERA, UWB, Measurement
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.onboard.estimator.at_rest import rest_of
from ortilo_drake.onboard.estimator.extra_states import Extra, augmented_rows, extra_states, names_of
from ortilo_drake.onboard.estimator.filter_element import filter_box, vehicle_belief_box
from ortilo_drake.onboard.estimator.filter_model import augmented_model, initial_covariance
from ortilo_drake.onboard.estimator.imu_rows import imu_rows_box, imu_variances
from ortilo_drake.onboard.estimator.lasting_element import (
    N_LASTING,
    LearnedCoefficients,
    Sort,
    learned_coefficients_of,
    told_box,
)
from ortilo_drake.onboard.estimator.measurement_handler import handler_box, incoming_of, oldest_used
from ortilo_drake.onboard.estimator.replay_element import acted_box, belief_at_stamp_box, replay_box
from ortilo_drake.onboard.estimator.robust.stuck_gate import stuck_box
from ortilo_drake.onboard.estimator.robust.weights import gate_box, opening_variances, weighing_of
from ortilo_drake.onboard.ranging.bank_element import bank_box
from ortilo_drake.onboard.ranging.sighted import sighted_box
from ortilo_drake.scenario import Belief
from ortilo_drake.sensors.described import described_per_tick, measuring

SIGHTING = measuring("landmarks")
SURVEY_TIME = 20.0  # of what a survey makes last of the camera's fixes, beside what their places say of it [s]


class Filtering(NamedTuple):
    """The states and the measurement of the filter.

    Attributes:
        extras: its states beside the vehicle's and the integral.
        seen: its measurement, over all its states.
        n: how many those are.
        replays: whether it puts late measurements into the tick of their stamp.
    """

    extras: tuple[Extra, ...]
    seen: Measurement
    n: int
    replays: bool

    @property
    def belief(self) -> str:
        """The name of the box, or its part, with the filter's belief of all its states."""
        return "filter.belief" if self.replays else "filter"

    @property
    def vehicle_belief(self) -> str:
        """The name of the box, or its part, with the belief of [x; i]."""
        return "vehicle_belief.belief" if self.extras else self.belief


def intermittent_boxes(belief: Belief, room: Room, xbar_0: np.ndarray, messages: dict[str, Box]) -> list[Box]:
    """Return the paper's estimator; it reads boxes `servo` and `reference`.

    Args:
        belief: what is known of a scenario.
        room: its room as it was surveyed.
        xbar_0: first estimate (15).
        messages: which box says each sensor's message as it lands.
    """
    settings, setup = belief.estimator, filtering_of(belief)
    stuck, gates = None if settings.robust is None else settings.robust.stuck, dict[str, Box]()
    if stuck is not None:
        for name, said in messages.items():
            gates[name] = stuck_box(name, said.size, stuck, belief.samples(name)).with_inputs(message=said.name)
    heard = messages | gates
    of_stamp = "{}_vehicle_at_stamp.belief" if setup.extras else "{}_belief_at_stamp"
    at = {name: of_stamp.format(name) if setup.replays else setup.vehicle_belief for name in heard}
    solving = {name: solver_boxes(belief, room, name, said, at[name]) for name, said in heard.items()}
    fixes = {name: boxes[-1] for name, boxes in solving.items() if boxes}
    past = {
        name: belief_at_stamp_box(f"{name}_belief_at_stamp", setup.seen, setup.n, belief.h).with_inputs(
            message=heard[name].name, memory="filter"
        )
        for name in (fixes if setup.replays else ())
    }
    split = [box for boxes in solving.values() for box in boxes[:-1]]
    ranging = measuring("anchors")
    sighted = sighted_box(belief.uwb, room) if ranging in fixes else None
    if sighted is not None and fixes[ranging].system is None:
        split.append(sighted.with_inputs(message=heard[ranging].name, belief=at[ranging]))
        fixes[ranging] = fixes[ranging].with_inputs(message=sighted.name)
    handler_inputs = heard | fixes

    handler = handler_of(belief, {name: box.size for name, box in handler_inputs.items()})
    chain = [handler.with_inputs(belief=setup.vehicle_belief)]
    if settings.robust is not None:
        gate = robust_box(belief, setup, list(past)).with_inputs(belief=setup.belief)
        chain.append(gate.with_inputs(past="beliefs_at_stamp" if past else setup.belief, **measurement_of(chain[-1])))
    variances = imu_variances(belief)
    if variances is not None:
        imu = handler_inputs[belief.measurement.sensors[belief.measurement.inertial]]  # or its samples' mean
        rows = imu_rows_box(belief.measurement, variances).with_inputs(imu=imu.name, stamps="handler.stamps")
        chain.append(rows.with_inputs(**measurement_of(chain[-1])))
    kalman = kalman_box(belief, setup, xbar_0).with_inputs(**measurement_of(chain[-1]), control="servo")
    banks = list[Box]()
    if learns_survey(belief) or (belief.measures_ranges and belief.multilateration.noise_scale is not None):
        fix, period = fixes[ranging], belief.every(ranging) * belief.h
        bank = bank_box(belief.multilateration, room.anchor_positions, period)
        banks.append(bank.with_inputs(message=fix.reads["message"], fix=fix.name))
    if setup.extras and (learns_survey(belief) or learns_landmarks(belief)):
        banks.append(constant("nothing_lasting", np.zeros(N_LASTING)))
        kalman = told_box(kalman, learned_coefficients(belief, setup)).with_inputs(
            lasting=f"{fixes[ranging].name}.lasting" if learns_survey(belief) else "nothing_lasting",
            camera_lasting=f"{fixes[SIGHTING].name}.lasting" if learns_landmarks(belief) else "nothing_lasting",
        )
    kalman = kalman.with_inputs(
        stamps="handler.stamps" if variances is None else "imu_rows.stamps",
        opening="no_opening" if settings.robust is None else "robust_gate.opening",
    )

    boxes = [*gates.values(), *past.values(), *split, *fixes.values()]
    boxes += [bundle("messages", list(handler_inputs.values())), *chain, kalman, *banks]
    if past:
        boxes.append(bundle("beliefs_at_stamp", list(past.values())))
    if settings.robust is None:
        boxes.append(constant("no_opening", np.zeros(setup.n)))
    if setup.extras:
        boxes.append(vehicle_belief_box("vehicle_belief").with_inputs(belief=setup.belief))
        boxes += [
            vehicle_belief_box(f"{name}_vehicle_at_stamp").with_inputs(belief=box.name) for name, box in past.items()
        ]
    return boxes


def filtering_of(belief: Belief) -> Filtering:
    """Return the states and model of a scenario's filter."""
    settings = belief.estimator
    if learns_landmarks(belief):
        biases = settings.biases.model_copy(update={"camera_time": SURVEY_TIME})
        settings = settings.model_copy(update={"biases": biases})
    extras = extra_states(settings, belief.vehicle, belief.h, belief.flown_rows, belief.yaw)
    seen = augmented_rows(belief.measurement.rows, extras)
    return Filtering(extras, seen, N_XBAR + len(names_of(extras)), settings.delay == "replay")


def learns_survey(belief: Belief) -> bool:
    """Return whether fixes are made of ranges that tell how good the anchors' survey is."""
    return belief.measures_ranges and belief.multilateration.bias_bank is not None


def learned_coefficients(belief: Belief, setup: Filtering) -> LearnedCoefficients:
    """Return the coefficients of a filter's measurement that come from fixes that learn."""
    biases = belief.estimator.biases
    ranges = Sort(UWB, biases.uwb_sd) if learns_survey(belief) else None
    boxes = Sort(CAMERA, biases.camera_sd, np.exp(-belief.h / biases.camera_time)) if learns_landmarks(belief) else None
    return learned_coefficients_of(setup.seen, ranges, boxes)


def learns_landmarks(belief: Belief) -> bool:
    """Return whether fixes are made of boxes that tell how good the landmarks' survey is."""
    return SIGHTING in belief.sensors and belief.landmark_fix.survey_bank is not None


def measurement_of(box: Box) -> dict[str, str]:
    """Return the parts of a box that hold y, delta and V2, by input."""
    return {name: f"{box.name}.{name}" for name in ("y", "delta", "V2")}


def handler_of(belief: Belief, sizes: dict[str, int]) -> Box:
    """Return the handler of messages and fixes that have these sizes, in their order."""
    settings, measurement = belief.estimator, belief.measurement
    V = {name: described_per_tick(name, belief).V(belief) for name in measurement.sensors}
    oldest = oldest_used(settings.delay, settings.horizon, belief.h)
    incoming = incoming_of(measurement, sizes, V, dict(settings.gates), oldest)
    return handler_box(incoming, measurement.layout, settings.delay != "ignore", belief.h)


def robust_box(belief: Belief, setup: Filtering, late: list[str]) -> Box:
    """Return the box that refuses and weighs values; late ones are judged by the belief of their own tick."""
    settings: Any = belief.estimator.robust
    sensors, opening = belief.measurement.sensors, opening_variances(settings.opening, names_of(setup.extras))
    numbers = [late.index(name) if name in late else -1 for name in sensors]
    return gate_box(weighing_of(settings, setup.seen, len(sensors)), opening, numbers, belief.h)


def kalman_box(belief: Belief, setup: Filtering, xbar_0: np.ndarray) -> Box:
    """Return the filter, which begins with an estimate (15)."""
    settings, vehicle, h = belief.estimator, belief.vehicle, belief.h
    model = augmented_model(settings, vehicle, settings.integrator, h, setup.extras, belief.yaw)
    P_0 = initial_covariance(settings, setup.extras, rest_of(belief), belief.yaw)
    belief_0 = np.concatenate((xbar_0[:N_X], np.zeros(setup.n - N_XBAR), xbar_0[N_X:], P_0.ravel()))
    if setup.replays:
        replay = replay_box(model, setup.seen, vehicle.hover_thrust, belief_0, history_ticks(settings.horizon, h), h)
        return acted_box(replay) if belief.commands.filter == "acted" else replay
    return filter_box(model, setup.seen, vehicle.hover_thrust, belief_0)
