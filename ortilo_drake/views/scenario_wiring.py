"""The wiring of a scenario, to be looked at."""

from ortilo_drake.diagrams.wiring.whole import boxes_of
from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.scenario import Scenario


def wiring_of(scenario: Scenario) -> Wiring:
    """Return a scenario's wiring; InputError if it cannot be flown."""
    return Wiring(boxes_of(scenario, flight_ticks(scenario)))
