"""The live filter's settings, and the check of the imu's first samples against the map."""

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.range_rows import NO_RANGES
from ortilo_drake.interop.recorded.recording import Imu, Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.live.rates_watch import rest_doubts
from ortilo_drake.studies.recorded.filter_types import NO_AIDS, Setup
from ortilo_drake.studies.recorded.filtered import FilterSetup, levers_of, noise_of
from ortilo_drake.studies.recorded.imu_doubts import force_doubts, is_gravity
from ortilo_drake.studies.recorded.level_doubts import lean_warning, level_doubts
from ortilo_drake.studies.recorded.setups import uncalibrated_setup


def settings_of(map_: Map, anchors: np.ndarray) -> FilterSetup:
    """Return the filter's settings by a map with anchors (n, 3), before any message has come."""
    return uncalibrated_setup(Recording("live", NO_RANGES, None, None, anchors, 0.0, 0.0, [], {}), map_, None)


def setup_of(known: FilterSetup, map_: Map) -> Setup:
    """Return the settings that hold throughout a run of a filter with one tag, by a map."""
    aids = known.aids if map_.imu is not None else NO_AIDS
    noise = noise_of(map_.filter, map_.imu is not None)
    return Setup(known.anchors, levers_of(known, None), known.level, noise, aids)


def checked_force(imu: Imu, map_: Map) -> str:
    """Return a doubt about the force at the start, by a map; empty if there is none.

    InputError if the body begins upside down or turns at rest, or if the force is not even a flying vehicle's.
    """
    doubt = next(iter(force_doubts(imu, map_)), "")
    wrong = [doubt] if doubt and not is_gravity(imu) else []
    for said in wrong + level_doubts(imu, map_) + rest_doubts(imu, map_):
        raise InputError(said)
    return doubt or lean_warning(imu, map_)
