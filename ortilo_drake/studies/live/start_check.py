"""The live filter's settings, and the check of the first samples of the imu, and of the first ranges, against the map.

check_start: the medians of each anchor's first ranges, r_i, give a least-squares place of the antenna, which is
compared with the start's. The errors of this place are the anchors' biases and the ranges' own errors, by the map. The
start is doubted if the places are farther apart than both errors allow, by a chi-square of three, or farther than FAR;
but not if the ranges fit no place.
"""

from typing import Final

import numpy as np
import scipy  # not scipy.stats: that takes a second to import, and loads by itself when it is used
from scipy.optimize import least_squares

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.range_rows import NO_RANGES, Ranges
from ortilo_drake.interop.recorded.recording import Imu, Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.live.rates_watch import rest_doubts
from ortilo_drake.studies.recorded.filter_types import FilterSetup
from ortilo_drake.studies.recorded.imu_doubts import force_doubts, is_gravity
from ortilo_drake.studies.recorded.level_doubts import lean_warning, level_doubts
from ortilo_drake.studies.recorded.reacquired import FIRST_RANGES
from ortilo_drake.studies.recorded.readings import UNITS
from ortilo_drake.studies.recorded.setups import uncalibrated_setup
from ortilo_drake.studies.recorded.truth_path import modelled

FAR: Final = 0.3  # the first ranges may differ by so much from the ranges at the map's start [m]
RARE: Final = 5e-3  # share of right starts that are doubted
KNOWN: Final = 0.5  # a place by the ranges with a larger standard deviation is not told [m]


def settings_of(map_: Map, anchors: np.ndarray) -> FilterSetup:
    """Return the filter's settings by a map with anchors (n, 3), before any message has come."""
    return uncalibrated_setup(Recording("live", NO_RANGES, None, None, anchors, 0.0, 0.0, [], {}), map_, None)


def checked_force(imu: Imu, map_: Map) -> str:
    """Return a doubt about the force at the start, by a map; empty if there is none.

    InputError if the body begins upside down or turns at rest, or if the force is not even a flying vehicle's.
    """
    doubt = next(iter(force_doubts(imu, map_)), "")
    wrong = [doubt] if doubt and not is_gravity(imu) else []
    for said in wrong + level_doubts(imu, map_) + rest_doubts(imu, map_):
        raise InputError(said)
    return doubt or lean_warning(imu, map_)


def check_start(ranges: Ranges, antenna: np.ndarray, anchors: np.ndarray, map_: Map) -> str:
    """Return a doubt about the start, empty if there is none.

    Raises:
        InputError: if half of the anchors' first ranges are far from those at the start; it names a unit that fits.

    Args:
        ranges: from the start on.
        antenna: the antenna's place at the start (3).
        anchors: positions (n, 3).
        map_: the map, with start and noise.
    """
    assert map_.start is not None
    near, none = ranges.only(np.flatnonzero(ranges.t <= ranges.t[0] + FIRST_RANGES)), np.zeros(len(anchors))
    single = near.only(np.flatnonzero(near.other < 0))
    if map_.start.rests:  # differences are metres wrong on the floor
        near = single
    if not len(near.t):
        return ""
    first = near.only(np.unique(near.anchor, return_index=True)[1])
    expected = modelled(np.tile(antenna, (len(first.t), 1)), anchors, none, first)
    off, limit = np.median(np.abs(first.r - expected)), max(FAR, 3.0 * map_.start.position_sd)
    if off > limit:
        fits = [unit for unit, by in UNITS.items() if np.median(np.abs(by * first.r - expected)) <= limit]
        unit = f"; or are they in {fits[0]} (`scale: {UNITS[fits[0]]:g}`)?" if len(fits) == 1 else ""
        raise InputError(
            f"start: the first ranges are {off:.1f} m (median) from those of its position: is the vehicle there, "
            f"and is each anchor where the map has it? Mend them or its position_sd, or leave it out{unit}"
        )
    heard = np.unique(single.anchor)
    if len(heard) < 5:  # four anchors are too few to check the place
        return ""
    r, settings = np.array([np.median(single.r[single.anchor == i]) for i in heard]), map_.filter
    variance = settings.bias_start**2 + settings.range_white**2 + settings.range_correlated**2
    found = least_squares(lambda p: np.linalg.norm(p - anchors[heard], axis=1) - r, antenna)
    C = variance * np.linalg.pinv(found.jac.T @ found.jac)
    d = found.x - antenna
    if 2.0 * found.cost / variance > scipy.stats.chi2.isf(RARE, len(heard) - 3):
        return ""
    sd = np.sqrt(np.diag(C))
    rare = d @ np.linalg.solve(C + map_.start.position_sd**2 * np.eye(3), d) > scipy.stats.chi2.isf(RARE, 3)
    if not rare and (np.linalg.norm(d) < limit or sd.max() > KNOWN):
        return ""
    place, by, known = (", ".join(f"{one:.2f}" for one in part) for part in (found.x, d, sd))
    why = "more than it and the anchors' biases allow" if rare else "which the anchors' biases may make"
    return f"start: the first ranges put the antenna at ({place}) m, by ({by}) m off (sd {known}), {why}: is it right?"
