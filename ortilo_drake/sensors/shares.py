"""Sensors beside uwb, camera and imu, by the compiled share of their description (model/parts.py, Compiled)."""

from ortilo_drake.model.parts import Compiled
from ortilo_drake.sensors.described import described


def share_of(sensor: str) -> Compiled:
    """Return a sensor's share in compiled flights.

    Raises:
        ValueError: if it has none.
    """
    share = described(sensor).compiled
    if share is None:
        raise ValueError(f"sensors: {sensor}: has no compiled form")
    return share
