"""Compiling, or loading, all code that a live filter needs, before messages come."""

from contextlib import suppress
from typing import Final

import numpy as np

from ortilo_drake.interop.recorded.live_rows import Block
from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import GRAVITY, NO_AID_ROWS, Imu
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.live.live_filter import LiveFilter
from ortilo_drake.studies.live.stamped_estimate import estimate_at

LASTS: Final = 3.0  # duration of a made-up rest among the anchors [s]


def warm_up(map_: Map, anchors: np.ndarray) -> None:
    """Run a live filter over a made-up rest of LASTS seconds, by a map with anchors (n, 3), and discard the result."""
    t_r, t = np.arange(0.0, LASTS, 0.1), np.arange(0.0, LASTS, 0.02)
    n, place = len(anchors), anchors.mean(axis=0) + [0.3, 0.2, 0.1]
    r = np.linalg.norm(anchors - place, axis=1)
    ranges = single_ranges(np.repeat(t_r, n), np.tile(np.arange(n), len(t_r)), np.tile(r, len(t_r)))
    imu = None
    if map_.imu is not None:
        rates, force = np.zeros((len(t), 3)), np.tile([0.0, 0.0, GRAVITY], (len(t), 1))
        turned = None if map_.imu.orientation is None else np.tile(np.eye(3), (len(t), 1, 1))
        imu = Imu(t, rates, force, turned, None if map_.accelerometer is None else (t, force))
        map_ = map_.without_standstill()
    if map_.start is not None:
        map_ = map_.model_copy(update={"start": map_.start.model_copy(update={"position": tuple(place.tolist())})})
    with suppress(InputError):  # a map that contradicts the made-up rest compiles all the same
        for one in LiveFilter(map_, anchors).advance(LASTS, Block(ranges, imu, NO_AID_ROWS), ended=True):
            estimate_at(one.t, one.state, imu is not None)
