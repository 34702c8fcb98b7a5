"""The wiring of a scenario, to be looked at."""

from ortilo_drake.diagrams.wiring.blocks import system_of
from ortilo_drake.diagrams.wiring.whole import boxes_of, why_not
from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario


def wiring_of(scenario: Scenario) -> Wiring:
    """Return a scenario's wiring.

    Raises:
        InputError: if it cannot be flown, or if a part that is no element has no box.
    """
    try:
        return Wiring(boxes_of(scenario, flight_ticks(scenario)))
    except Exception as error:  # to go when every part has a box
        reason = why_not(scenario)
        if isinstance(error, InputError) or reason is None:
            raise
        raise InputError(f"{scenario.name}: {reason}: it has no box; --drake draws the loop that flies") from error


def unlike_flown(scenario: Scenario, wiring: Wiring) -> str | None:
    """Return in a line which part of a scenario flies as a System of Drake and has another box here; None if none."""
    reason = why_not(scenario)
    if reason is None or any(system_of(box) is not None for box in wiring.boxes.values()):
        return None
    return f"{scenario.name}: {reason}: a System of Drake flies in place of this box"
