"""World and onboard half of a scenario in one wiring."""

from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.faults import check_room
from ortilo_drake.diagrams.wiring.onboard import belief_in, onboard_boxes
from ortilo_drake.diagrams.wiring.world import world_boxes
from ortilo_drake.loop.element import Box
from ortilo_drake.model.parts import find_part
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.onboard.planner.planned import BUILT_IN, plan_of
from ortilo_drake.scenario import CommandLink, Commands, IntermittentFilter, LqServo, Scenario
from ortilo_drake.scenario.tight import TightFilter
from ortilo_drake.sensors.described import described


def boxes_of(scenario: Scenario, ticks: int) -> list[Box]:
    """Return the boxes of a scenario's flight of so many ticks; its own seed is not used.

    Raises:
        InputError: if there is no path or no servo gain, or if a fault concerns what is not there.
    """
    room = scenario.load_room()
    check_room(scenario, room)
    path = plan_of(scenario)
    world, messages = world_boxes(scenario, room, path)
    return [*world, *onboard_boxes(scenario, room, path, ticks, messages)]


def signals_of(boxes: list[Box]) -> dict[str, str]:
    """Return which box, or part of one, says each signal of a flight's log."""
    signals = {"state": "plant", "control": "servo", "reference": "reference", "belief": belief_in(boxes)}
    weighed = "robust_gate" if any(box.name == "robust_gate" for box in boxes) else "handler"
    return signals | {name: f"{weighed}.{name}" for name in ("y", "delta", "V2")}


def why_not(scenario: Scenario) -> str | None:
    """Return which part of a scenario is no element, naming the field; None where all are, and it can be played."""
    is_tight, is_papers = (
        isinstance(scenario.estimator, TightFilter),
        isinstance(scenario.estimator, IntermittentFilter),
    )
    own = [name for name in own_sensors(scenario) if described(name).compiled is None]
    if own:
        return f"sensors: {own[0]}: has no compiled form"
    faster = [name for name in scenario.faster_sensors if not (is_tight and name == "imu")]
    if faster:
        return f"{faster[0]}.link.rate: is faster than the tick"
    built_in = {"estimator": is_tight or is_papers, "servo": isinstance(scenario.servo, LqServo)}
    built_in["planner"] = isinstance(scenario.planner, BUILT_IN)
    for role in [role for role, its in built_in.items() if not its]:
        kind = getattr(scenario, role).kind
        if not is_element(role, kind) and (role != "planner" or not isinstance(plan_of(scenario), Trajectory)):
            return f"{role}.kind: {kind}: has no compiled form"
    if scenario.is_rendered:
        return "camera.kind: rendered: has no compiled form"
    if "camera" in scenario.sensors and not is_tight and scenario.landmark_fix.method == "pnp":  # it is OpenCV's
        return f"landmark_fix.method: {scenario.landmark_fix.method}: has no compiled form"
    if scenario.commands != Commands() or scenario.command_link != CommandLink():
        return "command_link, commands: late or lost commands have no compiled form"
    return None


def own_sensors(scenario: Scenario) -> list[str]:
    """Return the sensors that fly beside uwb, camera and imu, in their order in the measurement."""
    return [name for name in scenario.measurement.sensors if name in scenario.sensors and name not in SENSORS]


def is_element(role: str, kind: str) -> bool:
    """Return whether a part of one's own is an element."""
    found = find_part(role, kind)
    return found is not None and found.box is not None
