"""World and onboard half of a scenario in one wiring."""

from ortilo_drake.diagrams.faults import check_room
from ortilo_drake.diagrams.wiring.onboard import belief_in, onboard_boxes
from ortilo_drake.diagrams.wiring.world import world_boxes
from ortilo_drake.loop.element import Box
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.scenario import Scenario

__all__ = ["belief_in", "boxes_of", "missing", "signals_of"]


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


def signals_of(boxes: list[Box]) -> dict[str, str]:
    """Return which box, or part of one, says each signal of a flight's log."""
    signals = {"state": "plant", "control": "servo", "reference": "reference", "belief": belief_in(boxes)}
    weighed = "robust_gate" if any(box.name == "robust_gate" for box in boxes) else "handler"
    return signals | {name: f"{weighed}.{name}" for name in ("y", "delta", "V2")}


def missing(scenario: Scenario) -> str | None:
    """Return which box of a scenario is no element yet, None where all are."""
    return None
