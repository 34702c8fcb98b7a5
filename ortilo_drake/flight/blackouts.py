"""The ticks of a flight in which a sensor is blacked out."""

import numpy as np

from ortilo_drake.model.signals import SENSORS
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.radio.link import blackout_rows


def in_blackout(truth: np.ndarray, scenario: Scenario, sensor: str = SENSORS[0]) -> np.ndarray:
    """Return a mask of the ticks (n) in which a sensor is blacked out, given the true states x (n, 12); see link.py."""
    black = np.zeros(len(truth), dtype=bool)
    for axis, start, end in blackout_rows(scenario.link_of(sensor), scenario.h):
        where = np.arange(len(truth)) if axis == 3 else truth[:, int(axis)]
        black |= (where >= start) & (where < end)
    return black
