"""Errors of recorded ranges and differences by the truth, while the vehicle is airborne."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.calibrate import Calibration, calibrate
from ortilo_drake.studies.recorded.setups import airborne
from ortilo_drake.studies.recorded.truth_path import antennas, covered_ranges, modelled, truth_path

FEWEST = 200  # ranges that a fit needs


class RangeErrors(NamedTuple):
    """Errors in the order of their stamps (n each).

    Stamp [s], anchor b, the other anchor a of a difference or -1, error [m], and where the antenna was (n, 3).
    """

    t: np.ndarray
    anchor: np.ndarray
    other: np.ndarray
    e: np.ndarray
    place: np.ndarray

    def only(self, which: np.ndarray) -> "RangeErrors":
        """Return some of them."""
        return RangeErrors(*(part[which] for part in self))


def calibration_of(recording: Recording, map_: Map) -> Calibration:
    """Return the calibration between truth and sensors, with no anchor's constant taken off.

    Raises:
        InputError: if the recording has no truth.
    """
    if recording.truth is None:
        raise InputError(f"{recording.name}: truth: the map has none, and errors are counted from it")
    given = map_.calibration.share == 0.0
    found = calibrate(recording, map_.calibration, lever=given or recording.imu is not None)
    return found._replace(biases=np.zeros_like(found.biases))


def range_errors(recording: Recording, map_: Map, by: Calibration) -> RangeErrors:
    """Return the errors of a recording's ranges while it is airborne.

    Raises:
        InputError: if fewer than 200 ranges fall within it.
    """
    truth, ranges = recording.truth, recording.ranges
    assert truth is not None
    path = truth_path(truth)
    ranges = ranges.only(covered_ranges(ranges, by.offset, path))
    ranges = ranges.only(airborne(truth, by, map_)(ranges.t))
    if len(ranges.t) < FEWEST:
        raise InputError(f"{recording.name}: {len(ranges.t)} ranges within the truth's time, {FEWEST} are needed")
    p, R = path.at(ranges.t + by.offset)
    mount = np.eye(3) if by.mount is None else by.mount
    place = by.position(antennas(p, R, mount @ by.lever, recording.tags @ mount.T, ranges.tag))
    e = ranges.r - modelled(place, by.anchors, np.zeros(len(by.anchors)), ranges)
    return RangeErrors(ranges.t, ranges.anchor, ranges.other, e, place)
