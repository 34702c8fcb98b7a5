"""World and onboard half of a scenario in one wiring."""

from pydrake.systems.framework import System

from ortilo_drake.diagrams.wiring.messages import detected
from ortilo_drake.diagrams.wiring.onboard import belief_in, measurement_in, onboard_boxes, system_of
from ortilo_drake.diagrams.wiring.world import is_element, is_system, world_boxes
from ortilo_drake.loop.element import Box
from ortilo_drake.onboard.planner.planned import planned, start_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import described
from ortilo_drake.world.faults.table import check_room


def boxes_of(scenario: Scenario, ticks: int) -> list[Box]:
    """Return the boxes of a scenario's flight of so many ticks; its own seed is not used.

    Raises:
        InputError: if there is no path or no servo gain, or if a fault concerns what is not there.
    """
    room = scenario.load_room()
    check_room(scenario, room)
    plan = planned(scenario)
    world, messages = world_boxes(scenario, room, start_of(plan))
    seeing, messages = detected(scenario.belief, room, messages)
    return [*world, *seeing, *onboard_boxes(scenario.belief, room, plan, ticks, messages)]


def signals_of(boxes: list[Box]) -> dict[str, str]:
    """Return the box, or part of one, behind each signal of a flight's log."""
    signals = {"state": "plant", "control": "servo", "reference": "reference", "belief": belief_in(boxes)}
    return signals | measurement_in(boxes)


def why_not(scenario: Scenario) -> str | None:
    """Return the field of a part of a scenario that is no element; None where all are, and it flies compiled.

    Such a part is a System of Drake's: a renderer, OpenCV's solver, a part of one's own that is no element, or a sensor
    faster than the tick that has a fault of one's own.
    """
    for sensor in scenario.sensors:
        if is_system(scenario, sensor):
            if is_element(sensor):
                return f"{sensor}.link.rate: faster than the tick, with a fault of one's own: has no compiled form"
            return f"sensors: {sensor}: has no compiled form"
    for role in ("estimator", "servo"):
        if system_of(scenario.belief, role) is not None:
            return f"{role}.kind: {getattr(scenario, role).kind}: has no compiled form"
    if system_of(scenario.belief, "planner") is not None and isinstance(planned(scenario), System):
        return f"planner.kind: {scenario.planner.kind}: has no compiled form"
    asked = (described(sensor).only_drake for sensor in scenario.sensors)
    setting = next((why for ask in asked if ask is not None and (why := ask(scenario)) is not None), None)
    return setting and f"{setting}: has no compiled form"
