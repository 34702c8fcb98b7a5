"""The boxes of the onboard half: fixes, handler, filter, servo and planner."""

import numpy as np
from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.onboard import initial_estimate
from ortilo_drake.diagrams.wiring.tight import tight_boxes
from ortilo_drake.loop.element import Box, Element, bundle, constant
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.onboard.estimator.extra_states import augmented_rows, extra_states
from ortilo_drake.onboard.estimator.filter_element import filter_boxes
from ortilo_drake.onboard.estimator.filter_model import augmented_model, initial_covariance
from ortilo_drake.onboard.estimator.measurement_handler import handler_box, incoming_of, oldest_used
from ortilo_drake.onboard.landmarks.fix_element import camera_fix_box
from ortilo_drake.onboard.planner.planned import start_of
from ortilo_drake.onboard.planner.planner import make_planner
from ortilo_drake.onboard.planner.table_player import reference_box
from ortilo_drake.onboard.ranging.multilateration import fix_box
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.onboard.servo.lq_servo import LENT, servo_box
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.tight import TightFilter
from ortilo_drake.sensors.described import as_known, flown
from ortilo_drake.sensors.messages import message_size


def onboard_boxes(scenario: Scenario, room: Room, path: Trajectory, ticks: int, messages: dict[str, str]) -> list[Box]:
    """Return the boxes of the onboard half.

    Args:
        scenario: the scenario.
        room: its room as it was surveyed.
        path: that is flown.
        ticks: of the flight.
        messages: which box says each sensor's message as it lands.
    """
    make = tight_boxes if isinstance(scenario.estimator, TightFilter) else intermittent_boxes
    estimator = make(scenario, room, start_of(path), messages)
    force = "known.force" if any(box.name == "known" for box in estimator) else "no_force"
    known = "known.belief" if force != "no_force" else "filter"
    servo = servo_box(
        servo_gain(scenario.vehicle, scenario.servo.weights, scenario.h, scenario.yaw),
        scenario.vehicle.mass,
        scenario.servo,
    )
    boxes = [*estimator, reference_box(reference_table(path, ticks, scenario.h)), constant("no_force", np.zeros(3))]
    if scenario.lends_velocities:
        boxes.append(Box("lent", LENT, N_XBAR).reading(belief=known, state="plant"))
        known = "lent"
    return [*boxes, servo.reading(belief=known, force=force)]


def reference_table(path: Trajectory, ticks: int, h: float) -> np.ndarray:
    """Return r, r_dot and r_ddot of a path at every tick (ticks + 1, 9)."""
    planner = make_planner(path)
    context, table = planner.CreateDefaultContext(), np.empty((ticks + 1, 9))
    for k in range(ticks + 1):
        context.SetTime(k * h)
        table[k] = planner.get_output_port().Eval(context)
    return table


def intermittent_boxes(scenario: Scenario, room: Room, r_0: np.ndarray, messages: dict[str, str]) -> list[Box]:
    """Return the paper's estimator: fixes, handler and filter, `filter`."""
    settings, measurement, vehicle, h = scenario.estimator, scenario.measurement, scenario.vehicle, scenario.h
    extras = extra_states(settings, vehicle, h, scenario.flown_rows, scenario.yaw)
    seen = augmented_rows(measurement.rows, extras)
    model = augmented_model(settings, vehicle, settings.integrator, h, extras, scenario.yaw)
    P_0, xbar_0 = initial_covariance(settings, extras), initial_estimate(scenario, r_0)
    belief_0 = np.concatenate((xbar_0[:N_X], np.zeros(len(P_0) - N_XBAR), xbar_0[N_X:], P_0.ravel()))
    known = "known.belief" if extras else "filter"
    solvers = [
        solver.reading(belief=known, **{name: messages[name]}) for name, solver in fix_boxes(scenario, room).items()
    ]
    handed = handed_boxes(scenario, room, messages, solvers)
    V = {name: flown(name, scenario).V(scenario) for name in measurement.sensors}
    oldest = oldest_used(settings.delay, settings.horizon, h)
    sizes = {name: box.size for name, box in zip(messages, handed, strict=True)}
    incoming = incoming_of(measurement, sizes, V, dict(settings.gates), oldest)
    handler = handler_box(incoming, measurement.layout, settings.delay != "ignore", h).reading(belief=known)
    kalman, *others = filter_boxes(model, seen, vehicle.hover_thrust, belief_0)
    kalman = kalman.reading(
        y="handler.y", delta="handler.delta", V2="handler.V2", control="servo", opening="no_opening"
    )
    return [*solvers, bundle("messages", handed), handler, kalman, *others, constant("no_opening", np.zeros(len(P_0)))]


def fix_boxes(scenario: Scenario, room: Room) -> dict[str, Box]:
    """Return what makes fixes, of each sensor whose messages are none: it reads the message and a belief (240)."""
    found = {}
    if "uwb" in scenario.sensors:
        found["uwb"] = fix_box(scenario.multilateration, room.anchor_positions)
    if "camera" in scenario.sensors:
        known = as_known(scenario, room)
        found["camera"] = camera_fix_box(scenario.landmark_fix, known, scenario.image_width)
    return found


def handed_boxes(scenario: Scenario, room: Room, messages: dict[str, str], solvers: list[Box]) -> list[Box]:
    """Return what the handler takes of each sensor: its fix or, of one that needs none, its message."""
    fixes = {solver.name: solver for solver in solvers}
    return [
        fixes.get(f"{name}_fix") or Box(said, Element("message"), message_size(flown(name, scenario), scenario, room))
        for name, said in messages.items()
    ]
