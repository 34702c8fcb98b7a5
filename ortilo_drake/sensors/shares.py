"""Sensors beside uwb, camera and imu, by the compiled share of their description (model/parts.py, Compiled)."""

from ortilo_drake.model.parts import Compiled
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.scenario import Belief
from ortilo_drake.sensors.described import BUILT_IN, described


def own_sensors(scenario: Belief) -> list[str]:
    """Return the sensors that fly beside uwb, camera and imu, in their order in the measurement."""
    return [name for name in scenario.measurement.sensors if name in scenario.sensors and name not in BUILT_IN]


def share_of(sensor: str) -> Compiled:
    """Return a sensor's share in compiled flights.

    Raises:
        ValueError: if it has none.
    """
    share = described(sensor).compiled
    if share is None:
        raise ValueError(f"sensors: {sensor}: has no compiled form")
    return share


def handed_size(sensor: str) -> int:
    """Return the size of what the handler takes of one of own_sensors: of its fix, or of its message."""
    m, share = len(described(sensor).rows), share_of(sensor)
    return PAYLOAD + (share.payload if share.solve is None else m + m * m)
