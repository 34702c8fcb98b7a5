"""The filter's aids beside ranges and IMU, as the map has them, and the part of a flight that is judged."""

from collections.abc import Callable

import numpy as np
from scipy.stats import chi2

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import NO_AID_ROWS, Recording, Truth
from ortilo_drake.studies.recorded.at_rest import AtRest
from ortilo_drake.studies.recorded.calibrate import Calibration
from ortilo_drake.studies.recorded.filter_types import NO_AIDS, Sight
from ortilo_drake.studies.recorded.filtered import FilterSetup, StartSetup
from ortilo_drake.studies.recorded.level import given_level


def uncalibrated_setup(recording: Recording, map_: Map, rest: AtRest | None) -> FilterSetup:
    """Return the filter's settings where there is no truth: the map's values, and biases to be estimated online.

    Args:
        recording: with surveyed anchors.
        map_: settings; a lever that it gives is believed.
        rest: what the imu said while it stood still.
    """
    given = map_.calibration.lever
    lever = np.zeros(3) if given == "estimate" else np.array(given)
    anchors, level = np.asarray(recording.anchors), given_level(map_)
    known = FilterSetup(anchors, None, lever, None, level, rest=rest, tags=recording.tags)
    return with_aids(known, recording, map_, True)


def with_aids(known: FilterSetup, recording: Recording, map_: Map, looks: bool) -> FilterSetup:
    """Return the filter's settings with the map's start and drag; with range finder, flow and camera if `looks`."""
    aids, start, heading, k_sd = NO_AIDS._replace(floor=map_.floor), None, known.heading, 0.0
    if map_.drag is not None:
        drag = map_.drag
        aids, k_sd = aids._replace(drag=drag.k, drag_sd=drag.noise, doubted=drag.doubted), drag.k_sd
    if map_.range_finder is not None:
        aids = aids._replace(finder=np.array(map_.range_finder.at), finder_sd=map_.range_finder.sd)
    if map_.boxes is not None and recording.scene is not None:
        noise, inside = np.array([map_.boxes.sd, map_.boxes.growth, 0.0]), chi2.cdf(map_.filter.gate**2, 1)
        gates = np.full(2, chi2.ppf(inside, 2))  # of two numbers what the gate is of one
        aids = aids._replace(sight=Sight(*recording.scene, noise, gates))
    scale_sd = 0.0
    if map_.flow is not None:
        aids = aids._replace(pixels=map_.flow.per_rad, flow_sd=map_.flow.sd)
        scale_sd = map_.flow.per_rad_sd
    if map_.start is not None:
        at = map_.start
        start = StartSetup(np.array(at.position), at.position_sd, at.heading_sd, at.rests, at.lands)
        heading = at.heading
    looked = recording.looks if looks else NO_AID_ROWS
    return known._replace(aids=aids, start=start, heading=heading, scale_sd=scale_sd, k_sd=k_sd, looks=looked)


def airborne(
    t: np.ndarray, truth: Truth | None, calibration: Calibration | None, map_: Map
) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function of stamps that selects those to be judged: all, or only those while airborne.

    Args:
        t: stamps by the sensors' clock [s].
        truth: the motion's.
        calibration: its clock and frame.
        map_: `airborne` says how far above its first height the vehicle flies.
    """
    first, last = -np.inf, np.inf
    if truth is not None and calibration is not None and map_.airborne is not None:
        z = calibration.position(truth.p)[:, 2]
        up = truth.t[z > np.median(z[:FIRST]) + map_.airborne] - calibration.offset
        first, last = (float(up[0]), float(up[-1])) if len(up) else (np.inf, -np.inf)
    return lambda stamps: (stamps >= first) & (stamps <= last)


FIRST = 20  # positions that tell the first height
