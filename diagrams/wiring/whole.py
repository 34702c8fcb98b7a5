"""World and onboard half of a scenario in one wiring."""

from ortilo_drake.diagrams.faults import check_room
from ortilo_drake.diagrams.wiring.onboard import onboard_boxes
from ortilo_drake.diagrams.wiring.world import world_boxes
from ortilo_drake.loop.element import Box
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.scenario import Scenario


def boxes_of(scenario: Scenario, ticks: int) -> list[Box]:
    """Return the boxes of a scenario's flight of so many ticks; its own seed is not used.

    Raises:
        InputError: if there is no path or no servo gain, or if a fault concerns what is not there.
    """
    room = scenario.load_room()
    check_room(scenario, room)
    path = path_of(scenario)
    world, messages = world_boxes(scenario, room, path)
    return [*world, *onboard_boxes(scenario, room, path, ticks, messages)]


def belief_in(boxes: list[Box]) -> str:
    """Return what says the belief of [x; i] (240) that was predicted for this tick."""
    return "known.belief" if any(box.name == "known" for box in boxes) else "filter"
