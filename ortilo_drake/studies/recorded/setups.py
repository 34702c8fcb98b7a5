"""The filter's settings for one motion, by its map and its calibration, and the part that is judged."""

from collections.abc import Callable

import numpy as np
import scipy  # not scipy.stats: that takes a second to import, and loads by itself when it is used

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import NO_AID_ROWS, Recording, Truth
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.at_rest import AtRest, at_rest
from ortilo_drake.studies.recorded.calibrate import Calibration
from ortilo_drake.studies.recorded.filter_types import NO_AIDS, FilterSetup, Level, Sight
from ortilo_drake.studies.recorded.truth_path import truth_path

CLIMB = 0.02  # standard deviation of v_z where the height is constant [m/s]
HEIGHT = 0.05  # standard deviation of a known height unless the map gives another [m]
LEVEL = 0.02  # least standard deviation of a calibrated height: floors are not level [m]
UNEVEN = 0.1  # a truth whose height deviates by more is not planar [m]
FIRST = 20  # number of positions that tell the first height
QUERY_RATE = 10.0  # rate of the estimates without a truth [Hz]
SHORTEST = 3.0  # least duration on which a recording is judged [s]


def given_level(map_: Map) -> Level:
    """Return the antenna's height by the map alone."""
    climb = CLIMB if map_.planar else np.inf
    if map_.height is None:
        return Level(0.0, np.inf, climb)
    return Level(map_.height, HEIGHT if map_.height_sd is None else map_.height_sd, climb)


def calibrated_level(map_: Map, calibration: Calibration, recording: Recording) -> Level:
    """Return the antenna's height after calibration: the first part tells a constant height that the map lacks."""
    level, truth = given_level(map_), recording.truth
    if not map_.planar or map_.height is not None or truth is None:
        return level
    z, deviation = _heights(calibration, recording)
    return level._replace(height=z, deviation=max(deviation, LEVEL))


def height_doubts(map_: Map, calibration: Calibration, recording: Recording) -> list[str]:
    """Return doubts about the map's height if the truth contradicts it."""
    z, deviation = _heights(calibration, recording)
    found = []
    if map_.planar and deviation > UNEVEN:
        found.append(f"planar: true, but the truth's height deviates by {deviation:.2f} m: leave planar out")
    level = given_level(map_)
    if map_.height is not None and abs(z - map_.height) > 3.0 * level.deviation + UNEVEN:
        found.append(f"height: {map_.height:g}, but the calibrated truth is at {z:.2f} m on average: is height right?")
    return found


def _heights(calibration: Calibration, recording: Recording) -> tuple[float, float]:
    """Return mean and standard deviation of the antenna's height in the first part [m]."""
    truth = recording.truth
    assert truth is not None
    first = truth.t <= calibration.end
    p = truth.p[first]
    if truth.R is not None and calibration.mount is not None:
        p = p + truth.R[first] @ (calibration.mount @ calibration.lever)
    z = calibration.position(p)[:, 2]
    return float(z.mean()), float(z.std())


def uncalibrated_setup(recording: Recording, map_: Map, rest: AtRest | None) -> FilterSetup:
    """Return the filter's settings without a truth: the map's values, biases estimated online."""
    given = map_.calibration.lever
    lever = np.zeros(3) if given == "estimate" else np.array(given)
    anchors, level = np.asarray(recording.anchors), given_level(map_)
    known = FilterSetup(anchors, None, lever, None, level, rest=rest, tags=recording.tags)
    return with_aids(known, recording, map_, True)


def calibrated_setup(calibration: Calibration, recording: Recording, map_: Map) -> FilterSetup:
    """Return the calibrated filter's settings."""
    heading = None
    truth, imu = recording.truth, recording.imu
    if imu is not None and truth is not None and truth.R is not None and calibration.mount is not None:
        at = np.array([max(imu.t[0], recording.ranges.t[0]) + calibration.offset])
        R = calibration.F @ truth_path(truth).at(np.clip(at, 0.0, None))[1][0] @ calibration.mount  # type: ignore[index]
        heading = float(np.arctan2(R[1, 0], R[0, 0]))
    biases = {"calibrated": calibration.biases, "online": None, "none": np.zeros(len(calibration.biases))}
    level, rest = calibrated_level(map_, calibration, recording), at_rest(recording, map_)
    own, anchors = biases[map_.calibration.biases], calibration.anchors
    return FilterSetup(anchors, own, calibration.lever, heading, level, rest=rest, tags=recording.tags)


def with_aids(known: FilterSetup, recording: Recording, map_: Map, looks: bool) -> FilterSetup:
    """Return the filter's settings with the map's start and drag, and with range finder, flow and camera if `looks`."""
    aids, start, scale_sd, k_sd = NO_AIDS._replace(floor=map_.floor), map_.start, 0.0, 0.0
    if map_.drag is not None:
        drag = map_.drag
        aids, k_sd = aids._replace(drag=drag.k, drag_sd=drag.noise, doubted=drag.doubted), drag.k_sd
    if map_.range_finder is not None:
        aids = aids._replace(finder=np.array(map_.range_finder.at), finder_sd=map_.range_finder.sd)
    if map_.boxes is not None and recording.scene is not None:
        noise, inside = np.array([map_.boxes.sd, map_.boxes.growth, 0.0]), scipy.stats.chi2.cdf(map_.filter.gate**2, 1)
        gates = np.full(2, scipy.stats.chi2.ppf(inside, 2))  # the gate's probability, for two numbers instead of one
        aids = aids._replace(sight=Sight(*recording.scene, noise, gates))
    if map_.flow is not None:
        aids = aids._replace(pixels=map_.flow.per_rad, flow_sd=map_.flow.sd)
        scale_sd = map_.flow.per_rad_sd
    heading = known.heading if start is None else start.heading
    looked = recording.looks if looks else NO_AID_ROWS
    return known._replace(aids=aids, start=start, heading=heading, scale_sd=scale_sd, k_sd=k_sd, looks=looked)


def airborne(truth: Truth | None, calibration: Calibration | None, map_: Map) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function from stamps by the sensors' clock [s] to a mask: all, or only the airborne ones by the map."""
    first, last = -np.inf, np.inf
    if truth is not None and calibration is not None and map_.airborne is not None:
        z = calibration.position(truth.p)[:, 2]
        up = truth.t[z > np.median(z[:FIRST]) + map_.airborne] - calibration.offset
        first, last = (float(up[0]), float(up[-1])) if len(up) else (np.inf, -np.inf)
    return lambda stamps: (stamps >= first) & (stamps <= last)


def judged_part(
    recording: Recording, by: Calibration | None, map_: Map
) -> tuple[np.ndarray, float, Callable[[np.ndarray], np.ndarray]]:
    """Return stamps for estimates, the end of the part that calibrates, and a function that selects judged stamps.

    Stamps [s] are by the sensors' clock: the truth's stamps while there are ranges, or QUERY_RATE without a truth.

    Raises:
        InputError: if hardly anything is left to judge.
    """
    ranges, truth = recording.ranges, recording.truth
    if truth is None or by is None:
        t = np.arange(ranges.t[0], ranges.t[-1], 1.0 / QUERY_RATE)
        first = float(t[0] + map_.calibration.share * (t[-1] - t[0]))
    else:
        t = truth.t - by.offset
        t, first = t[(t >= ranges.t[0]) & (t <= ranges.t[-1])], by.end - by.offset
    up = airborne(truth, by, map_)

    def judged(stamps: np.ndarray) -> np.ndarray:
        return up(stamps) & (stamps > first)

    left = t[judged(t)]
    if len(left) < 2 or left[-1] - left[0] < SHORTEST:
        raise InputError(f"{recording.name}: less than {SHORTEST:g} s of the recording is left to judge")
    return t, first, judged
