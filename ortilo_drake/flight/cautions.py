"""What a user should know of a flight before it is flown: it is allowed, and will hardly be what was meant."""

from ortilo_drake.flight.fit import vehicle_fit
from ortilo_drake.flight.late import late_messages
from ortilo_drake.scenario import Scenario


def cautions(scenario: Scenario) -> list[str]:
    """Return a line for each thing, beginning with the setting; none for a scenario as one would expect it."""
    return late_messages(scenario) + vehicle_fit(scenario)
