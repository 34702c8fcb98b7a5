"""The boxes between a sensor's message as it lands and what the handler takes of it."""

from pydrake.systems.framework import System

from ortilo_drake.diagrams.wiring.systems import system_box
from ortilo_drake.loop.element import Box
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.onboard.estimator.robust.stuck_gate import stuck_box
from ortilo_drake.onboard.fix_solver import own_fix_box
from ortilo_drake.onboard.landmarks.fix_element import ELEMENTS, camera_fix_box
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix
from ortilo_drake.onboard.ranging.fix_element import fix_box
from ortilo_drake.onboard.sample_mean import SampleMean
from ortilo_drake.scenario import Belief
from ortilo_drake.scenario.robust import Robust
from ortilo_drake.sensors.described import as_known, described, flown
from ortilo_drake.sensors.messages import message_port
from ortilo_drake.sensors.shares import share_of


def heard_boxes(settings: Robust | None, messages: dict[str, Box], samples: dict[str, int]) -> dict[str, Box]:
    """Return what says each sensor's message as it is heard: where it may be stuck, behind a gate."""
    if settings is None or settings.stuck is None:
        return messages
    gates = {name: stuck_box(name, said.size, settings.stuck, samples[name]) for name, said in messages.items()}
    return {name: gate.reading(message=messages[name].name) for name, gate in gates.items()}


def solver_boxes(belief: Belief, room: Room, heard: dict[str, Box]) -> dict[str, Box]:
    """Return what makes fixes of messages, by sensor.

    An element reads a `belief` of [x; i] (240) besides; a System reads `<sensor>_prior`, whose parts are that belief's.
    A sensor whose message begins with its value has none.
    """
    solvers = {name: solver_box(belief, room, name, said) for name, said in heard.items()}
    return {name: solver for name, solver in solvers.items() if solver is not None}


def solver_box(belief: Belief, room: Room, sensor: str, message: Box) -> Box | None:
    """Return what makes a fix of a sensor's message, None where nothing need."""
    if belief.samples(sensor) > 1:
        make = flown(sensor, belief).make_onboard
        return None if make is None else system_solver_box(sensor, make(belief, room), message)
    if sensor == "uwb":
        solver = fix_box(belief.multilateration, room.anchor_positions).reading(message=message.name)
        return solver.reading(learned="survey_bank") if belief.multilateration.bias_bank is not None else solver
    if sensor == "camera" and belief.landmark_fix.method not in ELEMENTS:  # it is OpenCV's
        its = LandmarkFix(belief.landmark_fix, as_known(belief, room), belief.image_width, belief.h)
        return system_solver_box(sensor, its, message)
    if sensor == "camera":
        solver = camera_fix_box(belief.landmark_fix, as_known(belief, room), belief.image_width)
        return solver.reading(message=message.name)
    own = described(sensor)
    if own.compiled is None:
        return None if own.make_onboard is None else system_solver_box(sensor, own.make_onboard(belief, room), message)
    if sensor == "imu":
        return None
    found = own_fix_box(sensor, share_of(sensor), len(own.rows), belief, room)
    return None if found is None else found.reading(message=message.name)


def system_solver_box(sensor: str, system: System, message: Box) -> Box:
    """Return the box of a System that makes fixes: it reads the message and, where it asks, its prior."""
    signals = {message_port(system).get_name(): (message.name, message.size)}
    sizes = {"estimate": N_XBAR, "covariance": N_XBAR**2}
    signals |= {name: (f"{sensor}_prior.{name}", size) for name, size in sizes.items()}
    return system_box(f"{sensor}_fix", system, (system.get_output_port().get_name(),), signals)


def mean_box(sensor: str, size: int, samples: int, message: Box) -> Box:
    """Return what says the mean of the samples in a message, each of that size, as a message of one."""
    mean = SampleMean(sensor, size, samples)
    return system_box(f"{sensor}_mean", mean, ("mean",), {sensor: (message.name, message.size)})
