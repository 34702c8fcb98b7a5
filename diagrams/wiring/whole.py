"""World and onboard half of a scenario in one wiring."""

from ortilo_drake.diagrams.faults import check_room
from ortilo_drake.diagrams.wiring.onboard import onboard_boxes
from ortilo_drake.diagrams.wiring.world import world_boxes
from ortilo_drake.loop.element import Box
from ortilo_drake.onboard.estimator.imu_rows import imu_variances
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.scenario import IntermittentFilter, Scenario


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


def signals_of(boxes: list[Box]) -> dict[str, str]:
    """Return which box, or part of one, says each signal of a flight's log."""
    signals = {"state": "plant", "control": "servo", "reference": "reference", "belief": belief_in(boxes)}
    return signals | {name: f"handler.{name}" for name in ("y", "delta", "V2")}


def missing(scenario: Scenario) -> str | None:
    """Return which box of a scenario is no element yet, None where all are."""
    settings = scenario.estimator
    if not isinstance(settings, IntermittentFilter):
        return f"estimator.kind: {settings.kind}"
    others = [name for name in scenario.sensors if name not in ("uwb", "camera", "imu")]
    if others:
        return f"sensors: {others[0]}: its fix"
    if imu_variances(scenario) is not None or settings.delay == "replay" or settings.robust is not None:
        return "estimator: rows of the imu, replayed history, robust form"
    if scenario.multilateration.exclude is not None:
        return "multilateration.exclude"
    return None
