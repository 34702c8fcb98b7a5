"""The boxes between a sensor's message as it lands and what the handler takes of it."""

from ortilo_drake.loop.element import Box
from ortilo_drake.model.room import Room
from ortilo_drake.onboard.estimator.robust.stuck_gate import stuck_box
from ortilo_drake.onboard.fix_solver import own_fix_box
from ortilo_drake.onboard.landmarks.fix_element import camera_fix_box
from ortilo_drake.onboard.ranging.fix_element import fix_box
from ortilo_drake.scenario import Belief
from ortilo_drake.scenario.robust import Robust
from ortilo_drake.sensors.described import as_known, described
from ortilo_drake.sensors.shares import share_of


def heard_boxes(settings: Robust | None, messages: dict[str, Box]) -> dict[str, Box]:
    """Return what says each sensor's message as it is heard: where it may be stuck, behind a gate."""
    if settings is None or settings.stuck is None:
        return messages
    gates = {name: stuck_box(name, said.size, settings.stuck) for name, said in messages.items()}
    return {name: gate.reading(message=messages[name].name) for name, gate in gates.items()}


def solver_boxes(belief: Belief, room: Room, heard: dict[str, Box]) -> dict[str, Box]:
    """Return what makes fixes of messages, by sensor; each reads a `belief` of [x; i] (240) besides.

    A sensor whose message begins with its value has none.
    """
    solvers = {name: solver_box(belief, room, name) for name in heard}
    return {name: solver.reading(message=heard[name].name) for name, solver in solvers.items() if solver is not None}


def solver_box(belief: Belief, room: Room, sensor: str) -> Box | None:
    """Return what makes a fix of a sensor's message, None where nothing need."""
    if sensor == "uwb":
        return fix_box(belief.multilateration, room.anchor_positions)
    if sensor == "camera":
        return camera_fix_box(belief.landmark_fix, as_known(belief, room), belief.image_width)
    if sensor == "imu":
        return None
    return own_fix_box(sensor, share_of(sensor), len(described(sensor).rows), belief, room)
