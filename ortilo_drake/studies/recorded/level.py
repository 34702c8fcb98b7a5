"""The height from a map and the truth's first part, as the filter takes it."""

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.studies.recorded.calibrate import Calibration
from ortilo_drake.studies.recorded.filter_types import Level

CLIMB = 0.02  # deviation of v_z where the height is constant [m/s]
HEIGHT = 0.05  # deviation of a known height unless the map has another [m]
LEVEL = 0.02  # a floor is no more level than this [m]
UNEVEN = 0.1  # a truth whose height deviates by more is not planar [m]


def given_level(map_: Map) -> Level:
    """Return the antenna's height as the map alone gives it."""
    climb = CLIMB if map_.planar else np.inf
    if map_.height is None:
        return Level(0.0, np.inf, climb)
    return Level(map_.height, HEIGHT if map_.height_sd is None else map_.height_sd, climb)


def calibrated_level(map_: Map, calibration: Calibration, recording: Recording) -> Level:
    """Return the same after calibration: a constant height that the map does not give is that of the first part."""
    level, truth = given_level(map_), recording.truth
    if not map_.planar or map_.height is not None or truth is None:
        return level
    z, deviation = _heights(calibration, recording)
    return level._replace(height=z, deviation=max(deviation, LEVEL))


def height_doubts(map_: Map, calibration: Calibration, recording: Recording) -> list[str]:
    """Return doubts about the map's height, where the truth contradicts it."""
    z, deviation = _heights(calibration, recording)
    found = []
    if map_.planar and deviation > UNEVEN:
        found.append(f"planar: true, but the truth's height deviates by {deviation:.2f} m: leave planar out")
    level = given_level(map_)
    if map_.height is not None and abs(z - map_.height) > 3.0 * level.deviation + UNEVEN:
        found.append(f"height: {map_.height:g}, but the calibrated truth is at {z:.2f} m on average: is height right?")
    return found


def _heights(calibration: Calibration, recording: Recording) -> tuple[float, float]:
    """Return mean and deviation of the antenna's height in the first part [m]."""
    truth = recording.truth
    assert truth is not None
    first = truth.t <= calibration.end
    p = truth.p[first]
    if truth.R is not None and calibration.mount is not None:
        p = p + truth.R[first] @ (calibration.mount @ calibration.lever)
    z = calibration.position(p)[:, 2]
    return float(z.mean()), float(z.std())
