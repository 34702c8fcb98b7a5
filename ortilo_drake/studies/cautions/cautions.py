"""Warnings about a flight before it is flown: it is allowed, but hardly what the user meant."""

from collections.abc import Sequence
from pathlib import Path

from ortilo_drake.flight.late import late_messages
from ortilo_drake.model.vehicle_units import vehicle_units
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.load import Setting
from ortilo_drake.scenario.unread import unread_settings
from ortilo_drake.sensors.uwb_believed_noise import believed_noise
from ortilo_drake.studies.cautions.vehicle_fit import vehicle_fit


def cautions(scenario: Scenario, name_or_file: str | Path | None = None, settings: Sequence[Setting] = ()) -> list[str]:
    """Return a line for each thing, beginning with the setting; none for a scenario as one would expect it.

    Args:
        scenario: what is to be flown.
        name_or_file: what it was made of, for settings that are given and not read; None leaves those out.
        settings: that were laid over it.
    """
    unread = [] if name_or_file is None else unread_settings(scenario, name_or_file, settings)
    vehicle = vehicle_units(scenario.vehicle) or vehicle_fit(scenario)  # of a wrong vehicle nothing else is known
    return unread + believed_noise(scenario) + late_messages(scenario) + vehicle
